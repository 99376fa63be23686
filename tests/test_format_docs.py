"""docs/formats.md tells every code of refusals and flags, and no other."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
DOCUMENT = (ROOT / "docs" / "formats.md").read_text(encoding="utf-8")


def _codes_in_table(heading: str) -> set[str]:
    section = DOCUMENT.split(f"### {heading}\n", 1)[1].split("\n#", 1)[0]
    first_cells = re.findall(r"^\| (`[^|]*) \|", section, flags=re.MULTILINE)
    return {code for cell in first_cells for code in re.findall(r"`(\w+)`", cell)}


def _codes_in_source(pattern: str, *places: str) -> set[str]:
    files = [path for place in places for path in sorted((ROOT / "inhalemon").glob(place))]
    assert files
    return {code for path in files for code in re.findall(pattern, path.read_text(encoding="utf-8"))}


def test_every_refusal_is_told() -> None:
    raised = _codes_in_source(r'(?:RecordingError\(|_internal\(source,|"code":)\s*"(\w+)"', "**/*.py")
    assert _codes_in_table("Why a recording is refused") == raised


def test_every_flag_is_told() -> None:
    raised = _codes_in_source(r'Flag\("(\w+)"', "stages/quality.py") | {"gyr_saturated", "acc_saturated"}
    assert _codes_in_table("What is flagged in `quality`") == raised
