"""Which session a recording file holds, without reading its samples."""

from __future__ import annotations

from pathlib import Path

from inhalemon.exceptions import RecordingError
from inhalemon.recording.layout import session_of, suffix_of
from inhalemon.recording.parquet import embedded_sidecar
from inhalemon.recording.reader import sidecar_beside
from inhalemon.recording.sidecar import sidecar_from_json


def session_id_of(path: str | Path) -> str:
    """The session id that a report of this file carries: the sidecar's, or the file's stem."""
    path = Path(path)
    try:
        embedded = embedded_sidecar(path) if suffix_of(path.name) == ".parquet" else None
        sidecar = sidecar_from_json(embedded, file=str(path)) if embedded is not None else sidecar_beside(path)
    except RecordingError:
        sidecar = None  # reading the file will tell what is wrong
    return (sidecar.session_id if sidecar else None) or session_of(path.name)
