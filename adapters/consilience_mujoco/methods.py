"""The ways in which MuJoCo answers, every option each sets, and a model with these options.

Two profiles: `matched` has hard welds, `default` sets nothing. A weld holds ``J a + R f = aref`` with the
regularisation ``R = (1 - d) / d`` times the inverse inertia `body_invweight0`, d the impedance of `solimp`. While R is
small beside the inverse inertia ``J M^-1 J^T`` that the weld truly sees, the error of an acceleration is linear in R;
where R is not small, as at the defaults for many a loop, it saturates: the weld hardly holds at all. The softness of
a method is a factor on R, by way of `body_invweight0`; the impedance has no room, MuJoCo clips it at 0.9999.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import mujoco

from consilience.run import Method, Profile, Question, Route
from consilience_mujoco.translate import Translation

INVWEIGHT_SCALE = 2e-11
"""Factor on `body_invweight0`: with impedance 0.9999 the regularisation of a weld is 1e-4 times this, relative."""

OPTIONS: dict[str, Any] = {
    "opt.jacobian": "DENSE",
    "opt.disableflags": ["CONTACT", "WARMSTART", "EULERDAMP", "AUTORESET", "ISLAND"],
}

WELD_SETTINGS: dict[str, Any] = {
    "opt.solver": "CG",
    "opt.tolerance": 0.0,
    "eq_solref": [-0.0, -0.0],
    "eq_solimp": [0.9999, 0.9999, 0.001, 0.5, 2.0],
    "body_invweight0, factor": INVWEIGHT_SCALE,
}

_MATCHED_STEPS = {"RK4": (4, (10, 20, 40, 80)), "Euler": (1, (200, 400, 800))}
_DEFAULT_STEPS = (25, 50, 100)
"""MuJoCo's time step of 0.002 s at samples every 0.05 s, then its halves."""

_SELF_DIFFERENCES: dict[str, dict[str, Any]] = {
    "mj_forward, defaults but sparse": {"opt.jacobian": "SPARSE"},
    "mj_forward, defaults but CG": {"opt.solver": "CG", "opt.tolerance": 0.0, "opt.iterations": 500},
}
"""The same soft problem, which has one solution, by another code path of MuJoCo."""

_EVALUATIONS = {"RK4": 4, "EULER": 1}


def evaluations(method: Method) -> int:
    """Evaluations of the accelerations in a step; MuJoCo's default integrator is Euler."""
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
        _default("Euler, defaults", None, order=1, substeps=_DEFAULT_STEPS),
    )


def _loops(question: Question, welds: int) -> tuple[Method, ...]:
    settings = OPTIONS | WELD_SETTINGS
    if question is Question.TRAJECTORY:
        settings |= {"opt.iterations": 20 + 12 * welds, "opt.integrator": "RK4"}
        return (
            Method("RK4", Route.TUNED, *_MATCHED_STEPS["RK4"], settings=settings, softness=1.0),
            _default("Euler, defaults", 1.0, order=1, substeps=_DEFAULT_STEPS),
        )
    forward = Method("mj_forward", Route.TUNED, settings=settings | {"opt.iterations": 500}, softness=1.0)
    if question is Question.MODEL:
        return (replace(forward, softness=None),)
    borrowed = {"eq_solref": WELD_SETTINGS["eq_solref"]}  # nothing else of the welds enters their equations
    return (
        forward,
        Method("mj_fullM, efc_J", Route.HARNESS_SOLVE, settings=OPTIONS | borrowed),
        _default("mj_forward, defaults", 1.0),
        *(_default(name, 1.0, settings=settings) for name, settings in _SELF_DIFFERENCES.items()),
    )


def methods(question: Question, welds: int) -> tuple[Method, ...]:
    """Methods for a question about a mechanism with so many welds, the headline first."""
    return _loops(question, welds) if welds else _tree(question)


def _disable(names: list[str]) -> int:
    return sum(int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}")) for name in names)


_VALUES: dict[str, Callable[[Any], Any]] = {
    "opt.disableflags": _disable,
    "opt.integrator": lambda name: getattr(mujoco.mjtIntegrator, f"mjINT_{name}"),
    "opt.jacobian": lambda name: getattr(mujoco.mjtJacobian, f"mjJAC_{name}"),
    "opt.solver": lambda name: getattr(mujoco.mjtSolver, f"mjSOL_{name}"),
    "opt.iterations": int,
    "opt.tolerance": float,
}
"""From a value of `Method.settings`, by the names of MuJoCo's enumerations, to MuJoCo's."""


def configured(translation: Translation, method: Method) -> Translation:
    """Copy a translation as it was compiled, and set what the method sets, and nothing else.

    Raises
    ------
    ValueError
        If the softness is not positive.
    """
    model, settings = copy.copy(translation.model), method.settings
    for name, value in _VALUES.items():
        if name in settings:
            setattr(model.opt, name.removeprefix("opt."), value(settings[name]))
    for name in ("eq_solref", "eq_solimp"):
        if name in settings:
            getattr(model, name)[:] = settings[name]
    softness = 1.0 if method.softness is None else method.softness
    if not softness > 0.0:
        raise ValueError(f"the softness of a weld is positive, not {softness:g}")
    model.body_invweight0[:] *= softness * settings.get("body_invweight0, factor", 1.0)
    return replace(translation, model=model, data=mujoco.MjData(model))
