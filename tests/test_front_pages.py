"""CONTRIBUTING tells the stages in the order in which the pipeline runs them."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_stages_are_told_in_the_order_in_which_they_run() -> None:
    told = re.search(r"stages/ \(([^)]*)\)", (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"))
    assert told is not None
    pipeline = (ROOT / "inhalemon" / "pipeline.py").read_text(encoding="utf-8")
    imported = re.findall(r"^from inhalemon\.stages\.(\w+) import (\w+)", pipeline, flags=re.MULTILINE)
    body = pipeline[pipeline.index("def estimate_tracks") :]
    run = sorted(imported, key=lambda stage: body.index(f"{stage[1]}("))
    assert re.findall(r"\w+", told[1]) == [stage for stage, _ in run]


def test_every_document_is_listed() -> None:
    index = (ROOT / "docs" / "README.md").read_text(encoding="utf-8")
    for document in (ROOT / "docs").glob("*.md"):
        assert document.name == "README.md" or f"({document.name})" in index
