"""Accelerations at an instant with closed contacts, stops and dry friction, by two steps of `World.step`.

Force mixing e = 1e-5 adds ``e D h f`` to the velocity u of a contact with the force f, D the diagonal of its inverse
inertia: DART's law is one of ``u + e D h f``. The first step has it as an error e of the acceleration; the second makes
up for it, as far as f does not change (`MIXING`). The difference quotient of the second is extrapolated to zero step.
A slip that starts from rest is ``k h a`` after k steps: friction is along ``a + e D f / k``, an error in proportion to
1/k, which the second and the third step tell and remove.

DART's rows are those of the start of a step and lack the rates of their directions. Where these count, as at a turning
corner, the first step starts ahead by what they change in it (`turning`), and the second finds its rows turned; spheres
that press are kept in touch (`pressing`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from consilience.engine import limit_of_halved
from consilience.mechanism import (
    Array,
    State,
    characteristic_length,
    contact_parts,
    determinate_forces,
    nearest_points,
    sharing_rows,
)
from consilience_dart.constraints import weld_terms
from consilience_dart.contacts import CLOSED, SLIDING, Touching
from consilience_dart.state import Coordinates, send
from consilience_dart.stepping import (
    CONSTRAINT_FORCE_MIXING,
    ERROR_REDUCTION_INSTANT,
    MIXINGS,
    Stepper,
    set_softness,
    zero_step_accelerations,
)
from consilience_dart.translation import Model
from consilience_dart.turning import turning

STEP, SHORTER = 1e-3, (1, 8, 64)
"""Longest step in s, and its parts that are asked for one after the other until the accelerations settle: those of
drives and of fast turning change in a step. Shorter steps are spoilt by rounding and by overlaps."""

TURN, FRICTION = 1e-2, 30.0
"""Part by which friction may change a slip in a step, at this acceleration in m/s^2 or a larger one of a first step."""

SOLVERS = (("NsgsFrictionSolver", "maxSweeps", 1000), ("FbfFrictionSolver", "maxOuterIterations", 4000))
"""Solvers of friction in the order in which they are asked, with the option that bounds their iterations, and the
bound. The first is faster and has more digits, but does not converge for boxes that slide; the second does not for a
ball that rolls in a trough, and 100 iterations are too few for a box that tips. Each has a world of its own at each
state and step, because DART begins with the forces of the step before: the second then stops at its bound, 5e-7 off."""

FINE = 1e-12
"""Their tolerance."""

SETTLED, UNSETTLED = 1e-7, 2.5e-7
"""Error of an acceleration, over the largest one or 1 m/s^2, below which the other solver is not asked, and above which
there is no answer: by two extrapolations, by what force mixing makes of forces that still change, by gaps that open or
close in spite of a force, or by loops that part. The bar is four times the second."""

UNDERSTATED = 3.0
"""Largest error over what two extrapolations tell, as in a loop."""

STEPS, SHARED_STEPS = 2, 3
"""Steps of which the last counts; three where contacts share a load, or two do not settle: forces still change in the
second, and no shorter step settles them."""

MIXING = 1e-5
"""Force mixing of DART's contacts, a part of the diagonal of their inverse inertia; there is no setter."""

UNMIXED = ((1, 1.0),)
"""Factor on the force mixing of welds, and its weight, where there are none."""


def _slips(model: Model, touching: Touching, state: State) -> tuple[float, Array]:
    """Return the least rate that is not zero, and which closed contacts have a part at rest, bool (n_c,).

    The rates are those of slips, m/s, and of coordinates with dry friction, m/s or rad/s; infinite if all are zero.

    Raises
    ------
    ArithmeticError
        A closed contact closes further.
    """
    rates = [abs(model.axes[d.joint, d.coordinate].rate) for d in touching.mechanism.dry_frictions]
    resting = np.zeros(len(touching.mechanism.contacts), dtype=bool)
    for n, contact in enumerate(touching.mechanism.contacts):
        for part in contact_parts(contact):
            nearest = nearest_points(touching.mechanism, state, part)
            if nearest.gap > CLOSED:
                continue
            slip = touching.slip(n, nearest.on_body)
            rate = float(nearest.normal @ slip)
            if rate < -CLOSED:
                raise ArithmeticError(f"contact '{part.name}' closes at {-rate:.3g} m/s: an impact, no acceleration")
            speed = float(np.linalg.norm(slip - rate * nearest.normal))
            resting[n] |= speed <= CLOSED
            rates.append(speed)
    return min((rate for rate in rates if rate > CLOSED), default=np.inf), resting


def _require_same_contacts(touching: Touching, forces: list[Array]) -> None:
    """Refuse steps of which some miss a contact that others, or the first, find: their limit is that of neither."""
    acting = np.any(forces, axis=2)
    for n in np.flatnonzero(np.any(acting, axis=0) & ~np.all(acting, axis=0)):
        name = touching.mechanism.contacts[n].name
        raise ArithmeticError(f"contact '{name}' acts in some of the halved steps and not in others")


def settle(stepping: Stepper, fresh: Callable[[], Stepper], c: Coordinates, state: State) -> Array:
    """Compute generalised accelerations, and the forces of the contacts (n_c, 3) on their bodies, world axes.

    The skeleton of `stepping` is left at the state, with these accelerations.

    Parameters
    ----------
    stepping : Stepper
    fresh : callable
        Makes a stepper like it.
    c : Coordinates
    state : State

    Raises
    ------
    CannotRepresent
        Contacts that turn apart.
    ArithmeticError
        DART has no acceleration: an impact, or friction without a solution.
    """
    touching, model = stepping.touching, stepping.model
    assert touching is not None
    free = not (touching.mechanism.stops or touching.mechanism.dry_frictions) and np.min(touching.gaps()) > CLOSED
    if free:
        touching.solve_by_pivoting()
    x = np.zeros(0) if free else turning(model, touching, c)
    kept = (lambda: replace(fresh(), mended=True, ahead=x)) if np.any(x) else fresh
    a, forces = np.zeros(model.skeleton.getNumDofs()), np.zeros((len(touching.mechanism.contacts), 3))
    for factor, weight in MIXINGS if model.tree.welds else UNMIXED:
        set_softness(ERROR_REDUCTION_INSTANT, factor * CONSTRAINT_FORCE_MIXING)
        if free:
            a += weight * zero_step_accelerations(stepping, c, state)
            continue
        shared = len(sharing_rows(model.mechanism, state)) > 0
        unsure = not np.all(determinate_forces(model.mechanism, state).contacts)
        settled = _settled(kept, c, state, shared, unsure)
        a += weight * settled.a
        forces += weight * settled.forces
    send(model, c)
    model.skeleton.setAccelerations(a)
    return forces


class _Settled(NamedTuple):
    """Accelerations and forces by a solver of friction, and an estimate of the error of the former."""

    a: Array
    forces: Array
    spread: float


class _Quotient(NamedTuple):
    """Accelerations and forces of a step, and the change of the forces from the step before."""

    a: Array
    forces: Array
    change: Array


def _quotient(stepping: Stepper, c: Coordinates, h: float, count: int) -> _Quotient:
    """Return the difference quotient of the last of some steps from a state."""
    touching = stepping.touching
    assert touching is not None
    stepping.restart(c, 0.0, h)
    stepping.step(count - 1)
    v, forces = np.array(stepping.model.skeleton.getVelocities()), touching.forces
    stepping.step(1)
    a = (stepping.model.skeleton.getVelocities() - v) / h
    return _Quotient(a, touching.forces, touching.forces - forces)


def _mixed(touching: Touching, model: Model, change: Array) -> float:
    """Return the acceleration in m/s^2 that force mixing makes of a change of forces in a step."""
    W = model.skeleton.getInvMassMatrix()
    found = 0.0
    for n in np.flatnonzero(np.any(change, axis=1)):
        J = touching.jacobian(int(n), touching.points[n])
        found = max(found, MIXING * float(np.max(np.diag(J @ W @ J.T)) * np.linalg.norm(change[n])))
    return found


def _parting(model: Model, c: Coordinates, a: Array) -> float:
    """Return the acceleration in m/s^2 with which loops part under generalised accelerations a.

    The first solver may end far from their rows with no sign that it does.
    """
    send(model, c)
    model.skeleton.setAccelerations(np.zeros(len(a)))
    J, bias = weld_terms(model)
    sizes = np.repeat([characteristic_length(model.mechanism), 1.0], 3)
    return float(np.max(np.abs((J @ a + bias).reshape(-1, 6) * sizes), initial=0.0))


def _settled(fresh: Callable[[], Stepper], c: Coordinates, state: State, shared: bool, unsure: bool) -> _Settled:
    """Solve by one solver of friction, by the other and with shorter steps where it leaves the accelerations open.

    Where contacts share a load the second solver comes first: the first ends with no sign that it is off. Where
    equilibrium leaves forces open (`unsure`), both are asked, and their difference counts as an error.

    Raises
    ------
    ArithmeticError
    """
    found: list[_Settled] = []
    why: ArithmeticError | None = None
    solvers = SOLVERS[::-1] if shared else SOLVERS
    for part in SHORTER:
        steps = SHARED_STEPS if shared or part > 1 else STEPS
        answers: list[_Settled] = []
        for solver in solvers:
            try:
                answers.append(_by(solver, fresh, c, state, part, steps))
            except ArithmeticError as error:
                why = error
                continue
            if answers[-1].spread < SETTLED and not unsure:
                break
        found += _compared(answers) if unsure else answers
        if any(one.spread < SETTLED for one in found):
            break
    best = min(found, key=lambda one: one.spread, default=None)
    if best is None or best.spread > UNSETTLED:
        raise why or ArithmeticError("DART's solvers of friction leave the accelerations open")
    return best


def _compared(answers: list[_Settled]) -> list[_Settled]:
    """Return answers with spreads of their largest difference at least, unless `UNDERSTATED` spreads explain it."""
    if not answers:
        return []
    a = np.array([one.a for one in answers])
    apart = float(np.max(np.ptp(a, axis=0)) / max(1.0, np.max(np.abs(a))))
    if apart <= UNDERSTATED * sum(one.spread for one in answers):
        return answers
    return [one._replace(spread=max(one.spread, apart)) for one in answers]


def _by(
    solver: tuple[str, str, int], fresh: Callable[[], Stepper], c: Coordinates, state: State, part: int, steps: int
) -> _Settled:
    """Extrapolate the last of some steps to zero step, by a solver of friction, from a part of the longest step.

    Raises
    ------
    ArithmeticError
    """
    worlds: list[Touching] = []

    def world() -> Stepper:
        stepping = fresh()
        assert stepping.touching is not None
        stepping.touching.solve_by((*solver, FINE))
        worlds.append(stepping.touching)
        return stepping

    stepping = world()
    touching = worlds[0]
    slowest, resting = _slips(stepping.model, touching, state)
    stepping.restart(c, 0.0, STEP)
    stepping.step(1)
    first, starts = touching.forces, np.any(resting & (touching.modes == SLIDING))
    h = min(STEP, TURN * slowest / max(FRICTION, touching.slip_rate)) / part
    quotients, forces, changes, opening = [], [], [], []
    for halves in (1, 2, 4, 8):
        stepping = world()
        last = _quotient(stepping, c, h / halves, steps)
        a, force, rate = last.a, last.forces, np.array(worlds[-1].opening)
        if starts:
            stepping = world()
            last = _quotient(stepping, c, h / halves, steps + 1)
            a, force = (steps + 1) * last.a - steps * a, (steps + 1) * last.forces - steps * force
            rate = (steps + 1) * worlds[-1].opening - steps * rate
        quotients.append(a)
        forces.append(force)
        changes.append(last.change)
        opening.append(rate)
    if any(one.failed() for one in worlds):
        raise ArithmeticError(f"{solver[0]} fails at this state")
    _require_same_contacts(touching, [first, *forces])
    a, finer = limit_of_halved(quotients[:3]), limit_of_halved(quotients[1:])
    size = max(1.0, np.max(np.abs(a), initial=0.0))
    spread = np.max(np.abs(finer - a), initial=0.0) / size
    least = slice(1, 4) if spread < SETTLED else slice(3)  # shorter steps have less room for the errors of a solver
    off = max(
        abs(float(limit_of_halved(opening[least]))), _mixed(worlds[-1], stepping.model, limit_of_halved(changes[least]))
    )
    best = limit_of_halved(quotients[least])
    spread = max(spread, off / size, _parting(stepping.model, c, best) / size)
    return _Settled(best, limit_of_halved(forces[least]), float(spread))
