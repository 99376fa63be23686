"""`inhalemon serve`: the service as a child process, so that the library never imports it."""

from __future__ import annotations

import signal
import subprocess
import sys
from types import FrameType

import typer


def add_to(app: typer.Typer) -> None:
    app.command(
        "serve",
        context_settings={"allow_extra_args": True, "ignore_unknown_options": True},
        add_help_option=False,
    )(serve)


def serve(context: typer.Context) -> None:
    """Start the review pages and the HTTP service (`python -m api serve`; options are handed on).

    What a supervisor or a closing terminal sends here is handed on too, and the service ends in its own good order.
    """
    children: list[subprocess.Popen[bytes]] = []

    def hand_on(number: int, _frame: FrameType | None) -> None:
        for child in children:
            child.send_signal(number)

    def leave_to_child(_number: int, _frame: FrameType | None) -> None:
        """The terminal sends Ctrl-C to the child as well."""

    # Handlers, unlike ignored signals, are not handed down; and what is ignored here (nohup) stays so.
    for number, handler in ((signal.SIGTERM, hand_on), (signal.SIGHUP, hand_on), (signal.SIGINT, leave_to_child)):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, handler)
    children.append(subprocess.Popen([sys.executable, "-m", "api", "serve", *context.args]))
    code = children[0].wait()
    raise typer.Exit(code if code >= 0 else 128 - code)
