"""Springs between points and constant loads: DART has none of its own, so they are external forces on body nodes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from consilience.mechanism import GROUND, Load, Spring
from consilience.spatial import Array
from consilience_dart.translation import Model

Apply = Callable[[], None]
ZERO = np.zeros(3)


class _End:
    """One end of a spring: a point of a body node (None: of the ground, fixed in the world)."""

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
        """World position of the point."""
        if self.node is None:
            return self.offset
        return np.asarray(self.node.getWorldTransform().multiply(self.offset))

    def velocity(self) -> Array:
        """World velocity of the point."""
        return ZERO if self.node is None else np.asarray(self.node.getLinearVelocity(self.offset))

    def push(self, force: Array) -> None:
        """Apply a force in world axes at the point."""
        if self.node is not None:
            self.node.addExtForce(force, self.offset, False, True)


def _length(ends: tuple[_End, _End]) -> tuple[float, Array]:
    """Length and direction (predecessor to successor) of a spring."""
    d = ends[1].position() - ends[0].position()
    length = float(d @ d) ** 0.5
    return length, d / length


def _ends(model: Model, spring: Spring) -> tuple[_End, _End]:
    return (
        _End(model, spring.predecessor, spring.point_predecessor),
        _End(model, spring.successor, spring.point_successor),
    )


def _spring(model: Model, spring: Spring) -> Apply:
    ends = _ends(model, spring)

    def apply() -> None:
        """Push both ends along the line between them."""
        length, e = _length(ends)
        rate = float(e @ (ends[1].velocity() - ends[0].velocity()))
        force = (spring.stiffness * (length - spring.free_length) + spring.damping * rate) * e
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
        return lambda: node.addExtTorque(vector, local)
    return lambda: node.addExtForce(vector, offset, local, True)


def appliers(model: Model) -> list[Apply]:
    """Functions that add the forces of springs and loads at the skeleton's present state, one for each element."""
    return [
        *(_spring(model, spring) for spring in model.mechanism.springs),
        *(_load(model, load) for load in model.mechanism.loads if load.body != GROUND),
    ]


def spring_energy(model: Model) -> float:
    """Potential energy in J of the springs between points at the skeleton's present state."""
    return sum(0.5 * s.stiffness * (_length(_ends(model, s))[0] - s.free_length) ** 2 for s in model.mechanism.springs)
