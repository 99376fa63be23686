"""Measures everything anew and writes `validation/RESULTS.md`: `python -m validation [SECTION ...]`.

Each section is a module of this package with `tables() -> list[Table]`. Sections named on the command line are
printed only; the file is written by a full run alone, so that it never mixes runs.
"""

from __future__ import annotations

import importlib
import os
import platform
import sys
import time
from pathlib import Path

# One thread a process: results to the bit, and timings that mean something on two cores.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

SECTIONS = {
    "attitude": "Attitude on real recordings (BROAD)",
    "hinge": "Hinge angle on real recordings",
    "source_claim": "The source's claim, on simulated pMDI sessions",
    "sessions": "Phases, events, measures and mistakes on simulated sessions",
    "speed": "Speed and memory",
}
RESULTS = Path(__file__).with_name("RESULTS.md")


def main(wanted: list[str]) -> int:
    unknown = [name for name in wanted if name not in SECTIONS]
    if unknown:
        print(f"unknown section {unknown[0]}; expected {', '.join(SECTIONS)}", file=sys.stderr)
        return 2
    parts = [
        "# Results",
        "",
        "Written by `make validate`, never by hand. Every peer ran in the same run, on the same machine.",
        f"Python {platform.python_version()}, {platform.machine()}, {os.cpu_count()} cores.",
        "",
    ]
    for name in wanted or SECTIONS:
        start_s = time.perf_counter()
        tables = importlib.import_module(f"validation.{name}").tables()
        seconds = time.perf_counter() - start_s
        section = [f"## {SECTIONS[name]}", "", *(table.to_markdown() for table in tables)]
        print("\n".join(section), flush=True)
        print(f"({name}: {seconds:.0f} s)\n", flush=True)
        parts += section
    if not wanted:
        RESULTS.write_text("\n".join(parts), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
