"""Methods by which DART answers, and the settings of each that differ from DART's defaults."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from consilience.engine import Method, Profile, Question, Route, Unsupported, without_screws
from consilience.mechanism import Mechanism, Tree, free_directions, initial_state, to_elementary_tree
from consilience_dart.contact_methods import touches, unilateral_methods
from consilience_dart.stepping import (
    CONSTRAINT_FORCE_MIXING,
    ERROR_REDUCTION_DEFAULT,
    ERROR_REDUCTION_INSTANT,
    ERROR_REDUCTION_TRAJECTORY,
    HALVINGS,
    LARGEST_ROTATION,
    LARGEST_STEP,
    LARGEST_TURN,
    set_softness,
)
from consilience_dart.translation import constrained, unstepped

MODEL = "inertias of the skeleton"
ARTICULATED = "computeForwardDynamics"
MASS_MATRIX = "mass matrix and inverse dynamics"
CONSTRAINED = "mass matrix, inverse dynamics and constraint Jacobians"
EXTRAPOLATED = "World.step with weld constraints, to zero step"
EXTRAPOLATED_DEFAULT = "World.step with weld constraints, defaults, to zero step"
EULER = "World.step"
EULER_DEFAULT = "World.step, defaults"
RK4_ARTICULATED = "computeForwardDynamics + RK4 of the harness"
RK4_CONSTRAINED = "mass matrix + constraint solve and RK4 of the harness"

EULER_SUBSTEPS = (100, 200, 400)
EULER_SUBSTEPS_WITH_FORCES = (50, 100, 200)  # applying forces from Python costs ten times the step
EULER_SUBSTEPS_DEFAULT = (50, 100, 200)  # DART's step of 0.001 s at samples every 0.05 s, then its halves
RK4_SUBSTEPS = (4, 8, 16)

AT_THE_STATE: dict[str, Any] = {"Skeleton.timeStep": 0.0}
STEPPING: dict[str, Any] = {"DeactivationOptions.enabled": False}
TO_ZERO_STEP = (
    f"{LARGEST_STEP:g} s, {LARGEST_ROTATION / 2:g} rad of a body, or {LARGEST_TURN:g} rad of a link, "
    f"halved up to {HALVINGS} times, extrapolated to 0"
)


def _in_proportion(reduction: float, softness: float) -> float:
    return reduction * softness


def _compounded(reduction: float, softness: float) -> float:
    """Reduction that removes in `softness` steps the error that `reduction` removes in one step."""
    return float(1.0 - (1.0 - reduction) ** (1.0 / softness))


REDUCTIONS: dict[str, tuple[float, Callable[[float, float], float]]] = {
    EULER: (ERROR_REDUCTION_TRAJECTORY, _compounded),
    EULER_DEFAULT: (ERROR_REDUCTION_DEFAULT, _compounded),
    EXTRAPOLATED_DEFAULT: (ERROR_REDUCTION_DEFAULT, _in_proportion),
}
"""Error reduction of the welds by method, and the function that scales it by a softness (errors: see `stepping`)."""


def soften(method: Method) -> None:
    """Set error reduction and force mixing of all constraints to the values of a method, scaled by its softness.

    DART accepts no force mixing below its default: a softness below 1 scales the error reduction alone.

    Raises
    ------
    ValueError
        The softness is not positive, or gives an error reduction above 1.
    """
    softness = 1.0 if method.softness is None else method.softness
    if not softness > 0.0:
        raise ValueError(f"the softness of a constraint is positive, not {softness:g}")
    given, scaled = REDUCTIONS[method.name]
    reduction = scaled(given, softness)
    if reduction > 1.0:
        raise ValueError(f"softness {softness:g} asks for an error reduction of {reduction:g}, above 1")
    set_softness(reduction, max(1.0, softness) * CONSTRAINT_FORCE_MIXING)


def _instant(mechanism: Mechanism, tree: Tree) -> tuple[Method, ...]:
    if not constrained(mechanism, tree):
        return (
            Method(ARTICULATED, Route.NATIVE, settings=AT_THE_STATE),
            Method(MASS_MATRIX, Route.HARNESS_SOLVE, settings=AT_THE_STATE),
        )
    extrapolation = {
        "errorReductionParameter": ERROR_REDUCTION_INSTANT,
        "constraintForceMixing": f"{CONSTRAINT_FORCE_MIXING:g}, twice and four times that, extrapolated to 0",
        "step": TO_ZERO_STEP,
    }
    solved = Method(CONSTRAINED, Route.HARNESS_SOLVE, settings=AT_THE_STATE)
    if unstepped(mechanism):
        return (solved,)
    return (
        solved,
        Method(EXTRAPOLATED, Route.EXTRAPOLATED, settings=STEPPING | extrapolation),
        Method(
            EXTRAPOLATED_DEFAULT,
            Route.EXTRAPOLATED,
            settings={"step": TO_ZERO_STEP},
            profile=Profile.DEFAULT,
            softness=1.0,
        ),
    )


def _has_elements(mechanism: Mechanism) -> bool:
    """Whether the adapter applies forces or commands at every step."""
    m = mechanism
    more = any(spring.actuator is not None or not spring.is_linear for spring in m.joint_springs)
    return bool(m.springs or m.loads or m.frictions or m.controls or m.drives or more)


def _moves_as_told(mechanism: Mechanism) -> bool:
    """Whether drives leave no freedom: the positions of `World.step` are then of order two."""
    return bool(mechanism.drives) and free_directions(mechanism, initial_state(mechanism)).shape[1] == 0


def _stepped(mechanism: Mechanism, loops: bool) -> tuple[Method, Method]:
    """Methods by `World.step`: with settings of the adapter, and with DART's defaults."""
    substeps = EULER_SUBSTEPS_WITH_FORCES if _has_elements(mechanism) else EULER_SUBSTEPS
    settings = STEPPING | ({"errorReductionParameter": ERROR_REDUCTION_TRAJECTORY} if loops else {})
    route = Route.TUNED if loops else Route.NATIVE
    softness = 1.0 if loops else None
    order = 2 if _moves_as_told(mechanism) else 1
    return (
        Method(EULER, route, order, substeps, settings=settings, softness=softness),
        Method(EULER_DEFAULT, Route.NATIVE, order, EULER_SUBSTEPS_DEFAULT, profile=Profile.DEFAULT, softness=softness),
    )


def _trajectory(mechanism: Mechanism, tree: Tree) -> tuple[Method, ...]:
    name = RK4_CONSTRAINED if constrained(mechanism, tree) else RK4_ARTICULATED
    runge_kutta = Method(name, Route.HARNESS_INTEGRATOR, 4, RK4_SUBSTEPS, settings=AT_THE_STATE)
    own = () if unstepped(mechanism) else _stepped(mechanism, bool(tree.welds))
    # near the singular pose of a rod's two angles no affordable step shows order four
    return (*own[:1], *(() if _has_rods(mechanism) else (runge_kutta,)), *own[1:])


def _has_rods(mechanism: Mechanism) -> bool:
    return any(joint.kind == "rod" for joint in mechanism.joints)


def unmovable(mechanism: Mechanism) -> tuple[Unsupported, ...]:
    """Return the constraints that neither `World.step` nor the harness's Runge-Kutta method can integrate."""
    if not _has_rods(mechanism):
        return ()
    reason = "World.step has no such constraint, and Runge-Kutta on DART's accelerations needs mechanisms without rods"
    return tuple(Unsupported(f"{what} '{name}'", reason) for what, name in unstepped(mechanism).items())


def methods(mechanism: Mechanism, question: Question) -> tuple[Method, ...]:
    """Return the methods for a question, the headline method first."""
    if question is Question.MODEL:
        return (Method(MODEL, Route.NATIVE),)
    tree = to_elementary_tree(without_screws(mechanism, "revolute"))
    if touches(mechanism):
        return unilateral_methods(mechanism, question, bool(tree.welds))
    return _instant(mechanism, tree) if question is Question.INSTANT else _trajectory(mechanism, tree)
