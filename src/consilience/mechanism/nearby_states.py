"""Random and displaced states: consistent states on the branch of another, drawn along the free directions.

Displacements count rad and characteristic lengths of the mechanism alike: the same seed gives the same angles at any
size of a mechanism.
"""

from __future__ import annotations

from numbers import Integral

import numpy as np

from consilience.errors import CannotAssemble, InvalidInput, in_range
from consilience.mechanism.assembly import assemble_positions, assemble_velocities, largest_residual
from consilience.mechanism.branches import singular_pose
from consilience.mechanism.constraints import RANK_TOLERANCE, null_space, scaled_jacobian, velocity_sizes
from consilience.mechanism.contact_geometry import closing_rows, sharing_rows
from consilience.mechanism.model import Mechanism, State, require_states
from consilience.mechanism.singular import move
from consilience.mechanism.spatial import Array

STEPS = (0.05, 0.45)
"""Least and greatest displacement from one random state to the next, rad or characteristic lengths."""

_MOST_FAILED = 50
"""Random steps in a row that may fail before the search for states ends."""


def _free_motion(mechanism: Mechanism, state: State, rng: np.random.Generator, holonomic: bool = False) -> Array:
    """Return a random vector of the free directions, shape (6 n_b,): each component normal of standard deviation one.

    Lengths are in characteristic lengths.

    Parameters
    ----------
    state : State
        Consistent state of the mechanism.
    rng : Generator
    holonomic : bool
        A displacement; default: a velocity.
    """
    Q = scaled_jacobian(mechanism, state)
    basis = null_space(Q[: mechanism.holonomic_count] if holonomic else Q)
    # a projection, the same for every basis of the free directions
    return basis @ (basis.T @ rng.normal(size=len(basis)))


def random_states(mechanism: Mechanism, start: State, count: int, seed: int, speed: float = 2.0) -> list[State]:
    """Return consistent states on the branch of `start`: a random walk on the constraint manifold, random velocities.

    A mechanism with contacts or stops keeps the pose of the start, and what is closed there stays closed: it slides,
    and does not turn on more than three contacts of one pair on one plane (`sharing_rows`).

    Parameters
    ----------
    start : State
        Consistent state of the mechanism.
    count, seed : int
        The same seed gives the same states.
    speed : float, rad/s and characteristic lengths per s
        Standard deviation of the velocity along each free direction.

    Raises
    ------
    InvalidInput, CannotAssemble
    """
    require_states(mechanism, (start,))
    for name, number in (("count", count), ("seed", seed)):
        if not isinstance(number, Integral) or number < 0:
            raise InvalidInput(name, f"{number!r} is no integer of at least zero", "Give one, for example 10.")
    in_range("speed", speed, 0.0, 1e100, "Give a speed in rad/s and characteristic lengths per s.")
    rng = np.random.default_rng(seed)
    sizes = velocity_sizes(mechanism)
    if mechanism.contacts or mechanism.stops:
        return [_sliding(mechanism, start, speed * sizes * _free_motion(mechanism, start, rng)) for _ in range(count)]
    states: list[State] = []
    state = start
    failed = 0
    while len(states) < count:
        if failed == _MOST_FAILED:
            raise CannotAssemble(
                f"mechanism '{mechanism.name}'",
                f"{failed} random steps away from a state of it led nowhere{_stuck(mechanism, start)}",
                "Ask for fewer states (instant.states = 1 asks for the initial one alone).",
            )
        step = _free_motion(mechanism, state, rng, holonomic=True)
        step *= rng.uniform(*STEPS) / max(largest_residual(step), 1e-300)
        try:
            placed = assemble_positions(mechanism, move(state, sizes * step))
            velocity = (speed * sizes * _free_motion(mechanism, placed, rng)).reshape(-1, 6)
            moving = State(placed.p_WB, placed.quat_WB, velocity[:, :3], velocity[:, 3:])
            state = assemble_velocities(mechanism, moving)
        except CannotAssemble:
            failed += 1
            continue  # no state near there: draw another step
        failed = 0
        states.append(state)
    return states


def states_in_motion(mechanism: Mechanism, start: State, seed: int, speed: float = 2.0) -> list[State]:
    """Return the start, and the same pose with other velocities along the free directions.

    Parameters
    ----------
    mechanism, start, seed, speed : see `random_states`
        The speed is that of the change.
    """
    rng = np.random.default_rng(seed)
    change = (speed * velocity_sizes(mechanism) * _free_motion(mechanism, start, rng)).reshape(-1, 6)
    v, w = start.v_WB_W + change[:, :3], start.w_WB_W + change[:, 3:]
    return [start, State(start.p_WB, start.quat_WB, v, w)]


def _closed(mechanism: Mechanism, state: State, y: Array, rows: Array | None = None) -> Array:
    """Return the part of a free motion y, (6 n_b,) in lengths of the mechanism, that leaves closed what is closed.

    Nothing moves along other `rows`, shape (n, 6 n_b), either.
    """
    sizes, closing = velocity_sizes(mechanism), closing_rows(mechanism, state)
    rows = (closing if rows is None else np.concatenate([closing, rows])) * sizes
    if not len(rows):
        return y
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    free = null_space(scaled_jacobian(mechanism, state))
    along = rows @ free
    along[np.linalg.norm(along, axis=1) <= RANK_TOLERANCE] = 0.0  # the joints hold these gaps
    return np.asarray(y - free @ np.linalg.lstsq(along, rows @ y, rcond=RANK_TOLERANCE)[0])


def _sliding(mechanism: Mechanism, start: State, velocity: Array) -> State:
    """Return the pose of a state with the admissible velocity nearest to a given one, (6 n_b,), in closed contacts.

    Nearest in characteristic lengths and rad per s.
    """
    v, w = velocity.reshape(-1, 6)[:, :3], velocity.reshape(-1, 6)[:, 3:]
    state = assemble_velocities(mechanism, State(start.p_WB, start.quat_WB, v, w))
    sizes = velocity_sizes(mechanism)
    y = np.hstack([state.v_WB_W, state.w_WB_W]).ravel() / sizes
    y = _closed(mechanism, start, y, sharing_rows(mechanism, start))
    twists = (sizes * y).reshape(-1, 6)
    return State(start.p_WB, start.quat_WB, twists[:, :3], twists[:, 3:])


def _stuck(mechanism: Mechanism, start: State) -> str:
    """Return, for a message, that a mechanism which moves at its start is rigid beside it; otherwise nothing."""
    pose = singular_pose(mechanism, start)
    locks = pose is not None and not any(pose.branches)
    return ": it can move at the start alone, a singular pose, and locks" if locks else ""


def displaced_states(
    mechanism: Mechanism, start: State, size: float, count: int, seed: int = 0, rate: float = 1.0
) -> list[State]:
    """Return consistent states near `start`: poses and velocities changed in random free directions.

    What is closed at the start stays closed, and does not turn on more than three contacts of one pair on one plane.

    Parameters
    ----------
    start : State
        Consistent state of the mechanism.
    size : float, rad and characteristic lengths
        Length of the displacement.
    count, seed : int
        The same seed gives the same states.
    rate : float, 1/s
        Length of the change of velocity over that of the displacement.

    Returns
    -------
    list of State
        None where the constraints leave nothing free, as in a mechanism that drives move alone.
    """
    rng = np.random.default_rng(seed)
    sizes = velocity_sizes(mechanism)
    states = []
    for _ in range(count):
        step = _closed(mechanism, start, _free_motion(mechanism, start, rng, holonomic=True))
        if not np.any(step):
            break
        placed = assemble_positions(mechanism, move(start, size * sizes * step / np.linalg.norm(step)))
        push = _closed(mechanism, placed, _free_motion(mechanism, placed, rng), sharing_rows(mechanism, placed))
        change = (rate * size * sizes * push / max(float(np.linalg.norm(push)), 1e-300)).reshape(-1, 6)
        moving = State(placed.p_WB, placed.quat_WB, placed.v_WB_W + change[:, :3], placed.w_WB_W + change[:, 3:])
        states.append(assemble_velocities(mechanism, moving))
    return states
