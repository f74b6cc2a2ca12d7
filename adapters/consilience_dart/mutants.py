"""Mutants of this adapter, for `consilience mutate`: known errors of users and adapters of DART.

Only the campaign imports this module; the vocabulary of `consilience.audit.mutate` stays out of the adapter itself.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from consilience.audit.mutate import (
    CONTACTS,
    FINE,
    FRACTION,
    MOTION,
    WHOLE,
    Mutant,
    Planting,
    changed,
    decades,
    first_order_step,
    inside,
    on_result,
    outputs,
    preconditions,
    wrapped,
)
from consilience.engine import Question

M, I, T = Question.MODEL, Question.INSTANT, Question.TRAJECTORY

SOLVER = "dynamics"

_MASSLESS_LINKS = preconditions.kind(
    *("cylindrical", "universal", "planar", "rod", "point_on_line", "point_in_plane", "parallel_axes")
)


def _time_step(model: Any, magnitude: float) -> None:
    model.skeleton.setTimeStep(magnitude)


def _default_inertia(original: Any, magnitude: float, node: Any, mass: float, com: Any, moment: Any) -> None:
    """Leave a part of DART's default, mass 1 and inertia 1, to links without mass.

    Parameters
    ----------
    original : callable
        Function of the adapter, of the parameters after `magnitude`.
    magnitude : float
        Part of the default in kg and kg m^2.
    node, mass, com, moment
        As in `translation.set_inertia`.
    """
    if mass > 0.0:
        original(node, mass, com, moment)
    else:
        original(node, magnitude, np.zeros(3), magnitude * np.eye(3))


def _left_on(reduction: float, mixing: float) -> Planting:
    """Add error reduction and force mixing of another run, which DART keeps in a class, to those that are set."""

    def change(original: Any, magnitude: float, set_reduction: float, set_mixing: float) -> None:
        original(set_reduction + reduction * magnitude, set_mixing + mixing * magnitude)

    return inside(*((where, "set_softness", wrapped(change)) for where in ("stepping", "methods")))


def _free_twist(original: Any, magnitude: float, model: Any, state: Any) -> Any:
    """Exchange angular and linear velocity of free joints."""
    c = original(model, state)
    v = c.v.copy()
    for link, i in zip(model.tree.links, model.start, strict=True):
        if link.elementary == "F":
            w, u = v[i : i + 3].copy(), v[i + 3 : i + 6].copy()
            v[i : i + 3], v[i + 3 : i + 6] = w + magnitude * (u - w), u + magnitude * (w - u)
    return replace(c, v=v)


def _pads(change: Any) -> Any:
    """Replace friction and restitution of a shape by those of a function of contact, restitution and magnitude."""

    def make(original: Any, magnitude: float) -> Any:
        class Changed(original):  # type: ignore[misc]
            def add(self, shape: Any, position: Any, law: Any, restitution: float) -> Any:
                return super().add(shape, position, *change(law, restitution, magnitude))

        return Changed

    return make


def _frictions(law: Any, restitution: float, magnitude: float) -> Any:
    return replace(law, friction=(1.0 - 0.5 * magnitude) * law.friction), restitution


def _restitution_on_both(law: Any, restitution: float, magnitude: float) -> Any:
    return law, law.restitution if restitution == 1.0 else restitution


def _shape_off(original: Any, magnitude: float) -> Any:
    class Shifted(original):  # type: ignore[misc]
        def add(self, shape: Any, position: Any, law: Any, restitution: float) -> Any:
            return super().add(shape, (1.0 - magnitude) * position, law, restitution)

    return Shifted


def _boxed(original: Any, magnitude: float, *arguments: Any, **named: Any) -> Any:
    stepping = original(*arguments, **(named | {"cones": False}))
    stepping.touching.solve_by = lambda *_: None
    return stepping


def _on_partner(original: Any, magnitude: float, *arguments: Any) -> Any:
    return (1.0 - 2.0 * magnitude) * original(*arguments)


def _no_black_list(original: Any, magnitude: float) -> Any:
    return lambda *_: ()


def _limits_not_turned(original: Any, magnitude: float, model: Any) -> None:
    straight = {key: replace(axis, sign=1.0) for key, axis in model.axes.items()}
    original(replace(model, axes=straight))


CONTACT_MUTANTS = (
    Mutant(CONTACTS, "friction of one partner, DART", "half of the coefficient", FINE[:2], FRACTION, I,
           inside(("contacts", "_Pad", _pads(_frictions)))),
    Mutant(CONTACTS, "restitution squared, DART", "restitution on both shapes, which DART multiplies", WHOLE, "", T,
           inside(("contacts", "_Pad", _pads(_restitution_on_both)))),
    Mutant(CONTACTS, "shapes at the origin", "a part of the place of each shape is lost", FINE[:2], FRACTION, I,
           inside(("contacts", "_Pad", _shape_off))),
    Mutant(CONTACTS, "box for a cone", "DART's default friction", WHOLE, "", T,
           inside(("engine", "stepper", wrapped(_boxed)))),
    Mutant(CONTACTS, "force on the partner, DART", "forces of contacts are those on the other body", FINE[:2],
           FRACTION, I, inside(("engine", "settle", wrapped(_on_partner)))),
    Mutant(CONTACTS, "all pairs collide", "the black list is empty", WHOLE, "", I,
           inside(("contacts", "combinations", _no_black_list))),
    Mutant(CONTACTS, "margin, DART", "spheres are larger by this", (1e-2, 1e-3), "m", T,
           inside(("contacts", "INSIDE", lambda original, magnitude: magnitude))),
    Mutant(CONTACTS, "limits not turned", "limits of joints passed backwards are at the wrong ends", WHOLE, "", T,
           inside(("stepping", "set_limits", wrapped(_limits_not_turned)))),
)  # fmt: skip
"""Errors in contacts, which `tests/conformance/test_contact_mutants.py` plants, too."""

MUTANTS = (
    Mutant(2, "implicit damping", "the skeleton keeps a time step, over which springs and dampers are implicit",
           (1e-1, 1e-2, 1e-3, *decades(-4, -14, 2)), "s", I, inside(("", "_translated", on_result(_time_step))),
           preconditions.damper),
    Mutant(4, "default mass of massless links", "they keep this part of DART's mass 1 and inertia 1", FINE,
           "kg, kg m^2", M, inside(("translation", "set_inertia", wrapped(_default_inertia))), _MASSLESS_LINKS),
    Mutant(7, "free joint, DART", "linear part where the angular one belongs", FINE, FRACTION, I,
           inside(("engine", "from_state", wrapped(_free_twist))), preconditions.kind("free")),
    Mutant(16, "error reduction left on", "DART's class keeps an error reduction from another run",
           (1.0, 1e-1, 1e-2, *decades(-3, -13, 2)), "a step", I, _left_on(1.0, 0.0), preconditions.loop,
           methods="World.step"),
    Mutant(16, "force mixing left on", "DART's class keeps a force mixing from another run", decades(-1, -13, 2),
           "1/(kg s)", I, _left_on(0.0, 1.0), preconditions.loop, methods="World.step"),
    Mutant(16, "error reduction left on, motion", "DART's class keeps more of it from another run", (0.5, 0.1),
           "a step", T, _left_on(1.0, 0.0), preconditions.loop, methods="World.step", harmless=True,
           remark="0.1 to 1 give one and the same motion: the error reduction is gone with the step"),
    Mutant(16, "force mixing left on, motion", "DART's class keeps a force mixing from another run", decades(0, -8, 4),
           "1/(kg s)", T, _left_on(0.0, 1.0), preconditions.loop, methods="World.step", harmless=True,
           remark="the impulses of a step are in proportion to it, and what they lack, too"),
    Mutant(24, "order two declared", "World.step is of order one", WHOLE, "", T,
           changed(method=outputs.order_declared(2)), methods="World.step"),
    Mutant(24, "part of Euler in RK4, DART", "this part of the step is by Euler's method", MOTION, FRACTION, T,
           inside(("integration", "runge_kutta_4", first_order_step)), methods="RK4"),
)  # fmt: skip
