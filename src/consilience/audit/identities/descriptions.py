"""Equivalent descriptions of one mechanism: other numbers and names, the same physics.

Each function returns a `Description`: the second description of the mechanism, the map of states to the second
description, and the map of answers back to the first.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from consilience.engine import InstantAnswer
from consilience.mechanism import (
    GROUND,
    Array,
    Body,
    Frame,
    Joint,
    Mechanism,
    State,
    Units,
    cross,
    in_units,
    joint_frames,
    quaternion_from_rotation,
    quaternion_product,
    spanning_tree,
)


@dataclass(frozen=True, eq=False)
class Description:
    """A second description of a mechanism.

    Attributes
    ----------
    mechanism : Mechanism
        The second description.
    state : callable
        State of the first description to state of the second.
    answer : callable
        States of the first description and answer about the second, to an answer about the first.
    """

    mechanism: Mechanism
    state: Callable[[State], State]
    answer: Callable[[Sequence[State], InstantAnswer], InstantAnswer]


def _compose(outer: Frame, inner: Frame) -> Frame:
    return Frame(outer.p + outer.R @ inner.p, outer.R @ inner.R)


def _seen_from(mechanism: Mechanism, world: Frame) -> Description:
    """Describe the mechanism in another world frame, given in the old one: convert gravity and points of the ground."""
    R, back = world.R.T, Frame(-world.R.T @ world.p, world.R.T)

    def frame(body: str, old: Frame) -> Frame:
        return _compose(back, old) if body == GROUND else old

    def point(body: str, p: Array) -> Array:
        return back.p + R @ p if body == GROUND else p

    second = replace(
        mechanism,
        gravity=R @ mechanism.gravity,
        bodies=tuple(replace(b, drawing=_compose(back, b.drawing)) for b in mechanism.bodies),
        joints=tuple(replace(j, F=frame(j.predecessor, j.F), M=frame(j.successor, j.M)) for j in mechanism.joints),
        springs=tuple(
            replace(
                s,
                point_predecessor=point(s.predecessor, s.point_predecessor),
                point_successor=point(s.successor, s.point_successor),
            )
            for s in mechanism.springs
        ),
        loads=tuple(
            replace(
                x,
                point=point(x.body, x.point),
                vector=R @ x.vector if x.frame == "world" or x.body == GROUND else x.vector,
            )
            for x in mechanism.loads
        ),
        rollings=tuple(replace(r, point=back.p + R @ r.point, normal=R @ r.normal) for r in mechanism.rollings),
    )
    quat = quaternion_from_rotation(R)
    lift = sum(b.mass for b in mechanism.bodies) * float(mechanism.gravity @ world.p)

    def state(s: State) -> State:
        turned = quaternion_product(quat, s.quat_WB)
        unit = turned / np.linalg.norm(turned, axis=1, keepdims=True)
        return State(s.p_WB @ R.T + back.p, unit, s.v_WB_W @ R.T, s.w_WB_W @ R.T)

    def answer(_: Sequence[State], a: InstantAnswer) -> InstantAnswer:
        return replace(a, a_WB_W=a.a_WB_W @ R, alpha_WB_W=a.alpha_WB_W @ R, potential=a.potential - lift)

    return Description(second, state, answer)


def rotated(mechanism: Mechanism, R: Array) -> Description:
    """Describe a mechanism, gravity included, in a world frame turned by R, shape (3, 3)."""
    return _seen_from(mechanism, Frame(np.zeros(3), R))


def moved(mechanism: Mechanism, offset: Array) -> Description:
    """Describe a mechanism in a world frame whose origin is at `offset`, shape (3,), m."""
    return _seen_from(mechanism, Frame(offset, np.eye(3)))


def reordered(mechanism: Mechanism, bodies: Sequence[int], joints: Sequence[int]) -> Description:
    """List bodies and joints in another order, and elements in reverse.

    Parameters
    ----------
    bodies, joints : sequence of int
        Index in the old list of each body and joint of the new list.
    """
    b, j = np.array(bodies), np.array(joints)
    elements = ("springs", "joint_springs", "loads", "frictions", "controls")
    reverse = {name: getattr(mechanism, name)[::-1] for name in elements}
    second = replace(
        mechanism, bodies=tuple(mechanism.bodies[k] for k in b), joints=tuple(mechanism.joints[k] for k in j), **reverse
    )
    old_b, old_j = np.argsort(b), np.argsort(j)
    return Description(second, lambda s: _of_bodies(s, b), lambda _, a: _picked(a, old_b, old_j))


def _of_bodies(state: State, bodies: Array) -> State:
    """Return the state of the bodies of some indices, in that order."""
    return State(state.p_WB[bodies], state.quat_WB[bodies], state.v_WB_W[bodies], state.w_WB_W[bodies])


def _picked(answer: InstantAnswer, bodies: Array | slice, joints: Array | slice) -> InstantAnswer:
    """Return the part of an answer about some bodies and joints."""
    return replace(
        answer,
        a_WB_W=answer.a_WB_W[:, bodies],
        alpha_WB_W=answer.alpha_WB_W[:, bodies],
        force_F=None if answer.force_F is None else answer.force_F[:, joints],
        torque_F=None if answer.torque_F is None else answer.torque_F[:, joints],
    )


def recut(mechanism: Mechanism) -> Description | None:
    """List joints so that other joints close the loops of a spanning tree; None without a loop or such an order.

    Only the order of the joints changes. The cut moves in engines that cut the joint reached last by a search of the
    graph, as `consilience.mechanism.spanning_tree` does.
    """

    def cut(order: Sequence[int]) -> set[str]:
        listed = replace(mechanism, joints=tuple(mechanism.joints[k] for k in order))
        return {listed.joints[k].name for k in spanning_tree(listed)[1]}

    n = len(mechanism.joints)
    listed = list(range(n))
    for order in ([*way[k:], *way[:k]] for way in (listed[::-1], listed) for k in range(n)):
        if cut(order) != cut(listed):
            return reordered(mechanism, range(len(mechanism.bodies)), order)
    return None


_Z_TO_X = np.array([[0.0, 0, 1], [0, -1, 0], [1, 0, 0]])
"""Columns z, -y, x. The axes of a universal joint are z of F and x of M; this rotation exchanges them."""

_ONE_WAY = ("point_on_line", "point_in_plane")
"""Kinds of joints that become another kind when their sides are swapped."""


def swapped(mechanism: Mechanism) -> Description:
    """Exchange predecessor and successor of every joint, except joints that would become another kind.

    Joint coordinates change sign, and so do the numbers of springs, controls, drives and couplings.
    """
    turns = [_Z_TO_X if j.kind == "universal" else np.eye(3) for j in mechanism.joints]
    joints = tuple(_swap(j, turn) for j, turn in zip(mechanism.joints, turns, strict=True))
    swapped_names = {j.name for j in mechanism.joints if j.kind not in _ONE_WAY}
    second = in_units(replace(mechanism, joints=joints), sign={name: -1.0 for name in swapped_names})

    def answer(states: Sequence[State], a: InstantAnswer) -> InstantAnswer:
        """Convert reactions to the successors and axes of the first description; other values are equal in both."""
        if a.force_F is None or a.torque_F is None:
            return a
        force, torque = np.array(a.force_F), np.array(a.torque_F)
        for n, state in enumerate(states):
            for k, joint in enumerate(mechanism.joints):
                if joint.name in swapped_names:
                    f = joint_frames(mechanism, state, joint)
                    axes = f.W @ turns[k]
                    F, T = axes @ force[n, k], axes @ torque[n, k]  # on the predecessor, at the origin of F
                    force[n, k], torque[n, k] = -f.U.T @ F, -f.U.T @ (T - cross(f.d, F))
        return replace(a, force_F=force, torque_F=torque)

    return Description(second, lambda s: s, answer)


def _swap(joint: Joint, turn: Array) -> Joint:
    if joint.kind in _ONE_WAY:
        return joint
    F, M = Frame(joint.M.p, joint.M.R @ turn), Frame(joint.F.p, joint.F.R @ turn)
    return replace(joint, predecessor=joint.successor, successor=joint.predecessor, F=F, M=M)


def scaled_units(mechanism: Mechanism, length: float, mass: float, time: float) -> Description:
    """Describe a mechanism in other units: how many of the new units make a metre, a kilogram, a second."""
    units = Units(length, mass, time)
    second = in_units(mechanism, *units)
    return Description(second, units.convert, lambda _, a: units.inverse.convert(a))


def split(mechanism: Mechanism) -> Description:
    """Cut a body into two parts in the same place, welded together; all its joints but the first go to the second.

    The body is the first with more than one joint, so that the weld transmits forces between joints.
    """
    ends = [[j.name for j in mechanism.joints if b.name in (j.predecessor, j.successor)] for b in mechanism.bodies]
    i = next((k for k, joints in enumerate(ends) if len(joints) > 1), 0)
    body, name = mechanism.bodies[i], f"{mechanism.bodies[i].name} (other part)"
    moving = set(ends[i][1:])

    def part(fraction: float, called: str) -> Body:
        return replace(body, name=called, mass=fraction * body.mass, inertia=fraction * body.inertia)

    def end(joint: Joint, at: str) -> str:
        return name if at == body.name and joint.name in moving else at

    joints = [replace(j, predecessor=end(j, j.predecessor), successor=end(j, j.successor)) for j in mechanism.joints]
    here = Frame(np.zeros(3), np.eye(3))
    weld = Joint(f"{body.name} (weld)", "rigid", body.name, name, here, here)
    bodies = [part(0.4, body.name) if k == i else b for k, b in enumerate(mechanism.bodies)]
    second = replace(mechanism, bodies=(*bodies, part(0.6, name)), joints=(*joints, weld))
    rows = np.array([*range(len(mechanism.bodies)), i])
    return Description(second, lambda s: _of_bodies(s, rows), lambda _, a: _picked(a, slice(-1), slice(-1)))
