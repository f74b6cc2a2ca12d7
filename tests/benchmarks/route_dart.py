"""Routes by DART: `World.step` extrapolated, and its accelerations with integrators of high order."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
from routes import HIGH_ORDER, TOLERANCES, Integrator, Route, extrapolated, steps

from consilience.case import Case
from consilience.engine import Question, solve_constrained
from consilience.mechanism import Array
from consilience_dart import methods
from consilience_dart.dynamics import constrained_terms, forward_dynamics
from consilience_dart.engine import DartEngine
from consilience_dart.loads import Forces
from consilience_dart.state import from_state, rotations, send
from consilience_dart.stepping import ERROR_REDUCTION_TRAJECTORY, stepper
from consilience_dart.translation import build, constrained, unstepped


def _origins(model) -> Array:
    carried = [(model.nodes[c], model.tree.links[c].body_frame.p) for c in model.carriers]
    return np.array([(T := node.getWorldTransform()).translation() + T.rotation() @ p for node, p in carried])


def _stepped(case: Case) -> Route:
    """Route by the semi-implicit Euler method of `World.step`, of order one."""
    stepping = stepper(case.mechanism, case.initial_state)
    start = from_state(stepping.model, case.initial_state)
    stepping.reduction = ERROR_REDUCTION_TRAJECTORY
    method = DartEngine().methods(case.mechanism, Question.TRAJECTORY)[0]

    def run(count: int) -> Array:
        methods.soften(method)
        stepping.restart(start, 0.0, case.sample / count)
        motion = [_origins(stepping.model)]
        for t in case.times[1:]:
            stepping.step(count)
            stepping.time = float(t)
            motion.append(_origins(stepping.model))
        return np.array(motion)

    return Route("DART", "World.step", True, steps(case), run, lambda motion: motion)


def _high_order(case: Case) -> Iterator[Route]:
    """Routes by methods of high order on accelerations in joint coordinates, for skeletons without rotation vectors."""
    model = build(case.mechanism)
    skeleton, forces, start = model.skeleton, Forces(model), from_state(model, case.initial_state)
    n = skeleton.getNumDofs()
    rate = np.empty(2 * n)
    bare = not forces and not case.mechanism.drives

    def accelerations(t: float) -> Array:
        if constrained(case.mechanism, model.tree):
            return solve_constrained(*constrained_terms(model, forces, t))[0]
        if bare:
            skeleton.computeForwardDynamics()
            return skeleton.getAccelerations()
        return forward_dynamics(model, forces, t)

    def derivative(t: float, y: Array) -> Array:
        skeleton.setPositions(y[:n])
        skeleton.setVelocities(y[n:])
        rate[:n], rate[n:] = y[n:], accelerations(t)
        return rate

    def run(integrator: Integrator, tolerance: float) -> Array:
        send(model, start)
        return integrator(derivative, np.concatenate([start.q, start.v]), case.times, tolerance)[:, :n]

    def positions(motion: Array) -> Array:
        found = []
        for q in motion:
            skeleton.setPositions(q)
            found.append(_origins(model))
        return np.array(found)

    name = "mass matrix, Jacobians" if constrained(case.mechanism, model.tree) else "computeForwardDynamics"
    for method, integrator in HIGH_ORDER.items():
        yield Route("DART", f"{name} + {method}", False, TOLERANCES, partial(run, integrator), positions)


def routes(case: Case) -> Iterator[Route]:
    """Return the routes of a case."""
    if DartEngine().unsupported(case.mechanism, Question.TRAJECTORY) or case.mechanism.controls:
        return
    if not unstepped(case.mechanism):
        euler = _stepped(case)
        yield extrapolated(euler, (1, 2), (1,))
        yield extrapolated(euler, (1, 2, 3, 4), (1, 2, 3))
        yield extrapolated(euler, (1, 2, 3, 4, 6, 8), (1, 2, 3, 4, 5))
    if not rotations(build(case.mechanism)):
        yield from _high_order(case)
