"""Every number that may be tuned, one frozen dataclass a stage; `Settings` holds them all.

A field's name ends in its unit; its type says its range (`ranges.py`), which `SettingsError` holds to.
A settings file is TOML with one table a stage; what it leaves out keeps its default.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
import math
import tomllib
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Self

from inhalemon.exceptions import SettingsError
from inhalemon.ranges import Block, Checked, NotNegative, Range, Share, field_types
from inhalemon.values import STANDARD_GRAVITY_M_S2


class AttitudeMethod(StrEnum):
    AKF = "akf"
    AKF_SOURCE = "akf_source"
    EKF = "ekf"
    GYRO = "gyro"


@dataclass(frozen=True, slots=True)
class ClockSettings(Checked):
    """Two sensors, two clocks: how the offset and drift between them are sought."""

    # The coarse search: offsets beyond this are believed only when they agree better by `near_preference`.
    max_offset_s: float = 0.5
    near_preference: float = 0.2
    coarse_bin_s: Block = 0.02
    faint_rad_s: float = 0.1  # slower motion than this counts little
    chunk_s: float = 120.0  # the liveliest stretch, where drift cannot mislead yet
    peak_share: Share = 0.5  # other lags that agree half as well are tried too
    max_peaks: int = 8
    clear_share: Share = 0.001  # of the motion unexplained, and ...
    clear_agreed: float = 0.95  # ... of it within tolerance in a typical second: no other lag can be right
    # The fine fit.
    max_samples: Annotated[int, Range(100, 100_000)] = 1500
    min_samples: int = 50
    n_iterations: int = 12
    max_step_s: float = 0.03
    converged_s: float = 1e-4
    converged_rest: float = 3e-3  # biases (rad/s) and axes (rad)
    tukey: Annotated[float, Range(1.0, 1e3)] = 4.685  # 95 % efficient on Gaussian noise
    sd_noise_rad_s: float = 0.01
    # What is known before: crystals agree to some 50 ppm, chips' own oscillators worse; gyroscopes' scales to some 3 %;
    # the hinge axes are near x to some 10 degrees; biases reach some 15 deg/s where no rest tells them.
    sd_drift: float = 2e-4
    sd_bias_rad_s: float = 0.25
    sd_scale: float = 0.03
    sd_axis_rad: float = 0.17
    # What makes a fit believable: how sure, how much of the motion agrees, and how closely.
    sd_floor_s: float = 2e-4
    max_sd_offset_s: float = 0.004
    tolerance_rad_s: float = 0.05  # rates that differ by less agree ...
    tolerance_share: Share = 0.02  # ... and by less of themselves: crossed axes
    min_agreed: Share = 0.4  # half a period off, a fifth does; stamps that jitter by 1 ms take it down to a half
    max_share_left: float = 0.01
    max_share_noise: float = 0.25  # with the sensors' own noise, where motion is faint


@dataclass(frozen=True, slots=True)
class SensorSettings(Checked):
    """How the sensors' biases are found from the shut lever and from gravity, in a finished recording."""

    is_used: bool = True
    block_s: Block = 0.2
    max_gap_s: float = 0.05  # a block with a longer gap is left out
    min_common_s: float = 2.0  # of both sensors, and of the shut lever
    sd_gyr_rad_s: float = math.radians(0.3)  # of a block's mean: tremor, a soft lever
    sd_gyr_scale: float = 0.02  # of the rate: the sensors' scales
    sd_mounting_rad: float = math.radians(6.0)  # of one frame against the other, each axis
    sd_gyr_bias_rad_s: float = math.radians(1.0)  # what quiet stretches leave of it
    max_mounting_rad: float = math.radians(25.0)  # a larger turn about the hinge is a lever that is not shut
    min_across_rad_s: float = math.radians(15.0)  # slower turns across the hinge say nothing of the lever's angle
    max_hinge_rate_rad_s: float = math.radians(5.0)
    shut_band_rad: float = math.radians(5.0)  # a weak press is more
    quiet_s: Block = 0.5
    quiet_acc_m_s2: float = 0.15
    quiet_gyr_rad_s: float = math.radians(3.0)
    sd_acc_bias_m_s2: float = 0.3  # LSM9DS1 datasheet: 90 mg as three standard deviations
    sd_acc_m_s2: float = 0.2  # of one quiet stretch: scale and cross-axis errors, which do not average out


@dataclass(frozen=True, slots=True)
class AttitudeSettings(Checked):
    """How attitude is estimated from one sensor's rates and specific force.

    Numbers come from data sheets (MPU-9250, LSM9DS1) and from how hands move; none was fitted to one recording.
    """

    method: AttitudeMethod = AttitudeMethod.AKF
    smooth: bool = True  # use the whole recording for every sample; False: only what came before, as while recording
    is_adaptive: bool = True  # False: R stays `r_start_m2_s2` (for comparison)
    update_s: float = 0.12  # between corrections: drift is slow beside it, and 0.04 is hardly better on any recording

    # the sensor's errors
    gyr_delay_s: NotNegative = (
        0.002  # the gyro's low-pass is late: MPU-9250, 1 ms at 250 Hz, 2.9 ms at 184, 3.9 ms at 92
    )
    sd_delay_s: NotNegative = 0.001
    gyr_noise_rad_sqrt_s: float = math.radians(0.01)  # MPU-9250: 0.01 deg/s/sqrt(Hz)
    gyr_scale_error: float = 0.002  # noise that grows with the rate: nonlinear, and scales change, by so much ...
    gyr_scale_time_s: float = 0.3  # ... and a stroke of a hand lasts so long
    bias_walk_rad_s_sqrt_s: float = math.radians(0.01)
    acc_noise_m_s_sqrt_s: float = 0.01
    sd_acc_bias_m_s2: NotNegative = (
        0.3  # not seen by the filter, added to sd: 90 mg as three standard deviations, and mounting
    )

    # samples that cannot be trusted
    clip_rate_rad_s: float = math.radians(
        200.0
    )  # the same reading three times running, beyond this, is taken for clipped
    clip_acc_m_s2: float = 15.0
    gyr_saturated_rad_sqrt_s: float = math.radians(30.0)
    acc_saturated_m_s_sqrt_s: float = 3.0
    gap_s: float = 0.05  # steps longer than this are gaps: the rate between is unknown by `gap_rate_deg_s`
    gap_rate_rad_s: float = math.radians(60.0)
    gap_acc_m_s2: float = 2.0
    reset_gap_s: float = 1.0  # after a longer gap the tilt starts anew

    # the start
    start_s: float = 1.0  # while recording: so long the tilt is that of the mean specific force
    sd_start_tilt_rad: float = math.radians(40.0)
    sd_start_velocity_m_s: float = 1.0
    sd_start_bias_rad_s: float = math.radians(3.0)  # MPU-9250: +-5 deg/s, LSM9DS1: +-30; a rest is believed beyond it
    sd_start_scale: NotNegative = (
        0.005  # gyro scales and crossed axes: MPU-9250 3 % and 2 % at most, calibrated ones less
    )

    # the measurement "the velocity is zero, give or take R"
    window_s: float = 3.0
    r_factor_s: float = 2.0  # twice the time in which a hand's velocity forgets itself, 1 s
    r_floor_m2_s2: float = 0.01
    r_largest_m2_s2: float = 0.2  # a hand that is faster than 0.45 m/s turns back sooner: its reach is a metre
    r_start_m2_s2: float = 0.5  # before the window has seen anything, counted as `r_start_s` of it
    r_start_s: float = 2.0

    # rest, where the gyro reads its bias
    rest_rate_rad_s: float = math.radians(1.0)  # the largest deviation from the mean of a rest
    rest_acc_m_s2: float = 0.3
    rest_min_s: float = 0.5
    rest_bias_rad_sqrt_s: float = math.radians(0.05)
    rest_bias_gate_rad_s: float = math.radians(1.0)
    rest_r_m_sqrt_s: float = 0.02

    # the source's filter: noises of the MPU-9250's data sheet; it names no window
    source_gyr_noise_rad_s: float = math.radians(0.1)
    source_acc_noise_m_s2: float = 0.08
    source_window_n: int = 50


@dataclass(frozen=True, slots=True)
class LeverSettings(Checked):
    """How the lever's angle is found from two attitudes."""

    smooth: bool = True
    # The heading between the two rooms: a Kalman filter on blocks.
    block_s: Block = 0.2
    sd_hinge_rad: float = math.radians(0.5)  # of the hinge's direction between the attitudes, until the data tell
    sd_hinge_s: float = 0.6  # how much data that is worth
    scatter_window_s: float = 3.0  # the data that tell
    scatter_memory_s: float = 0.9  # such errors last: measured on real hinges in motion, 0.4-1.3 s
    still_pose_rad: float = math.radians(1.0)  # from block to block; such a pose's errors last for `axis_memory_s`
    sd_shut_first_rad: float = math.radians(30.0)  # of a device that is usually shut at first
    sd_heading_rate_rad_s: float = math.radians(0.5)  # what is left of the gyros' bias at the start
    heading_walk_rad_s: float = math.radians(0.014)  # per root of a second: two gyros, each as in its attitude
    min_shown: float = 0.03  # of 1: blocks in which the hinge is more upright than this say nothing
    max_surprise: float = 3.0  # standard deviations
    sd_acc_change_m_s2: NotNegative = (
        0.1  # an accelerometer's error that changes with attitude: scale and crossed axes, 1 %
    )
    # The hinge axes.
    sd_axis_rad: float = math.radians(3.0)  # how well the profile's axis is known before
    max_axis_sds: float = 3.0  # axes further from the profile's are not believed
    axis_memory_s: float = 4.0  # what biased accelerometers make of one pose lasts as long as the pose
    n_axis_fits: int = 3
    first_fit_blocks: int = 5  # while recording: the first fit, ...
    fit_again: float = 0.1  # ... and again whenever the recording is longer by this share
    # The shut lever.
    sd_alike_rad: float = math.radians(0.4)  # corrected sensors' tilts, one against the other, while shut
    max_zero_rad: float = math.radians(20.0)  # two parts mounted within 10 deg each
    sd_zero_rad: float = math.radians(7.0)  # when the shut lever was not seen
    max_shut_change_rad: float = math.radians(0.5)  # from block to block
    shut_width_rad: float = math.radians(2.0)
    min_shut_s: float = 0.6
    min_shut_share: Share = 0.1  # of the longest stay at one angle


@dataclass(frozen=True, slots=True)
class MotionSettings(Checked):
    """How the motion of the inhaler in the room is described."""

    long_gap_s: float = 0.1  # missing samples for longer than this are not bridged in silence
    block_s: Block = 0.04  # step of the velocity solution
    still_acc_m_s2: float = 0.25  # spread of the slow inertial acceleration in a hand that holds still
    still_gyr_rad_s: float = 0.12  # slow angular rate of a hand that holds still, 7 deg/s
    slow_s: Block = 0.2  # a mean over this takes away most of a tremor of 6-12 Hz; what is left is slow
    spread_s: Block = 0.4  # in which the slow acceleration spreads
    # The velocity solution: what a hand does, and what is known of it.
    sd_acc_m_s2: float = 0.15  # per block, what attitude and accelerometer get wrong from block to block
    sd_offset_m_s2: float = 0.4  # a level error of 1 deg and an offset of 30 mg
    offset_walk_m_s2_sqrt_s: float = 0.15  # how far that wanders within a second, as the inhaler turns
    sd_still_m_s: float = 0.015  # a hand that holds still
    hardly_still: float = 0.1  # activity at which that is twice as much
    sd_moving_m_s: float = 1.0  # a hand that does not


@dataclass(frozen=True, slots=True)
class ShakeSettings(Checked):
    """What counts as shaking."""

    stroke_m_s2: float = 0.6 * STANDARD_GRAVITY_M_S2
    sd_stroke_m_s2: float = (
        0.12 * STANDARD_GRAVITY_M_S2
    )  # of a half wave's height: where the sensor sits, peaks between samples
    min_sd_strokes: float = 0.1  # of a bout's count, however clear its strokes
    min_strokes: int = 4  # fewer are bumps
    min_stroke_s: float = 0.04  # a hand shakes below 10 Hz; a half wave lasts longer than this
    max_pause_s: float = 0.6  # between two strokes of one bout
    slow_s: float = 1.0  # motion slower than this is carrying


@dataclass(frozen=True, slots=True)
class EventSettings(Checked):
    """How strokes of the lever or cover are found."""

    smooth_s: float = 0.03
    min_stroke_rad: float = math.radians(1.5)  # of an uncalibrated lever: less is play or a bump
    max_press_rise_s: float = 1.5  # a slower change of the lever's angle is drift
    slow_rate_rad_s: float = math.radians(4.0)  # slower is drift
    max_pause_s: float = 0.06  # within one stroke
    min_release: float = 0.5  # of the stroke, that the lever comes back
    max_held_s: float = 3.0  # before the recording's end, without coming back
    gap_margin_s: float = 0.1  # before and after a gap the angle is not believed
    max_hesitation_s: float = 1.5  # of a cover on its way
    settling_s: float = 0.6  # of a cover that springs back from its end stop
    min_spring_back_rad: float = math.radians(1.0)
    gap_blur_rad_s: float = math.radians(20.0)  # of a gap in the samples, that may show in the angle
    turn_blur: float = 0.05  # of a turn of the whole device, that may show in the angle


@dataclass(frozen=True, slots=True)
class PhaseSettings(Checked):
    """How the session is cut into phases."""

    window_s: float = 0.2
    n_clusters: int = 8
    # Holding still.
    smooth_s: tuple[float, ...] = (0.1, 0.3)  # as little as shows the hand still: it walks, or sits in a car
    min_still_share: Share = 0.25  # of the time in the hand
    still_speed: float = 0.7  # clear movements a second: 7 deg/s, 3.5 cm/s
    times_sway: float = 2.0  # the speed of a hand in the stillest quarter of its time
    max_still_speed: float = 1.5
    min_hold_s: float = 0.08
    bridged_s: float = 0.05  # a shorter start in the midst of stillness is none
    near_hold: float = 0.2  # of a clear movement from the hold, and ...
    far_from_hold: float = 0.6  # ... so much: where a movement is seen; it began before
    near_middle: float = 0.25  # in place of `near_hold` from the hold's middle: it may have wandered since, ...
    wandering_s: float = 0.15  # ... and is taken for where it was so long before that
    setting_off_s: float = 0.5  # the first of a movement, slow as sway
    max_disturbance_s: float = 0.8  # a press shakes the hand for less
    same_place: float = 0.4  # of a clear movement
    beside_s: float = 0.1  # before and after a disturbance, where it was
    clear_turn_rad: float = math.radians(10.0)
    clear_move_m: float = 0.05
    # Lying on a table: below a hand's tremor, above the sensors' noise.
    table_window_s: Block = 0.5
    noise_smooth_s: float = 0.04
    noise_left: float = 0.6  # of the variance that smoothing takes away, more where samples are bridged
    table_acc_m_s2: float = 0.04
    table_gyr_rad_s: float = 0.0032
    min_table_s: float = 0.6
    letting_go_s: float = 0.8  # a hand that has put something down lets go within this
    table_unrest: float = 16.0  # in squares of the two limits together: more is a hand or a bump
    max_put_down_s: float = 3.0
    # At the mouth.
    min_tilt_back_rad: float = math.radians(6.0)
    max_tilt_back_rad: float = math.radians(50.0)  # no head goes farther
    usual_tilt_back_rad: float = math.radians(12.0)
    max_tilt_back_s: float = 2.0
    at_mouth_m: float = 0.12  # the tilt-back itself carries the device so far at most
    carried_m_s: float = 0.15  # where a tilt-back begins, the device is hardly carried any more
    min_stay_s: float = 0.3
    mouth_way_m: float = 0.12  # the way to the mouth is longer, for a child too
    lowered_m: float = 0.03
    min_lift_m: float = 0.12  # of a stay without a tilt
    raised_m: float = 0.03  # of one with a press, out of a hold in the hand
    leaving_s: float = 8.0  # a breath may be held with the device at the mouth
    pause_speed: float = 0.3  # clear movements a second
    settling_s: float = 0.6  # a hand settles within this
    min_likeness: float = 0.55
    one_trait: float = 0.25  # of likeness, as each of the four traits adds
    min_untilted_stay_s: float = 0.7
    fidget: float = 0.7  # clear movements: less ends neither a pause nor a held breath
    min_lift_share: Share = 0.5  # of the lift to the inhalation
    max_aside_rad: float = math.radians(45.0)  # a face, and the heading that drifts, turn no farther between two visits
    away_m: float = 0.10  # farther from the mouth than this, the device has left it, and than what the head carries it
    mouth_sway_m: float = 0.06
    waiting_m: float = 0.04  # how far the device sways and seems to drift while it waits for the tilt-back
    head_arm_m: float = 0.2  # from neck to mouth
    max_breath_s: float = 1.5
    fall_m: float = 0.03  # the hand sinks at least so much as the breath is let out
    max_fall_m: float = 0.2
    # The path over labels: costs in windows' worth of evidence.
    cost_unlike: float = 3.0  # of a label where nothing speaks for it
    cost_unlike_cluster: float = 1.0  # of shaking in a still cluster, of rest in one that moves
    cost_restless_pause: float = 0.5  # of a pause in a cluster that moves: a child's hand
    cost_handling: float = 1.2  # anywhere; less than a label without evidence, more than half of one
    cost_change: float = 1.0  # from one label to another
    cost_skip: float = 0.3  # for each step of the device that is left out
    cost_back: float = 2.0  # for going back in the device's order
    refine_s: float = 0.4  # two windows: so far a boundary moves to where its evidence changes


@dataclass(frozen=True, slots=True)
class QualitySettings(Checked):
    """From where on a recording is doubtful, and from where on it cannot be used."""

    min_gap_s: float = 0.05  # fixed by the recording format
    max_gap_share: Share = 0.3  # of the session missing; beyond, unusable
    max_gyr_saturated_share: Share = 0.2
    max_acc_saturated_share: Share = 0.5
    rate_block: int = 50  # samples whose median step is compared
    max_rate_change: float = 0.1
    max_stuck_share: Share = 0.9
    # Rest: two blocks in a row below both deviations, per axis; within `end_s` of the session's start or end.
    rest_block_s: Block = 0.25
    max_rest_sd_rad_s: float = 0.0175  # 1 deg/s
    max_rest_sd_m_s2: float = 0.3
    end_s: float = 3.0
    max_gravity_excess_m_s2: float = 0.5  # datasheets allow 60-90 mg of offset an axis
    unusable_gravity_excess_m_s2: float = 4.9  # half of g: the unit must be wrong
    max_clock_offset_s: float = 0.01
    max_clock_drift_s: float = 0.005  # what drift adds up to over the session
    min_common_share: Share = 0.9
    unusable_common_share: Share = 0.5
    max_axis_rad: float = 0.175  # the format promises frames to within 10 degrees
    max_off_axis_rad: float = 0.175
    max_angle_sd_rad: float = 0.35  # 20 degrees: no stroke of a lever can be told
    # The gyroscope's unit, from how far gravity turns between the blocks of `rest_block_s`.
    max_turn_excess_m_s2: float = 1.0  # specific force farther from g is more than gravity
    min_turn_blocks: int = 20
    min_turn_rad: float = 0.1  # root of the sum of squares: a session that hardly turns says nothing
    min_turn_agreed: float = 0.4  # correlation of the turn seen with the one told
    max_gyr_scale: float = 7.5  # either way: rad/s and deg/s are 57 apart, and this is the root
    # A lever or cover on the wrong side of shut.
    stroke_block_s: Block = 0.1  # three in a row: shorter than any press, longer than what a gap in a shake does
    min_backwards_rad: float = 0.087  # 5 degrees, a full press
    backwards_share: Share = 0.33  # so much of it to the right side, and the sign may be right


@dataclass(frozen=True, slots=True)
class MeasureSettings(Checked):
    """How sure the measures are: standard deviations of single boundaries and angles, found on simulated sessions."""

    sd_press_s: float = 0.012
    sd_inhalation_start_s: float = 0.015
    sd_onset_carried_s: float = 0.3  # where the tilt-back seems to begin on the way to the mouth
    carried_m_s: float = 0.15
    sd_inhalation_end_s: float = 0.033
    sd_exhale_pause_s: float = 0.09
    sd_breath_hold_s: float = 0.05  # where a movement shows the breath let out
    sd_breath_unseen_s: float = 0.2  # where only the next movement ends it
    max_removal_s: float = 1.4  # of the device from the mouth, in one movement
    sd_shake_s: float = 0.06
    sd_inverted_s: float = 0.0145
    sd_cover_stop_s: float = 0.02
    sd_press_angle_deg: float = 0.3
    sd_cover_angle_deg: float = 1.25
    sd_cover_shut_deg: float = 0.8
    sd_mount_rad: float = math.radians(1.5)  # of the sensor against the part, unknown to the filter
    left_mouth_m: float = 0.05
    min_still_share: Share = 0.2  # of the time in the hand: a hand that is stiller shows what it did not do
    max_gap_s: float = 0.5  # a longer gap within a measure's stretch leaves it without a value
    max_gap_share: Share = 0.25  # of the stretch


@dataclass(frozen=True)  # without slots, so that the digest is worked out once
class Settings(Checked):
    """All settings of the pipeline; frozen, hashable, the same digest for the same numbers."""

    clocks: ClockSettings = field(default_factory=ClockSettings)
    sensors: SensorSettings = field(default_factory=SensorSettings)
    attitude: AttitudeSettings = field(default_factory=AttitudeSettings)
    lever: LeverSettings = field(default_factory=LeverSettings)
    motion: MotionSettings = field(default_factory=MotionSettings)
    shakes: ShakeSettings = field(default_factory=ShakeSettings)
    events: EventSettings = field(default_factory=EventSettings)
    phases: PhaseSettings = field(default_factory=PhaseSettings)
    measures: MeasureSettings = field(default_factory=MeasureSettings)
    quality: QualitySettings = field(default_factory=QualitySettings)

    @classmethod
    def causal(cls) -> Self:
        """Settings that use the past only, as while recording; the two clocks alone are compared over the whole."""
        return cls(
            sensors=SensorSettings(is_used=False),
            attitude=AttitudeSettings(smooth=False),
            lever=LeverSettings(smooth=False),
        )

    @classmethod
    def from_toml(cls, source: str | Path) -> Self:
        """Settings from a TOML file (a path) or TOML text (a string with a newline or `=`).

        Raises `SettingsError` naming the table, the field, what was found and what was wanted.
        """
        is_text = isinstance(source, str) and ("\n" in source or "=" in source)
        where = "settings" if is_text else str(source)
        try:
            text = str(source) if is_text else Path(source).read_text(encoding="utf-8")
            return cls.from_mapping(tomllib.loads(text), where=where)
        except (OSError, ValueError, RecursionError) as error:  # not there, not text, not TOML, or nested without end
            raise SettingsError(f"{where}: {error}. Give a readable TOML file") from error

    @classmethod
    def from_mapping(cls, tables: dict[str, object], *, where: str = "settings") -> Self:
        """Settings from nested mappings, one a stage. Raises `SettingsError`."""
        stages = field_types(cls)  # type: ignore[arg-type]  # a class can be hashed
        given: dict[str, Any] = {}
        for name, table in tables.items():
            if name not in stages:
                raise SettingsError(f"{where}: [{name}] is unknown; expected one of {', '.join(stages)}")
            if not isinstance(table, dict):
                raise SettingsError(f"{where}: {name} is {table!r}; expected a table [{name}]")
            given[name] = _stage_from_mapping(stages[name], table, f"{where} [{name}]")
        return cls(**given)

    @functools.cached_property
    def digest(self) -> str:
        """SHA-256 of the settings' canonical JSON: equal numbers, equal digest."""
        canonical = json.dumps(dataclasses.asdict(self), sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(canonical.encode()).hexdigest()


def _stage_from_mapping(stage: type, table: dict[str, object], where: str) -> object:
    names = field_types(stage)
    for name in table:
        if name not in names:
            raise SettingsError(f"{where}: {name} is unknown; expected one of {', '.join(names)}")
    try:
        return stage(**table)
    except SettingsError as error:
        raise SettingsError(f"{where}: {error}") from error
