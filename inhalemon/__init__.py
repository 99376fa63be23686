"""inhalemon: how an inhaler was used, from two small inertial sensors.

The public names are loaded when they are first asked for, so that `inhalemon --help` stays quick.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

__version__ = "0.1.0"

_HOME = {
    "ImuTrack": "inhalemon.values",
    "Recording": "inhalemon.values",
    "AttitudeTrack": "inhalemon.values",
    "LeverTrack": "inhalemon.values",
    "Report": "inhalemon.values",
    "Settings": "inhalemon.settings",
    "AttitudeSettings": "inhalemon.settings",
    "estimate_attitude": "inhalemon.stages.attitude",
    "track_lever": "inhalemon.pipeline",
    "estimate_tracks": "inhalemon.pipeline",
    "score_recording": "inhalemon.pipeline",
    "InhalemonError": "inhalemon.exceptions",
    "RecordingError": "inhalemon.exceptions",
    "read_recording": "inhalemon.recording",
    "read_recording_bytes": "inhalemon.recording",
    "write_recording": "inhalemon.recording",
    "Truth": "inhalemon.simulate",
    "simulate_session": "inhalemon.simulate",
}

__all__ = ["__version__", *_HOME]

if TYPE_CHECKING:
    from inhalemon.exceptions import InhalemonError, RecordingError
    from inhalemon.pipeline import estimate_tracks, score_recording, track_lever
    from inhalemon.recording import read_recording, read_recording_bytes, write_recording
    from inhalemon.settings import AttitudeSettings, Settings
    from inhalemon.simulate import Truth, simulate_session
    from inhalemon.stages.attitude import estimate_attitude
    from inhalemon.values import AttitudeTrack, ImuTrack, LeverTrack, Recording, Report


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'inhalemon' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
