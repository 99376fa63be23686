"""Draws k-means and what the path makes of it on two sample sessions: `python -m validation.phase_figure`.

After the manner of the source's fig. 7 (windows of an Ellipta session, coloured by cluster), with the phases below.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from inhalemon.devices import load_device
from inhalemon.pipeline import estimate_tracks
from inhalemon.recording import read_recording
from inhalemon.settings import Settings
from inhalemon.stages.events import find_events
from inhalemon.stages.motion import describe_motion
from inhalemon.stages.phases.evidence import gather_evidence
from inhalemon.stages.phases.find import find_phases
from inhalemon.stages.phases.order import LABELS
from inhalemon.stages.shakes import find_shakes
from inhalemon.values import PhaseKind

ROOT = Path(__file__).resolve().parents[1]
FIGURE = ROOT / "docs" / "figures" / "phases.png"
SESSIONS = ("ellipta_correct.csv.gz", "pmdi_correct.csv")
SHORT = {PhaseKind.TO_MOUTH: "to mouth", PhaseKind.BREATH_HOLD: "hold", PhaseKind.EXHALE_AFTER: "exhale"}


def draw(path: Path, above: Axes, below: Axes) -> None:
    """The two angles with the windows' clusters behind them, and the phases that come out."""
    recording = read_recording(path)
    settings, device = Settings(), load_device(recording.device)
    tracks = estimate_tracks(recording, settings, device=device)
    motion = describe_motion(tracks.recording, tracks.body, tracks.angle, settings.motion)
    shakes = find_shakes(motion, settings.shakes)
    events = find_events(motion, shakes, device, settings.events)
    evidence = gather_evidence(motion, shakes, events, device, settings.phases)
    phases = find_phases(motion, shakes, events, device, settings.phases)

    edges_s = motion.time_s[np.minimum(evidence.windows.edges, motion.time_s.size - 1)]
    colours = plt.get_cmap("Pastel2")
    for start_s, end_s, cluster in zip(edges_s[:-1], edges_s[1:], evidence.windows.cluster, strict=True):
        above.axvspan(start_s, end_s, color=colours(int(cluster) % 8), linewidth=0)
    above.plot(motion.time_s, np.degrees(motion.lever_rad), color="#b3261e", linewidth=1, label=device.moving_part)
    above.plot(motion.time_s, np.degrees(motion.elevation_rad), color="#1a3d6d", linewidth=1, label="tilt-back")
    above.set_ylabel("angle in deg")
    above.set_title(f"{path.name.split('.')[0]} (simulated): windows by k-means cluster", loc="left", fontsize=9)
    above.legend(loc="upper right", fontsize=7, ncols=2)

    shades = plt.get_cmap("tab20")
    for phase in phases:
        below.axvspan(phase.start_s, phase.end_s, color=shades(LABELS.index(phase.kind) % 20), alpha=0.55, linewidth=0)
        if phase.end_s - phase.start_s > 0.4:
            name = SHORT.get(phase.kind, phase.kind.value.replace("_", " "))
            below.text((phase.start_s + phase.end_s) / 2, 0.5, name, ha="center", va="center", rotation=90, fontsize=6)
    below.set_yticks([])
    below.set_ylabel("phases")
    below.set_xlim(phases[0].start_s, phases[-1].end_s)
    below.set_xlabel("time in s")


def main() -> None:
    matplotlib.use("Agg")
    figure, axes = plt.subplots(4, 1, figsize=(9, 7), height_ratios=(3, 1.6, 3, 1.6), layout="constrained")
    for k, name in enumerate(SESSIONS):
        axes[2 * k].sharex(axes[2 * k + 1])
        draw(ROOT / "sample_data" / name, axes[2 * k], axes[2 * k + 1])
    FIGURE.parent.mkdir(exist_ok=True)
    figure.savefig(FIGURE, dpi=110)
    plt.close(figure)
    print(f"{FIGURE.relative_to(ROOT)}: {FIGURE.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
