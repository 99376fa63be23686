"""Attitude on BROAD (optical truth) beside VQF, offlineVQF and imufusion in the same run, and on simulated sessions.

The error of a sample is the inclination part of (estimate x truth*); a trial's number is its RMSE over the `movement`
samples, in degrees. BROAD's truth runs ahead of its sensors: every filter gets better when it is taken 0.7 samples
(2.45 ms) late, so each table says which of the two it shows, the same for every filter.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import imufusion
import numpy as np
from vqf import VQF, offlineVQF

import inhalemon as im
from inhalemon.rotation import conjugate, multiply, slerp
from inhalemon.settings import AttitudeSettings
from inhalemon.values import FloatArray, ImuTrack, PhaseKind
from validation.tables import Table, Target

DATA = Path(__file__).resolve().parents[1].parent / "shared" / "data" / "broad"
LATE_S = 0.7 / (2000 / 7)
G_M_S2 = 9.80665
CAUSAL, SMOOTH = AttitudeSettings(smooth=False), AttitudeSettings(smooth=True)

Mask = np.ndarray[tuple[int], np.dtype[np.bool_]]


@dataclass(frozen=True)
class Trial:
    """One recording with its truth; `is_used` marks movement with truth."""

    name: str
    track: ImuTrack
    q_true: FloatArray
    is_used: Mask


def load_trials(data: Path = DATA) -> list[Trial]:
    trials = []
    for path in sorted(data.glob("*.npz")):
        content = np.load(path)
        time_s = np.arange(len(content["gyr"])) / float(content["rate_hz"])
        track = ImuTrack(time_s, content["acc"].astype(np.float64), content["gyr"].astype(np.float64))
        q_true = content["opt_quat"].astype(np.float64)
        trials.append(Trial(path.stem[:2], track, q_true, content["movement"] & ~np.isnan(q_true).any(axis=1)))
    return trials


def rmse_deg(trial: Trial, q: FloatArray, *, late_s: float = 0.0) -> float:
    """RMSE of inclination; `late_s` takes the truth of that much earlier for each sample."""
    q_true, used = trial.q_true, trial.is_used
    if late_s:
        shift = late_s * trial.track.rate_hz
        whole = int(shift)
        before, after = np.roll(q_true, whole + 1, axis=0), np.roll(q_true, whole, axis=0)
        q_true = slerp(after, before, np.full(len(q), shift - whole))
        used = used & np.roll(trial.is_used, whole + 1) & np.roll(trial.is_used, whole)
        used[: whole + 1] = False
    return float(np.degrees(np.sqrt(np.mean(inclination_rad(q[used], q_true[used]) ** 2))))


def inclination_rad(q: FloatArray, q_true: FloatArray) -> FloatArray:
    error = multiply(q, conjugate(q_true))
    return np.asarray(2.0 * np.arctan2(np.hypot(error[:, 1], error[:, 2]), np.hypot(error[:, 0], error[:, 3])))


# -------------------------------------------------------------------------------------------------------- filters


def ours(settings: AttitudeSettings) -> Callable[[ImuTrack], FloatArray]:
    return lambda track: im.estimate_attitude(track, settings).q


def vqf(track: ImuTrack) -> FloatArray:
    q: FloatArray = VQF(1.0 / track.rate_hz).updateBatch(track.gyr_rad_s, track.acc_m_s2)["quat6D"]
    return q


def offline_vqf(track: ImuTrack) -> FloatArray:
    q: FloatArray = offlineVQF(track.gyr_rad_s, track.acc_m_s2, None, 1.0 / track.rate_hz)["quat6D"]
    return q


def imufusion_default(track: ImuTrack) -> FloatArray:
    ahrs = imufusion.Ahrs()
    ahrs.set_sample_period(1.0 / track.rate_hz)
    gyr, acc = np.degrees(track.gyr_rad_s), track.acc_m_s2 / G_M_S2
    q = np.empty((track.n_samples, 4))
    for k in range(track.n_samples):
        ahrs.update_no_magnetometer(gyr[k], acc[k])
        q[k] = ahrs.get_quaternion()
    return q


FILTERS: dict[str, Callable[[ImuTrack], FloatArray]] = {
    "akf": ours(CAUSAL),
    "VQF": vqf,
    "akf smooth": ours(SMOOTH),
    "offlineVQF": offline_vqf,
    "ekf": ours(replace(CAUSAL, method="ekf")),
    "akf_source": ours(replace(CAUSAL, method="akf_source")),
    "gyro": ours(replace(CAUSAL, method="gyro")),
    "imufusion": imufusion_default,
}
PAIRS = ("akf", "VQF", "akf smooth", "offlineVQF")


# --------------------------------------------------------------------------------------------------- made harder


def decimated(trial: Trial, n: int) -> Trial:
    """The mean of every n samples, n odd, and the truth at their middle."""
    m = trial.track.n_samples // n * n
    time_s = trial.track.time_s[:m].reshape(-1, n)[:, n // 2]
    acc, gyr = (v[:m].reshape(-1, n, 3).mean(axis=1) for v in (trial.track.acc_m_s2, trial.track.gyr_rad_s))
    q_true, used = trial.q_true[:m][n // 2 :: n], trial.is_used[:m][n // 2 :: n]
    return replace(trial, track=ImuTrack(time_s, acc, gyr), q_true=q_true, is_used=used)


def clipped(trial: Trial) -> Trial:
    """At 4 g and 500 deg/s; nobody says so."""
    acc = np.clip(trial.track.acc_m_s2, -4 * G_M_S2, 4 * G_M_S2)
    gyr = np.clip(trial.track.gyr_rad_s, -np.radians(500.0), np.radians(500.0))
    return replace(trial, track=ImuTrack(trial.track.time_s, acc, gyr))


def in_motion(trial: Trial) -> Trial:
    """From 30 s after movement began."""
    first = int(np.flatnonzero(trial.is_used)[0] + 30.0 * trial.track.rate_hz)
    track = ImuTrack(trial.track.time_s[first:], trial.track.acc_m_s2[first:], trial.track.gyr_rad_s[first:])
    return replace(trial, track=track, q_true=trial.q_true[first:], is_used=trial.is_used[first:])


def biased(trial: Trial, bias_deg_s: float) -> Trial:
    bias = np.radians(bias_deg_s) * np.array([0.6, -0.48, 0.64])
    track = ImuTrack(trial.track.time_s, trial.track.acc_m_s2, trial.track.gyr_rad_s + bias)
    return replace(trial, track=track)


def off_scale(trial: Trial, sd: float) -> Trial:
    """Scales and crossed axes off by so much, drawn anew for each trial: a chip as it is sold."""
    off = np.eye(3) + np.random.default_rng(int(trial.name)).normal(0.0, sd, (3, 3))
    return replace(trial, track=replace(trial.track, gyr_rad_s=trial.track.gyr_rad_s @ off.T))


HARDER: dict[str, Callable[[Trial], Trial]] = {
    "as recorded, 286 Hz": lambda trial: trial,
    "95 Hz": lambda trial: decimated(trial, 3),
    "57 Hz": lambda trial: decimated(trial, 5),
    "clipped at 4 g, 500 deg/s": clipped,
    "started in motion": in_motion,
    "bias 2 deg/s": lambda trial: biased(trial, 2.0),
    "bias 5 deg/s": lambda trial: biased(trial, 5.0),
    "bias 10 deg/s": lambda trial: biased(trial, 10.0),
    "scales and axes 1 % off": lambda trial: off_scale(trial, 0.01),
    "bias 2 deg/s, started in motion": lambda trial: in_motion(biased(trial, 2.0)),
}


# -------------------------------------------------------------------------------------------------------- tables


def tables() -> list[Table]:
    """BROAD trial by trial, made harder, cross-validated; and what the window buys."""
    if not DATA.exists():
        return [Table("Attitude", "nothing: shared/data/broad is not beside the repository", ("",), ())]
    trials = load_trials()
    return [*_trial_by_trial(trials), _made_harder(trials), _held_out(trials), _window(trials), _window_in_the_hand()]


def run(data: Path = DATA) -> list[tuple[str | float, ...]]:
    """Rows of (trial, RMSE of each of FILTERS), raw; the last row is the mean."""
    rows: list[tuple[str | float, ...]] = [
        (trial.name, *(rmse_deg(trial, estimate(trial.track)) for estimate in FILTERS.values()))
        for trial in load_trials(data)
    ]
    return [*rows, ("mean", *_means(rows))]


def _means(rows: list[tuple[str | float, ...]]) -> tuple[float, ...]:
    return tuple(float(v) for v in np.mean([[float(v) for v in row[1:]] for row in rows], axis=0))


def _trial_by_trial(trials: list[Trial]) -> list[Table]:
    raw: list[tuple[str | float, ...]] = []
    late: list[tuple[str | float, ...]] = []
    for trial in trials:
        estimates = [estimate(trial.track) for estimate in FILTERS.values()]
        raw.append((trial.name, *(rmse_deg(trial, q) for q in estimates)))
        late.append((trial.name, *(rmse_deg(trial, q, late_s=LATE_S) for q in estimates)))
    made = []
    for rows, how in ((raw, "truth as it comes"), (late, "truth 0.7 samples late")):
        mean = _means(rows)
        ratio = max(float(row[1]) / float(row[2]) for row in rows)
        targets = (
            Target("mean of akf while recording, against VQF", mean[0], mean[1], "deg"),
            Target("its worst ratio to VQF on one trial", ratio, 1.15),
            Target("mean of akf smoothed, against offlineVQF", mean[2], mean[3], "deg"),
        )
        made.append(
            Table(
                f"Inclination, RMSE in degrees, {how}",
                f"BROAD, {len(rows)} trials at 286 Hz, movement only",
                ("trial", *FILTERS),
                (*rows, ("mean", *mean)),
                targets,
                ("imufusion runs at its defaults; it has settings that do better on such motion.",),
            )
        )
    return made


def _made_harder(trials: list[Trial]) -> Table:
    rows = []
    for name, change in HARDER.items():
        changed = [change(trial) for trial in trials]
        estimates = {pair: [FILTERS[pair](trial.track) for trial in changed] for pair in PAIRS}
        row: list[str | float] = [name]
        for late_s in (0.0, LATE_S):
            for pair in PAIRS:
                errors = [rmse_deg(t, q, late_s=late_s) for t, q in zip(changed, estimates[pair], strict=True)]
                row.append(float(np.mean(errors)))
        rows.append(tuple(row))
    return Table(
        "The same trials made harder: mean inclination RMSE in degrees",
        f"BROAD, {len(trials)} trials; `late` columns with the truth 0.7 samples (2.45 ms) late",
        ("change", *PAIRS, *(f"{pair}, late" for pair in PAIRS)),
        tuple(rows),
        notes=(
            "Decimated by means over the samples, with the truth at their middle: VQF takes a rate as the mean over "
            "the step before it, so its estimate is half a step ahead, which at 57 Hz is most of its error.",
        ),
    )


def _held_out(trials: list[Trial]) -> Table:
    """The two numbers that matter most, chosen on the other trials: no better than the physical defaults."""
    grid = [
        replace(CAUSAL, r_factor_s=factor, sd_start_scale=scale)
        for factor in (1.0, 2.0, 4.0)
        for scale in (0.0, 0.0025, 0.005, 0.01)
    ]
    errors = np.array(
        [[rmse_deg(t, ours(settings)(t.track), late_s=LATE_S) for t in trials] for settings in grid]
    )  # (settings, trials)
    rows: list[tuple[str | float, ...]] = []
    for fold in range(4):
        out = np.arange(len(trials)) % 4 == fold
        best = int(np.argmin(errors[:, ~out].mean(axis=1)))
        rows.append(
            (
                " ".join(trials[k].name for k in np.flatnonzero(out)),
                grid[best].r_factor_s,
                grid[best].sd_start_scale,
                float(errors[best, out].mean()),
                float(errors[grid.index(CAUSAL), out].mean()),
            )
        )
    rows.append(("mean", "", "", float(np.mean([r[3] for r in rows])), float(np.mean([r[4] for r in rows]))))
    return Table(
        "Parameters chosen on the other trials, while recording",
        f"BROAD, {len(trials)} trials in four folds, truth 0.7 samples late",
        ("left out", "chosen r_factor_s", "chosen sd_start_scale", "RMSE of the choice, deg", "of the defaults, deg"),
        tuple(rows),
        notes=("The defaults come from data sheets and from how long a stroke of a hand lasts.",),
    )


# What R would be without a window: one number for all motion, and none right for all.
CONSTANT_R = {"R of rest, 0.01 m2/s2": 0.01, "R of a hand, 0.1": 0.1, "R of a shake, 1": 1.0}


def _window(trials: list[Trial]) -> Table:
    rows: list[tuple[str | float, ...]] = []
    for name, settings in _with_and_without_window():
        row: list[str | float] = [name]
        for smooth in (False, True):
            estimate = ours(replace(settings, smooth=smooth))
            row.append(float(np.mean([rmse_deg(t, estimate(t.track), late_s=LATE_S) for t in trials])))
        rows.append(tuple(row))
    return Table(
        "What the window of R buys: mean inclination RMSE in degrees",
        f"BROAD, {len(trials)} trials, truth 0.7 samples late",
        ("R", "while recording", "smoothed"),
        tuple(rows),
    )


def _with_and_without_window() -> Iterator[tuple[str, AttitudeSettings]]:
    yield "adaptive, window 3 s", CAUSAL
    yield "the same, scale not estimated", replace(CAUSAL, sd_start_scale=0.0)
    yield "adaptive, window 1 s", replace(CAUSAL, window_s=1.0)
    yield "adaptive, window 10 s", replace(CAUSAL, window_s=10.0)
    for name, r in CONSTANT_R.items():
        yield f"constant, {name}", replace(CAUSAL, is_adaptive=False, r_start_m2_s2=r)


def _window_in_the_hand() -> Table:
    """Change of the tilt error in the shake and in the second after it, and over the stop of the press."""
    sessions = [im.simulate_session("pmdi", seed=seed) for seed in range(8)]
    rows: list[tuple[str | float, ...]] = []
    methods = [*_with_and_without_window(), ("the source's ekf", replace(CAUSAL, method="ekf"))]
    methods.append(("the source's akf", replace(CAUSAL, method="akf_source")))
    for name, causal in methods:
        row: list[str | float] = [name]
        for smooth in (False, True):
            settings = replace(causal, smooth=smooth, gyr_delay_s=0.0)
            in_shake, at_press = [], []
            for recording, truth in sessions:
                track = recording.body
                # the offset is the accelerometer's and the same for every filter: what counts is what moves
                q = im.estimate_attitude(
                    replace(track, gyr_rad_s=track.gyr_rad_s - truth.gyr_bias_body_rad_s), settings
                ).q
                error = _tilt_error(q, truth.q_ref_body)
                for phase in truth.phases:
                    if phase.kind is PhaseKind.SHAKE:
                        seen = (track.time_s >= phase.start_s) & (track.time_s < phase.end_s + 1.0)
                        in_shake.append(error[seen] - error[seen].mean(axis=0))
                for event in truth.events:
                    seen = (track.time_s >= event.start_s) & (track.time_s < event.peak_s + 0.3)
                    at_press.append(error[seen] - error[seen].mean(axis=0))
            row += [float(np.degrees(np.sqrt(np.mean(np.concatenate(e) ** 2)))) for e in (in_shake, at_press)]
        rows.append(tuple(row))
    return Table(
        "What it buys in the hand: how far the tilt error moves, in degrees (RMS per axis about its mean)",
        f"{len(sessions)} simulated pMDI sessions, 100 Hz, typical sensors, gyro bias known",
        ("R", "shake, while recording", "press, while recording", "shake, smoothed", "press, smoothed"),
        tuple(rows),
    )


def _tilt_error(q: FloatArray, q_true: FloatArray) -> FloatArray:
    """The two level parts of the error's rotation vector (n, 2), heading taken out."""
    error = multiply(q, conjugate(q_true))
    heading = error * np.array([1.0, 0.0, 0.0, 1.0])
    heading /= np.linalg.norm(heading, axis=1, keepdims=True)
    return 2.0 * multiply(conjugate(heading), error)[:, 1:3]
