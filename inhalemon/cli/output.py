"""Where results go: standard output, or a file that is whole or absent."""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console


def write(text: str | bytes, out: Path | None) -> None:
    """Write to the file `out`, whole or not at all, or to standard output when there is none."""
    data = text.encode() if isinstance(text, str) else text
    if out is None:
        sys.stdout.flush()
        sys.stdout.buffer.write(data)
        sys.stdout.buffer.flush()
    else:
        write_whole(data, out)


def write_whole(data: bytes, path: Path) -> None:
    """Write a file beside its name and rename it, so that a reader or a kill never sees half of it."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        umask = os.umask(0)
        os.umask(umask)
        os.chmod(name, 0o666 & ~umask)
        os.replace(name, path)
    except BaseException:
        os.unlink(name)
        raise


def console(*, stderr: bool = False) -> Console:
    """A rich console; plain when its stream is no terminal or NO_COLOR is set."""
    from rich.console import Console

    return Console(stderr=stderr, highlight=False, soft_wrap=False)
