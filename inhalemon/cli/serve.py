"""`inhalemon serve`: becomes the service, so that the library never imports it."""

from __future__ import annotations

import os
import sys

import typer


def add_to(app: typer.Typer) -> None:
    app.command(
        "serve",
        context_settings={"allow_extra_args": True, "ignore_unknown_options": True},
        add_help_option=False,
    )(serve)


def serve(context: typer.Context) -> None:
    """Start the review pages and the HTTP service (`python -m api serve`; options are handed on).

    The same process goes on as the service, so whatever is sent to it, the service gets.
    """
    os.execv(sys.executable, [sys.executable, "-m", "api", "serve", *context.args])
