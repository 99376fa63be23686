"""Recordings as they arrive: a raw body, or the parts of a form, streamed to disk with a limit on size and on silence.

Nothing here is kept in memory but the small parts; what is not kept in the end is removed, however the request ends.
"""

from __future__ import annotations

import asyncio
import base64
import binascii
import contextlib
import hashlib
import hmac
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from pathlib import PurePosixPath

from fastapi import Request
from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser, parse_options_header
from starlette.requests import ClientDisconnect

from api.files import Incoming, RawFiles
from api.problems import BadRequestError, InvalidError, TooLargeError, TooSlowError, UnsupportedTypeError
from api.settings import ServiceSettings

_MAX_FIELD = 1024 * 1024
_FIELDS = ("metadata", "device", "patient_ref", "recorded_at", "session_id")
SUFFIXES = (".csv", ".csv.gz", ".csv.zst", ".parquet")
_SUFFIX_OF_TYPE = {
    "text/csv": ".csv",
    "application/csv": ".csv",
    "text/plain": ".csv",
    "application/gzip": ".csv.gz",
    "application/x-gzip": ".csv.gz",
    "application/zstd": ".csv.zst",
    "application/x-zstd": ".csv.zst",
    "application/vnd.apache.parquet": ".parquet",
    "application/x-parquet": ".parquet",
}
_ANY_TYPE = ("application/octet-stream", "application/vnd.ms-excel", "")  # browsers on Windows call a CSV the second
_SUFFIX_OF_ENCODING = {"gzip": ".csv.gz", "zstd": ".csv.zst", "identity": None}


@dataclass(slots=True)
class Received:
    """One recording that came: where it is, and how its sender called it."""

    incoming: Incoming
    file_name: str | None
    content_type: str
    repr_digest: str | None
    suffix: str = ""


@dataclass(slots=True)
class Upload:
    """All that one request brought."""

    recordings: list[Received] = field(default_factory=list)
    fields: dict[str, list[bytes]] = field(default_factory=dict)
    body_digest: bytes = b""


@contextlib.asynccontextmanager
async def received(request: Request, files: RawFiles, settings: ServiceSettings) -> AsyncIterator[Upload]:
    """What the request brings. The recordings are gone at the end of the block unless they were kept.

    Raises `TooLargeError`, `TooSlowError`, `UnsupportedTypeError`, `DiskFullError`, `BadRequestError`, `InvalidError`.
    """
    announced = request.headers.get("content-length", "")
    if announced.isdigit() and int(announced) > settings.max_upload_bytes:
        raise _too_large(settings)
    kind, options = parse_options_header(request.headers.get("content-type"))
    with contextlib.ExitStack() as stack:
        if kind == b"multipart/form-data":
            form = _Form(files, stack, settings)
            upload = await _read_form(request, options.get(b"boundary", b""), form, settings)
        else:
            upload = await _read_raw(request, kind.decode("latin-1"), files, stack, settings)
        _check(upload, request.headers.get("repr-digest"))
        yield upload


# ------------------------------------------------------------------------------------------ the body


async def _body(request: Request, settings: ServiceSettings) -> AsyncIterator[bytes]:
    """The body's blocks, within the limits on size and time."""
    total = 0
    now_s = asyncio.get_running_loop().time
    last_s = now_s() + settings.upload_deadline_s
    try:
        async with asyncio.timeout_at(min(last_s, now_s() + settings.upload_stall_s)) as patience:
            async for block in request.stream():
                total += len(block)
                if total > settings.max_upload_bytes:
                    raise _too_large(settings)
                yield block
                patience.reschedule(min(last_s, now_s() + settings.upload_stall_s))
    except TimeoutError as error:
        raise TooSlowError(
            f"Nothing came for {settings.upload_stall_s:g} s, or not all within {settings.upload_deadline_s:g} s."
        ) from error
    except ClientDisconnect as error:
        raise BadRequestError("The connection closed before the upload was complete.") from error


def _too_large(settings: ServiceSettings) -> TooLargeError:
    return TooLargeError(f"An upload may have {settings.max_upload_bytes} bytes; compress it, or send fewer files.")


async def _read_raw(
    request: Request, content_type: str, files: RawFiles, stack: contextlib.ExitStack, settings: ServiceSettings
) -> Upload:
    encoding = request.headers.get("content-encoding", "identity").strip().lower()
    if encoding not in _SUFFIX_OF_ENCODING:
        raise UnsupportedTypeError(f"Content-Encoding is {encoding!r}; expected gzip, zstd or none.")
    name = request.query_params.get("file_name")
    suffix = _SUFFIX_OF_ENCODING[encoding] or _suffix(name, content_type)
    incoming = stack.enter_context(files.receive())
    async for block in _body(request, settings):
        incoming.write(block)
    one = Received(incoming, name, content_type, request.headers.get("repr-digest"), suffix)
    return Upload([one], body_digest=incoming.digest)


async def _read_form(request: Request, boundary: bytes, form: _Form, settings: ServiceSettings) -> Upload:
    if not boundary:
        raise BadRequestError("The form has no boundary in its Content-Type.")
    digest = hashlib.sha256()
    parser = MultipartParser(
        boundary,
        {
            "on_part_begin": form.on_part_begin,
            "on_header_field": form.on_header_field,
            "on_header_value": form.on_header_value,
            "on_header_end": form.on_header_end,
            "on_headers_finished": form.on_headers_finished,
            "on_part_data": form.on_part_data,
            "on_part_end": form.on_part_end,
            "on_end": form.on_end,
        },
    )
    try:
        async for block in _body(request, settings):
            digest.update(block)
            parser.write(block)
        parser.finalize()
    except FormParserError as error:
        raise BadRequestError(f"The form cannot be read: {error}.") from error
    if not form.is_whole:
        raise BadRequestError("The form ends before its last boundary.")
    form.upload.body_digest = digest.digest()
    return form.upload


class _Form:
    """Takes what the form's parser finds: recordings to disk, small fields to memory."""

    def __init__(self, files: RawFiles, stack: contextlib.ExitStack, settings: ServiceSettings) -> None:
        self.upload = Upload()
        self.is_whole = False
        self._files = files
        self._stack = stack
        self._max_files = settings.max_files_per_upload
        self._headers: dict[str, str] = {}
        self._name = b""
        self._value = b""
        self._incoming: Incoming | None = None
        self._field: bytearray | None = None

    def on_part_begin(self) -> None:
        self._headers = {}

    def on_header_field(self, data: bytes, start: int, end: int) -> None:
        self._name += data[start:end]

    def on_header_value(self, data: bytes, start: int, end: int) -> None:
        self._value += data[start:end]

    def on_header_end(self) -> None:
        self._headers[self._name.decode("latin-1").lower()] = self._value.decode("latin-1")
        self._name = self._value = b""

    def on_headers_finished(self) -> None:
        _, options = parse_options_header(self._headers.get("content-disposition"))
        name = options.get(b"name", b"").decode("utf-8", "replace")
        if name == "recording":
            if len(self.upload.recordings) >= self._max_files:
                raise TooLargeError(f"A request may bring {self._max_files} files; send the others in another one.")
            content_type = parse_options_header(self._headers.get("content-type"))[0].decode("latin-1")
            # A header is Latin-1 on the wire; browsers and curl write file names in UTF-8.
            file_name = options.get(b"filename", b"").decode("utf-8", "replace") or None
            incoming = self._stack.enter_context(self._files.receive())
            self._incoming = incoming
            one = Received(incoming, file_name, content_type, self._headers.get("repr-digest"))
            one.suffix = _suffix(file_name, content_type)
            self.upload.recordings.append(one)
        elif name in _FIELDS:
            self._field = bytearray()
            self.upload.fields.setdefault(name, [])
            self._field_name = name
        else:
            raise InvalidError(f"The form has a part named {name!r}; expected recording or {', '.join(_FIELDS)}.")

    def on_part_data(self, data: bytes, start: int, end: int) -> None:
        if self._incoming is not None:
            self._incoming.write(data[start:end])
        elif self._field is not None:
            self._field += data[start:end]
            if len(self._field) > _MAX_FIELD:
                raise TooLargeError(f"{self._field_name} is over {_MAX_FIELD} bytes.")

    def on_part_end(self) -> None:
        if self._field is not None:
            self.upload.fields[self._field_name].append(bytes(self._field))
        self._incoming = self._field = None

    def on_end(self) -> None:
        self.is_whole = True


# ------------------------------------------------------------------------------------------ checks


def _suffix(file_name: str | None, content_type: str) -> str:
    """The recording's suffix, by its name or else its type. Raises `UnsupportedTypeError`."""
    for suffix in SUFFIXES:
        if file_name is not None and PurePosixPath(file_name.lower()).name.endswith(suffix):
            return suffix
    if content_type.lower() in _SUFFIX_OF_TYPE:
        return _SUFFIX_OF_TYPE[content_type.lower()]
    is_named_otherwise = file_name is not None and PurePosixPath(file_name).suffix != ""
    if content_type.lower() in _ANY_TYPE and not is_named_otherwise:
        return ""  # the reader looks at the first bytes
    raise UnsupportedTypeError(
        f"The type is {content_type or 'not given'!r}; expected {', '.join(SUFFIXES)} or their media types."
    )


def _check(upload: Upload, repr_digest: str | None) -> None:
    if not upload.recordings:
        raise InvalidError("There is no recording: send a part named `recording`, or the recording as the body.")
    if upload.recordings[0].incoming.size == 0 and len(upload.recordings) == 1:
        raise InvalidError("The recording is empty.", code="empty")
    for each in upload.recordings:
        if each.repr_digest is not None:
            _check_digest(each.repr_digest, [each.incoming.digest])
    if repr_digest is not None:
        # Of a form it may be that of the whole body, or that of the one recording in it.
        one = [upload.recordings[0].incoming.digest] if len(upload.recordings) == 1 else []
        _check_digest(repr_digest, [upload.body_digest, *one])


def _check_digest(header: str, digests: list[bytes]) -> None:
    """Raises `BadRequestError` unless the header's SHA-256 is one of `digests`; other algorithms are let be."""
    for part in header.split(","):
        name, _, value = part.strip().partition("=")
        if name.strip().lower() != "sha-256":
            continue
        try:
            given = base64.b64decode(value.strip().strip(":"), validate=True)
        except (ValueError, binascii.Error) as error:
            raise BadRequestError("Repr-Digest is not as RFC 9530 has it: sha-256=:BASE64:.") from error
        if not any(hmac.compare_digest(given, digest) for digest in digests):
            raise BadRequestError("The bytes differ from their Repr-Digest: they were changed on the way; send again.")
