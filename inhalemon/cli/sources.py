"""Which recordings are meant by the paths on the command line."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

STANDARD_INPUT = "-"
SUFFIXES = (".csv", ".csv.gz", ".csv.zst", ".parquet")


@dataclass(frozen=True, slots=True)
class Source:
    """One recording: a file, or bytes that came by standard input."""

    name: str
    data: bytes | None = None


def sources(paths: Iterable[str]) -> list[Source]:
    """The recordings, in the order given; folders are walked by name, hidden files left out, nothing taken twice.

    What is named is taken whatever its suffix; a sidecar or a `*.truth.json` is never a recording of its own.
    Raises `FileNotFoundError` for a folder without recordings.
    """
    found: dict[str, Source] = {}
    for path in paths:
        if path == STANDARD_INPUT:
            found[path] = Source(path, sys.stdin.buffer.read())
        elif os.path.isdir(path):
            inside = {name: Source(name) for name in _walked(path)}
            if not inside:
                raise FileNotFoundError(0, f"no recordings found ({', '.join(SUFFIXES)})", path)
            found.update(inside)
        else:
            found[path] = Source(path)
    return list(found.values())


def session_stem(name: str) -> str:
    """A recording's name without folders and format suffixes: its session id when nothing else says one."""
    base = Path(name).name
    for suffix in (".gz", ".zst", ".csv", ".parquet"):
        base = base.removesuffix(suffix)
    return base


def _walked(folder: str) -> Iterator[str]:
    for place, folders, files in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        yield from (
            os.path.join(place, name) for name in sorted(files) if name.endswith(SUFFIXES) and not name.startswith(".")
        )
