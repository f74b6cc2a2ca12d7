"""Exudyn as an engine of Consilience."""

from consilience_exudyn.engine import ExudynEngine

__all__ = ["ExudynEngine"]
