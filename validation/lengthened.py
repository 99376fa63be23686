"""One simulated session at any length."""

from __future__ import annotations

import numpy as np

import inhalemon as im
from inhalemon.values import ImuTrack, Recording


def session_of(seconds: float, *, rate_hz: float = 100.0) -> Recording:
    """A simulated pMDI session lengthened by rest on the table to the length wanted."""
    recording, _ = im.simulate_session("pmdi", seed=7, rate_hz=rate_hz)
    return Recording(
        device=recording.device,
        body=_lengthened(recording.body, seconds),
        lever=_lengthened(recording.lever, seconds),
        session_id=f"simulated-{seconds:.0f}s",
    )


def _lengthened(track: ImuTrack, seconds: float) -> ImuTrack:
    """The track cut or repeated to `seconds`; each repetition is the same session again."""
    step = float(np.median(np.diff(track.time_s)))
    span = float(track.time_s[-1] - track.time_s[0]) + step
    times = int(np.ceil(seconds / span))
    time_s = np.concatenate([track.time_s + k * span for k in range(times)])
    kept = time_s - time_s[0] <= seconds
    return ImuTrack(
        time_s=time_s[kept],
        acc_m_s2=np.tile(track.acc_m_s2, (times, 1))[kept],
        gyr_rad_s=np.tile(track.gyr_rad_s, (times, 1))[kept],
    )
