"""Mutants of this adapter, for `consilience mutate`: known errors of users and adapters of Pinocchio.

Only the campaign imports this module; the vocabulary of `consilience.audit.mutate` stays out of the adapter itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pinocchio as pin

from consilience.audit.mutate import (
    CONTACTS,
    FINE,
    FRACTION,
    MOTION,
    WHOLE,
    Mutant,
    Proxy,
    decades,
    first_order_step,
    inside,
    preconditions,
    replaced,
    with_settings,
    wrapped,
)
from consilience.engine import Engine, Question
from consilience_pinocchio import translate

M, I, T = Question.MODEL, Question.INSTANT, Question.TRAJECTORY

SOLVER = "dynamics"


def _hinges_without_springs(subject: Any) -> bool:
    """Require a hinge and no joint spring, whose angle the adapter reads from one coordinate."""
    hinges = preconditions.kind("revolute", "cylindrical", "planar", "universal")
    return hinges(subject) and not subject.mechanism.joint_springs


def _armature(original: Any, magnitude: float, mechanism: Any, state: Any) -> Any:
    built = original(mechanism, state)
    model = built[0].model
    model.armature = np.zeros(model.nv)  # crba adds it
    zero = np.zeros(model.nq)
    for joint in model.joints[1:]:
        if joint.nq != joint.nv:
            zero[joint.idx_q + joint.nq - 1] = 1.0
    model.armature = magnitude * np.diag(pin.crba(model, model.createData(), zero))
    return built


def _gains(original: Any, magnitude: float, mechanism: Any, state: Any) -> Any:
    built = original(mechanism, state)
    for constraint in built[0].constraints:
        gains = pin.BaumgarteCorrectorParameters(magnitude, 2.0 * magnitude**0.5)
        constraint.setBaumgarteCorrectorParameters(gains)
    return built


_baumgarte = inside(("", "_suited", wrapped(_gains)))


def _spatial(original: Any, magnitude: float) -> Any:
    def acceleration(*arguments: Any) -> Any:
        classical = pin.getFrameClassicalAcceleration(*arguments)
        spatial = pin.getFrameAcceleration(*arguments)
        return pin.Motion((1.0 - magnitude) * classical.vector + magnitude * spatial.vector)

    return Proxy(original, getFrameClassicalAcceleration=acceleration)


def _free_in_parent(original: Any, magnitude: float, coordinate: Any) -> Any:
    """Give velocities of a free-flyer in axes of the parent instead of the body."""
    q, v = original(coordinate)
    return q, [*(np.array(v[:3]) + magnitude * (coordinate.v - np.array(v[:3]))), *v[3:]]


def _scalar_first(original: Any, magnitude: float, coordinate: Any) -> Any:
    del magnitude
    q, v = original(coordinate)
    return [q[3], *q[:3]], v


@contextmanager
def _continuous_joints(engine: Engine, magnitude: float) -> Iterator[Engine]:
    """Make hinges continuous joints, whose cosine and sine are off the unit circle by a fraction."""

    def of(coordinate: Any) -> Any:
        size = 1.0 + magnitude
        return [size * np.cos(coordinate.q), size * np.sin(coordinate.q)], [coordinate.rate]

    with (
        replaced(translate._JOINT_MODELS, "R", lambda _: pin.JointModelRUBZ),
        replaced(translate._COORDINATES, "R", lambda _: of),
    ):
        yield engine


def _contact_sign(original: Any, magnitude: float, translation: Any) -> Any:
    return [((1.0 - 2.0 * magnitude) * a, (1.0 - 2.0 * magnitude) * b) for a, b in original(translation)]


def _one_iteration(settings: dict[str, Any], magnitude: float) -> dict[str, Any]:
    return {"mu": magnitude, "max_iter": 1} if "mu" in settings else {}


def _frictions(original: Any, magnitude: float, friction: float) -> Any:
    """Take a part of the friction away: of the two coefficients of a pair only one is read."""
    return original((1.0 - 0.5 * magnitude) * friction)


def _restitution_squared(original: Any, magnitude: float) -> Any:
    class Squared(original):  # type: ignore[misc]
        def needed(self, gap: float, along: Any, restitution: float) -> float | None:
            return super().needed(gap, along, restitution ** (1.0 + magnitude))

    return Squared


def _touch(change: Callable[[Any, float, tuple[Any, ...]], tuple[Any, ...]]) -> Callable[[Any, float], Any]:
    """Replace gap, normal and arm of contacts by those of a function of contact, magnitude and these three."""

    def make(original: Any, magnitude: float) -> Any:
        class Changed(original):  # type: ignore[misc]
            def _geometry(self) -> Any:
                return change(self, magnitude, super()._geometry())

        return Changed

    return make


def _normal_of_body(touch: Any, magnitude: float, found: tuple[Any, ...]) -> tuple[Any, ...]:
    gap, normal, arm = found
    if not hasattr(touch.law, "normal"):  # two spheres
        return found
    turned = normal + magnitude * (touch.body.R @ touch.law.normal - normal)
    return gap, turned / np.linalg.norm(turned), arm


def _at_center(touch: Any, magnitude: float, found: tuple[Any, ...]) -> tuple[Any, ...]:
    gap, normal, arm = found
    return gap, normal, arm + magnitude * (touch.body.R @ touch.law.center - arm)


def _margin(touch: Any, magnitude: float, found: tuple[Any, ...]) -> tuple[Any, ...]:
    return (found[0] - magnitude, *found[1:])


def _no_bias(original: Any, magnitude: float) -> Any:
    class Unturned(original):  # type: ignore[misc]
        def bias(self, nearest: Any) -> Any:
            return (1.0 - magnitude) * super().bias(nearest)

    return Unturned


def _on_partner(original: Any, magnitude: float, *arguments: Any) -> Any:
    solution, forces = original(*arguments)
    return solution, (1.0 - 2.0 * magnitude) * forces


def _lifting(original: Any, magnitude: float) -> Any:
    return lambda associated=False: original(associated=True)


CONTACT_MUTANTS = (
    Mutant(CONTACTS, "friction of one partner, Pinocchio", "half of the coefficient", FINE[:2], FRACTION, I,
           inside(("unilateral", "Circle", wrapped(_frictions)))),
    Mutant(CONTACTS, "restitution squared, Pinocchio", "restitution of both partners multiplied", WHOLE, "", T,
           inside(("moreau", "Start", _restitution_squared))),
    Mutant(CONTACTS, "normal of the body", "the normal of a plane turns with the other body", FINE[:2], FRACTION, I,
           inside(("unilateral", "Touch", _touch(_normal_of_body)))),
    Mutant(CONTACTS, "force at the centre", "the force of a contact acts at the centre of its sphere", FINE[:2],
           FRACTION, I, inside(("unilateral", "Touch", _touch(_at_center)))),
    Mutant(CONTACTS, "margin, Pinocchio", "gaps are too small by this", (1e-2, 1e-3), "m", T,
           inside(("unilateral", "Touch", _touch(_margin)))),
    Mutant(CONTACTS, "no turning of contacts", "rates of the slip at zero accelerations left out", FINE[:2], FRACTION,
           I, inside(("unilateral", "Touch", _no_bias))),
    Mutant(CONTACTS, "force on the partner, Pinocchio", "forces of contacts on the other body", FINE[:2], FRACTION, I,
           inside(("engine", "settle", wrapped(_on_partner)))),
    Mutant(CONTACTS, "cone that lifts", "solve_ncp is false", WHOLE, "", T,
           inside(("unilateral", "ConeSolver", _lifting))),
)  # fmt: skip
"""Errors in contacts, which `tests/conformance/test_contact_mutants.py` plants, too."""

MUTANTS = (
    Mutant(1, "armature, Pinocchio", "Model.armature: this part of the diagonal of the mass matrix", decades(-1, -13),
           "of the inertia", I, inside(("", "_suited", wrapped(_armature)))),
    Mutant(6, "scalar first", "quaternions of balls in the wrong order", WHOLE, "", M,
           inside(("translate[_COORDINATES]", "S", wrapped(_scalar_first))),
           preconditions.kind("spherical", "rod", "point_on_line", "point_in_plane")),
    Mutant(7, "free joint, Pinocchio", "linear velocity in axes of the parent", FINE, FRACTION, I,
           inside(("translate[_COORDINATES]", "F", wrapped(_free_in_parent))), preconditions.kind("free")),
    Mutant(8, "getFrameAcceleration", "Pinocchio's spatial acceleration of the bodies", FINE, FRACTION, I,
           inside(("observe", "pin", _spatial))),
    Mutant(8, "bias of welds", "Pinocchio's spatial acceleration in the rows of the harness's solve", FINE[:2],
           FRACTION, I, inside(("dynamics", "pin", _spatial)), preconditions.loop, methods="own weld rows",
           harmless=True,
           remark="the frames that a weld holds together move alike, w x v is the same for both: no error"),
    Mutant(9, "continuous joints", "hinges by cosine and sine, which have drifted off the circle", decades(-1, -15, 2),
           "of the radius", I, _continuous_joints, _hinges_without_springs),
    Mutant(12, "sign of contact forces", "wrenches of constraintDynamics turned round", FINE, FRACTION, I,
           inside(("dynamics", "_contact_wrenches", wrapped(_contact_sign))), preconditions.loop,
           methods="constraintDynamics"),
    Mutant(19, "Baumgarte, Pinocchio", "corrector gains Kp, and Kd = 2 sqrt(Kp)", decades(10, 0, 2), "1/s^2", I,
           _baumgarte, preconditions.loop, methods="constraintDynamics",
           remark="the states are assembled to 1e-13: the terms act on nothing, and change nothing that can be seen"),
    Mutant(19, "Baumgarte, motion", "corrector gains Kp, and Kd = 2 sqrt(Kp)", (1e2, 1.0), "1/s^2", T, _baumgarte,
           preconditions.loop, harmless=True, remark="holds the constraints of a motion that keeps them anyhow"),
    Mutant(20, "one proximal iteration", "constraintDynamics regularised by this and stopped after one iteration",
           (*decades(-2, -14, 2), 0.0), "mu", I, with_settings(_one_iteration), preconditions.loop,
           methods="constraintDynamics", remark="at 0, the default, dependent rows give values that are not numbers"),
    Mutant(24, "part of Euler in RK4, Pinocchio", "this part of the step is by Euler's method", MOTION, FRACTION, T,
           inside(("motion", "runge_kutta_4", first_order_step))),
)  # fmt: skip
