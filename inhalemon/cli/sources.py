"""Which recordings are meant by the paths on the command line."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

STANDARD_INPUT = "-"


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
    from inhalemon.recording.layout import MAX_UNPACKED_BYTES

    found: dict[str, Source] = {}
    for path in paths:
        if path == STANDARD_INPUT:
            # One byte more than a recording may have, so that the reader sees what is too large.
            found[path] = Source("stdin", sys.stdin.buffer.read(MAX_UNPACKED_BYTES + 1))
        elif os.path.isdir(path):
            inside = {name: Source(name) for name in _walked(path)}
            if not inside:
                raise FileNotFoundError(0, "no recordings in this folder", path)
            found.update(inside)
        else:
            found[path] = Source(path)
    return list(found.values())


def _walked(folder: str) -> Iterator[str]:
    from inhalemon.recording import is_recording_file

    for place, folders, files in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        yield from (
            os.path.join(place, name) for name in sorted(files) if is_recording_file(name) and not name.startswith(".")
        )
