"""Where the CPU time of one session goes, stage by stage: `python -m validation.profile`."""

from __future__ import annotations

import cProfile
import pstats
import tempfile
import time
from pathlib import Path

import inhalemon as im
from inhalemon.report import to_json
from validation.lengthened import session_of
from validation.tables import Table

REPEATS = 20

# The functions that `score_recording` calls in turn; each row is the time within them and all they call.
STAGES = (
    ("read_recording", "reading and checking the file"),
    ("align_clocks", "the two clocks"),
    ("correct_sensors", "sensors' biases"),
    ("estimate_attitude", "attitude, both sensors"),
    ("resample_attitude", "the lever's attitude at the body's samples"),
    ("calibrate", "hinge axes, heading, zero"),
    ("lever_angle", "the lever's angle"),
    ("assess_quality", "quality"),
    ("describe_motion", "motion in the room"),
    ("find_shakes", "shaking"),
    ("find_events", "strokes of lever or cover"),
    ("find_phases", "phases: all of it"),
    ("find_holds", "- still holds"),
    ("find_stays", "- stays at the mouth"),
    ("cut_windows", "- windows and k-means"),
    ("cheapest_path", "- cheapest path"),
    ("measure_dose", "measures"),
    ("apply_rules", "findings"),
    ("to_json", "the report's JSON"),
)


def rows() -> list[tuple[str, float, float]]:
    """Each stage with its CPU time in ms and its share of the whole; the first row is the whole, without a profiler.

    A profiler makes small calls look dear, so the shares are its own and the times are shares of the unprofiled whole.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "session.csv"
        im.write_recording(session_of(60.0), path)
        _score(path)
        samples = []
        for _ in range(REPEATS):
            start = time.process_time()
            _score(path)
            samples.append(time.process_time() - start)
        whole_ms = 1e3 * min(samples)
        profiler = cProfile.Profile(time.process_time)
        profiler.enable()
        for _ in range(REPEATS):
            _score(path)
        profiler.disable()
    within: dict[str, float] = {}
    for (_, _, name), stat in pstats.Stats(profiler).stats.items():  # type: ignore[attr-defined]  # not in typeshed
        within[name] = max(within.get(name, 0.0), stat[3])
    total = within["_score"]
    return [("all", whole_ms, 1.0)] + [
        (label, whole_ms * within[name] / total, within[name] / total) for name, label in STAGES if name in within
    ]


def _score(path: Path) -> None:
    to_json(im.score_recording(im.read_recording(path, device="pmdi")))


def table() -> Table:
    """The rows as a table of RESULTS.md, which `make docs` also puts into docs/speed.md."""
    return Table(
        title="Where the time goes",
        measured_on="the same session; shares are a profiler's, which makes many small calls look dear, times these "
        "shares of the unprofiled whole",
        columns=("what", "CPU", "share"),
        rows=tuple((label, f"{ms:.1f} ms", f"{share:.0%}") for label, ms, share in rows()),
    )


if __name__ == "__main__":
    print(table().to_markdown())
