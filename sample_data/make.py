"""Makes the sample sessions again, byte for byte: `python sample_data/make.py`. All of them are simulated."""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from inhalemon.recording import write_recording
from inhalemon.simulate import Truth, simulate_session
from inhalemon.values import Grade, Severity

HERE: Final = Path(__file__).resolve().parent


@dataclass(frozen=True)
class Sample:
    """One session: its file, what is acted in it, and how it is recorded."""

    file: str
    mistakes: tuple[str, ...]
    seed: int
    subject: int
    rate_hz: float | tuple[float, float] = 100.0
    profile: str = "typical"
    n_doses: int = 1


SAMPLES: Final = (
    Sample("pmdi_correct.csv", (), seed=1, subject=0, rate_hz=50.0),
    Sample("pmdi_two_doses_correct.csv.gz", (), seed=2, subject=8, n_doses=2),
    Sample("pmdi_press_late.csv.gz", ("press_late",), seed=13, subject=3),
    Sample("pmdi_not_shaken_no_exhale.csv.zst", ("not_shaken", "no_exhale_pause"), seed=4, subject=16, rate_hz=200.0),
    Sample("pmdi_tilted_short_hold.csv.gz", ("not_upright_at_press", "breath_hold_too_short"), seed=5, subject=12),
    Sample("pmdi_pressed_twice_trembling.csv.gz", ("multiple_presses",), seed=6, subject=4, profile="harsh"),
    Sample("ellipta_correct.csv.gz", (), seed=21, subject=1, rate_hz=(100.0, 119.0)),
    Sample("ellipta_correct_child.csv.zst", (), seed=22, subject=6, rate_hz=200.0),
    Sample("ellipta_half_open.csv.gz", ("cover_not_fully_open",), seed=23, subject=5),
    Sample("ellipta_shaken_after_open.csv.gz", ("shaken_after_open",), seed=24, subject=11),
    Sample("ellipta_short_breath_not_closed.csv.gz", ("inhalation_too_short", "cover_not_closed"), seed=25, subject=2),
    Sample("ellipta_opened_twice.csv", ("opened_repeatedly",), seed=26, subject=10, rate_hz=50.0),
)

# The default profile's severity of each mistake acted above, as `inhalemon explain` gives it.
SEVERITY: Final = {
    "press_late": Severity.MAJOR,  # still at the mouth
    "not_shaken": Severity.CRITICAL,
    "no_exhale_pause": Severity.MAJOR,
    "not_upright_at_press": Severity.MAJOR,
    "breath_hold_too_short": Severity.MAJOR,
    "multiple_presses": Severity.MAJOR,
    "cover_not_fully_open": Severity.CRITICAL,
    "shaken_after_open": Severity.CRITICAL,
    "inhalation_too_short": Severity.CRITICAL,
    "cover_not_closed": Severity.MINOR,
    "opened_repeatedly": Severity.MAJOR,
}
GRADES: Final = (
    (Severity.CRITICAL, Grade.CRITICAL_MISTAKES),
    (Severity.MAJOR, Grade.MAJOR_MISTAKES),
    (Severity.MINOR, Grade.MINOR_MISTAKES),
)


def expected_grade(mistakes: Iterable[str]) -> Grade:
    """The worst mistake's grade."""
    severities = {SEVERITY[mistake] for mistake in mistakes}
    return next((grade for severity, grade in GRADES if severity in severities), Grade.CORRECT)


def make(folder: Path) -> list[Truth]:
    """Writes all samples, their labels and `expected.json` into the folder."""
    truths = []
    expected = {}
    for sample in SAMPLES:
        session_id = sample.file.split(".")[0]
        recording, truth = simulate_session(
            session_id.split("_")[0],
            sample.mistakes,
            seed=sample.seed,
            subject=sample.subject,
            rate_hz=sample.rate_hz,
            profile=sample.profile,
            n_doses=sample.n_doses,
            session_id=session_id,
        )
        recording = dataclasses.replace(recording, recorded_at=f"2025-11-{sample.seed:02d}T08:30:00+09:00")
        write_recording(recording, folder / sample.file)
        truth.write_labels(folder / sample.file)
        expected[session_id] = {"grade": expected_grade(truth.mistakes).value, "mistakes": list(truth.mistakes)}
        truths.append(truth)
    (folder / "expected.json").write_text(json.dumps(expected, indent=1) + "\n", encoding="utf-8")
    return truths


if __name__ == "__main__":
    make(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE)
