"""The one table from exceptions to exit codes, and how a failure is told: one line on stderr."""

from __future__ import annotations

from typing import Final

import typer

from inhalemon.exceptions import DeviceError, LabelsError, RecordingError, RulesError, SettingsError, SimulationError

USAGE: Final = 2
UNUSABLE_RECORDING: Final = 3
BAD_SETTINGS: Final = 4
NOBODY_READS: Final = 1  # as typer says it when a write fails because the reader has closed the pipe

EXIT_CODES: Final[tuple[tuple[type[Exception], int], ...]] = (
    (RecordingError, UNUSABLE_RECORDING),
    (SettingsError, BAD_SETTINGS),
    (RulesError, BAD_SETTINGS),
    (DeviceError, BAD_SETTINGS),
    (LabelsError, USAGE),
    (SimulationError, USAGE),
    (OSError, USAGE),
)


def told(error: Exception) -> int:
    """Exit code of the error, which has been printed as one line on stderr."""
    if isinstance(error, OSError) and error.strerror:
        sentence = f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    else:
        sentence = str(error)
    tell(sentence)
    return next(code for kind, code in EXIT_CODES if isinstance(error, kind))


def tell(sentence: str) -> None:
    """Print one line on stderr."""
    typer.echo("inhalemon: " + " ".join(sentence.split()), err=True)
