"""The recordings' bytes on disk: compressed, named by their SHA-256, durable before anybody is told so.

A file is written under a name of its own in `incoming/`, synced, renamed to its place, and its folder synced; only then
may the database mention it. What a crash leaves in `incoming/` is removed at the next start.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import secrets
import shutil
import threading
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Self

import zstandard

from api.problems import DiskFullError

_LEVEL = 1
_BLOCK = 256 * 1024
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT)


@contextlib.contextmanager
def room_needed() -> Iterator[None]:
    """Tell a full disk as what it is."""
    try:
        yield
    except OSError as error:
        if error.errno in _NO_ROOM:
            raise DiskFullError from error
        raise


class Incoming:
    """A recording while it arrives: hashed and compressed as it comes, gone unless it is kept.

    `size` counts the bytes as they came; `sha256` is theirs as well.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / f"{secrets.token_hex(16)}.tmp"
        self.size = 0
        self._digest = hashlib.sha256()
        self._compressor = zstandard.ZstdCompressor(level=_LEVEL).compressobj()
        with room_needed():
            self._file = self.path.open("xb")
        self.head = b""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        self._file.close()
        self.path.unlink(missing_ok=True)

    def write(self, block: bytes) -> None:
        """Take the next bytes. Raises `DiskFullError`."""
        if len(self.head) < 64:
            self.head += block[:64]
        self.size += len(block)
        self._digest.update(block)
        with room_needed():
            self._file.write(self._compressor.compress(block))

    def sync(self) -> None:
        """All that came is on the disk. Raises `DiskFullError`."""
        with room_needed():
            self._file.write(self._compressor.flush())
            self._file.flush()
            os.fsync(self._file.fileno())

    @property
    def sha256(self) -> str:
        return self._digest.hexdigest()

    @property
    def digest(self) -> bytes:
        return self._digest.digest()


class RawFiles:
    """The recordings of all clinics, below one folder."""

    def __init__(self, root: Path, *, min_free_bytes: int) -> None:
        self._root = root
        self._incoming = root / "incoming"
        self._min_free_bytes = min_free_bytes
        self._locks = [threading.Lock() for _ in range(64)]
        self._incoming.mkdir(parents=True, exist_ok=True)

    def path(self, clinic_id: str, sha256: str) -> Path:
        return self._root / clinic_id / sha256[:2] / f"{sha256}.zst"

    @contextlib.contextmanager
    def held(self, sha256: str) -> Iterator[None]:
        """Nobody else keeps or erases these bytes within the block: file and row change together."""
        with self._locks[int(sha256[:8], 16) % len(self._locks)]:
            yield

    def receive(self) -> Incoming:
        """A place for a recording that is about to come. Raises `DiskFullError`."""
        self.require_room()
        return Incoming(self._incoming)

    def keep(self, incoming: Incoming, clinic_id: str) -> Path:
        """Move what came to its place, durably. Raises `DiskFullError`."""
        place = self.path(clinic_id, incoming.sha256)
        with room_needed():
            _make_durably(place.parent, self._root)
            incoming.sync()
            incoming.path.rename(place)
            _sync_folder(place.parent)
        return place

    def blocks(self, clinic_id: str, sha256: str) -> Iterator[bytes]:
        """The bytes as they came, in blocks. Raises `FileNotFoundError`."""
        with (
            self.path(clinic_id, sha256).open("rb") as file,
            zstandard.ZstdDecompressor().stream_reader(file, read_size=_BLOCK) as reader,
        ):
            while block := reader.read(_BLOCK):
                yield block

    def is_whole(self, clinic_id: str, sha256: str) -> bool:
        """Whether the file is there and its bytes still have the digest in its name."""
        digest = hashlib.sha256()
        try:
            for block in self.blocks(clinic_id, sha256):
                digest.update(block)
        except (OSError, zstandard.ZstdError):
            return False
        return digest.hexdigest() == sha256

    def erase(self, clinic_id: str, sha256: str) -> None:
        """Remove a recording, durably; that it is gone already is no error."""
        place = self.path(clinic_id, sha256)
        place.unlink(missing_ok=True)
        if place.parent.is_dir():
            _sync_folder(place.parent)

    def sweep(self) -> int:
        """Remove what broken uploads of an earlier run left; returns how many there were."""
        left = list(self._incoming.glob("*.tmp"))
        for path in left:
            path.unlink(missing_ok=True)
        return len(left)

    def kept(self) -> Iterator[tuple[str, str, Path]]:
        """(clinic, SHA-256, path) of every recording on the disk."""
        for path in self._root.glob("*/??/*.zst"):
            yield path.parent.parent.name, path.stem, path

    def require_room(self) -> None:
        """Raises `DiskFullError` when less is free than is to be kept free."""
        with room_needed():
            free = shutil.disk_usage(self._root).free
        if free < self._min_free_bytes:
            raise DiskFullError

    def try_writing(self) -> None:
        """Write, sync and remove a small file. Raises `DiskFullError` or `OSError`."""
        with Incoming(self._incoming) as probe:
            probe.write(os.urandom(4096))  # such as does not shrink
            probe.sync()


def write_once(path: Path, content: bytes) -> None:
    """Write a file that only its owner may read; whoever is first wins."""
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh = path.with_name(f"{path.name}.{secrets.token_hex(4)}")
    handle = os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(handle, "wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    try:
        os.link(fresh, path)
    except FileExistsError:
        pass
    finally:
        fresh.unlink()


def _make_durably(folder: Path, root: Path) -> None:
    """Make `folder` below `root`, syncing each folder that gained a child."""
    if folder.is_dir():
        return
    if folder.parent != root:
        _make_durably(folder.parent, root)
    folder.mkdir(exist_ok=True)
    _sync_folder(folder.parent)


def _sync_folder(folder: Path) -> None:
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
