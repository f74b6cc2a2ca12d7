"""Adapter of DART (dartpy) for Consilience."""

from consilience_dart.engine import DartEngine

__all__ = ["DartEngine"]
