"""The verbs put together."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import Annotated

import typer

from inhalemon import __version__
from inhalemon.cli import calibrate, check, convert, evaluate, report, rules, score, serve, simulate, track
from inhalemon.cli.failures import NOBODY_READS, told
from inhalemon.exceptions import InhalemonError

app = typer.Typer(
    name="inhalemon",
    help="How an inhaler was used, from two small inertial sensors. Decision support for trained staff.",
    epilog="Exit codes: 0 done, whatever the score; 2 usage; 3 some recording could not be used; "
    "4 bad settings or rules.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(is_asked: bool) -> None:
    if is_asked:
        typer.echo(f"inhalemon {__version__}")
        raise typer.Exit


@app.callback()
def inhalemon(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """How an inhaler was used, from two small inertial sensors. Decision support for trained staff."""


for _verb in (score, check, report, simulate, evaluate, track, calibrate, rules, convert, serve):
    _verb.add_to(app)


def run(arguments: Sequence[str] | None = None) -> int:
    """Exit code of `inhalemon ARGUMENTS`; errors made on purpose become one line on stderr."""
    try:
        try:
            app(args=arguments, prog_name="inhalemon")
        except SystemExit as ended:
            code = ended.code
        except (InhalemonError, OSError) as error:
            if isinstance(error, BrokenPipeError):
                raise
            code = told(error)
        sys.stdout.flush()
    except BrokenPipeError:
        # The reader has gone, as in `| head`. What is still buffered must not complain when Python shuts down.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return NOBODY_READS
    return code if isinstance(code, int) else 0
