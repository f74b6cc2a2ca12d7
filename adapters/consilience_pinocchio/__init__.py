"""Adapter of Pinocchio: trees of elementary joints by `aba`, loops by `constraintDynamics` on split bodies."""

from consilience_pinocchio.engine import PinocchioEngine

__all__ = ["PinocchioEngine"]
