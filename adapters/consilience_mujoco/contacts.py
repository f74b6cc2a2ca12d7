"""Contacts, stops and dry friction in a MuJoCo model: geometries and pairs, limits of joints, frictionloss.

Only the declared pairs collide: every geometry has `contype` and `conaffinity` zero, and every elementary contact is a
`pair`. Each geometry is on a massless body of its own, welded to the body that it belongs to: regularisation is
proportional to `body_invweight0`, which is so set for every contact alone, apart from those of loops.

A point is a sphere of `POINT`. A plane on the ground is MuJoCo's plane, which is a half-space; on a body, where MuJoCo
allows no plane, it is the upper face of a large box.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from consilience.engine import axis_link
from consilience.mechanism import (
    GROUND,
    Array,
    ElementaryContact,
    Frame,
    Mechanism,
    SphereSphere,
    Tree,
    characteristic_length,
    contact_parts,
    cross,
    quaternion_from_rotation,
    rotation_with_z_axis,
)
from consilience_mujoco.places import compose, link_name
from consilience_mujoco.rows import moving_dofs, velocity_term

POINT = 1e-12
"""Radius in m of the sphere that is a point: MuJoCo takes no zero."""

_THICK, _WIDE = 10.0, 1e4
"""Half the thickness and width of the box that is a moving plane, over the characteristic length of the mechanism."""

IMPEDANCE = 0.5
"""Impedance d of contacts, stops and dry friction in the profile `matched`: ``R = (1 - d)/d`` times the inverse inertia
is that inverse inertia, and `solref` gives half the stiffness and damping of ``aref = -k r - b v``."""

UNLIMITED = 1e8
"""Limit of a joint coordinate without a stop on one side, in m or rad."""


@dataclass(frozen=True, eq=False)
class Touch:
    """An elementary contact in a model.

    Attributes
    ----------
    contact : int
        Declared contact of which this is a part.
    part : ElementaryContact
    pair : int
    geoms, carriers : tuple of int
        Geometries of `body` and `partner`, and the MuJoCo bodies that carry them.
    dofs : tuple of ndarray of int
        Velocities that move the carriers.
    """

    contact: int
    part: ElementaryContact
    pair: int
    geoms: tuple[int, int]
    carriers: tuple[int, int]
    dofs: tuple[Array, Array]

    def point_and_normal(self, data: Any) -> tuple[Array, Array]:
        """Return the contact point on `body` and the normal, each (3,), world axes."""
        center = data.geom_xpos[self.geoms[0]]
        if isinstance(self.part, SphereSphere):
            n = center - data.geom_xpos[self.geoms[1]]
            n = n / np.linalg.norm(n)
        else:
            n = data.geom_xmat[self.geoms[1]].reshape(3, 3)[:, 2]
        return center - self.part.radius * n, n

    def convection(self, model: Any, data: Any) -> tuple[Array, Array, Array]:
        """Return gamma of ``u' = J a + gamma``, the normal and its rate, each (3,), world axes.

        u is the velocity of the point of `body` in contact relative to that of `partner`. The contact point x moves in
        both bodies: ``gamma = J' v + w x (x' - v_x)`` for each, with the velocity v_x of the material point.
        """
        x, n = self.point_and_normal(data)
        frames = [self._motion(model, data, side, x) for side in (0, 1)]
        center = [self._velocity(model, data, side, data.geom_xpos[self.geoms[side]])[1] for side in (0, 1)]
        if isinstance(self.part, SphereSphere):
            apart = center[0] - center[1]
            distance = self.part.radius + self.part.partner_radius
            n_dot = (apart - n * (n @ apart)) / distance
        else:
            n_dot = cross(frames[1][0], n)
        x_dot = center[0] - self.part.radius * n_dot
        gamma = [bias + cross(w, x_dot - v) for w, v, bias in frames]
        return np.asarray(gamma[0] - gamma[1]), n, np.asarray(n_dot)

    def velocity(self, model: Any, data: Any) -> Array:
        """Return u, the velocity of the point of `body` in contact relative to that of `partner`, world axes."""
        x, _ = self.point_and_normal(data)
        return self._velocity(model, data, 0, x)[1] - self._velocity(model, data, 1, x)[1]

    def _velocity(self, model: Any, data: Any, side: int, point: Array) -> tuple[Array, Array]:
        """Angular velocity of a carrier, and velocity of its material point."""
        body = self.carriers[side]
        w, v = data.cvel[body].reshape(2, 3)
        return w, np.asarray(v + cross(w, point - data.subtree_com[model.body_rootid[body]]))

    def _motion(self, model: Any, data: Any, side: int, point: Array) -> tuple[Array, Array, Array]:
        """Angular velocity of a carrier, velocity and ``J' v`` of its material point."""
        w, v = self._velocity(model, data, side, point)
        return w, v, velocity_term(model, data, self.carriers[side], self.dofs[side], point)

    def jacobian(self, model: Any, data: Any, central: bool = False) -> Array:
        """Return J of ``u = J v`` in MuJoCo's velocities, shape (3, nv), world axes; `central`: at the centre."""
        x = data.geom_xpos[self.geoms[0]] if central else self.point_and_normal(data)[0]
        J = np.zeros((2, 3, model.nv))
        for side in (0, 1):
            mujoco.mj_jac(model, data, J[side], None, x, self.carriers[side])
        return np.asarray(J[0] - J[1])


@dataclass(frozen=True, eq=False)
class Limit:
    """A joint coordinate with stops: MuJoCo joint, places in `qpos` and `qvel`, restitution."""

    joint: int
    qpos: int
    dof: int
    restitution: float


def is_unilateral(mechanism: Mechanism) -> bool:
    """Whether a mechanism has contacts, stops or dry friction."""
    return bool(mechanism.contacts or mechanism.stops or mechanism.dry_frictions)


def _carrier(spec: Any, mechanism: Mechanism, tree: Tree, body: str, name: str) -> tuple[Any, Frame]:
    """MuJoCo body for a geometry of a body, and the frame B of that body in it: the world, or a massless body.

    The massless body has the centre of mass of its link, so that MuJoCo gives it the inverse inertia of the link.
    """
    if body == GROUND:
        return spec.worldbody, Frame(np.zeros(3), np.eye(3))
    number = tree.carrier(mechanism.body_index[body])
    link = tree.links[number]
    massless = {"mass": 0.0, "ipos": link.com, "inertia": np.zeros(3), "explicitinertial": True}
    return spec.body(link_name(tree, number)).add_body(name=name, **massless), link.body_frame


def _add_part(spec: Any, mechanism: Mechanism, tree: Tree, part: ElementaryContact) -> None:
    """Add the geometries and the pair of an elementary contact."""
    name, length = f"contact {part.name}", characteristic_length(mechanism)
    common = {"mass": 0.0, "contype": 0, "conaffinity": 0}
    sphere, plane = mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_PLANE
    first, B = _carrier(spec, mechanism, tree, part.body, f"{name}: body")
    at = compose(B, Frame(part.center, np.eye(3))).p
    first.add_geom(name=f"{name}: body", type=sphere, size=[max(part.radius, POINT), 0.0, 0.0], pos=at, **common)
    second, P = _carrier(spec, mechanism, tree, part.partner, f"{name}: partner")
    if isinstance(part, SphereSphere):
        at = compose(P, Frame(part.partner_center, np.eye(3))).p
        shape: dict[str, Any] = {"type": sphere, "size": [part.partner_radius, 0.0, 0.0], "pos": at}
    else:
        frame = compose(P, Frame(part.point, rotation_with_z_axis(part.normal)))
        shape = {"type": plane, "size": [0.0, 0.0, length], "pos": frame.p}
        if part.partner != GROUND:
            wide, thick = _WIDE * length, _THICK * length
            shape = {"type": mujoco.mjtGeom.mjGEOM_BOX, "size": [wide, wide, thick]}
            shape["pos"] = frame.p - thick * frame.R[:, 2]
        shape["quat"] = quaternion_from_rotation(frame.R)
    second.add_geom(name=f"{name}: partner", **shape, **common)
    mu = part.friction
    spec.add_pair(
        name=name,
        geomname1=f"{name}: body",
        geomname2=f"{name}: partner",
        condim=3 if mu > 0.0 else 1,
        friction=[mu, mu, 0.0, 0.0, 0.0],
    )


def add_contacts(spec: Any, mechanism: Mechanism, tree: Tree) -> None:
    """Add the pairs of all contacts, the limits of all stops and the frictionloss of all dry friction."""
    for contact in mechanism.contacts:
        for part in contact_parts(contact):
            _add_part(spec, mechanism, tree, part)
    for stop in mechanism.stops:
        link, sign = axis_link(mechanism, tree, stop.joint, stop.coordinate)
        joint = spec.joint(link_name(tree, link))
        low, high = (sign * limit for limit in bounds(mechanism, stop.joint, stop.coordinate)[:: int(sign)])
        joint.limited, joint.range = mujoco.mjtLimited.mjLIMITED_TRUE, [low, high]
    for friction in mechanism.dry_frictions:
        link, _ = axis_link(mechanism, tree, friction.joint, friction.coordinate)
        spec.joint(link_name(tree, link)).frictionloss += friction.bound


def bounds(mechanism: Mechanism, joint: str, coordinate: str) -> tuple[float, float]:
    """Return the narrowest limits of all stops in a joint coordinate."""
    stops = [s for s in mechanism.stops if (s.joint, s.coordinate) == (joint, coordinate)]
    low = max((s.lower for s in stops if s.lower is not None), default=-UNLIMITED)
    high = min((s.upper for s in stops if s.upper is not None), default=UNLIMITED)
    return low, high


def touches_of(model: Any, mechanism: Mechanism) -> tuple[Touch, ...]:
    """Return the elementary contacts of a compiled model."""
    found = []
    for number, contact in enumerate(mechanism.contacts):
        for part in contact_parts(contact):
            name = f"contact {part.name}"
            ours, theirs = (int(model.geom(f"{name}: {side}").id) for side in ("body", "partner"))
            carriers = int(model.geom_bodyid[ours]), int(model.geom_bodyid[theirs])
            dofs = moving_dofs(model, carriers[0]), moving_dofs(model, carriers[1])
            found.append(Touch(number, part, int(model.pair(name).id), (ours, theirs), carriers, dofs))
    return tuple(found)


def limits_of(model: Any, mechanism: Mechanism, tree: Tree) -> tuple[Limit, ...]:
    """Return the joint coordinates with stops of a compiled model."""
    found = {}
    for stop in mechanism.stops:
        joint = model.joint(link_name(tree, axis_link(mechanism, tree, stop.joint, stop.coordinate)[0])).id
        found[joint] = Limit(joint, int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint]), stop.restitution)
    return tuple(found.values())


def set_inverse_inertia(model: Any, touch: Touch, value: float) -> None:
    """Set the inverse inertia to which the regularisation of a contact is proportional."""
    first, second = touch.carriers
    model.body_invweight0[first] = model.body_invweight0[second] = 0.0
    model.body_invweight0[first or second] = value
