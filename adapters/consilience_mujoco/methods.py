"""Methods by which MuJoCo answers, their options, and models with these options.

The profile `matched` has hard welds; the profile `default` sets nothing. A weld holds ``J a + R f = aref`` with the
regularisation ``R = (1 - d) / d`` times the inverse inertia `body_invweight0`, with the impedance d of `solimp`. The
error of an acceleration is linear in R while R is small beside the actual inverse inertia ``J M^-1 J^T`` of the weld.
Where R is not small, as for many loops at the defaults, the error saturates: the weld hardly holds. The softness of a
method is a factor on R by way of `body_invweight0`, because MuJoCo clips the impedance at 0.9999.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import mujoco

from consilience.engine import Method, Profile, Question, Route
from consilience_mujoco.rows import Equalities
from consilience_mujoco.translate import Translation

INVWEIGHT_SCALE = 2e-11
"""Factor on `body_invweight0`; with impedance 0.9999 the relative regularisation of a weld is 1e-4 times the factor."""

OPTIONS: dict[str, Any] = {
    "opt.jacobian": "DENSE",
    "opt.disableflags": ["CONTACT", "WARMSTART", "EULERDAMP", "AUTORESET", "ISLAND"],
}

HARD: dict[str, Any] = {
    "opt.solver": "CG",
    "opt.tolerance": 0.0,
    "eq_solref": [-0.0, -0.0],
    "eq_solimp": [0.9999, 0.9999, 0.001, 0.5, 2.0],
}

WEIGHTS = ("body_invweight0", "dof_invweight0", "tendon_invweight0")
"""Inverse inertias to which the regularisation of welds, rows on joints, and rows on guided bodies is proportional."""

GAINS = (
    *("eq_solref", "eq_solimp", "pair_solref", "pair_solreffriction", "pair_solimp", "pair_margin"),
    *("jnt_solref", "jnt_solimp", "jnt_margin", "dof_solref", "dof_solimp"),
)
"""Arrays of gains and impedances of the rows of equalities, contacts, stops and dry friction."""

_MATCHED_STEPS = {"RK4": (4, (10, 20, 40)), "Euler": (1, (200, 400, 800))}
STIFF = 2e3
"""Rate of a damper, 1/s, above which an implicit method is asked too: `RK4` at samples every 0.05 s is unstable."""

_IMPLICIT = {"opt.integrator": "IMPLICITFAST"}
DEFAULT_STEPS = (25, 50, 100)
"""MuJoCo's time step of 0.002 s at samples every 0.05 s, then a half and a quarter."""

AT_AN_INSTANT = 2000
"""Iterations of the solver at an instant. By CG accelerations converge in tens of iterations; forces inside a linkage
that cannot move (a slider-crank locked by its coupling) converge slowly: 2.4e-10 off after 500, 3e-12 after 2000."""

_CUT = "cut to its rank at the start"
"""Setting of a motion with hard constraints; without effect where the rows are independent."""

_SPARSE = 60
"""Number of coordinates from which MuJoCo's Jacobian is sparse by default."""

_SELF_DIFFERENCES: dict[str, dict[str, Any]] = {
    "mj_forward, defaults but sparse": {"opt.jacobian": "SPARSE"},
    "mj_forward, defaults but CG": {"opt.solver": "CG", "opt.tolerance": 0.0, "opt.iterations": 500},
}
"""Methods that solve the same soft problem, whose solution is unique, by another code path of MuJoCo."""

_EVALUATIONS = {"RK4": 4, "EULER": 1, "IMPLICITFAST": 1}


def evaluations(method: Method) -> int:
    """Return the evaluations of the accelerations in a step; MuJoCo's default integrator is Euler."""
    return _EVALUATIONS[method.settings.get("opt.integrator", "EULER")]


def _default(name: str, softness: float | None, **more: Any) -> Method:
    return Method(name, Route.NATIVE, profile=Profile.DEFAULT, softness=softness, **more)


def _tree(question: Question) -> tuple[Method, ...]:
    if question is not Question.TRAJECTORY:
        return (Method("mj_forward", Route.NATIVE, settings=OPTIONS),)
    (rk4, halves), (euler, steps) = _MATCHED_STEPS.values()
    return (
        Method("RK4", Route.NATIVE, rk4, halves, settings=OPTIONS | {"opt.integrator": "RK4"}),
        Method("Euler", Route.NATIVE, euler, steps, settings=OPTIONS),
        _default("Euler, defaults", None, order=1, substeps=DEFAULT_STEPS),
    )


def hard(equalities: Equalities) -> dict[str, Any]:
    """Settings that make the constraints hard, and the fields that the callback writes."""
    counts = zip(WEIGHTS, (equalities.welds, equalities.joints, equalities.guides), strict=True)
    factors = {f"{name}, factor": INVWEIGHT_SCALE for name, count in counts if count}
    callback = {"mjcb_control": "efc_aref, efc_J" if equalities.written else "efc_aref"}
    return HARD | factors | (callback if equalities.completed or equalities.written else {})


def iterations(equalities: Equalities) -> int:
    """Iterations of the solver at every stage of a step."""
    return 20 + 12 * equalities.welds + 4 * (equalities.joints + equalities.guides)


def _held(question: Question, equalities: Equalities) -> tuple[Method, ...]:
    settings = OPTIONS | hard(equalities)
    softly = not equalities.written or equalities.freedom < _SPARSE
    if question is Question.TRAJECTORY:
        settings |= {"opt.iterations": iterations(equalities), "opt.integrator": "RK4", "efc_J": _CUT}
        rk4 = Method("RK4", Route.TUNED, *_MATCHED_STEPS["RK4"], settings=settings, softness=1.0)
        return (rk4, _default("Euler, defaults", 1.0, order=1, substeps=DEFAULT_STEPS)) if softly else (rk4,)
    forward = Method("mj_forward", Route.TUNED, settings=settings | {"opt.iterations": AT_AN_INSTANT}, softness=1.0)
    if question is Question.MODEL:
        return (replace(forward, softness=None),)
    # other settings of constraints do not enter these equations
    borrowed = {name: settings[name] for name in ("eq_solref", "mjcb_control") if name in settings}
    harness = Method("mj_fullM, efc_J", Route.HARNESS_SOLVE, settings=OPTIONS | borrowed)
    differences = tuple(
        _default(name, 1.0, settings=settings)
        for name, settings in _SELF_DIFFERENCES.items()
        if not (equalities.written and "opt.jacobian" in settings)
    )
    return (forward, harness, *((_default("mj_forward, defaults", 1.0), *differences) if softly else ()))


def methods(question: Question, equalities: Equalities, stiff: bool) -> tuple[Method, ...]:
    """Return the methods for a question about a mechanism with such constraints, the headline method first.

    Parameters
    ----------
    question : Question
    equalities : Equalities
    stiff : bool
        Dampers have rates above `STIFF`.
    """
    held = equalities.welds + equalities.joints + equalities.guides
    found = _held(question, equalities) if held else _tree(question)
    if question is not Question.TRAJECTORY or not stiff:
        return found
    order, steps = _MATCHED_STEPS["Euler"]
    settings = found[0].settings | _IMPLICIT
    implicit = replace(found[0], name="implicitfast", order=order, substeps=steps, settings=settings)
    return (found[0], implicit, *found[1:])


def _disable(names: list[str]) -> int:
    return sum(int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}")) for name in names)


_VALUES: dict[str, Callable[[Any], Any]] = {
    "opt.disableflags": _disable,
    "opt.integrator": lambda name: getattr(mujoco.mjtIntegrator, f"mjINT_{name}"),
    "opt.jacobian": lambda name: getattr(mujoco.mjtJacobian, f"mjJAC_{name}"),
    "opt.solver": lambda name: getattr(mujoco.mjtSolver, f"mjSOL_{name}"),
    "opt.iterations": int,
    "opt.tolerance": float,
    "opt.ls_iterations": int,
    "opt.cone": lambda name: getattr(mujoco.mjtCone, f"mjCONE_{name}"),
    "opt.impratio": float,
}
"""Functions from values of `Method.settings`, by the names of MuJoCo's enumerations, to values of MuJoCo's."""


def configured(translation: Translation, method: Method) -> Translation:
    """Copy a translation as compiled, with the settings of a method.

    Raises
    ------
    ValueError
        The softness is not positive.
    """
    model, settings = copy.copy(translation.model), method.settings
    for name, value in _VALUES.items():
        if name in settings:
            setattr(model.opt, name.removeprefix("opt."), value(settings[name]))
    for name in GAINS:
        if not isinstance(settings.get(name, ""), str):
            getattr(model, name)[:] = settings[name]
    softness = 1.0 if method.softness is None else method.softness
    if not softness > 0.0:
        raise ValueError(f"the softness of a constraint is positive, not {softness:g}")
    for name in WEIGHTS:
        getattr(model, name)[:] *= softness * settings.get(f"{name}, factor", 1.0)
    return replace(translation, model=model, data=mujoco.MjData(model))
