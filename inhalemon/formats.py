"""The names and versions of the documents that are written and read."""

from __future__ import annotations

from typing import Final

RECORDING_FORMAT: Final = "inhalemon-recording/1"
REPORT_FORMAT: Final = "inhalemon-report/1"
ERROR_FORMAT: Final = "inhalemon-error/1"
LABELS_FORMAT: Final = "inhalemon-labels/1"
RULES_FORMAT: Final = "inhalemon-rules/1"
EVALUATION_FORMAT: Final = "inhalemon-evaluation/1"
