"""Applied forces of a mechanism as wrenches on its bodies, in plain NumPy.

A wrench is a force in N and a torque in N m about the origin of the body, in axes of the world. Beside each sum of
wrenches stands its *size*: the sum of the lengths of all terms, before anything cancels. Rounding errors of the sum are
in proportion to the size.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from consilience.mechanism.elements import friction_law, spring_force
from consilience.mechanism.joint_rows import joint_frames
from consilience.mechanism.model import GROUND, Mechanism, State
from consilience.mechanism.observables import body_point, joint_spring_motion
from consilience.mechanism.spatial import Array, cross


@dataclass(eq=False)
class Wrenches:
    """Sums of wrenches on the bodies of a mechanism at a state.

    Attributes
    ----------
    total : ndarray, shape (n_b, 6), N and N m
        Force and torque about the body's origin, world axes.
    size : ndarray, shape (n_b, 2), N and N m
        Sums of the lengths of the forces and of the torques, of each term of a force that is a difference.
    magnitude : ndarray, shape (n_b, 2), N and N m
        Sums of the lengths of the forces and of the torques as they act.
    """

    mechanism: Mechanism
    state: State
    total: Array = field(init=False)
    size: Array = field(init=False)
    magnitude: Array = field(init=False)

    def __post_init__(self) -> None:
        count = len(self.mechanism.bodies)
        self.total, self.size, self.magnitude = (np.zeros((count, width)) for width in (6, 2, 2))

    def push(
        self, body: str, force: Array, point_W: Array, torque: Array | None = None, size: float | None = None
    ) -> None:
        """Add a force at a point and a torque to a body.

        Parameters
        ----------
        body : str
        force, torque : ndarray, shape (3,), N and N m
            World axes.
        point_W : ndarray, shape (3,), m
            Point of application of the force, in the world.
        size : float, N, optional
            Size of the force if the force is a difference; default: its length.
        """
        if body == GROUND:
            return
        i = self.mechanism.body_index[body]
        arm = point_W - self.state.p_WB[i]
        self.total[i, :3] += force
        self.total[i, 3:] += cross(arm, force)
        reach, acting = np.array([1.0, float(np.linalg.norm(arm))]), float(np.linalg.norm(force))
        self.size[i] += reach * (acting if size is None else size)
        self.magnitude[i] += reach * acting
        if torque is not None:
            self.total[i, 3:] += torque
            self.size[i, 1] += float(np.linalg.norm(torque))
            self.magnitude[i, 1] += float(np.linalg.norm(torque))


def applied_wrenches(mechanism: Mechanism, state: State, t: float = 0.0) -> Wrenches:
    """Return the wrenches of gravity, springs, loads, friction and controls; integrals of controllers are zero."""
    sums = Wrenches(mechanism, state)
    R = state.R_WB
    for i, body in enumerate(mechanism.bodies):
        sums.push(body.name, body.mass * mechanism.gravity, state.p_WB[i] + R[i] @ body.com)
    _add_springs(sums, t)
    _add_loads(sums, t)
    for name, coordinate, effort, size in _joint_efforts(mechanism, state, t):
        joint = mechanism.joints[mechanism.joint_index[name]]
        axis = joint_frames(mechanism, state, joint).U[:, 2]
        point, _ = body_point(mechanism, state, joint.successor, joint.M.p)
        for end, sign in ((joint.successor, 1.0), (joint.predecessor, -1.0)):
            if coordinate == "distance":
                sums.push(end, sign * effort * axis, point, size=size)
            else:
                sums.push(end, np.zeros(3), point, sign * effort * axis)
    return sums


def _add_springs(sums: Wrenches, t: float) -> None:
    """Add the forces of springs, dampers and actuators between points at the time t, s."""
    mechanism, state = sums.mechanism, sums.state
    for s in mechanism.springs:
        p_i, v_i = body_point(mechanism, state, s.predecessor, s.point_predecessor)
        p_j, v_j = body_point(mechanism, state, s.successor, s.point_successor)
        d, v, push = p_j - p_i, v_j - v_i, float(s.actuator.at(t)[0]) if s.actuator else 0.0
        force, length = spring_force(s.law, push, d, v), float(np.linalg.norm(d))
        rate = float(d @ v) / length if length > 0.0 else float(np.linalg.norm(v))
        size = abs(s.stiffness) * (length + abs(s.free_length)) + abs(s.damping * rate) + abs(push)
        sums.push(s.predecessor, force, p_i, size=size)
        sums.push(s.successor, -force, p_j, size=size)


def _add_loads(sums: Wrenches, t: float) -> None:
    """Add the forces and torques on bodies at the time t, s."""
    mechanism, state = sums.mechanism, sums.state
    for load in mechanism.loads:
        if load.body == GROUND:
            continue
        R = state.R_WB[mechanism.body_index[load.body]]
        vector = load.vector if load.frame == "world" else R @ load.vector
        vector = vector * (float(load.history.at(t)[0]) if load.history else 1.0)
        point, _ = body_point(mechanism, state, load.body, load.point)
        if load.kind == "force":
            sums.push(load.body, vector, point)
        else:
            sums.push(load.body, np.zeros(3), point, vector)


def _joint_efforts(mechanism: Mechanism, state: State, t: float) -> Iterator[tuple[str, str, float, float]]:
    """Joint, coordinate, effort on the successor and its size, of joint springs, friction and controls."""
    for s in mechanism.joint_springs:
        q, rate = joint_spring_motion(mechanism, state, s.joint, s.coordinate)
        k1, k2, c1, c2 = s.higher
        parts = [float(s.actuator.at(t)[0]) if s.actuator else 0.0, -s.stiffness * q, s.stiffness * s.rest]
        parts += [-s.damping * rate, -k1 * (q - s.rest) ** 2, -k2 * (q - s.rest) ** 3]
        yield s.joint, s.coordinate, *_sum([*parts, -c1 * abs(rate) * rate, -c2 * rate**3])
    for f in mechanism.frictions:
        _, rate = joint_spring_motion(mechanism, state, f.joint, f.coordinate)
        effort, _ = friction_law(rate, f.viscous, f.coulomb, f.speed)
        yield f.joint, f.coordinate, effort, abs(effort)
    for c in mechanism.controls:
        q, rate = joint_spring_motion(mechanism, state, c.joint, c.coordinate)
        target, target_rate, _ = c.target.at(t)
        parts = [c.proportional * float(target), -c.proportional * q]
        yield c.joint, c.coordinate, *_sum([*parts, c.derivative * float(target_rate), -c.derivative * rate])


def _sum(parts: list[float]) -> tuple[float, float]:
    return sum(parts), sum(abs(part) for part in parts)


def conservative_part(mechanism: Mechanism) -> Mechanism:
    """Return the mechanism with only those forces whose energy is in `observables.potential_energy`."""
    return replace(
        mechanism,
        springs=tuple(replace(s, damping=0.0, actuator=None) for s in mechanism.springs),
        joint_springs=tuple(replace(s, damping=0.0, higher_damping=(), actuator=None) for s in mechanism.joint_springs),
        loads=(),
        frictions=(),
        controls=(),
    )
