"""Simulated sessions with exact truth, for tests, validation and the sample data. Simulated is not real: say so."""

from inhalemon.simulate.mistakes import MISTAKES, draw_mistakes
from inhalemon.simulate.sensors import HARSH, PERFECT, TYPICAL, Conditions
from inhalemon.simulate.session import simulate_session
from inhalemon.simulate.subjects import N_SUBJECTS, Subject, subject
from inhalemon.simulate.truth import Truth

__all__ = [
    "HARSH",
    "MISTAKES",
    "N_SUBJECTS",
    "PERFECT",
    "TYPICAL",
    "Conditions",
    "Subject",
    "Truth",
    "draw_mistakes",
    "simulate_session",
    "subject",
]
