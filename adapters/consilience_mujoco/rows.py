"""Drives, couplings, screws, rolling bodies and skates as equality constraints of MuJoCo.

MuJoCo holds ``J a + R f = aref`` [MuJoCo, Computation]. A joint equality ``q1 = poly(q2)``, of degree four at most, has
no velocity term ``poly'' q2'^2`` in aref, and its offset is constant in time. A callback writes the missing terms:

========================  =============================  ==========================================================
element                   equality                       terms that the callback writes into the row
========================  =============================  ==========================================================
screw                     joint, ``P = pitch R / 2 pi``  nothing
drive                     joint, ``q = 0``               aref
coupling by a polynomial  joint                          aref
any other coupling        joint                          aref and J, ``1`` and ``-f'``
rolling body, skate       tendon, only for its row       aref and J, from `mj_jac` and `cdof_dot`, at the point held
========================  =============================  ==========================================================

With residual g, its rate g', and gamma of ``J a = gamma``: ``aref = gamma - B g' - K d g``. K, B and the impedance d
are MuJoCo's, from `solref` and `solimp` (d at the residual of MuJoCo's own row). MuJoCo finds islands before the
callback, so that a row has room only for coefficients in the same trees as the equality over which it is written.

The point of contact of a rolling body is at ``rho = -R m / |m| - r n`` from the centre, ``m = n - (n.a) a``, and moves
in the body. The condition ``v + w x rho = 0`` therefore has the rate ``a_P + w x (rho' - w x rho) = 0`` with the
acceleration a_P of the material point.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import mujoco
import numpy as np

from consilience.engine import axis_link
from consilience.mechanism import (
    Array,
    Frame,
    Function,
    Jet,
    Mechanism,
    Rolling,
    Skate,
    Tree,
    cross,
    plane_axes,
    rolling_contact,
)
from consilience_mujoco.functions import jet_of
from consilience_mujoco.places import add_point, add_site, link_name

_TURN = 2.0 * np.pi
_POWERS = 5
"""Number of coefficients of the polynomial of a joint equality."""

_FREEDOM = {"R": 1, "P": 1, "S": 3, "F": 6, "W": 0}

_ASIDE = np.array([0.37, -0.23, 0.41])
"""Ends in m of the tendons of which rows are used: points that move with every motion of their body."""


@dataclass(frozen=True, eq=False)
class JointRow:
    """Row ``q = sign f(x)`` in MuJoCo's coordinate q; x is the time or the coordinate of a driving joint.

    Attributes
    ----------
    equality : int
    qpos, dof : int
        Places of the held joint in `qpos` and `qvel`.
    sign : float
        -1 where the tree passes the held joint backwards.
    driver : (qpos, dof, sign) or None
        The same of the driving joint; None for a drive.
    law : Function
        The function f.
    jet : callable
        Value and two derivatives of f.
    angle : bool
        The residual is taken within half a turn.
    written : bool
        The callback also writes the coefficient of the driving joint.
    """

    equality: int
    qpos: int
    dof: int
    sign: float
    driver: tuple[int, int, float] | None
    law: Function
    jet: Callable[[float], Jet]
    angle: bool
    written: bool

    def evaluate(self, data: Any) -> tuple[float, float, float, float]:
        """Return the residual, its rate, gamma, and the coefficient of the driving joint."""
        if self.driver is None:
            x, x_dot, turn = data.time, 1.0, 0.0
        else:
            qpos, dof, turn = self.driver
            x, x_dot = turn * float(data.qpos[qpos]), turn * float(data.qvel[dof])
        f, slope, bend = self.jet(x)
        residual = float(data.qpos[self.qpos]) - self.sign * f
        if self.angle and np.isfinite(residual):
            residual -= _TURN * round(residual / _TURN)
        rate = float(data.qvel[self.dof]) - self.sign * slope * x_dot
        return residual, rate, self.sign * bend * x_dot**2, -self.sign * turn * slope


def moving_dofs(model: Any, body: int) -> Array:
    """Return the velocities that move a body, from its own to those of the root. Exported scripts contain this text."""
    while body > 0 and model.body_dofnum[body] == 0:
        body = int(model.body_parentid[body])
    dof, found = int(model.body_dofadr[body] + model.body_dofnum[body]) - 1 if body > 0 else -1, []
    while dof >= 0:
        found.append(dof)
        dof = int(model.dof_parentid[dof])
    return np.array(found, dtype=int)


def velocity_term(model: Any, data: Any, body: int, dofs: Array, point: Array) -> Array:
    """Return the acceleration ``J' v`` of a point of a body, shape (3,), in the world.

    `cdof_dot` is used, as in MuJoCo's own accelerations, because `mj_jacDot` is wrong where a slide follows a ball on
    one body. Exported scripts contain the text of this function.

    Parameters
    ----------
    model, data : mujoco.MjModel, mujoco.MjData
    body : int
    dofs : ndarray of int
        Velocities that move the body (`moving_dofs`).
    point : ndarray, shape (3,), m
        In world axes.
    """
    angular, linear = (data.cdof_dot[dofs].T @ data.qvel[dofs]).reshape(2, 3)
    w, v = data.cvel[body].reshape(2, 3)  # about the centre of mass of the tree, as the line above
    arm = point - data.subtree_com[model.body_rootid[body]]
    return np.asarray(linear + cross(angular, arm) + cross(w, v + cross(w, arm)))


Held = tuple[Array, Array, Array, Array]
"""Arm or point (3,), directions (k, 3), violations (k,), wanted accelerations along the directions (k,); world axes."""


@dataclass(frozen=True, eq=False)
class Guide:
    """Rows of a rolling body or a skate: directions in which a point of the body has no velocity.

    Attributes
    ----------
    element : Rolling or Skate
    equalities : tuple of int
        One equality for each direction.
    body, site : int
        MuJoCo body, and the site of frame B.
    dofs : ndarray of int
        Velocities that move the body.
    hold : callable
        From position, axes, velocity and angular velocity of B to `Held`, with the arm of the point from B.
    """

    element: Rolling | Skate

    equalities: tuple[int, ...]
    body: int
    site: int
    dofs: Array
    hold: Callable[[Array, Array, Array, Array], Held]

    def place(self, model: Any, data: Any) -> Held:
        """Return `Held` at the state of the data, with the point in the world."""
        p, R = data.site_xpos[self.site], data.site_xmat[self.site].reshape(3, 3)
        twist = np.zeros(6)
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_SITE, self.site, twist, 0)
        arm, directions, residuals, accelerations = self.hold(p, R, twist[3:], twist[:3])
        return p + arm, directions, residuals, accelerations

    def rows(self, model: Any, data: Any) -> tuple[Array, Array, Array, Array]:
        """Return the Jacobian in MuJoCo's velocities, residuals, their rates, and gamma."""
        point, directions, residuals, accelerations = self.place(model, data)
        J = np.zeros((3, model.nv))
        mujoco.mj_jac(model, data, J, None, point, self.body)
        rows = directions @ J
        bias = velocity_term(model, data, self.body, self.dofs, point)
        return rows, residuals, rows @ data.qvel, accelerations - directions @ bias


@dataclass(frozen=True)
class Equalities:
    """Numbers of equality constraints of a model.

    Attributes
    ----------
    welds, joints, guides : int
        Welds, of six rows each; single rows on joints; single rows on guided bodies.
    completed : bool
        The callback completes right-hand sides of rows on joints.
    written : bool
        The callback also writes rows of the Jacobian.
    freedom : int
        Number of coordinates. From 60 on MuJoCo's default is a sparse Jacobian, which has no room for written rows.
    """

    welds: int
    joints: int = 0
    guides: int = 0
    completed: bool = False
    written: bool = False
    freedom: int = 0


@dataclass(frozen=True, eq=False)
class Rows:
    """Constraints of a model beside those of its joints.

    Attributes
    ----------
    joints, guides : tuple
        Rows that the callback completes.
    screws : tuple of (int, int, float)
        Places of slide and hinge in `qpos`, and the pitch in m.
    """

    joints: tuple[JointRow, ...]
    guides: tuple[Guide, ...]
    screws: tuple[tuple[int, int, float], ...]


def hold_rolling(rolling: Rolling, p: Array, R_WB: Array, v: Array, w: Array) -> Held:
    """Return `Held` at the point of contact of a rolling body. Exported scripts contain the text of this function.

    Parameters
    ----------
    rolling : Rolling
    p, v, w : ndarray, shape (3,), m, m/s and rad/s
        Position, velocity and angular velocity of the body's origin, world axes.
    R_WB : ndarray, shape (3, 3)
    """
    n, plane = rolling.normal, plane_axes(rolling)
    rho, rho_dot = rolling_contact(R_WB @ rolling.axis, n, w, rolling.radius, rolling.rounding)
    arm = R_WB @ rolling.center + rho
    height = n @ (p + arm - rolling.point)
    return arm, plane, np.array([height, 0.0, 0.0]), plane @ cross(w, cross(w, rho) - rho_dot)


def hold_skate(skate: Skate, p: Array, R_WB: Array, v: Array, w: Array) -> Held:
    """Return `Held` at the point of a skate. Exported scripts contain the text of this function.

    Parameters
    ----------
    skate : Skate
    p, v, w : ndarray, shape (3,), m, m/s and rad/s
        Position, velocity and angular velocity of the body's origin, world axes.
    R_WB : ndarray, shape (3, 3)
    """
    arm, lateral = R_WB @ skate.point, R_WB @ skate.lateral
    return arm, lateral[None], np.zeros(1), np.array([-cross(w, lateral) @ (v + cross(w, arm))])


_GUIDES: dict[str, tuple[int, Callable[..., Held]]] = {"rollings": (3, hold_rolling), "skates": (1, hold_skate)}


def _guided(mechanism: Mechanism) -> list[tuple[Any, int, Callable[..., Held]]]:
    """Rolling bodies and skates, with the number of rows and the function of each."""
    return [(x, count, hold) for group, (count, hold) in _GUIDES.items() for x in getattr(mechanism, group)]


def is_own(law: Function) -> bool:
    """Whether MuJoCo's joint equality can express the law of a coupling."""
    return law.table is None and not len(law.harmonics) and len(law.polynomial) <= _POWERS


def count_rows(mechanism: Mechanism, tree: Tree) -> Equalities:
    """Count the equality constraints of the model of a mechanism."""
    screws = sum(joint.kind == "screw" for joint in mechanism.joints)
    guides = sum(count for _, count, _ in _guided(mechanism))
    completed = len(mechanism.drives) + len(mechanism.couplings)
    written = guides > 0 or not all(is_own(c.law) for c in mechanism.couplings)
    freedom = sum(_FREEDOM[link.elementary] for link in tree.links)
    return Equalities(len(tree.welds), screws + completed, guides, completed > 0, written, freedom)


def _add_joint_equality(spec: Any, name: str, held: str, driver: str, coefficients: Sequence[float]) -> None:
    """Add a joint equality ``q_held = sum c_k q_driver^k``.

    Parameters
    ----------
    spec : mujoco.MjSpec
    name : str
    held, driver : str
        MuJoCo joints; without a driver the held joint is at the constant.
    coefficients : sequence of float
        The c_k, from k = 0.
    """
    data = np.zeros(mujoco.mjNEQDATA)
    data[: len(coefficients)] = coefficients
    spec.add_equality(
        name=name, type=mujoco.mjtEq.mjEQ_JOINT, objtype=mujoco.mjtObj.mjOBJ_JOINT, name1=held, name2=driver, data=data
    )


def _add_tendon_equality(spec: Any, mechanism: Mechanism, tree: Tree, body: str, name: str) -> None:
    """Add the equality of a tendon from the world to a body, whose row the callback overwrites.

    Parameters
    ----------
    spec : mujoco.MjSpec
    mechanism : Mechanism
    tree : Tree
    body : str
        Body that rolls or skates.
    name : str
        Name of equality, tendon and site.
    """
    frame = mechanism.bodies[mechanism.body_index[body]].drawing
    add_site(spec.worldbody, name, Frame(frame.p - 2.0 * _ASIDE, np.eye(3)))
    add_point(spec, mechanism, tree, body, _ASIDE, f"end of {name}")
    tendon = spec.add_tendon(name=name)
    tendon.wrap_site(name)
    tendon.wrap_site(f"end of {name}")
    spec.add_equality(name=name, type=mujoco.mjtEq.mjEQ_TENDON, objtype=mujoco.mjtObj.mjOBJ_TENDON, name1=name)


def add_rows(spec: Any, mechanism: Mechanism, tree: Tree) -> None:
    """Add an equality for every screw, drive, coupling, rolling body and skate of a mechanism."""

    def axis(joint: str, coordinate: str) -> tuple[str, float]:
        link, direction = axis_link(mechanism, tree, joint, coordinate)
        return link_name(tree, link), direction

    for joint in mechanism.joints:
        if joint.kind == "screw":  # both coordinates change their signs where the joint is passed backwards
            slide, turn = axis(joint.name, "distance")[0], axis(joint.name, "angle")[0]
            _add_joint_equality(spec, f"screw {joint.name}", slide, turn, [0.0, joint.pitch / _TURN])
    for drive in mechanism.drives:
        _add_joint_equality(spec, f"drive {drive.name}", axis(drive.joint, drive.coordinate)[0], "", [0.0])
    for c in mechanism.couplings:
        (held, sign), (driver, mirror) = axis(c.joint, c.coordinate), axis(c.driver_joint, c.driver_coordinate)
        powers = c.law.polynomial.tolist() if is_own(c.law) else [0.0, 1.0]
        coefficients = [sign * p * mirror**k for k, p in enumerate(powers)]
        _add_joint_equality(spec, f"coupling {c.name}", held, driver, coefficients)
    for element, count, _ in _guided(mechanism):
        for k in range(count):
            _add_tendon_equality(spec, mechanism, tree, element.body, f"row {k} of {element.name}")


def rows_of(model: Any, mechanism: Mechanism, tree: Tree) -> Rows:
    """Return the rows of a compiled model that the callback completes, and the coordinates of screws."""

    def axis(joint: str, coordinate: str) -> tuple[int, int, float]:
        link, sign = axis_link(mechanism, tree, joint, coordinate)
        number = model.joint(link_name(tree, link)).id
        return int(model.jnt_qposadr[number]), int(model.jnt_dofadr[number]), sign

    def held(name: str, x: Any, driver: tuple[int, int, float] | None, law: Function, written: bool) -> JointRow:
        """Return the row of a drive or coupling.

        Parameters
        ----------
        name : str
            Equality of the row.
        x : Drive or Coupling
        driver, law, written
            As in `JointRow`.
        """
        number, angle = model.equality(name).id, x.coordinate == "angle"
        return JointRow(number, *axis(x.joint, x.coordinate), driver, law, jet_of(law), angle, written)

    joints = [held(f"drive {d.name}", d, None, d.motion, False) for d in mechanism.drives]
    for c in mechanism.couplings:
        driver = axis(c.driver_joint, c.driver_coordinate)
        joints.append(held(f"coupling {c.name}", c, driver, c.law, not is_own(c.law)))
    guides = []
    for element, count, hold in _guided(mechanism):
        equalities = tuple(model.equality(f"row {k} of {element.name}").id for k in range(count))
        site = model.site(link_name(tree, tree.carrier(mechanism.body_index[element.body]))).id
        body = int(model.site_bodyid[site])
        guides.append(Guide(element, equalities, body, site, moving_dofs(model, body), partial(hold, element)))
    screws = [
        (axis(joint.name, "distance")[0], axis(joint.name, "angle")[0], joint.pitch)
        for joint in mechanism.joints
        if joint.kind == "screw"
    ]
    return Rows(tuple(joints), tuple(guides), tuple(screws))
