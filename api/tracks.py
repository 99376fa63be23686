"""The curves of a session, as the library draws them, laid out for one time axis."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from api.channels import CHANNELS
from inhalemon.pipeline import estimate_tracks
from inhalemon.report.curves import channels
from inhalemon.settings import Settings
from inhalemon.values import Recording


def table(recording: Recording, settings: Settings) -> NDArray[np.float32]:
    """The channels of `api.channels`, (channel, sample), at the body's samples and on its clock; those of the lever or
    cover between its own samples.

    Raises `RecordingError` and whatever the pipeline raises.
    """
    tracks = estimate_tracks(recording, settings)
    time_s = tracks.recording.body.time_s
    found = channels(tracks)
    rows = [time_s, *(np.interp(time_s, *found[name], left=np.nan, right=np.nan) for name in CHANNELS[1:])]
    return np.stack([np.asarray(row, dtype=np.float32) for row in rows])
