"""The curves of a session, computed by the library and laid out for drawing: degrees, because people read them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from api.channels import CHANNELS
from inhalemon.pipeline import estimate_tracks
from inhalemon.rotation import tilt_from_upright
from inhalemon.settings import Settings
from inhalemon.values import Recording


def table(recording: Recording, settings: Settings) -> NDArray[np.float32]:
    """The channels of `api.series.CHANNELS`, (channel, sample), at the body's samples and on its clock.

    Raises `RecordingError` and whatever the pipeline raises.
    """
    tracks = estimate_tracks(recording, settings)
    body = tracks.recording.body
    gyr_deg_s, acc_m_s2 = np.degrees(body.gyr_rad_s), body.acc_m_s2
    found = {
        "time_s": body.time_s,
        "tilt_deg": np.degrees(tilt_from_upright(tracks.body.q)),
        "tilt_sd_deg": np.degrees(tracks.body.sd_tilt_rad),
        "angle_deg": np.degrees(tracks.angle.angle_rad),
        "angle_sd_deg": np.degrees(tracks.angle.sd_rad),
        "off_axis_deg": np.degrees(tracks.angle.off_axis_rad),
        "gyr_x_deg_s": gyr_deg_s[:, 0],
        "gyr_y_deg_s": gyr_deg_s[:, 1],
        "gyr_z_deg_s": gyr_deg_s[:, 2],
        "gyr_norm_deg_s": np.linalg.norm(gyr_deg_s, axis=1),
        "acc_x_m_s2": acc_m_s2[:, 0],
        "acc_y_m_s2": acc_m_s2[:, 1],
        "acc_z_m_s2": acc_m_s2[:, 2],
        "acc_norm_m_s2": np.linalg.norm(acc_m_s2, axis=1),
        "r": tracks.body.r,
    }
    return np.stack([np.asarray(found[name], dtype=np.float32) for name in CHANNELS])
