"""The source's own claim, tried on simulated pMDI sessions: the adaptive filter rides out the shake and the end stop.

The source (its fig. 4) shows one session without truth: integrated rates jump after the shake, the EKF's lever angle
swings during the shake and spikes when the lever meets its stop, the AKF's does neither. Here the truth is known.
`python -m validation.source_claim --figure` draws the same curves to docs/figures/.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from inhalemon.pipeline import Tracks, estimate_tracks
from inhalemon.rotation import up_in
from inhalemon.settings import AttitudeMethod, AttitudeSettings, SensorSettings, Settings
from inhalemon.simulate import Truth, simulate_session
from inhalemon.values import BoolArray, EventKind, FloatArray, PhaseKind, Recording
from validation.tables import Table

FIGURES = Path(__file__).resolve().parents[1] / "docs" / "figures"
SEEDS = range(100, 130)
STOP_S = 0.15  # on either side of the end stop
BEFORE_S = (0.45, 0.30)  # before the press: the angle that the spike is measured from

SETTINGS = {
    "gyro alone": AttitudeSettings(method=AttitudeMethod.GYRO, smooth=False),
    "EKF, R constant": AttitudeSettings(method=AttitudeMethod.EKF, smooth=False),
    "AKF of the source": AttitudeSettings(method=AttitudeMethod.AKF_SOURCE, smooth=False),
    "AKF of this project": AttitudeSettings(method=AttitudeMethod.AKF, smooth=False),
    "the same, smoothed": AttitudeSettings(method=AttitudeMethod.AKF, smooth=True),
}


@dataclass(frozen=True)
class Errors:
    """Of one session, in degrees."""

    body_after_shake: float
    lever_swing_in_shake: float
    spike: float
    lever: float


def settings_of(attitude: AttitudeSettings, *, is_corrected: bool) -> Settings:
    """The hinge stage is a finished recording's for every filter: learning anew on the way would show as spikes, too.

    `is_corrected` removes the sensors' biases beforehand.
    """
    return replace(Settings(), sensors=SensorSettings(is_used=is_corrected), attitude=attitude)


def sessions() -> Iterator[tuple[Recording, Truth]]:
    for seed in SEEDS:
        yield simulate_session("pmdi", seed=seed)


def body_angle(q_ref_body: FloatArray) -> FloatArray:
    """The body's turn about the hinge from upright, positive when it tilts back."""
    up = up_in(q_ref_body)
    return np.asarray(np.arctan2(up[:, 1], up[:, 2]))


def in_shake(truth: Truth) -> BoolArray:
    inside = np.zeros(truth.time_s.size, dtype=bool)
    for phase in truth.phases:
        if phase.kind is PhaseKind.SHAKE:
            inside |= (truth.time_s >= phase.start_s) & (truth.time_s < phase.end_s)
    return inside


def errors_of(tracks: Tracks, truth: Truth) -> Errors:
    time_s = truth.time_s
    shake = in_shake(truth)
    lever = np.degrees(tracks.angle.angle_rad - truth.angle_rad)
    body = np.degrees(np.angle(np.exp(1j * (body_angle(tracks.body.q) - body_angle(truth.q_ref_body)))))
    end_s = time_s[shake][-1]
    after = (time_s > end_s) & (time_s < end_s + 0.5)
    spikes = []
    for event in truth.events:
        if event.kind is EventKind.PRESS:
            before = (time_s > event.start_s - BEFORE_S[0]) & (time_s < event.start_s - BEFORE_S[0] + BEFORE_S[1])
            at_stop = np.abs(time_s - event.peak_s) < STOP_S
            spikes.append(float(np.abs(lever[at_stop] - np.median(lever[before])).max()))
    return Errors(
        body_after_shake=float(
            np.abs(np.mean(body[after]) - np.mean(body[~shake & (time_s < time_s[shake][0])][-50:]))
        ),
        lever_swing_in_shake=float(np.std(lever[shake])),
        spike=max(spikes),
        lever=float(np.sqrt(np.mean(lever**2))),
    )


def tables() -> list[Table]:
    made = list(sessions())
    rows: list[tuple[str | float | int | None, ...]] = []
    for is_corrected in (False, True):
        for name, attitude in SETTINGS.items():
            settings = settings_of(attitude, is_corrected=is_corrected)
            found = [errors_of(estimate_tracks(recording, settings), truth) for recording, truth in made]
            columns = zip(*((e.body_after_shake, e.lever_swing_in_shake, e.spike, e.lever) for e in found), strict=True)
            means = [float(np.mean(column)) for column in columns]
            rows.append((name, "removed" if is_corrected else "as recorded", *means))
    return [
        Table(
            "Shake and end stop, by filter, degrees",
            f"{len(made)} simulated pMDI sessions at 100 Hz with datasheet errors; not real recordings",
            (
                "attitude",
                "sensor biases",
                "body angle, step over the shake",
                "lever angle, swing in the shake (SD)",
                "lever angle, spike at the end stop",
                "lever angle, RMSE",
            ),
            tuple(rows),
            notes=(
                "Means over the sessions. The hinge stage behind the filter is the same for all; it takes out the slow "
                "heading, which the source's relative angle does not.",
            ),
        )
    ]


def draw(path: Path) -> None:
    """Body and lever angle of one session by the source's three methods and ours, with the truth."""
    import matplotlib as mpl  # noqa: PLC0415 - only the figure needs it

    mpl.use("Agg")
    import matplotlib.pyplot as plt  # noqa: PLC0415

    recording, truth = simulate_session("pmdi", seed=SEEDS[0])
    shown = {"gyro alone": "tab:green", "EKF, R constant": "tab:blue", "AKF of the source": "tab:orange"}
    figure, axes = plt.subplots(3, 1, figsize=(8.0, 8.5), constrained_layout=True)
    press = next(event for event in truth.events if event.kind is EventKind.PRESS)
    for name, colour in (shown | {"AKF of this project": "tab:red"}).items():
        tracks = estimate_tracks(recording, settings_of(SETTINGS[name], is_corrected=True))
        axes[0].plot(truth.time_s, np.degrees(body_angle(tracks.body.q)), color=colour, lw=0.9, label=name)
        for axis in axes[1:]:
            axis.plot(truth.time_s, np.degrees(tracks.angle.angle_rad), color=colour, lw=0.9)
    axes[0].plot(truth.time_s, np.degrees(body_angle(truth.q_ref_body)), "k--", lw=0.8, label="truth (simulated)")
    for axis in axes[1:]:
        axis.plot(truth.time_s, np.degrees(truth.angle_rad), "k--", lw=0.8)
    for axis in axes:
        for phase in truth.phases:
            colours = {PhaseKind.SHAKE: "gold", PhaseKind.INHALE: "yellowgreen"}
            if phase.kind in colours:
                axis.axvspan(phase.start_s, phase.end_s, color=colours[phase.kind], alpha=0.25, lw=0)
        axis.axvspan(press.start_s, press.end_s, color="grey", alpha=0.35, lw=0)
    axes[0].set_ylabel("body angle (deg)")
    axes[1].set_ylabel("lever angle (deg)")
    axes[1].set_ylim(-8.0, press.angle_deg + 8.0)
    axes[2].set_ylabel("lever angle (deg), the press")
    axes[2].set_xlim(press.start_s - 0.3, press.end_s + 0.5)
    axes[2].set_ylim(-4.0, press.angle_deg + 6.0)
    axes[2].set_xlabel("time (s)")
    axes[0].legend(loc="upper left", fontsize=8, ncols=3)
    figure.suptitle("A simulated pMDI session: shake yellow, inhalation green, press grey")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    if "--figure" in sys.argv:
        draw(FIGURES / "source_claim.png")
    else:
        for table in tables():
            print(table.to_markdown())
