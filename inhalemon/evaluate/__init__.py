"""Reports against labels: how often each rule is right, how far boundaries and measures are off.

Everything here is a pure function of values; `inhalemon evaluate` reads the files and prints the result.
"""

from __future__ import annotations

from inhalemon.evaluate.agreement import Agreement, agreement
from inhalemon.evaluate.compare import Evaluation, evaluate
from inhalemon.evaluate.documents import Session, session_from_labels, session_from_report

__all__ = [
    "Agreement",
    "Evaluation",
    "Session",
    "agreement",
    "evaluate",
    "session_from_labels",
    "session_from_report",
]
