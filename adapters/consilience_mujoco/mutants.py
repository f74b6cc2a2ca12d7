"""Mutants of this adapter, for `consilience mutate`: known errors of users and adapters of MuJoCo.

Only the campaign imports this module; the vocabulary of `consilience.audit.mutate` stays out of the adapter itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import mujoco
import numpy as np

from consilience.audit.mutate import (
    CONTACTS,
    FINE,
    FRACTION,
    WHOLE,
    Mutant,
    Planting,
    Proxy,
    contact_mutants,
    decades,
    inside,
    on_result,
    preconditions,
    replaced,
    with_settings,
    wrapped,
)
from consilience.engine import Engine, Question
from consilience_mujoco import states

M, I, T = Question.MODEL, Question.INSTANT, Question.TRAJECTORY

SOLVER = "evaluate"

_RADIUS = 0.05


def _model(change: Callable[[Any, float], None]) -> Planting:
    """Change the translation of a mechanism after its compilation by the adapter."""
    return inside(("", "_prepare", on_result(change)))


def _body(change: Callable[..., None]) -> Planting:
    """Change the function by which the adapter adds a body to the specification."""
    return inside(("translate", "_add_body", wrapped(change)))


def _setting(name: str, of: Callable[[float], Any]) -> Planting:
    """Plant another value of one setting in methods with this setting."""
    return with_settings(lambda settings, e: {name: of(e)} if name in settings else {})


def _without_flag(name: str) -> Callable[[dict[str, Any], float], dict[str, Any]]:
    """Remove one of the flags that the adapter sets."""

    def change(settings: dict[str, Any], magnitude: float) -> dict[str, Any]:
        del magnitude
        return {"opt.disableflags": [flag for flag in settings["opt.disableflags"] if flag != name]}

    return change


def _armature(translation: Any, magnitude: float) -> None:
    model = translation.model
    model.dof_armature[:] += magnitude * model.dof_M0


def _damping(translation: Any, magnitude: float) -> None:
    model = translation.model
    model.dof_damping[:] += magnitude * model.dof_M0


def _friction(translation: Any, magnitude: float) -> None:
    translation.model.dof_frictionloss[:] = magnitude


def _equality_off(translation: Any, magnitude: float) -> None:
    del magnitude
    translation.data.eq_active[:] = 0
    translation.model.eq_active0[:] = 0


def _gravity_compensation(original: Any, magnitude: float, spec: Any, *more: Any) -> None:
    original(spec, *more)
    spec.bodies[-1].gravcomp = magnitude


def _identity_axes(original: Any, magnitude: float, inertia: Any) -> Any:
    moments, quat = original(inertia)
    turned = quat + magnitude * (np.array([1.0, 0.0, 0.0, 0.0]) * np.sign(quat[0] or 1.0) - quat)
    return moments, turned / np.linalg.norm(turned)


def _geometry(original: Any, magnitude: float, spec: Any, *more: Any) -> None:
    """Add a ball of the body's mass and density 1000 to each body, from which MuJoCo takes the inertia."""
    del magnitude
    original(spec, *more)
    body = spec.bodies[-1]
    spec.compiler.inertiafromgeom = 1
    radius = (3.0 * max(float(body.mass), 1e-3) / (4.0 * np.pi * 1000.0)) ** (1.0 / 3.0)
    body.add_geom(size=[radius, 0.0, 0.0], density=1000.0, contype=0, conaffinity=0)


def _touching(original: Any, magnitude: float, spec: Any, mechanism: Any, tree: Any, chain: Any) -> None:
    """Add a ball to each body, and a ball on the ground that touches it in the drawing.

    Parameters
    ----------
    original : callable
        Function of the adapter, of the parameters after `magnitude`.
    magnitude : float, m
        Depth of the contact.
    spec, mechanism, tree, chain
        As in `translate._add_body`.
    """
    original(spec, mechanism, tree, chain)
    spec.bodies[-1].add_geom(size=[_RADIUS, 0.0, 0.0], pos=tree.links[chain[-1]].body_frame.p, mass=0.0)
    number = tree.links[chain[-1]].body
    if number >= 0:
        at = mechanism.bodies[number].drawing.p + np.array([0.0, 0.0, 2.0 * _RADIUS - magnitude])
        spec.worldbody.add_geom(size=[_RADIUS, 0.0, 0.0], pos=at, mass=0.0)


@contextmanager
def _contacts_on(engine: Engine, magnitude: float) -> Iterator[Engine]:
    """Enable contacts, as by default, between geometries that touch."""
    flags = with_settings(_without_flag("CONTACT"))
    with _body(_touching)(engine, magnitude) as inner, flags(inner, magnitude) as outer:
        yield outer


@contextmanager
def _stale_samples(engine: Engine, magnitude: float) -> Iterator[Engine]:
    """Read samples from the derived fields as they are after a step, at any magnitude."""
    del magnitude

    def only_at_start(name: str) -> Any:
        """Return a function of MuJoCo that has an effect at time zero only."""

        def evaluate(model: Any, data: Any) -> None:
            if data.time == 0.0:
                getattr(mujoco, name)(model, data)

        return evaluate

    stale = {name: only_at_start(name) for name in ("mj_kinematics", "mj_comPos", "mj_comVel")}
    with replaced(states, "mujoco", lambda original: Proxy(original, **stale)):
        yield engine


def _free_in_world(original: Any, magnitude: float, link: Any, coordinate: Any, state: Any) -> Any:
    """Give angular velocities of free joints in world axes where those of the body belong.

    Parameters
    ----------
    original : callable
        Function of the adapter, of the parameters after `magnitude`.
    magnitude : float
        Part of the error.
    link, coordinate, state
        As in `states._free`.
    """
    q, v = original(link, coordinate, state)
    w = state.w_WB_W[link.body]
    return q, np.concatenate([v[:3], v[3:] + magnitude * (w - v[3:])])


MUTANTS = (
    Mutant(1, "armature, MuJoCo", "dof_armature: this part of the diagonal of the mass matrix", decades(-1, -13),
           "of the inertia", I, _model(_armature)),
    Mutant(2, "dof_damping", "dof_damping: this part of the diagonal of the mass matrix", decades(0, -14, 2), "1/s", I,
           _model(_damping)),
    Mutant(2, "dof_frictionloss", "dry friction in every velocity", decades(0, -12, 2), "N m", I, _model(_friction),
           remark="at any magnitude the rows of friction are counted as constraints"),
    Mutant(3, "principal axes dropped", "orientation of the principal axes lost, as MuJoCo does without a position",
           FINE, FRACTION, M, inside(("translate", "principal_inertia", wrapped(_identity_axes)))),
    Mutant(4, "inertiafromgeom", "inertia from a sphere of density 1000 and the body's mass", WHOLE, "", M,
           _body(_geometry)),
    Mutant(5, "contacts on", "a sphere on each body touches one on the ground in the drawing", decades(-1, -9, 2),
           "m deep", I, _contacts_on,
           remark="only mechanisms asked about in their drawing touch: the shipped cases' first states"),
    Mutant(7, "free joint, MuJoCo", "qvel of a free joint: angular part in world axes", FINE, FRACTION, I,
           inside(("states[_WRITE]", "F", wrapped(_free_in_world))), preconditions.kind("free")),
    Mutant(14, "fields as a step leaves them", "MuJoCo's poses without mj_kinematics", WHOLE, "", T, _stale_samples,
           preconditions.tree, unseen=True,
           remark="the poses are those of the last stage of the step: off by less as steps get shorter, with the "
           "declared order; `differs: discretisation` is what there is to say"),
    Mutant(17, "soft welds", "regularisation at the clamped impedance: this factor on body_invweight0",
           decades(0, -12, 2), "of the default", I, _setting("body_invweight0, factor", float), preconditions.loop,
           methods="mj_forward"),
    Mutant(17, "impedance", "solimp: this much below one", (0.1, 1e-2, 1e-3, 2e-4), "", I,
           _setting("eq_solimp", lambda e: [1.0 - e, 1.0 - e, 0.001, 0.5, 2.0]), preconditions.loop,
           methods="mj_forward", remark="softness is this over one, times body_invweight0, which the adapter scales"),
    Mutant(17, "soft welds, motion", "regularisation at the clamped impedance: this factor on body_invweight0",
           decades(0, -8, 2), "of the default", T, _setting("body_invweight0, factor", float), preconditions.loop,
           methods="RK4"),
    Mutant(19, "Baumgarte, MuJoCo", "solref: stiffness, and the damping that goes with it", decades(10, 0, 2), "1/s^2",
           I, _setting("eq_solref", lambda e: [-e, -2.0 * e**0.5]), preconditions.loop, methods="mj_forward",
           remark="as above"),
    Mutant(22, "welds off", "equality constraints switched off", WHOLE, "", M, _model(_equality_off),
           preconditions.loop),
    Mutant(24, "RK4 is Euler", "opt.integrator: Euler, declared as order four", WHOLE, "", T,
           _setting("opt.integrator", lambda e: "EULER"), methods="RK4"),
    Mutant(25, "gravity compensated", "body_gravcomp: this part of the weight", FINE, "of the weight", I,
           _body(_gravity_compensation)),
    Mutant(26, "solver stopped early", "opt.iterations: one over the magnitude", (1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01),
           "", I, _setting("opt.iterations", lambda e: round(1.0 / e)), preconditions.loop, methods="mj_forward"),
    Mutant(26, "solver tolerance", "opt.tolerance; 1e-8 is the default", decades(0, -24, 4), "", I,
           _setting("opt.tolerance", float), preconditions.loop, methods="mj_forward"),
    Mutant(26, "sparse Jacobian", "opt.jacobian: sparse", WHOLE, "", I, _setting("opt.jacobian", lambda e: "SPARSE"),
           preconditions.only_joints, methods="mj_forward", harmless=True),
    Mutant(26, "warm start", "on, as it is by default: an instant depends on the one before", WHOLE, "", I,
           with_settings(_without_flag("WARMSTART")), preconditions.loop, methods="mj_forward"),
    Mutant(26, "islands", "on, as they are by default", WHOLE, "", I, with_settings(_without_flag("ISLAND")),
           methods="mj_forward", harmless=True),
)  # fmt: skip


def _torsion(original: Any, magnitude: float, spec: Any, *more: Any) -> None:
    original(spec, *more)
    spec.pairs[-1].condim = 4
    spec.pairs[-1].friction[2] = magnitude


CONTACT_MUTANTS = (
    *contact_mutants("MuJoCo"),
    Mutant(CONTACTS, "torsional friction on", "condim 4: this length", decades(-2, -8, 2), "m", T,
           inside(("contacts", "_add_part", wrapped(_torsion)))),
    Mutant(CONTACTS, "pyramid for the circle", "opt.cone at its default", WHOLE, "", T,
           _setting("opt.cone", lambda e: "PYRAMIDAL"), methods="RK4"),
    Mutant(CONTACTS, "soft friction", "opt.impratio: one over the magnitude", (1.0, 1e-4, 1e-8), "", T,
           _setting("opt.impratio", lambda e: 1.0 / e), methods="RK4"),
)  # fmt: skip
"""Errors in contacts, which `tests/conformance/test_contact_mujoco.py` plants, too."""
