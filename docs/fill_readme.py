"""Fills the marked parts of README.md with what really comes out: `python docs/fill_readme.py`.

A test compares, so that README never shows another output, example or figure than the real one.
"""

from __future__ import annotations

import contextlib
import io
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
README = ROOT / "README.md"
RESULTS = ROOT / "validation" / "RESULTS.md"

EXAMPLE = """
import inhalemon as im

recording = im.read_recording("sample_data/pmdi_press_late.csv.gz")
report = im.score_recording(recording)

print(report.score.grade, report.score.points)
for finding in report.findings:
    if finding.verdict == "fail":
        print(f"{finding.severity}: {finding.message}")
for phase in report.phases[:4]:
    print(f"{phase.kind:<9} {phase.start_s:5.2f} s to {phase.end_s:5.2f} s")
coordination = report.measures["coordination_s"]
print(f"press {coordination.value:.2f} s after the inhalation's start (sd {coordination.sd:.2f})")
""".strip()


def filled(text: str) -> str:
    """README's text with every marked part as it is now."""
    for name, content in (("demo", demo()), ("example", example()), ("results", results())):
        pattern = re.compile(rf"(<!-- {name}:begin -->\n).*?(<!-- {name}:end -->)", re.DOTALL)
        if not pattern.search(text):
            raise ValueError(f"README.md has no part {name}")
        text = pattern.sub(lambda found, content=content: found[1] + content + found[2], text)
    return text


def demo() -> str:
    """What `make demo` prints, without colours."""
    command = [sys.executable, "-m", "inhalemon", "score", "sample_data"]
    said = subprocess.run(command, cwd=ROOT, capture_output=True, check=True, text=True).stdout
    return _fenced("", "\n".join(line.rstrip() for line in said.splitlines()).strip("\n"))


def example() -> str:
    """The library example and what it prints."""
    printed = io.StringIO()
    with contextlib.chdir(ROOT), contextlib.redirect_stdout(printed):
        exec(compile(EXAMPLE, "README.md", "exec"), {"__name__": "example"})
    return _fenced("python", EXAMPLE) + "\nprints\n\n" + _fenced("", printed.getvalue().rstrip())


def results() -> str:
    """Every measured target of RESULTS.md, reached or missed, section by section."""
    if not RESULTS.exists():
        return "No run of `make validate` has been kept yet.\n"
    return "\n".join(_targets(RESULTS.read_text(encoding="utf-8"))) + "\n"


def _targets(text: str) -> Iterator[str]:
    for section in re.split(r"^## ", text, flags=re.MULTILINE)[1:]:
        title, _, body = section.partition("\n")
        found = [line for line in body.splitlines() if line.startswith("- ") and "(wanted " in line]
        if found:
            yield f"**{title}**\n"
            yield from found
            yield ""


def _fenced(language: str, text: str) -> str:
    return f"```{language}\n{text}\n```\n"


if __name__ == "__main__":
    README.write_text(filled(README.read_text(encoding="utf-8")), encoding="utf-8")
