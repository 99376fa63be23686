"""Time series of sessions on disk, so that drawing a session again computes nothing.

A cached file belongs to one session, one recording mounting and one version of the pipeline; the oldest go when the
space given to them is used up. Losing any of them costs a moment, never data.
"""

from __future__ import annotations

import os
import secrets
import shutil
from pathlib import Path


class SeriesCache:
    """Files below one folder: `<session>/<key>.npy`."""

    def __init__(self, root: Path, *, max_bytes: int) -> None:
        self._root = root
        self._max_bytes = max_bytes

    def path(self, session_id: str, key: str) -> Path:
        return self._root / session_id / f"{key}.npy"

    def find(self, session_id: str, key: str) -> Path | None:
        """The cached file, marked as used now, if there is one."""
        path = self.path(session_id, key)
        try:
            os.utime(path)
        except FileNotFoundError:
            return None
        return path

    def keep(self, session_id: str, key: str, content: bytes) -> Path:
        """Keep a file; a reader sees it whole or not at all."""
        path = self.path(session_id, key)
        path.parent.mkdir(parents=True, exist_ok=True)
        fresh = path.with_suffix(f".{secrets.token_hex(8)}.tmp")
        try:
            fresh.write_bytes(content)
            fresh.replace(path)
        finally:
            fresh.unlink(missing_ok=True)
        return path

    def drop(self, session_id: str) -> None:
        shutil.rmtree(self._root / session_id, ignore_errors=True)

    def trim(self) -> int:
        """Remove the longest unused files beyond the space given; returns how many."""
        found = sorted(
            ((entry.st_mtime, entry.st_size, path) for path in self._root.glob("*/*.npy") for entry in (path.stat(),)),
            reverse=True,
        )
        used, removed = 0, 0
        for _, size, path in found:
            used += size
            if used > self._max_bytes:
                path.unlink(missing_ok=True)
                removed += 1
        return removed
