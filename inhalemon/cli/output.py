"""Where results go: standard output, or a file that is whole or absent."""

from __future__ import annotations

import contextlib
import errno
import os
import sys
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

PIPED_WIDTH = 132
Result = TypeVar("Result")


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
    with _beside(path) as (handle, name):
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        umask = os.umask(0)
        os.umask(umask)
        os.chmod(name, 0o666 & ~umask)
        os.replace(name, path)


def check_writable(path: Path) -> None:
    """Raises the `OSError` that writing the file would raise, before there is anything to write."""
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    with _beside(path) as (handle, _):
        os.close(handle)


@contextlib.contextmanager
def _beside(path: Path) -> Iterator[tuple[int, str]]:
    """A new file beside the path, which is gone at the end unless it was renamed; errors name the path itself."""
    name = None
    try:
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        yield handle, name
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        if name is not None:
            with contextlib.suppress(FileNotFoundError):
                os.unlink(name)


def console(*, stderr: bool = False, is_file: bool = False) -> Console:
    """A rich console; plain and of a fixed width when what it writes is for no terminal, uncoloured under NO_COLOR."""
    from rich.console import Console

    stream = sys.stderr if stderr else sys.stdout
    is_terminal = stream.isatty() and not is_file
    return Console(
        stderr=stderr, highlight=False, force_terminal=is_terminal or None, width=None if is_terminal else PIPED_WIDTH
    )


def table(title: str, *columns: str) -> Table:
    """A table with names at the left and numbers at the right."""
    from rich import box
    from rich.table import Table

    made = Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, pad_edge=False)
    for number, column in enumerate(columns):
        made.add_column(column, justify="right" if number else "left", no_wrap=True)
    return made


def progress(results: Iterable[Result], *, n_done: int, n: int, doing: str) -> Iterator[Result]:
    """The results as they come, with a bar on stderr while it is a terminal."""
    if n <= 1 or not sys.stderr.isatty():
        yield from results
        return
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn(doing), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    # Lines told meanwhile go through the bar, so that neither overwrites the other.
    with Progress(*columns, console=console(stderr=True), transient=True) as bar:
        task = bar.add_task(doing, total=n, completed=n_done)
        for result in results:
            yield result
            bar.advance(task)
