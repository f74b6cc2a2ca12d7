"""Springs between points, and loads, as external forces on body nodes: DART has no such elements.

`Forces` holds them together with the efforts in joint coordinates.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from consilience.mechanism import GROUND, Array, Function, Load, Spring, spring_force
from consilience_dart.efforts import dampers, efforts, exert
from consilience_dart.translation import Model

Apply = Callable[[float], None]
"""Adds a force at a time in s to the body nodes of a skeleton."""

ZERO = np.zeros(3)


class _End:
    """End of a spring: a point of a body node, or of the ground (`node` is None)."""

    def __init__(self, model: Model, body: str, point: Array) -> None:
        index = model.mechanism.body_index[body]
        self.node: Any = None
        self.offset = point
        if index >= 0:
            carrier = model.carriers[index]
            frame = model.tree.links[carrier].body_frame
            self.node = model.nodes[carrier]
            self.offset = frame.p + frame.R @ point

    def position(self) -> Array:
        """World position of the point in m, shape (3,)."""
        if self.node is None:
            return self.offset
        return np.asarray(self.node.getWorldTransform().multiply(self.offset))

    def velocity(self) -> Array:
        """World velocity of the point in m/s, shape (3,)."""
        return ZERO if self.node is None else np.asarray(self.node.getLinearVelocity(self.offset))

    def push(self, force: Array) -> None:
        """Apply a force in world axes at the point."""
        if self.node is not None:
            self.node.addExtForce(force, self.offset, False, True)


def _factor(history: Function | None, t: float, otherwise: float) -> float:
    """Value of a function at the time t, or `otherwise` where there is no function."""
    return otherwise if history is None else float(history.at(t)[0])


def _length(ends: tuple[_End, _End]) -> float:
    """Length in m of a spring."""
    d = ends[1].position() - ends[0].position()
    return float(d @ d) ** 0.5


def _ends(model: Model, spring: Spring) -> tuple[_End, _End]:
    return (
        _End(model, spring.predecessor, spring.point_predecessor),
        _End(model, spring.successor, spring.point_successor),
    )


def _spring(model: Model, spring: Spring) -> Apply:
    ends = _ends(model, spring)

    def apply(t: float) -> None:
        """Apply the force of the spring to both ends, along the line between them."""
        d, v = ends[1].position() - ends[0].position(), ends[1].velocity() - ends[0].velocity()
        force = spring_force(spring.law, _factor(spring.actuator, t, 0.0), d, v)
        ends[0].push(force)
        ends[1].push(-force)

    return apply


def _load(model: Model, load: Load) -> Apply:
    carrier = model.carriers[model.mechanism.body_index[load.body]]
    node, frame = model.nodes[carrier], model.tree.links[carrier].body_frame
    local = load.frame == "body"
    vector = frame.R @ load.vector if local else load.vector
    offset = frame.p + frame.R @ load.point
    if load.kind == "torque":
        return lambda t: node.addExtTorque(_factor(load.history, t, 1.0) * vector, local)
    return lambda t: node.addExtForce(_factor(load.history, t, 1.0) * vector, offset, local, True)


class Forces:
    """All forces on a skeleton but gravity and those of DART's own joint springs.

    Attributes
    ----------
    integrals : ndarray, shape (n_controls,)
        Integrals of the controllers, updated by the integrator of a motion.
    """

    def __init__(self, model: Model) -> None:
        self.integrals = np.zeros(len(model.mechanism.controls))
        self._model = model
        self._targets = [(model.axes[c.joint, c.coordinate], c.target) for c in model.mechanism.controls]
        self._efforts = efforts(model, self.integrals)
        self._dampers = dampers(model, self._efforts)
        self._pushes: list[Apply] = [
            *(_spring(model, spring) for spring in model.mechanism.springs),
            *(_load(model, load) for load in model.mechanism.loads if load.body != GROUND),
        ]

    def apply(self, t: float) -> Array:
        """Replace the forces on the skeleton by those at its present state and the time t in s.

        Returns
        -------
        ndarray, shape (n,)
            Forces of the joints, which DART's inverse dynamics overwrites in the skeleton.
        """
        self._model.skeleton.clearExternalForces()
        for push in self._pushes:
            push(t)
        if not self._efforts:
            return np.zeros(self._model.skeleton.getNumDofs())
        return exert(self._model, self._efforts, self._dampers, t)

    def errors(self, t: float) -> Array:
        """Return the rates of the integrals, ``target(t) - q``, at the skeleton's present state."""
        return np.array([float(target.at(t)[0]) - axis.value for axis, target in self._targets])

    def __bool__(self) -> bool:
        """Whether there are any forces to apply."""
        return bool(self._pushes or self._efforts)


def spring_energy(model: Model) -> float:
    """Return the potential energy in J of the springs between points at the skeleton's present state."""
    return sum(0.5 * s.stiffness * (_length(_ends(model, s)) - s.free_length) ** 2 for s in model.mechanism.springs)
