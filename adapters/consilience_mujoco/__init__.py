"""MuJoCo as an engine of Consilience."""

from consilience_mujoco.engine import MujocoEngine

__all__ = ["MujocoEngine"]
