"""Phases of a session: k-means on windows, the cheapest path over labels, boundaries on the full-rate signals."""

from inhalemon.stages.phases.find import find_phases

__all__ = ["find_phases"]
