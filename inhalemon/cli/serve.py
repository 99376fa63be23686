"""`inhalemon serve`: the service as a child process, so that the library never imports it."""

from __future__ import annotations

import subprocess
import sys

import typer


def add_to(app: typer.Typer) -> None:
    app.command(
        "serve",
        context_settings={"allow_extra_args": True, "ignore_unknown_options": True},
        add_help_option=False,
    )(serve)


def serve(context: typer.Context) -> None:
    """Start the review pages and the HTTP service (`python -m api serve`; options are handed on)."""
    child = subprocess.Popen([sys.executable, "-m", "api", "serve", *context.args])
    while True:
        try:
            raise typer.Exit(child.wait())
        except KeyboardInterrupt:
            continue  # the terminal has sent it to the child too, which ends in its own good order
