"""The command line: one small module a verb, each loading what it needs when it is called.

Nothing heavy is imported here, so that `inhalemon --help` answers at once.
"""

from __future__ import annotations

from inhalemon.cli.app import app, run

__all__ = ["app", "run"]
