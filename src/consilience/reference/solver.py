"""Library interface of the reference solver: canonical states in, canonical observables out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from consilience.engine import InstantAnswer, TrajectoryAnswer
from consilience.errors import InvalidInput, NumericalFailure, in_range, nearest
from consilience.mechanism import (
    Array,
    Mechanism,
    State,
    assembled,
    body_point,
    characteristic_length,
    constraint_gamma,
    constraint_jacobian,
    continuous_in_time,
    frictions_too_steep,
    kinetic_energy,
    potential_energy,
    require_states,
    rough_dampers,
    row_names,
    velocity_sizes,
)
from consilience.mechanism.elements import NO_LENGTH
from consilience.mechanism.rates import LEAST_SPEED
from consilience.reference.bodies.arrays import flatten, pack, workspace
from consilience.reference.bodies.canonical import canonical_motion, sample_times
from consilience.reference.bodies.consistency import check_given, check_motion, check_solvable, check_states
from consilience.reference.bodies.forces import count_turns
from consilience.reference.bodies.residual import SOLVABLE, checked_rows, solvable_rows
from consilience.reference.bodies.smooth_equations import refuse_contacts
from consilience.reference.formulations import registry
from consilience.reference.integrators.step_control import STATUS
from consilience.reference.steppers.driver import counts_of
from consilience.reference.tree.solver import INTEGRATORS, simulate_relative

if TYPE_CHECKING:
    from consilience.reference.formulations.body_velocities import AppliedForces


def simulate(
    mechanism: Mechanism,
    state: State,
    times: ArrayLike,
    tolerance: float = 1e-12,
    formulation: str = "descriptor",
    integrator: str | None = None,
    forces: AppliedForces | None = None,
    assemble: bool = False,
) -> TrajectoryAnswer:
    """Integrate the motion of a mechanism.

    Parameters
    ----------
    mechanism : Mechanism
    state : State
        Consistent state at ``times[0]`` (see `consilience.mechanism.assembly`).
    times : array_like, shape (n_t,), s
        Increasing sample times.
    tolerance : float
        Bound on the scaled local error of a step, 1e-14 to 1e-3; for `generalised_alpha` its constant step, s.
    formulation : str
        Key of `registry.FORMULATIONS` or `registry.SYSTEMS`. Compiled as a whole: `relative`, `descriptor` and
        `null_space` with dop853, `relative` with its own integrators. Other combinations call Python at every
        evaluation.
    integrator : str, optional
        Key of `integrators.adaptive.METHODS`; for `relative` alone also ``gauss`` (collocation of order 16), ``taylor``
        (planar mechanisms) or ``radau13`` (stiff motions). Default: ``dop853``; for `relative` ``taylor`` if
        applicable, else ``tp86`` unless a function is a table, and ``radau13`` if tp86 detects stiffness. Formulations
        of `registry.SYSTEMS` have their own integrators.
    forces : callable, optional
        ``forces(t, state)``: force (N) and torque (N m) on each body at its origin, world axes, shape (n_b, 6), in
        addition to those of the mechanism; for formulations in body velocities, called at every evaluation.
    assemble : bool
        Whether to replace the state by the consistent one that is nearest to it; otherwise it is refused where joints
        or drives are violated by more than 1e-9 of the length, or of the speeds, of the mechanism.

    Returns
    -------
    TrajectoryAnswer
        Counters: ``steps``, ``evaluations`` (for taylor: coefficients) and further ones of the method.

    Raises
    ------
    InvalidInput
        Unknown formulation or integrator, tolerance out of range, times that do not increase, a state that is not
        consistent, or a mechanism that the formulation cannot represent or the integrator cannot follow.
    NumericalFailure
        With the status of the integrator, or the time and the constraint that is violated beyond the tolerance.
    """
    require_states(mechanism, (state,))
    grid = sample_times(times)
    in_range("tolerance", tolerance, 0.0, np.inf, "Give a number, for example 1e-12.", True)
    if not (forces is None or callable(forces)):
        raise InvalidInput("forces", f"{forces!r} is no function", "Give a function of the time and the state.")
    refuse_contacts(mechanism)
    refuse_steep_friction(mechanism)
    if integrator == "gauss":
        _refuse_rough_dampers(mechanism)
    if assemble:
        state = assembled(mechanism, state, float(grid[0]))
    if formulation in registry.SYSTEMS:
        return _system(mechanism, state, grid, tolerance, formulation, {"integrator": integrator, "forces": forces})
    if not 1e-14 <= tolerance <= 1e-3:
        raise InvalidInput("tolerance", f"{tolerance} is out of range", "Choose 1e-14 to 1e-3.")
    try:
        return _simulate(mechanism, state, grid, tolerance, formulation, integrator, forces)
    except (NumericalFailure, np.linalg.LinAlgError) as error:
        raise NumericalFailure(f"{_said(error, formulation)}{_causes(mechanism, state)}") from None


def refuse_steep_friction(mechanism: Mechanism) -> None:
    """Refuse friction whose Coulomb part no step resolves.

    Raises
    ------
    InvalidInput
    """
    for friction in frictions_too_steep(mechanism):
        raise InvalidInput(
            f"friction '{friction.name}': speed",
            f"{friction.speed:g} is too small: a joint that ought to stick creeps, and no step resolves it",
            f"Give {LEAST_SPEED:g} rad/s or characteristic lengths of the mechanism per second, or more.",
        )


def _refuse_rough_dampers(mechanism: Mechanism) -> None:
    for damper in rough_dampers(mechanism):
        what = f"gauss cannot follow the damper of joint spring '{damper.name}', not smooth where it rests"
        raise InvalidInput("integrator", what, "Use radau13, or leave it out.")


def _simulate(
    mechanism: Mechanism,
    state: State,
    times: Array,
    tolerance: float,
    formulation: str,
    integrator: str | None,
    forces: AppliedForces | None,
) -> TrajectoryAnswer:
    """Integrate as `simulate` by the first of the compiled and interpreted ways that serves."""
    if forces is None and formulation == "relative" and (integrator is None or integrator in INTEGRATORS):
        return simulate_relative(mechanism, state, times, tolerance, integrator)
    from consilience.reference.formulations import compiled_choice  # noqa: PLC0415 - relative needs none of its kernels

    integrator = integrator or "dop853"
    if forces is None and integrator == "dop853" and formulation in compiled_choice.FORMULATIONS:
        return _compiled(mechanism, state, times, tolerance, formulation)
    return _interpreted(mechanism, state, times, tolerance, formulation, integrator, forces)


def _system(
    mechanism: Mechanism, state: State, times: Array, tolerance: float, formulation: str, others: dict[str, object]
) -> TrajectoryAnswer:
    """Integrate a formulation of index 2 or 3, which takes no other arguments.

    Parameters
    ----------
    mechanism, state, times, tolerance, formulation
        As in `simulate`.
    others : dict
        Arguments to refuse unless they are None.
    """
    for what, given in others.items():
        if given is not None:
            raise InvalidInput(what, f"{formulation} takes none", "Leave it out.")
    integrate = registry.system(formulation)
    return _checked(
        mechanism, state, times, tolerance, formulation, lambda: integrate(mechanism, state, times, tolerance)
    )


def _interpreted(
    mechanism: Mechanism,
    state: State,
    times: Array,
    tolerance: float,
    formulation: str,
    integrator: str,
    forces: AppliedForces | None,
) -> TrajectoryAnswer:
    """Integrate in Python; parameters as in `simulate`."""
    from consilience.reference.formulations.body_velocities import KernelFormulation, kernel_names  # noqa: PLC0415
    from consilience.reference.integrators.adaptive import METHODS, integrate  # noqa: PLC0415 - SciPy takes long

    known = dict.fromkeys([*METHODS, *(INTEGRATORS if formulation == "relative" and forces is None else ())])
    if integrator not in known:
        what = f"{formulation} takes none of that name"
        raise InvalidInput(f"integrator '{integrator}'", what, nearest(integrator, known, "Integrators"))
    equations = registry.formulation(formulation, mechanism)
    if forces is not None:
        if not isinstance(equations, KernelFormulation):
            raise InvalidInput("forces", f"{formulation} takes none", f"Use one of {', '.join(kernel_names())}.")
        equations.forces = forces

    def answer() -> TrajectoryAnswer:
        motion = integrate(equations, equations.coordinates(state), times, tolerance, integrator)
        p, quat, v, w = (
            np.array([getattr(s, name) for s in motion.states]) for name in ("p_WB", "quat_WB", "v_WB_W", "w_WB_W")
        )
        return TrajectoryAnswer(times, p, continuous_in_time(quat), v, w, dict(motion.counters))

    return _checked(mechanism, state, times, tolerance, formulation, answer)


def _checked(
    mechanism: Mechanism,
    state: State,
    times: Array,
    tolerance: float,
    formulation: str,
    answer: Callable[[], TrajectoryAnswer],
) -> TrajectoryAnswer:
    """Return a motion whose rows are satisfied, from its first state on.

    Parameters
    ----------
    mechanism, state, times, tolerance, formulation
        As in `simulate`.
    answer : callable
        Integrates the motion.
    """
    model, y, times = flatten(mechanism), pack(mechanism, state), sample_times(times)
    check_given(mechanism, model, times, y)
    check_solvable(mechanism, solvable_rows(model), times[0], y)
    found = answer()
    allowed = tolerance * registry.largest_residual(formulation)
    if allowed < np.inf:
        samples = zip(found.p_WB, found.quat_WB, found.v_WB_W, found.w_WB_W, strict=True)
        states = np.array([pack(mechanism, State(*sample)) for sample in samples])
        label = f"reference, {formulation}, tolerance {tolerance:g}"
        check_motion(mechanism, checked_rows(model), model, times, states, allowed, label)
    return found


def _compiled(mechanism: Mechanism, state: State, times: Array, tolerance: float, formulation: str) -> TrajectoryAnswer:
    """Integrate by DOP853 in one compiled call.

    Parameters
    ----------
    mechanism, state, times, tolerance
        As in `simulate`.
    formulation : str
        Key of `compiled_choice.FORMULATIONS`.
    """
    from consilience.reference.formulations import compiled_choice, compiled_dop853  # noqa: PLC0415 - see `_simulate`

    model = flatten(mechanism)
    ws, y = workspace(model), pack(mechanism, state)
    motion, scratch = np.empty((len(times), *y.shape)), compiled_dop853.dop853_scratch(model, y)
    check_given(mechanism, model, times, y)
    check_solvable(mechanism, solvable_rows(model), times[0], y)
    count_turns(model, y, ws, scratch.turns)
    number = compiled_choice.FORMULATIONS[formulation]
    label = f"reference, {formulation}, tolerance {tolerance:g}"
    status = compiled_dop853.integrate(number, model, y, times, float(tolerance), ws, motion, scratch)
    if status:
        raise NumericalFailure(f"{label}: {STATUS[status]}")
    check_motion(mechanism, checked_rows(model), model, times, motion, tolerance, label)
    p, quat, v, w = canonical_motion(np.array([b.com for b in mechanism.bodies]), motion)
    return TrajectoryAnswer(times, p, quat, v, w, counts_of(scratch.run))


def _said(error: Exception, formulation: str) -> str:
    """Return the text of a failure; of one in a factorisation, what the numbers are that cannot be factorised."""
    if isinstance(error, NumericalFailure):
        return str(error)
    return f"reference, {formulation}: the equations of motion are singular to the digits of a float"


def _causes(mechanism: Mechanism, state: State) -> str:
    """Name elements that can make accelerations of a motion from a state not finite."""
    found = []
    for s in mechanism.springs:
        ends = (s.predecessor, s.point_predecessor), (s.successor, s.point_successor)
        (p_i, _), (p_j, _) = (body_point(mechanism, state, name, point) for name, point in ends)
        if np.linalg.norm(p_j - p_i) <= NO_LENGTH and (s.stiffness * s.free_length or s.actuator):
            found.append(f"spring '{s.name}' has no length at the start, and its force no direction")
    for c in mechanism.couplings:
        if c.law.table is not None and not c.law.table.periodic:
            found.append(f"coupling '{c.name}' has no value beyond its table")
    return "".join(f"; {cause}" for cause in found)


def accelerations(
    mechanism: Mechanism, states: State | Sequence[State], formulation: str = "descriptor", t: float = 0.0
) -> InstantAnswer:
    """Compute accelerations, reactions and energies at consistent states, drives and loads at the time t.

    The first axis of the answer counts the states, also where there is one.

    Reactions are those of least norm if dependent constraints leave them undetermined
    (`consilience.mechanism.determinate_reactions` tells the determined components), and None if a formulation
    eliminates them.

    Raises
    ------
    InvalidInput
        Unknown formulation, a mechanism that the formulation cannot represent, or a state that is not consistent, as in
        `simulate`.
    NumericalFailure
        If the accelerations are not finite, for example at a spring of no length, or do not satisfy a constraint: at a
        singular pose velocities may lead along no motion.
    """
    states = [states] if isinstance(states, State) else states
    require_states(mechanism, states)
    in_range("t", t, -1e300, 1e300, "Give a time in s.")
    check_states(mechanism, states, float(t))
    return accelerations_at(mechanism, states, formulation, t)


def accelerations_at(
    mechanism: Mechanism, states: Sequence[State], formulation: str = "descriptor", t: float = 0.0
) -> InstantAnswer:
    """Compute accelerations as `accelerations`, at states that are known to be consistent."""
    from consilience.reference.states.instants import instants  # noqa: PLC0415 - motions need none of its kernels

    refuse_contacts(mechanism)
    if formulation != "descriptor" or not len(states):
        return _accelerations(mechanism, states, formulation, t)
    found, sound = instants(mechanism, list(states), float(t))
    for n in np.flatnonzero(~sound).tolist():
        own = _accelerations(mechanism, [states[n]], formulation, t)
        for name in ("a_WB_W", "alpha_WB_W", "force_F", "torque_F", "kinetic", "potential"):
            getattr(found, name)[n] = getattr(own, name)[0]
    return found


def _accelerations(mechanism: Mechanism, states: Sequence[State], formulation: str, t: float) -> InstantAnswer:
    """Compute the answers as `accelerations`, state by state."""
    equations = registry.formulation(formulation, mechanism)
    linear, angular, forces, torques = [], [], [], []
    for state in states:
        try:
            a, alpha = equations.accelerations(state, t)
        except (NumericalFailure, np.linalg.LinAlgError) as error:
            raise NumericalFailure(f"{_said(error, formulation)}{_causes(mechanism, state)}") from None
        _refuse_unsolved(mechanism, state, t, np.hstack([a, alpha]).ravel(), formulation)
        linear.append(a)
        angular.append(alpha)
        reaction = equations.reactions(state, t)
        if reaction is not None:
            forces.append(reaction[0])
            torques.append(reaction[1])
    return InstantAnswer(
        a_WB_W=np.array(linear),
        alpha_WB_W=np.array(angular),
        force_F=np.array(forces) if forces else None,
        torque_F=np.array(torques) if torques else None,
        kinetic=np.array([kinetic_energy(mechanism, s) for s in states]),
        potential=np.array([potential_energy(mechanism, s) for s in states]),
    )


def _refuse_unsolved(mechanism: Mechanism, state: State, t: float, a: Array, formulation: str) -> None:
    """Refuse accelerations (a_WB_W, alpha_WB_W) of all bodies, shape (6 n_b,), with a residual of ``Q a = gamma``.

    Raises
    ------
    NumericalFailure
        With the row of the largest residual.
    """
    Q, gamma = constraint_jacobian(mechanism, state, t=t), constraint_gamma(mechanism, state, t=t)
    sizes = np.linalg.norm(Q * velocity_sizes(mechanism), axis=1)
    left, terms = np.abs(Q @ a - gamma) / sizes, (np.abs(Q) @ np.abs(a) + np.abs(gamma)) / sizes
    fall = float(np.linalg.norm(mechanism.gravity)) / characteristic_length(mechanism)
    free = float(np.max(np.abs(a) / velocity_sizes(mechanism)))  # may be at right angles to every row
    scale = max(fall, free, float(np.max(np.sum(state.w_WB_W**2, axis=1))), float(np.max(terms, initial=0.0)))
    if np.max(left, initial=0.0) > SOLVABLE * scale:
        worst = int(np.argmax(left))
        raise NumericalFailure(
            f"reference, {formulation}: the acceleration of {row_names(mechanism, [], velocities=True)[worst]} stays "
            f"wrong by {left[worst] * sizes[worst]:.3g}: no accelerations satisfy all constraints at this state"
        )
