"""Small helpers on sampled signals that several stages share."""

from __future__ import annotations

import numpy as np

from inhalemon.rotation import slerp
from inhalemon.values import AttitudeTrack, FloatArray


def resample_attitude(track: AttitudeTrack, time_s: FloatArray) -> AttitudeTrack:
    """The attitude at other times, by the shortest turn between the two samples around each; held beyond the ends."""
    after = np.clip(np.searchsorted(track.time_s, time_s, side="right"), 1, track.time_s.size - 1)
    before = after - 1
    step = track.time_s[after] - track.time_s[before]
    share = np.clip((time_s - track.time_s[before]) / step, 0.0, 1.0)
    bias = [np.interp(time_s, track.time_s, column) for column in track.gyr_bias_rad_s.T]
    return AttitudeTrack(
        time_s=time_s,
        q=slerp(track.q[before], track.q[after], share),
        sd_tilt_rad=np.interp(time_s, track.time_s, track.sd_tilt_rad),
        gyr_bias_rad_s=np.stack(bias, axis=-1),
        r=np.interp(time_s, track.time_s, track.r),
        r_unit=track.r_unit,
    )
