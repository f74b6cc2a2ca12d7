"""Identities between the answers about one mechanism: balance, power, momentum, response to loads.

Each identity takes an `IdentitySubject` and yields a residual for every state. Vectors are scaled as in
`consilience.audit.identities.equations`.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from consilience.audit.identities.equations import EPS, Equations, ScaledSolution, by_body, largest
from consilience.audit.identities.result import NotApplicableError, Residual, relative, worst
from consilience.audit.identities.subject import IdentitySubject
from consilience.errors import CannotAssemble
from consilience.mechanism import (
    GROUND,
    Array,
    State,
    applied_wrenches,
    assemble_positions,
    assemble_velocities,
    centres_of_mass,
    conservative_part,
    kinetic_energy,
    move,
)


def constraint(subject: IdentitySubject) -> Iterator[Residual]:
    """Check ``Q x = gamma`` with the engine's accelerations, row by row."""
    if subject.mechanism.constraint_count() == 0:
        raise NotApplicableError("there are no constraints")
    for n, eq in enumerate(subject.equations):
        left = np.abs(eq.Q @ subject.accelerations(n) - eq.gamma)
        allowed = eq.row_errors(eq.solution, subject.route)
        k = int(np.argmax(left / np.maximum(allowed, np.finfo(float).tiny)))
        yield relative(left[k], allowed[k], largest(eq.solution.rows), f"state {n}, row {k}")


def balance(subject: IdentitySubject) -> Iterator[Residual]:
    """Check the Newton-Euler equations of each body with the engine's accelerations and joint reactions.

    Forces of drives, couplings, contacts and skates are not reported: least squares remove them.
    """
    for n, eq in enumerate(subject.equations):
        wrenches = eq.joint_wrenches(*subject.reactions(n)).total.ravel() / eq.motion_scale
        left = np.abs(_without(eq.rows_without_reactions().T, eq.M @ subject.accelerations(n) - eq.b - wrenches))
        k = int(np.argmax(left))
        body = subject.mechanism.bodies[k // 6].name
        what = f"state {n}, {'force' if k % 6 < 3 else 'torque'} on {body}"
        yield relative(left[k], _allowed_wrench(eq, subject), largest(eq.solution.terms), what)


def _without(columns: Array, vector: Array) -> Array:
    """Return the part of a vector orthogonal to the columns."""
    if columns.shape[1] == 0:
        return vector
    return vector - columns @ np.linalg.lstsq(columns, vector, rcond=None)[0]


def _allowed_wrench(eq: Equations, subject: IdentitySubject) -> float:
    stated = largest(np.abs(eq.M).sum(axis=1)) * eq.stated_error(eq.solution, subject.route)
    return eq.guard * largest(eq.solution.terms) + stated


def momentum(subject: IdentitySubject) -> Iterator[Residual]:
    """Check the rates of linear and angular momentum against external forces and the reactions of the ground.

    Angular momentum is about the common centre of mass. A floating mechanism, without rows to the ground, needs no
    reactions.
    """
    held = any(j.rows and GROUND in (j.predecessor, j.successor) for j in subject.mechanism.joints)
    for n, eq in enumerate(subject.equations):
        rate = eq.M @ subject.accelerations(n) - eq.b
        if held:
            wrenches = eq.joint_wrenches(*subject.reactions(n), ground_only=True)
            rate = rate - wrenches.total.ravel() / eq.motion_scale
        sums = _summation(eq)
        left = np.abs(_without(sums @ eq.rows_without_reactions().T, sums @ rate))
        terms = np.abs(sums) @ eq.solution.terms
        stated = np.abs(sums) @ np.abs(eq.M).sum(axis=1) * eq.stated_error(eq.solution, subject.route)
        k = int(np.argmax(left))
        name = f"state {n}, {'linear' if k < 3 else 'angular'} momentum"
        yield relative(left[k], eq.guard * largest(terms) + largest(stated), largest(terms), name)


def _summation(eq: Equations) -> Array:
    """Return the matrix (6, 6 n_b) from scaled wrenches to total force and torque about the common centre of mass."""
    masses = np.array([b.mass for b in eq.mechanism.bodies])
    centre = masses @ centres_of_mass(eq.mechanism, eq.state)[0] / masses.sum()
    sums = np.zeros((6, 6 * len(masses)))
    for i, p in enumerate(eq.state.p_WB):
        x, y, z = (p - centre) / eq.length
        sums[:, 6 * i : 6 * i + 6] = np.eye(6)
        sums[3:, 6 * i : 6 * i + 3] = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
    return sums


def power(subject: IdentitySubject) -> Iterator[Residual]:
    """Check ``dT/dt`` of the engine's accelerations against the power of the applied forces."""
    _refuse_drives(subject)
    if all(eq.speed == 0.0 for eq in subject.equations):
        raise NotApplicableError("nothing moves")
    for n, eq in enumerate(subject.equations):
        v = eq.velocity
        terms = float(by_body(v) @ eq.solution.terms) / 6.0
        left = abs(float(v @ (eq.M @ subject.accelerations(n) - eq.b)))
        stated = float(np.abs(v) @ np.abs(eq.M).sum(axis=1)) * eq.stated_error(eq.solution, subject.route)
        yield relative(left, eq.guard * terms + stated, terms, f"state {n}")


def _refuse_drives(subject: IdentitySubject) -> None:
    if subject.mechanism.drives:
        raise NotApplicableError("drives do work, and their effort is not reported")


def energy(subject: IdentitySubject) -> Iterator[Residual]:
    """Check the rate of the engine's energies along its own accelerations against the power of dissipation and loads.

    The rate is a central difference over four states, ``(8 (E1 - E-1) - (E2 - E-2)) / 12 h``, assembled on a smooth
    curve with the state's velocity and the engine's accelerations. With a step of ``eps^(1/5)`` over the fastest rate
    of the state, rounding and truncation are both about ``eps^(4/5)`` of energy times rate, far below the bar.
    """
    _refuse_drives(subject)
    if subject.mechanism.rollings or subject.mechanism.skates:
        raise NotApplicableError("states beside this one are not found for non-holonomic rows")
    for n, eq in enumerate(subject.equations):
        x = subject.accelerations(n).reshape(-1, 3)
        fastest = max(eq.speed, float(np.sqrt(eq.length * largest(x)))) / eq.length or 1.0
        h = EPS**0.2 / fastest
        states = [_along(subject, n, k * h) for k in (-2, -1, 1, 2)]
        answer = subject.asker.instant(subject.mechanism, states, subject.method)
        E = answer.kinetic + answer.potential
        rate = float(8.0 * (E[2] - E[1]) - (E[3] - E[0])) / (12.0 * h)
        whole = applied_wrenches(subject.mechanism, eq.state).total
        kept = applied_wrenches(conservative_part(subject.mechanism), eq.state).total
        lost = float(eq.velocity @ ((whole - kept).ravel() / eq.motion_scale))
        size = (kinetic_energy(subject.mechanism, eq.state) + eq.potential_size) * fastest
        stated = float(np.abs(eq.velocity) @ np.abs(eq.M).sum(axis=1)) * eq.stated_error(eq.solution, subject.route)
        yield relative(abs(rate - lost), eq.guard / EPS**0.2 * size + stated, size, f"state {n}")


def _along(subject: IdentitySubject, n: int, h: float) -> State:
    """Return the state a time h later, to second order, projected onto the constraints."""
    s, a, alpha = subject.states[n], subject.answer.a_WB_W[n], subject.answer.alpha_WB_W[n]
    ahead = move(s, np.hstack([h * s.v_WB_W + 0.5 * h**2 * a, h * s.w_WB_W + 0.5 * h**2 * alpha]).ravel())
    try:
        placed = assemble_positions(subject.mechanism, ahead)
        moving = State(placed.p_WB, placed.quat_WB, s.v_WB_W + h * a, s.w_WB_W + h * alpha)
        return assemble_velocities(subject.mechanism, moving)
    except CannotAssemble as error:
        raise NotApplicableError(f"no state along these accelerations: {error}") from None


def forward_after_inverse(subject: IdentitySubject) -> Iterator[Residual]:
    """Choose accelerations and reactions, apply the loads that the Newton-Euler equations need, and ask for both back.

    The accelerations are random in the free directions, as large as those without loads; the reactions are those of
    random multipliers.
    """
    for n, eq in enumerate(subject.equations):
        chosen, load = _inverse(eq, np.random.default_rng(n))
        answer = subject.loaded(n, load)
        x = eq.motion(answer.a_WB_W[0], answer.alpha_WB_W[0])
        allowed = eq.acceleration_error(chosen, subject.route)
        found = [relative(largest(x - chosen.x), allowed, largest(chosen.x), f"state {n}, accelerations")]
        if answer.force_F is not None and answer.torque_F is not None:
            expected = -eq.reaction_map @ chosen.mu
            left = (eq.scaled_reactions(answer.force_F[0], answer.torque_F[0]) - expected)[eq.determined]
            allowed = eq.reaction_error(chosen)
            found.append(relative(largest(left), allowed, largest(expected), f"state {n}, reactions"))
        yield worst(found)


def _inverse(eq: Equations, rng: np.random.Generator) -> tuple[ScaledSolution, Array]:
    """Return random consistent accelerations and multipliers, and the scaled wrench that causes both."""
    own = eq.solution
    size = largest(own.x) or 1.0
    free = eq.N @ rng.normal(size=eq.N.shape[1])
    particular = own.x - eq.N @ (eq.N.T @ own.x)
    x = particular + size * free / max(largest(free), np.finfo(float).tiny)
    mu = rng.normal(size=len(own.mu)) * (largest(own.mu) or largest(eq.M @ x))
    load = eq.M @ x + eq.Q.T @ mu - eq.b
    return eq.sized(x, mu, load), load


def symmetry(subject: IdentitySubject) -> Iterator[Residual]:
    """Check that the response of direction i to a load in direction j is that of j to i."""
    for n, m in enumerate(subject.mobility):
        yield relative(largest(m.W - m.W.T), 2.0 * m.allowed, largest(m.neutral), f"state {n}")


def positivity(subject: IdentitySubject) -> Iterator[Residual]:
    """Check that no load in a free direction causes an acceleration against the load."""
    for n, m in enumerate(subject.mobility):
        lowest = float(np.linalg.eigvalsh(0.5 * (m.W + m.W.T))[0])
        yield relative(max(0.0, -lowest), m.allowed * len(m.W), largest(m.neutral), f"state {n}")


def inverse_mass(subject: IdentitySubject) -> Iterator[Residual]:
    """Check that the response is the inverse of the mass matrix in the free directions."""
    for n, m in enumerate(subject.mobility):
        yield relative(largest(m.W - m.neutral), m.allowed, largest(m.neutral), f"state {n}")


def linearity(subject: IdentitySubject) -> Iterator[Residual]:
    """Check that half of a load causes half of the response, and the opposite load the opposite response."""
    for n in range(len(subject.states)):
        load = subject.push(n, subject.directions(n).sum(axis=1))
        whole, half, back = (subject.response(n, c * load) for c in (1.0, 0.5, -1.0))
        left = max(largest(whole - 2.0 * half), largest(whole + back))
        yield relative(left, 4.0 * subject.response_error(n, load), largest(whole), f"state {n}")
