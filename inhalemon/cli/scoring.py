"""What a worker does with one recording. Importing this module imports the whole pipeline."""

from __future__ import annotations

from dataclasses import dataclass

import orjson

from inhalemon import report as documents
from inhalemon.cli.options import read_source
from inhalemon.cli.sources import Source
from inhalemon.devices import Device
from inhalemon.exceptions import InhalemonError, RecordingError
from inhalemon.pipeline import score_recording
from inhalemon.rules import RuleSet
from inhalemon.settings import Settings


@dataclass(frozen=True, slots=True)
class Outcome:
    """A recording's report, or why there is none, as a JSON document on one line."""

    file: str
    document: bytes
    failure: str | None = None  # the sentence for stderr


@dataclass(frozen=True, slots=True)
class Scoring:
    """Scores any source the same way; travels to the workers."""

    device: Device | None
    settings: Settings
    rules: RuleSet

    def __call__(self, source: Source) -> Outcome:
        """Outcome of one recording; whatever goes wrong with it stays its own."""
        try:
            recording = read_source(source, self.device)
            report = score_recording(recording, settings=self.settings, rules=self.rules, device=self.device)
            return Outcome(source.name, documents.to_json(report))
        except InhalemonError as error:
            return _failed(source, error)
        except MemoryError:
            return _failed(source, _internal(source, "out_of_memory", "memory ran out"))
        except Exception as error:  # a fault of ours in one file must not cost the others
            found = f"{type(error).__name__}: {error}"
            return _failed(source, _internal(source, "internal_error", found))


def crashed(source: Source, exit_code: int | None) -> Outcome:
    """Outcome of a recording whose worker died."""
    return _failed(source, _internal(source, "worker_died", f"exit code {exit_code}"))


def _internal(source: Source, code: str, found: str) -> RecordingError:
    return RecordingError(code, file=source.name, found=found, detail="Please report this recording as a fault")


def _failed(source: Source, error: InhalemonError) -> Outcome:
    document = orjson.dumps(documents.error_to_dict(error, file=source.name))
    return Outcome(source.name, document, " ".join(str(error).split()))
