"""Mechanisms and states with other body frames: the same physics in other numbers."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from consilience.mechanism import (
    Array,
    Frame,
    Mechanism,
    State,
    quaternion_from_rotation,
    quaternion_product,
    rotation_from_quaternion,
)


def compose(outer: Frame, inner: Frame) -> Frame:
    return Frame(outer.p + outer.R @ inner.p, outer.R @ inner.R)


def inverse(frame: Frame) -> Frame:
    return Frame(-frame.R.T @ frame.p, frame.R.T)


def reframed(mechanism: Mechanism, body: str, new: Frame, **changes) -> Mechanism:
    """The same mechanism, all data of `body` expressed in the frame `new`, which is given in the old body frame."""
    back = inverse(new)

    def point(name, p):
        return back.p + back.R @ p if name == body else p

    joints = tuple(
        replace(
            j,
            F=compose(back, j.F) if j.predecessor == body else j.F,
            M=compose(back, j.M) if j.successor == body else j.M,
        )
        for j in mechanism.joints
    )
    springs = tuple(
        replace(
            s,
            point_predecessor=point(s.predecessor, s.point_predecessor),
            point_successor=point(s.successor, s.point_successor),
        )
        for s in mechanism.springs
    )
    loads = tuple(
        replace(
            load,
            point=point(load.body, load.point),
            vector=back.R @ load.vector if load.body == body and load.frame == "body" else load.vector,
        )
        for load in mechanism.loads
    )
    contacts = tuple(contact_in(c, back, c.body == body, c.partner == body) for c in mechanism.contacts)
    changed = {"joints": joints, "springs": springs, "loads": loads, "contacts": contacts}
    return replace(mechanism, **changed | changes)


def contact_in(contact, back: Frame, of_body: bool, of_partner: bool):
    """The same contact, with what is given in axes of its body, or of its partner, in a frame seen from `back`."""
    given, found = vars(contact), {}
    places = of_body * ("center", "corner", "start", "end") + of_partner * ("point", "partner_center")
    turned = of_body * ("axis", "orientation") + of_partner * ("normal",)
    found |= {name: back.p + back.R @ given[name] for name in places if name in given}
    found |= {name: back.R @ given[name] for name in turned if name in given}
    if of_partner and contact.cone.tangent is not None:
        found["cone"] = replace(contact.cone, tangent=tuple(back.R @ contact.cone.tangent))
    return replace(contact, **found)


def symmetric(matrix: Array) -> Array:
    """Symmetric part of a matrix that is symmetric up to rounding."""
    return 0.5 * (matrix + matrix.T)


def in_frames(mechanism: Mechanism, frames: Sequence[Frame]) -> Mechanism:
    """The same mechanism with other body frames, given in the old ones."""
    second = mechanism
    for body, new in zip(mechanism.bodies, frames, strict=True):
        second = reframed(second, body.name, new)
    bodies = tuple(
        replace(b, com=x.R.T @ (b.com - x.p), inertia=symmetric(x.R.T @ b.inertia @ x.R), drawing=compose(b.drawing, x))
        for b, x in zip(mechanism.bodies, frames, strict=True)
    )
    return replace(second, bodies=bodies)


def arms(state: State, frames: Sequence[Frame]) -> Array:
    """Vectors from the old to the new body origins, world axes, shape (n_b, 3), m."""
    return np.einsum("bij,bj->bi", rotation_from_quaternion(state.quat_WB), np.array([x.p for x in frames]))


def state_in_frames(state: State, frames: Sequence[Frame]) -> State:
    """The same state for the mechanism that `in_frames` returns."""
    r = arms(state, frames)
    quats = quaternion_product(state.quat_WB, quaternion_from_rotation([x.R for x in frames]))
    return State(state.p_WB + r, quats, state.v_WB_W + np.cross(state.w_WB_W, r), state.w_WB_W)
