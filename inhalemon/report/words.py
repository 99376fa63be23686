"""What tables and pages say of every report."""

from __future__ import annotations

from typing import Final

from inhalemon.values import Grade

DISCLAIMER: Final = (
    "Decision support for trained staff; not a medical device. It never tells a patient to change treatment."
)
INFERRED: Final = (
    "The phases “exhale” and “breath hold” are inferred from stillness: the sensors see the inhaler, not the breath."
)
GRADES: Final = {
    Grade.CORRECT: "correct",
    Grade.MINOR_MISTAKES: "minor mistakes",
    Grade.MAJOR_MISTAKES: "major mistakes",
    Grade.CRITICAL_MISTAKES: "critical mistakes",
    Grade.NOT_ASSESSABLE: "not assessable",
}
