"""The lever's angle about its hinge, from the attitudes of body and lever."""

from __future__ import annotations

import numpy as np

from inhalemon.rotation import conjugate, multiply, split_twist, turned_about_z, up_in
from inhalemon.values import AttitudeTrack, Calibration, LeverTrack


def lever_angle(
    body: AttitudeTrack, lever: AttitudeTrack, calibration: Calibration, *, sd_delay_s: float = 0.0
) -> LeverTrack:
    """Angle of the lever about its hinge, 0 when shut, positive when it opens; continuous through half a turn.

    Both attitudes are at the same times, and `calibration` was made from them. The relative rotation
    body* (x) heading (x) lever is split into twist about the hinge and the rest. A hinge cannot make the rest, so it is
    returned as `off_axis_rad`, the measurement's own error.

    The standard deviation follows from those of the tilt of both parts, of the heading, of the zero and of the samples'
    time (`sd_delay_s`): an error of heading enters by the upright part of the hinge axis, one of tilt by the level
    part. What the hinge has shown of the tilts replaces what the attitudes claim, in so far as it is less. Tilts that
    err alike while the lever is shut do so in their own frames, and the less the further it opens.

    Source of the split: Dobrowolski (2015), arXiv:1506.05481.
    """
    q_lever = turned_about_z(calibration.heading_rad, lever.q)
    q_body_lever = multiply(conjugate(body.q), q_lever)
    q_opened = multiply(q_body_lever, conjugate(calibration.q_shut))
    twist, off_axis = split_twist(q_opened, calibration.axis_body)

    upright = np.einsum("ij,ij->i", up_in(body.q), calibration.axis_body) ** 2
    claimed = body.sd_tilt_rad**2 + lever.sd_tilt_rad**2
    # A loose hinge shows more than the tilts err.
    tilt = np.minimum(claimed, calibration.tilt_unseen * claimed + calibration.tilt_shown_rad2)
    if calibration.sd_alike_rad is not None:
        tilt = 2.0 * np.sin(twist / 2.0) ** 2 * tilt + calibration.sd_alike_rad**2
    turns = np.round(np.diff(twist, prepend=twist[:1]) / (2.0 * np.pi))
    angle = twist - 2.0 * np.pi * np.cumsum(turns)
    late = sd_delay_s * np.gradient(angle, body.time_s)
    variance = upright * calibration.sd_heading_rad**2 + (1.0 - upright) * tilt + calibration.sd_shut_rad**2 + late**2
    return LeverTrack(time_s=body.time_s, angle_rad=angle, sd_rad=np.sqrt(variance), off_axis_rad=off_axis)
