"""Fills the marked parts of README.md and docs/speed.md with what really comes out: `python docs/fill_readme.py`.

A test compares, so that neither ever shows another output, example or figure than the real one.
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
SPEED = ROOT / "docs" / "speed.md"
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
print(f"press {coordination.value:.3f} s after the inhalation's start (sd {coordination.sd:.3f})")
""".strip()


def fill(document: Path, parts: dict[str, str]) -> None:
    """Writes each marked part of a document as it is now."""
    text = document.read_text(encoding="utf-8")
    for name, content in parts.items():
        pattern = re.compile(rf"(<!-- {name}:begin -->\n).*?(<!-- {name}:end -->)", re.DOTALL)
        if not pattern.search(text):
            raise ValueError(f"{document.name} has no part {name}")
        text = pattern.sub(lambda found, content=content: found[1] + content + found[2], text)
    document.write_text(text, encoding="utf-8")


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
    """Every measured target of RESULTS.md, reached or missed, under its section and its table."""
    if not RESULTS.exists():
        return "No run of `make validate` has been kept yet.\n"
    return "\n".join(_targets(RESULTS.read_text(encoding="utf-8"))) + "\n"


def profile() -> str:
    """The table of RESULTS.md that says where the time of one session goes."""
    found = re.search(
        r"^### Where the time goes\n.*?(^\|.*?)\n\n", RESULTS.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE
    )
    if found is None:
        raise ValueError("RESULTS.md has no table of where the time goes; run `make validate`")
    return found[1] + "\n"


def _targets(text: str) -> Iterator[str]:
    for section in re.split(r"^## ", text, flags=re.MULTILINE)[1:]:
        title, _, body = section.partition("\n")
        if "(wanted " not in body:
            continue
        yield f"**{title}**\n"
        for table in re.split(r"^### ", body, flags=re.MULTILINE)[1:]:
            found = [line for line in table.splitlines() if line.startswith("- ") and "(wanted " in line]
            if found:
                yield f"*{table.partition(chr(10))[0]}*\n"
                yield from found
                yield ""


def _fenced(language: str, text: str) -> str:
    return f"```{language}\n{text}\n```\n"


if __name__ == "__main__":
    fill(README, {"demo": demo(), "example": example(), "results": results()})
    fill(SPEED, {"profile": profile()})
