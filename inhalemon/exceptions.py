"""Every exception inhalemon raises.

They know nothing of exit codes or HTTP: the command line and the service each keep one table that translates.
"""

from __future__ import annotations

import functools
from typing import Any


class InhalemonError(Exception):
    """Base of every error that inhalemon raises on purpose."""


class RecordingError(InhalemonError):
    """A recording that cannot be used: where, what was found, what was wanted, what to do.

    `code` is stable and machine readable (`wrong_header`, `not_a_number`, `too_short`, ...); `line` counts from 1 and
    includes the header; `detail` says what to do.
    """

    def __init__(
        self,
        code: str,
        *,
        file: str | None = None,
        line: int | None = None,
        column: str | None = None,
        found: str | None = None,
        wanted: str | None = None,
        detail: str | None = None,
    ) -> None:
        self.code = code
        self.file = file
        self.line = line
        self.column = column
        self.found = found
        self.wanted = wanted
        self.detail = detail
        super().__init__(self._sentence())

    def _sentence(self) -> str:
        where = self.file or "recording"
        if self.line is not None:
            where += f" line {self.line}"
        subject = self.column or self.code.replace("_", " ")
        sentence = f"{where}: {subject}"
        if self.found is not None:
            sentence += f" is {self.found}"
        if self.wanted is not None:
            sentence += f"; expected {self.wanted}"
        if self.detail:
            sentence += f". {self.detail}"
        return sentence

    def in_file(self, file: str) -> RecordingError:
        """The same, said of this file."""
        return RecordingError(self.code, **self._fields() | {"file": file})

    def _fields(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in ("file", "line", "column", "found", "wanted", "detail")}

    def __reduce__(self) -> tuple[object, ...]:
        # BaseException pickles its positional arguments alone; a worker process must hand all fields back.
        return (functools.partial(RecordingError, self.code, **self._fields()), ())


class SettingsError(InhalemonError):
    """Settings that cannot be used: an unknown name, a wrong type, or a value out of its range."""


class RulesError(InhalemonError):
    """A rule file that cannot be used: names the file, the rule, the field, what was found and what was wanted."""


class DeviceError(InhalemonError):
    """A device profile that is unknown or cannot be used."""


class LabelsError(InhalemonError):
    """A label file that cannot be used, or labels and reports that do not belong together."""


class SimulationError(InhalemonError):
    """A session that cannot be simulated: an unknown device, mistake, profile or rate, or mistakes that clash."""
