"""What is doubtful about a recording, and whether attitude and angle can be trusted at all."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from inhalemon.rotation import components
from inhalemon.settings import QualitySettings
from inhalemon.signals import lengths, quantile
from inhalemon.values import (
    STANDARD_GRAVITY_M_S2,
    BoolArray,
    Calibration,
    ClockFit,
    Flag,
    FloatArray,
    ImuTrack,
    LeverTrack,
    Quality,
    Recording,
    SensorName,
)

_BLOCKS_A_STROKE = 3
_Doubt = tuple[Flag, bool]  # and whether it makes the recording unusable


def assess_quality(
    recording: Recording,
    clock: ClockFit,
    settings: QualitySettings,
    *,
    calibration: Calibration | None = None,
    lever: LeverTrack | None = None,
    hinge_axis: FloatArray | None = None,
    has_shut_state: bool = False,
) -> Quality:
    """The flags of a recording, and whether it is usable: nothing is refused here, and nothing passed in silence.

    `recording` has the lever on the body's clock, as `clock` says. What later stages found may be given: the
    calibration (with `hinge_axis` (3,), where the device profile says the hinge is) and the lever's track (with whether
    its zero is a shut lever, from which it goes one way only).
    `usable` is false when attitude or angle cannot be trusted for much of the session: a gyroscope saturated or in
    another unit, samples missing, no time in common, a sensor whose numbers stand still, gravity off by half, an angle
    that is not known or has the wrong sign.
    """
    doubts: list[_Doubt] = []
    for name, track in ((SensorName.BODY, recording.body), (SensorName.LEVER, recording.lever)):
        doubts += _gaps(name, track, settings)
        doubts += _saturation(name, track, settings)
        doubts += _rate(name, track, settings)
        doubts += _stuck(name, track, settings)
        doubts += _rest_and_gravity(name, track, settings)
    doubts += _clocks(recording, clock, settings)
    if calibration is not None and hinge_axis is not None:
        doubts += _hinge(calibration, hinge_axis, settings)
    if lever is not None:
        doubts += _angle(lever, settings)
        doubts += _backwards(lever, settings) if has_shut_state else ()
    return Quality(usable=not any(is_fatal for _, is_fatal in doubts), flags=tuple(flag for flag, _ in doubts))


def _gaps(name: SensorName, track: ImuTrack, settings: QualitySettings) -> Iterator[_Doubt]:
    steps = np.diff(track.time_s)
    usual = track.usual_step_s
    # At 25 Hz one step is 40 ms: jitter alone must not make it a gap.
    is_gap = steps > max(settings.min_gap_s, 1.5 * usual)
    if is_gap.any():
        missing_s = float(np.sum(steps[is_gap] - usual))
        share = missing_s / float(track.time_s[-1] - track.time_s[0])
        at = int(np.argmax(steps))
        n_gaps = int(np.count_nonzero(is_gap))
        detail = (
            f"{_counted(n_gaps, 'gap')} over {1e3 * settings.min_gap_s:.0f} ms, {missing_s:.2f} s in all; "
            f"the longest {steps[at]:.2f} s at {track.time_s[at]:.2f} s"
        )
        yield Flag("gap", name, detail), share > settings.max_gap_share


def _saturation(name: SensorName, track: ImuTrack, settings: QualitySettings) -> Iterator[_Doubt]:
    checks = (
        ("gyr_saturated", track.is_gyr_saturated, settings.max_gyr_saturated_share),
        ("acc_saturated", track.is_acc_saturated, settings.max_acc_saturated_share),
    )
    for code, is_saturated, most in checks:
        if is_saturated is not None and is_saturated.any():
            count = int(np.count_nonzero(is_saturated))
            first_s = float(track.time_s[np.argmax(is_saturated)])
            share = count / track.n_samples
            detail = f"{_counted(count, 'sample')} at the range's end ({100 * share:.1f} %), from {first_s:.2f} s on"
            yield Flag(code, name, detail), share > most


def _rate(name: SensorName, track: ImuTrack, settings: QualitySettings) -> Iterator[_Doubt]:
    steps = np.diff(track.time_s)
    n_block = settings.rate_block
    if steps.size < 2 * n_block:
        return
    medians = quantile(steps[: steps.size // n_block * n_block].reshape(-1, n_block).T, 0.5)
    usual = track.usual_step_s
    is_other = np.abs(medians / usual - 1.0) > settings.max_rate_change
    if is_other.any():
        other = medians[np.argmax(np.abs(medians / usual - 1.0))]
        at_s = float(track.time_s[int(np.argmax(is_other)) * n_block])
        detail = f"mostly {1 / usual:.1f} Hz, from {at_s:.2f} s on {1 / other:.1f} Hz for a while"
        yield Flag("rate_changed", name, detail), False


def _stuck(name: SensorName, track: ImuTrack, settings: QualitySettings) -> Iterator[_Doubt]:
    """A live sensor's noise never lets the same numbers stand for long."""
    for quantity, values in (("accelerometer", track.acc_m_s2), ("gyroscope", track.gyr_rad_s)):
        x, y, z = components(values)
        is_same = (x[1:] == x[:-1]) & (y[1:] == y[:-1]) & (z[1:] == z[:-1])
        share = float(np.mean(is_same))
        if share > settings.max_stuck_share:
            detail = f"the {quantity}'s numbers do not change in {100 * share:.0f} % of the session"
            yield Flag("stuck", name, detail), True


def _rest_and_gravity(name: SensorName, track: ImuTrack, settings: QualitySettings) -> Iterator[_Doubt]:
    n_block = max(4, round(settings.rest_block_s * track.rate_hz))
    n_blocks = track.n_samples // n_block
    if n_blocks < 2:
        return
    gyr, acc, is_still = _blocks(track, n_block, n_blocks, settings)
    yield from _gyr_scale(name, gyr, acc, n_block / track.rate_hz, settings)
    rests = is_still[1:] & is_still[:-1]  # two blocks in a row
    if name is SensorName.BODY:
        n_end = max(1, round(settings.end_s / settings.rest_block_s))
        if not rests[:n_end].any():
            yield Flag("no_rest_at_start", name, f"not still within the first {settings.end_s:g} s"), False
        if not rests[-n_end:].any():
            yield Flag("no_rest_at_end", name, f"not still within the last {settings.end_s:g} s"), False
    if rests.any():
        found = float(quantile(lengths(acc)[1:][rests], 0.5))
        excess = abs(found - STANDARD_GRAVITY_M_S2)
        if excess > settings.max_gravity_excess_m_s2:
            detail = f"{found:.2f} m/s2 when still; expected {STANDARD_GRAVITY_M_S2:.2f}"
            yield Flag("gravity_off", name, detail), excess > settings.unusable_gravity_excess_m_s2


def _blocks(
    track: ImuTrack, n_block: int, n_blocks: int, settings: QualitySettings
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """The mean angular rate and specific force (m, 3) of each block, and whether it is still."""
    means, variances = [], []
    share = np.full(n_block, 1.0 / n_block)
    for values in (track.gyr_rad_s, track.acc_m_s2):
        blocks = values[: n_blocks * n_block].reshape(n_blocks, n_block, 3)
        mean = share @ blocks
        means.append(mean)
        variances.append((share @ (blocks * blocks) - mean * mean).max(axis=1))
    is_still = (variances[0] < settings.max_rest_sd_rad_s**2) & (variances[1] < settings.max_rest_sd_m_s2**2)
    return means[0], means[1], is_still


def _gyr_scale(
    name: SensorName, gyr: FloatArray, acc: FloatArray, block_s: float, settings: QualitySettings
) -> Iterator[_Doubt]:
    """Gravity turns in the sensor's frame as its gyroscope says; a wrong unit is 57 times off.

    From block to block, where the specific force is about gravity. The scale is regressed both ways, so that other
    accelerations make it look nearer to one.
    """
    is_near = np.abs(lengths(acc) - STANDARD_GRAVITY_M_S2) < settings.max_turn_excess_m_s2
    pairs = is_near[1:] & is_near[:-1]
    if np.count_nonzero(pairs) < settings.min_turn_blocks:
        return
    rate = 0.5 * (gyr[1:] + gyr[:-1])[pairs] - quantile(gyr, 0.5)
    before, after = (part[pairs] / lengths(part[pairs])[:, None] for part in (acc[:-1], acc[1:]))
    seen, told = after - before, block_s * np.cross(0.5 * (before + after), rate)
    seen2, told2, both = float(np.sum(seen * seen)), float(np.sum(told * told)), float(np.sum(seen * told))
    is_clear = seen2 > settings.min_turn_rad**2 and both > settings.min_turn_agreed * np.sqrt(seen2 * told2)
    if not is_clear:
        return
    scale = both / told2 if told2 < seen2 else seen2 / both
    if not 1.0 / settings.max_gyr_scale < scale < settings.max_gyr_scale:
        detail = f"gravity turns {scale:.2g} times as far as the gyroscope says; is it in deg/s or rad/s, as labelled?"
        yield Flag("gyr_scale_odd", name, detail), True


def _clocks(recording: Recording, clock: ClockFit, settings: QualitySettings) -> Iterator[_Doubt]:
    body_s, lever_s = recording.body.time_s, recording.lever.time_s
    if not clock.is_found:
        detail = "too little motion in common to compare the clocks; they are taken as they are"
        is_moved = clock.offset_s != 0.0
        if is_moved:
            detail = "the clocks have no time in common, nor enough motion to bring them together"
        yield Flag("clock_unknown", SensorName.LEVER, detail), is_moved
    elif abs(clock.offset_s) > settings.max_clock_offset_s:
        shown = f"{1e3 * clock.offset_s:+.1f} ms (sd {1e3 * clock.sd_offset_s:.1f})"
        yield Flag("clock_offset", SensorName.LEVER, f"its clock was corrected by {shown}"), False
    length_s = float(lever_s[-1] - lever_s[0])
    is_drifting = abs(clock.drift) > 3 * clock.sd_drift and abs(clock.drift) * length_s > settings.max_clock_drift_s
    if clock.is_found and is_drifting:
        shown = f"{1e6 * clock.drift:+.0f} ppm (sd {1e6 * clock.sd_drift:.0f})"
        yield Flag("clock_drift", SensorName.LEVER, f"its clock was corrected by {shown}"), False
    shared_s = float(min(body_s[-1], lever_s[-1]) - max(body_s[0], lever_s[0]))
    share = shared_s / float(body_s[-1] - body_s[0])
    if share < settings.min_common_share:
        detail = f"{max(shared_s, 0.0):.1f} s of {body_s[-1] - body_s[0]:.1f} s in common with the body"
        yield Flag("short_overlap", SensorName.LEVER, detail), share < settings.unusable_common_share


def _hinge(calibration: Calibration, hinge_axis: FloatArray, settings: QualitySettings) -> Iterator[_Doubt]:
    expected = np.asarray(hinge_axis, dtype=np.float64)
    found = calibration.axis_body[-1]
    cosine = float(found @ expected / (np.linalg.norm(found) * np.linalg.norm(expected)))
    away_rad = float(np.arccos(np.clip(cosine, -1.0, 1.0)))
    if away_rad > settings.max_axis_rad:
        detail = f"{np.degrees(away_rad):.0f} deg from where the device has its hinge; was a sensor mounted askew?"
        yield Flag("hinge_axis_off", SensorName.BODY, detail), False


def _angle(lever: LeverTrack, settings: QualitySettings) -> Iterator[_Doubt]:
    off_axis_rad = float(quantile(np.abs(lever.off_axis_rad), 0.5))
    if off_axis_rad > settings.max_off_axis_rad:
        detail = f"the two parts turn {np.degrees(off_axis_rad):.0f} deg in a way that a hinge cannot"
        yield Flag("off_axis", SensorName.LEVER, detail), False
    sd_rad = float(quantile(lever.sd_rad, 0.5))
    if not sd_rad <= settings.max_angle_sd_rad:
        detail = f"standard deviation of the angle {np.degrees(sd_rad):.0f} deg over most of the session"
        yield Flag("angle_unsure", SensorName.LEVER, detail), True


def _backwards(lever: LeverTrack, settings: QualitySettings) -> Iterator[_Doubt]:
    """A shut lever (cover) goes to one side only; an angle that goes to the other one alone has the wrong sign."""
    n = lever.time_s.size
    length_s = float(lever.time_s[-1] - lever.time_s[0])
    n_block = max(1, round(settings.stroke_block_s * (n - 1) / max(length_s, settings.stroke_block_s)))
    n_blocks = n // n_block
    if n_blocks < _BLOCKS_A_STROKE:
        return
    angle, surely = (
        values[: n_blocks * n_block].reshape(n_blocks, n_block).mean(axis=1)
        for values in (lever.angle_rad, lever.angle_rad + 3.0 * lever.sd_rad)
    )
    # What is kept for a few blocks in a row: a bump or a gap while shaking is shorter.
    farthest_rad = float(sliding_window_view(angle, _BLOCKS_A_STROKE).min(axis=1).max())
    lowest_rad = float(sliding_window_view(surely, _BLOCKS_A_STROKE).max(axis=1).min())
    if lowest_rad < -settings.min_backwards_rad and farthest_rad < -settings.backwards_share * lowest_rad:
        detail = (
            f"it goes {-np.degrees(lowest_rad):.0f} deg to the wrong side of shut; "
            "are the sensors swapped, or is the profile's hinge_sign wrong?"
        )
        yield Flag("lever_backwards", SensorName.LEVER, detail), True


def _counted(n: int, noun: str) -> str:
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"
