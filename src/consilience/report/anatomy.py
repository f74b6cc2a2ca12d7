"""Anatomy of a case: freedom, dependent rows, undetermined reactions, features, warnings.

Rows are those of `mechanism.constraints`. Which row of a linear dependency is redundant is arbitrary; so all rows that
take part in a dependency are named, with the number of dependencies.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import compress, permutations
from operator import attrgetter

import numpy as np

from consilience.case import Case
from consilience.case.published import OF_A_JOINT
from consilience.mechanism import (
    ASSOCIATED_ALONE,
    GROUND,
    RANK_TOLERANCE,
    Array,
    Mechanism,
    SphereSphere,
    State,
    body_point,
    centres_of_mass,
    characteristic_length,
    closing_rows,
    constraint_residual,
    determinate_forces,
    free_directions,
    frictions_too_steep,
    joint_frames,
    joint_spring_motion,
    scaled_jacobian,
    singular_pose,
    world_inertias,
)
from consilience.report.selection import grouped

COMPONENTS = ("force x", "force y", "force z", "torque x", "torque y", "torque z")

FAST = 1.0
"""Largest phase of the fastest motion in one sample, rad, that engines with a few steps per sample can follow."""

ENDLESS = 1e7
"""Angle of the fastest motion, rad, from which a duration is told as long: at a few steps in each, minutes to hours."""


@dataclass(frozen=True)
class Anatomy:
    """Facts of a case at its initial state.

    Attributes
    ----------
    residual : float
        Largest violation of a constraint, in m, rad or a pure number.
    freedom, rows, redundant : int
        Degrees of freedom, constraint rows, linear dependencies among the rows.
    dependent : dict
        Rows that take part in a dependency, by joint or element.
    undetermined : dict
        Components of the reaction, axes of F, that equilibrium does not determine, by joint.
    features : tuple of str
        Features that an engine must support to represent the mechanism.
    singular : str
        Mobility at the pose and nearby, in words, where the pose is singular; empty at a regular pose.
    """

    residual: float
    freedom: int
    rows: int
    redundant: int
    dependent: dict[str, tuple[str, ...]]
    undetermined: dict[str, tuple[str, ...]]
    features: tuple[str, ...]
    singular: str


def anatomy(mechanism: Mechanism, state: State) -> Anatomy:
    """Determine the facts of a mechanism at a consistent state."""
    Q = scaled_jacobian(mechanism, state)
    width, q = 6 * len(mechanism.bodies), len(Q)
    U, singular, _ = np.linalg.svd(Q) if q else (np.zeros((0, 0)), np.zeros(0), None)
    rank = int(np.sum(singular > RANK_TOLERANCE * singular[0])) if q else 0
    taking_part = np.linalg.norm(U[:, rank:], axis=1) > 1e-6
    dependent = grouped(compress(row_names(mechanism), taking_part))
    determined = determinate_forces(mechanism, state).reactions
    undetermined = {
        joint.name: tuple(c for c, sure in zip(COMPONENTS, known, strict=True) if not sure)
        for joint, known in zip(mechanism.joints, determined, strict=True)
        if not np.all(known)
    }
    residual = float(np.max(np.abs(constraint_residual(mechanism, state)), initial=0.0))
    rows = {owner: tuple(own) for owner, own in dependent.items()}
    pose = singular_pose(mechanism, state)
    words = "" if pose is None else str(pose)
    return Anatomy(residual, width - rank, q, q - rank, rows, undetermined, tuple(mechanism.features), words)


def row_names(mechanism: Mechanism) -> Iterator[tuple[str, str]]:
    """List owner and name of every constraint row, in the order of the rows."""
    for joint in mechanism.joints:
        for row in joint.rows:
            yield joint.name, row
    yield from ((drive.name, "drive") for drive in mechanism.drives)
    yield from ((coupling.name, "coupling") for coupling in mechanism.couplings)
    yield from ((rolling.name, "contact") for rolling in mechanism.rollings)
    for rolling in mechanism.rollings:
        yield from ((rolling.name, "slip") for _ in range(2))
    yield from ((skate.name, "skate") for skate in mechanism.skates)


def fastest(mechanism: Mechanism, state: State) -> tuple[float, str]:
    """Estimate the largest angular frequency of the motion, rad/s, and name its source: spin, a spring or gravity.

    A spring between two bodies counts with the frequency of the spring and the two bodies alone,
    ``w^2 = k (1 / m_1 + 1 / m_2)`` with effective masses, or moments about the axis, and its stiffness k at the state.
    """
    found = [(float(np.max(np.linalg.norm(state.w_WB_W, axis=1), initial=0.0)), "the spin at the start")]
    found.append((float(np.sqrt(np.linalg.norm(mechanism.gravity) / characteristic_length(mechanism))), "gravity"))
    for spring in mechanism.springs:
        ends = ((spring.predecessor, spring.point_predecessor), (spring.successor, spring.point_successor))
        line = np.subtract(*(body_point(mechanism, state, name, point)[0] for name, point in ends))
        length = float(np.linalg.norm(line))
        if length > 0.0:
            soft = sum(
                _mobility(mechanism, state, n, body_point(mechanism, state, n, p)[0], line / length) for n, p in ends
            )
            found.append((float(np.sqrt(abs(spring.stiffness) * soft)), f"spring '{spring.name}'"))
    for sprung in mechanism.joint_springs:
        joint = mechanism.joints[mechanism.joint_index[sprung.joint]]
        frames = joint_frames(mechanism, state, joint)
        axis, p = frames.U[:, 2], body_point(mechanism, state, joint.successor, joint.M.p)[0]
        about = sprung.coordinate != "distance"
        soft = sum(_mobility(mechanism, state, n, p, axis, about) for n in (joint.predecessor, joint.successor))
        x = joint_spring_motion(mechanism, state, sprung.joint, sprung.coordinate)[0] - sprung.rest
        k, k1, k2 = sprung.laws[0]
        stiffness = k + (2.0 * k1 + 3.0 * k2 * x) * x
        found.append((float(np.sqrt(abs(stiffness) * soft)), f"joint spring '{sprung.name}'"))
    return max(found)


def _mobility(mechanism: Mechanism, state: State, body: str, point: Array, e: Array, about: bool = False) -> float:
    """Return the acceleration of a free body by a unit force, 1/kg, or by a unit torque about an axis, 1/(kg m^2).

    Parameters
    ----------
    mechanism : Mechanism
    state : State
    body : str
        The mobility of the ground is zero.
    point : ndarray, shape (3,), m
        Point of the force or of the axis, world axes.
    e : ndarray, shape (3,)
        Unit vector of the force or of the axis, world axes.
    about : bool
        Whether the body turns about the axis, which is fixed; else its point accelerates along e.
    """
    if body == GROUND:
        return 0.0
    i = mechanism.body_index[body]
    mass, inertia = mechanism.bodies[i].mass, world_inertias(mechanism, state)[i]
    arm = np.cross(point - centres_of_mass(mechanism, state)[0][i], e)
    if about:
        return float(1.0 / (e @ inertia @ e + mass * arm @ arm))
    return float(1.0 / mass + arm @ np.linalg.solve(inertia, arm))


def expected_lines(case: Case) -> list[str]:
    """Write expected values with uncertainty, origin and source; the components of a vector share a line."""
    fields = attrgetter("observable", "of", "time", "uncertainty", "origin", "source", "second")
    lines = []
    for components in grouped((fields(known), known) for known in case.published).values():
        k = components[0]
        values = ", ".join(f"{c.value:.12g}" if c.uncertainty > 1e-12 else f"{c.value:.15g}" for c in components)
        axes = "" if k.observable in OF_A_JOINT else f" ({', '.join('xyz'[c.component] for c in components)})"
        second = f"; and {k.second}" if k.second else ""
        lines.append(
            f"{k.observable}{axes} of {k.of} at {k.time:g} s: {values}, uncertain by {k.uncertainty:.2g}; "
            f"{k.origin}: {k.source.removeprefix('closed form: ')}{second}"
        )
    return lines


def listed(groups: Mapping[str, Sequence[str]], joint: str) -> str:
    """Write names with their entries; names with equal entries share a group."""
    together = grouped((tuple(entries), name) for name, entries in groups.items())
    return "; ".join(f"{', '.join(names)}: {joint.join(entries)}" for entries, names in together.items())


def freedom_line(freedom: int, rows: int, redundant: int) -> str:
    """State degrees of freedom, constraint rows and dependencies."""
    return f"{freedom} degree{'s' * (freedom != 1)} of freedom, {rows} constraint rows, {redundant} of them dependent"


def dependency_lines(
    dependent: Mapping[str, Sequence[str]], undetermined: Mapping[str, Sequence[str]], singular: str
) -> Iterator[str]:
    """State a singular pose, the dependent rows and the undetermined reactions, if there are any."""
    if singular:
        yield f"drawn at a singular pose: {singular}; instants there are unresolved"
    if dependent:
        yield f"rows that depend on one another: {listed(dependent, ' ')}"
    if undetermined:
        yield f"reactions that equilibrium does not determine: {listed(undetermined, ', ')}"


def warnings(case: Case) -> list[str]:
    """List weaknesses of a case as a test, in sentences; no weakness makes a case invalid."""
    mechanism, found = case.mechanism, []
    if not case.published:
        found.append("no expected value: only the engines and the reference are compared with each other")
    if not any(np.any(_products(body.inertia)) for body in mechanism.bodies):
        found.append("no body has a product of inertia: its wrong sign, or a transposed rotation, would not show")
    if not any(np.any(body.com) for body in mechanism.bodies):
        found.append("every centre of mass is the origin of its body: one lost in translation would not show")
    if all(np.allclose(body.drawing.R, np.eye(3)) for body in mechanism.bodies):
        found.append("all bodies are drawn along the axes of the world: body and world axes mixed up would hardly show")
    frequency, why = fastest(mechanism, case.initial_state)
    if frequency * case.sample > FAST:
        found.append(
            f"the sample of {case.sample:g} s is long against the fastest motion, {frequency:.3g} rad/s from {why}: "
            f"engines step a fraction of the sample; choose {_rounded_down(FAST / frequency):g} s or less"
        )
    if frequency * case.duration > ENDLESS:
        found.append(
            f"the duration of {case.duration:g} s has {frequency * case.duration:.0e} rad of the fastest motion, "
            f"{frequency:.3g} rad/s from {why}: unless it comes to rest, runs may reach their limit of time; choose "
            f"{_rounded_down(ENDLESS / frequency):g} s or less"
        )
    found += _edges(case)
    travelled = np.max(np.linalg.norm(case.initial_state.v_WB_W, axis=1), initial=0.0) / characteristic_length(
        mechanism
    )
    if case.duration * max(frequency, travelled) < FAST:
        found.append(f"in {case.duration:g} s the fastest motion, {frequency:.3g} rad/s from {why}, has hardly begun")
    return found


def _edges(case: Case) -> Iterator[str]:
    """Describe friction too steep to integrate, and contacts whose answer depends on more than the case says."""
    mechanism = case.mechanism
    yield from _contacts_at_start(mechanism, case.initial_state)
    for friction in frictions_too_steep(mechanism):
        yield f"friction '{friction.name}': the speed {friction.speed:g} is too small to integrate"


def _contacts_at_start(mechanism: Mechanism, start: State) -> Iterator[str]:
    """Describe closed contacts that the joints hold, or that hit at once, tangents that jump, and laws of no motion."""
    free = free_directions(mechanism, start)
    motion = np.hstack([start.v_WB_W, start.w_WB_W]).ravel()
    hit, closed = [], set()
    for contact in mechanism.contacts:
        rows = closing_rows(replace(mechanism, contacts=(contact,), stops=()), start)
        if len(rows):
            closed.add(contact.name)
        if len(rows) and np.max(np.abs(rows @ free), initial=0.0) < RANK_TOLERANCE:
            yield (
                f"contact '{contact.name}' is wedged: it is closed at the start, and the joints let its bodies neither "
                "part nor press; its force is open"
            )
        if len(rows) and contact.restitution and np.min(rows @ motion) < 0.0:
            hit.append(contact.name)
        if contact.mixes_associated:
            yield f"contact '{contact.name}': the reference refuses its law, nothing is compared: {ASSOCIATED_ALONE}"
        if isinstance(contact, SphereSphere) and contact.cone.kind != "circle":
            yield f"contact '{contact.name}': the tangents of a {contact.cone.kind} cone jump where spheres roll round"
    if len(hit) > 1:
        yield (
            f"contacts {', '.join(hit)} are closed at the start and hit at once: they take part in one impact, with "
            "another result than in turn after any gap"
        )
    for held, other in _may_hit_together(mechanism, closed):
        yield (
            f"contact '{held}' is closed at the start: if '{other}' hits meanwhile, both take part in one impact, with "
            "another result than in turn after any gap"
        )


def _may_hit_together(mechanism: Mechanism, closed: set[str]) -> Iterator[tuple[str, str]]:
    """Yield pairs of contacts that rebound and share a body, the first closed and the second open."""
    rebounding = [contact for contact in mechanism.contacts if contact.restitution]
    for held, other in permutations(rebounding, 2):
        shared = {held.body, held.partner} & {other.body, other.partner} - {GROUND}
        if shared and held.name in closed and other.name not in closed:
            yield held.name, other.name


def _rounded_down(value: float) -> float:
    """Return a positive number rounded down to one digit."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(np.floor(value / power * (1.0 + 1e-12)) * power)


def _products(inertia: Array) -> Array:
    off = inertia[np.triu_indices(3, 1)]
    return np.abs(off) > 1e-9 * np.max(np.abs(inertia))
