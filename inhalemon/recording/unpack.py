"""Bytes of a recording file, unpacked in blocks, so that a small file cannot fill the memory."""

from __future__ import annotations

import gzip
import io
import zlib
from collections.abc import Iterator
from typing import TYPE_CHECKING, BinaryIO

from inhalemon.exceptions import RecordingError
from inhalemon.recording.layout import COMPRESSION_OF, MAX_UNPACKED_BYTES, suffix_of

if TYPE_CHECKING:
    from _typeshed import WriteableBuffer

BLOCK_BYTES = 2**19
# One byte of a hostile zstd frame can unpack to 32 KiB: feed it little at a time.
_ZSTD_FEED_BYTES = 512
_MAGIC = {b"\x1f\x8b": "gzip", b"\x28\xb5\x2f\xfd": "zstd", b"PAR1": "parquet"}


def kind_of(stream: BinaryIO, *, name: str) -> tuple[str, bytes]:
    """What is inside (`plain`, `gzip`, `zstd`, `parquet`), and the first bytes, already taken from the stream.

    The name's suffix decides; a name without a recording suffix leaves it to the first bytes.
    """
    head = stream.read(4)
    found = next((kind for magic, kind in _MAGIC.items() if head.startswith(magic)), "plain")
    suffix = suffix_of(name)
    wanted = COMPRESSION_OF[suffix] if suffix else found
    if wanted != found and head:
        raise RecordingError(
            "wrong_file_type",
            file=name,
            found=f"{found} content",
            wanted=f"{wanted} content, as {suffix} says",
            detail="Give the file the ending that fits its content",
        )
    return wanted, head


def unpacked_blocks(stream: BinaryIO, kind: str, head: bytes, *, file: str) -> Iterator[bytes]:
    """The unpacked bytes, block by block. Raises `RecordingError` (`too_large`, `bad_compression`)."""
    total = 0
    try:
        for block in _blocks(stream, kind, head):
            total += len(block)
            if total > MAX_UNPACKED_BYTES:
                raise too_large(file)
            yield block
    except (EOFError, gzip.BadGzipFile, zlib.error, _ZstdError) as error:
        raise RecordingError(
            "bad_compression",
            file=file,
            found=f"a broken {kind} stream ({error})",
            wanted="a whole one",
            detail="The file was cut short or damaged: copy it again",
        ) from error


def too_large(file: str) -> RecordingError:
    return RecordingError(
        "too_large",
        file=file,
        found=f"more than {MAX_UNPACKED_BYTES // 2**20} MiB unpacked",
        wanted=f"at most {MAX_UNPACKED_BYTES // 2**20} MiB",
        detail="Cut the recording into sessions",
    )


def _blocks(stream: BinaryIO, kind: str, head: bytes) -> Iterator[bytes]:
    if kind == "zstd":
        yield from _zstd_blocks(io.BufferedReader(_Rejoined(head, stream)))
        return
    source: BinaryIO | gzip.GzipFile = stream
    if kind == "gzip":
        source = gzip.GzipFile(fileobj=io.BufferedReader(_Rejoined(head, stream)), mode="rb")
    else:
        yield head + source.read(BLOCK_BYTES)
    while block := source.read(BLOCK_BYTES):
        yield block


class _ZstdError(Exception):
    """Stands for zstandard's own error, so that the package is imported only when it is needed."""


def _zstd_blocks(stream: BinaryIO) -> Iterator[bytes]:
    import zstandard  # noqa: PLC0415 - 10 ms that plain files need not pay

    context = zstandard.ZstdDecompressor()
    frame = context.decompressobj()
    pending = b""
    try:
        while feed := (pending or stream.read(_ZSTD_FEED_BYTES)):
            if frame.eof:
                frame = context.decompressobj()
            block = frame.decompress(feed)
            pending = frame.unused_data if frame.eof else b""
            if block:
                yield block
    except zstandard.ZstdError as error:
        raise _ZstdError(str(error)) from error
    if not frame.eof:
        raise _ZstdError("it ends in the middle of a frame")


class _Rejoined(io.RawIOBase):
    """A stream with the bytes that were taken from its front put back."""

    def __init__(self, head: bytes, stream: BinaryIO) -> None:
        self._head = head
        self._stream = stream

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: WriteableBuffer) -> int:
        view = memoryview(buffer)
        taken = self._head[: len(view)] or self._stream.read(len(view))
        self._head = self._head[len(taken) :]
        view[: len(taken)] = taken
        return len(taken)
