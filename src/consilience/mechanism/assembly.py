"""Assembly: consistent initial positions and velocities.

Positions satisfy ``g(p, R, t) = 0`` by Newton-Raphson's method with minimum-norm (SVD) steps [MASS], velocities
``Q v = nu`` by least squares. Joint coordinates and rates that a user gives are *held* ("emphasised" in MASS): rows of
their own beside those of the constraints. The drawing, or poses given for bodies, is the initial guess; bodies move as
little as possible from there. Rad and characteristic lengths of the mechanism are counted alike, in displacements and
in residuals: what assembles does not depend on the unit of length.

A displacement of a body is ``(dr, phi)``: of the origin in m, and a rotation vector in rad, both in axes of the world.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from consilience.errors import CannotAssemble, InvalidInput, require
from consilience.mechanism.bodies import Frame
from consilience.mechanism.constraints import (
    RANK_TOLERANCE,
    constraint_jacobian,
    constraint_rates,
    constraint_residual,
    joint_coordinates,
    relative_motion,
    row_sizes,
    velocity_sizes,
)
from consilience.mechanism.element_rows import Angles
from consilience.mechanism.joint_rows import joint_frames, row_jacobian, scatter
from consilience.mechanism.joints import JOINT_KINDS
from consilience.mechanism.model import Joint, Mechanism, State
from consilience.mechanism.singular import is_singular, move
from consilience.mechanism.spatial import (
    Array,
    fixed_array,
    quaternion_from_rotation,
    rotation_from_quaternion,
    rotation_vector_from_quaternion,
)
from consilience.mechanism.unassembled import stays_violated
from consilience.mechanism.units import characteristic_length

MAX_ITERATIONS = 30
CONVERGED = 1e-13
LONGEST_WAY = 2000
"""Largest number of further iterations for poses that are far away: one for each radian or longest step."""

_DRAWN = 1e-3
"""Residual, in rad or characteristic lengths, above which a drawing is another pose, not one with rounded numbers."""

_SCALARS = {"distance": "Z", "x": "X", "y": "Y"}


@dataclass(frozen=True)
class Initial:
    """Initial conditions that a user gives.

    Attributes
    ----------
    coordinates, rates : mapping of joint name to mapping of coordinate name to value
        Held joint coordinates and rates, by the names of `JOINT_KINDS`. An orientation is a quaternion or a matrix; its
        rate, ``angular_velocity`` or ``orientation``, is in axes of F.
    poses : mapping of body name to Frame
        Poses in the world, the guess in place of the drawing.
    velocities : mapping of body name to (v_WB_W, w_WB_W)
        Guess for the velocities; zero for bodies not named.
    """

    coordinates: Mapping[str, Mapping[str, ArrayLike]] = field(default_factory=dict)
    rates: Mapping[str, Mapping[str, ArrayLike]] = field(default_factory=dict)
    poses: Mapping[str, Frame] = field(default_factory=dict)
    velocities: Mapping[str, tuple[ArrayLike, ArrayLike]] = field(default_factory=dict)


def drawing_state(mechanism: Mechanism, poses: Mapping[str, Frame] | None = None) -> State:
    """Return the state of rest in the drawing, with poses of some bodies replaced."""
    frames = [(poses or {}).get(b.name, b.drawing) for b in mechanism.bodies]
    zeros = np.zeros((len(frames), 3))
    return State(np.array([f.p for f in frames]), quaternion_from_rotation([f.R for f in frames]), zeros, zeros)


def _joint(mechanism: Mechanism, name: str, field_name: str) -> Joint:
    if name not in mechanism.joint_index:
        known = ", ".join(mechanism.joint_index)
        raise InvalidInput(f"initial.{field_name}", f"there is no joint '{name}'", f"Joints are: {known}.")
    return mechanism.joints[mechanism.joint_index[name]]


def _check_coordinate(joint: Joint, coordinate: str) -> None:
    names = JOINT_KINDS[joint.kind].coordinates
    if coordinate not in names:
        known = ", ".join(names) or "none"
        raise InvalidInput(
            f"initial: joint '{joint.name}'", f"a {joint.kind} joint has no '{coordinate}'", f"It has: {known}."
        )


def held_rows(mechanism: Mechanism, state: State, joint: Joint, coordinate: str) -> Array:
    """Return the coefficients (n, 12) of the rate of a joint coordinate, of ``(v_i, w_i, v_j, w_j)``."""
    f = joint_frames(mechanism, state, joint)
    if coordinate in _SCALARS:
        return row_jacobian(f, _SCALARS[coordinate])[None]
    if coordinate == "position":
        return np.array([row_jacobian(f, row) for row in "XYZ"])
    axes = {"angle": f.U[:, 2:], "angle1": f.U[:, 2:], "angle2": f.W[:, :1], "orientation": f.U}[coordinate].T
    zero = np.zeros_like(axes)
    return np.hstack([zero, -axes, zero, axes])


def held_error(mechanism: Mechanism, state: State, joint: Joint, coordinate: str, target: ArrayLike) -> Array:
    """Return the actual minus the held value of a joint coordinate, shape (1,) or (3,).

    Parameters
    ----------
    joint : Joint
    coordinate : str
        Name of the coordinate in `JOINT_KINDS`.
    target : array_like, m or rad
        Held value; angles are compared modulo a turn. Of an orientation, a quaternion; the difference is then a
        rotation vector in axes of F.
    """
    motion = relative_motion(mechanism, state, joint)
    value = joint_coordinates(joint, motion)[coordinate]
    if coordinate == "orientation":
        R_held = rotation_from_quaternion(np.asarray(target))
        return rotation_vector_from_quaternion(quaternion_from_rotation(motion.R @ R_held.T))
    error = np.atleast_1d(value - np.asarray(target, dtype=float))
    if coordinate.startswith("angle") and joint.kind != "screw":  # the displacement of a screw tells its turns
        error = (error + np.pi) % (2 * np.pi) - np.pi
    return error


HeldCoordinates = list[tuple[Joint, str, ArrayLike]]
"""Joint, name of the coordinate, and the value at which the coordinate (or its rate) is held."""


def held_coordinates(
    mechanism: Mechanism, values: Mapping[str, Mapping[str, ArrayLike]], field_name: str
) -> HeldCoordinates:
    """Return the held joint coordinates of a mapping by names; refuse unknown joints and coordinates."""
    held: HeldCoordinates = []
    require(values, Mapping, f"initial.{field_name}", "Give values by joint and coordinate: {'pin': {'angle': 0.5}}.")
    for name, by_coordinate in values.items():
        joint = _joint(mechanism, name, field_name)
        known = JOINT_KINDS[joint.kind].coordinates
        where = f"initial.{field_name}: joint '{name}'"
        require(by_coordinate, Mapping, where, f"Give values by coordinate: {', '.join(known) or 'none'}.")
        for coordinate, value in by_coordinate.items():
            rates = field_name == "rates"
            name_of = "orientation" if rates and coordinate == "angular_velocity" else coordinate
            _check_coordinate(joint, name_of)
            held.append((joint, name_of, _held_value(where, name_of, value, rates)))
    return held


def _held_value(where: str, coordinate: str, value: ArrayLike, rates: bool) -> Array:
    """Return a held coordinate or rate as an array; refuse other shapes and what is not finite."""
    size = {"position": 3, "orientation": 3 if rates else 4}.get(coordinate, 1)
    hint = ""
    if coordinate == "orientation":
        hint = " It is an angular velocity in axes of F." if rates else " A quaternion, scalar first, or a matrix."
        if not rates and np.asarray(value, dtype=object).shape == (3, 3):
            value = quaternion_from_rotation(Frame(np.zeros(3), np.asarray(value)).R)
    held = fixed_array(np.atleast_1d(np.asarray(value)), (size,), f"{where}: {coordinate}", hint)
    if size == 4 and abs(np.linalg.norm(held) - 1.0) > 1e-9:
        what = f"the quaternion has norm {np.linalg.norm(held):.9g}"
        raise InvalidInput(f"{where}: {coordinate}", what, "Give a unit quaternion, scalar first.")
    return held


def row_names(mechanism: Mechanism, held: HeldCoordinates, velocities: bool) -> list[str]:
    """Return the names of constraint rows and held coordinates, in the order of the linear system."""
    names = [f"joint '{j.name}', constraint {row}" for j in mechanism.joints for row in j.rows]
    names += [f"drive '{d.name}'" for d in mechanism.drives] + [f"coupling '{c.name}'" for c in mechanism.couplings]
    names += [f"rolling '{r.name}', contact" for r in mechanism.rollings]
    if velocities:
        names += [f"rolling '{r.name}', slip" for r in mechanism.rollings for _ in range(2)]
        names += [f"skate '{s.name}'" for s in mechanism.skates]
    for joint, coordinate, _ in held:
        names += [f"joint '{joint.name}', held {coordinate}"] * _width(coordinate)
    return names


def _width(coordinate: str) -> int:
    """Return the number of rows that hold a coordinate."""
    return 3 if coordinate in ("position", "orientation") else 1


class NewtonIterate(NamedTuple):
    """Iterate of an assembly: pose, residual of all rows, and the step to the pose before it was shortened."""

    state: State
    residual: Array  # in units of the sizes of the rows
    left: Array  # residual that the linear model leaves
    step: float  # largest component, m and rad
    scale: float  # fraction of the step taken


def newton_iterates(
    mechanism: Mechanism, guess: State, held: HeldCoordinates, t: float = 0.0, angles: Angles | None = None
) -> Iterator[NewtonIterate]:
    """Yield a guess and the iterates of Newton's method, by least-norm steps.

    Steps are at most a radian, and a characteristic length or what `longest_step` tells: beyond, the linear model is
    meaningless.
    The equations are those of all holonomic rows and of the held coordinates; lengths count in characteristic lengths.

    Parameters
    ----------
    guess : State
    held : list of (Joint, str, array_like)
    t : float, s
    angles : mapping, optional
        Angles of joints that drive couplings, with full turns, as in `constraint_residual`.
    """
    rows, columns = row_lengths(mechanism, held), velocity_sizes(mechanism)
    state, longest, scale, most = guess, 0.0, 1.0, None
    while True:
        errors = [held_error(mechanism, state, *one) for one in held]
        residual = np.concatenate([constraint_residual(mechanism, state, t, angles), *errors]) / rows
        if most is None:
            most = np.tile(np.repeat([longest_step(largest_residual(residual)), 1.0], 3), len(mechanism.bodies))
        if not residual.any():
            yield NewtonIterate(state, residual, residual, longest, scale)
            return
        jacobian = _jacobian(mechanism, state, held, t, angles) * columns / rows[:, None]
        if not np.all(np.isfinite(jacobian)):
            raise CannotAssemble(
                f"mechanism '{mechanism.name}': assembly",
                "it leads to a pose at which the ends of a rod meet, and its direction is lost",
                "Draw the mechanism closer to an assembled pose.",
            )
        step = np.linalg.lstsq(jacobian, -residual, rcond=RANK_TOLERANCE)[0]
        yield NewtonIterate(state, residual, residual + jacobian @ step, longest, scale)
        longest = largest_residual(columns * step)
        scale = min(1.0, 1.0 / max(largest_residual(step / most), 1e-300))
        state = move(state, scale * columns * step)


def longest_step(way: float) -> float:
    """Return the longest step, in characteristic lengths: longer ones where the way would take too many."""
    return max(1.0, way / LONGEST_WAY)


def row_lengths(mechanism: Mechanism, held: HeldCoordinates) -> Array:
    """Return the sizes of all holonomic rows and of the held coordinates: the characteristic length, or one."""
    sizes = held_sizes(characteristic_length(mechanism), held)
    return np.concatenate([row_sizes(mechanism)[: mechanism.holonomic_count], sizes])


def _jacobian(
    mechanism: Mechanism, state: State, held: HeldCoordinates, t: float, angles: Angles | None = None
) -> Array:
    rows = [scatter(mechanism, joint, held_rows(mechanism, state, joint, name)) for joint, name, _ in held]
    return np.vstack([constraint_jacobian(mechanism, state, t=t, angles=angles)[: mechanism.holonomic_count], *rows])


def held_sizes(length: float, held: HeldCoordinates) -> Array:
    """Return the size of each held row: the characteristic length for rows in m, one for others."""
    lengths = [name in _SCALARS or name == "position" for _, name, _ in held for _ in range(_width(name))]
    return np.where(lengths, length, 1.0)


def assemble_positions(
    mechanism: Mechanism, guess: State, held: HeldCoordinates | None = None, t: float = 0.0
) -> State:
    """Project poses onto the constraints and the held coordinates with the least displacement of the bodies.

    Parameters
    ----------
    guess : State
        Its velocities are kept.
    held : list of (Joint, str, array_like), optional
    t : float, s
        Time at which drives are evaluated.

    Raises
    ------
    CannotAssemble
        No solution; the message names the constraint that stays violated, or the joint that closes flipped over.
    """
    held = held or []
    rows, state, before = row_lengths(mechanism, held), guess, np.inf
    for n, found in enumerate(newton_iterates(mechanism, guess, held, t)):
        error = largest_residual(found.residual)
        if n == 0:
            iterations = MAX_ITERATIONS + int(min(error, LONGEST_WAY))
            if largest_residual(found.left) > _DRAWN:
                _refuse_dead_centre(mechanism, guess, held, t, found.left * rows)
        if before < CONVERGED and error >= before:
            break
        state, residual, before = found.state, found.residual, error
        if n == iterations:
            break
    if before > CONVERGED * max(1.0, largest_residual(state.p_WB) / characteristic_length(mechanism)):
        names = row_names(mechanism, held, velocities=False)
        raise stays_violated(mechanism, names, residual, rows, iterations, "hold")
    refuse_flipped(mechanism, state)
    return state


def _refuse_dead_centre(mechanism: Mechanism, guess: State, held: HeldCoordinates, t: float, left: Array) -> None:
    """Refuse a guess at a singular pose that leaves residuals, in m or rad: rounding would choose the branch."""
    if is_singular(mechanism, guess, t, lambda at: _jacobian(mechanism, at, held, t)):
        names = row_names(mechanism, held, velocities=False)
        chosen = [n for n, name in enumerate(names) if not name.startswith("joint") or "held" in name]
        worst = max(chosen or range(len(names)), key=lambda n: abs(left[n]))
        raise CannotAssemble(
            f"mechanism '{mechanism.name}': {names[worst]}",
            "it cannot be reached from the pose as drawn, which is singular (a dead centre)",
            "The mechanism can leave that pose to either side: draw it off the pose, on the side that you mean.",
        )


def largest_residual(values: Array) -> float:
    """Return the largest magnitude; zero of an empty array."""
    return float(np.max(np.abs(values), initial=0.0))


def refuse_flipped(mechanism: Mechanism, state: State) -> None:
    """Refuse joints with frame M turned by half a turn: ``D_kl = 0`` holds there as well, for another mechanism."""
    for joint in mechanism.joints:
        f = joint_frames(mechanism, state, joint)
        if any(row in joint.rows and f.U[:, k] @ f.W[:, k] < 0 for row, k in (("D13", 2), ("D12", 0))):
            raise CannotAssemble(
                f"mechanism '{mechanism.name}': joint '{joint.name}'",
                "it closes only with frame M flipped over",
                "Draw the mechanism closer to the pose you mean.",
            )


def assemble_velocities(
    mechanism: Mechanism, state: State, held: HeldCoordinates | None = None, t: float = 0.0
) -> State:
    """Project velocities onto ``Q v = nu`` and the held rates with the least change.

    Parameters
    ----------
    state : State
        Consistent poses, and velocities as the guess.
    held : list of (Joint, str, array_like), optional
        Rates; of an orientation, the angular velocity of M relative to F in axes of F, rad/s.
    t : float, s
        Time at which the rates nu of drives are evaluated.

    Raises
    ------
    CannotAssemble
        The held rates contradict the joints or each other.
    """
    held = held or []

    def jacobian(at: State) -> Array:
        own = [scatter(mechanism, joint, held_rows(mechanism, at, joint, name)) for joint, name, _ in held]
        return np.vstack([constraint_jacobian(mechanism, at, t=t), *own])

    target = [constraint_rates(mechanism, t), *(np.atleast_1d(np.asarray(value, float)) for _, _, value in held)]
    rows = np.concatenate([row_sizes(mechanism), held_sizes(characteristic_length(mechanism), held)])
    columns = velocity_sizes(mechanism)
    Q, nu = jacobian(state) * columns / rows[:, None], np.concatenate(target) / rows
    v = np.hstack([state.v_WB_W, state.w_WB_W]).ravel() / columns
    for _ in range(2):  # the second pass removes the rounding of the first
        v = v + np.linalg.lstsq(Q, nu - Q @ v, rcond=RANK_TOLERANCE)[0]
    error = Q @ v - nu
    allowed = 1e-10 * max(largest_residual(nu), largest_residual(v))
    if largest_residual(error) > allowed:
        asked = np.arange(len(error)) >= mechanism.constraint_count()
        # name a rate that was asked for, rather than the constraint that opposes it
        worst = int(np.argmax(np.where(asked & (np.abs(error) > allowed), np.inf, np.abs(error))))
        why, remedy = "the held rates contradict the joints", "Hold it at that rate, or leave it out."
        if is_singular(mechanism, state, t, jacobian):
            why = "it is at a singular pose (a dead centre, or one where it locks), and no motion has these rates"
            remedy = "Start beside that pose, or hold rates with which the mechanism can leave it."
        raise CannotAssemble(
            f"mechanism '{mechanism.name}': {row_names(mechanism, held, velocities=True)[worst]}",
            f"its rate is to be {nu[worst] * rows[worst]:.6g}, "
            f"but joints, drives and other held rates make it {_rate_by_others(Q, nu, worst) * rows[worst]:.6g}: {why}",
            remedy,
        )
    both = (v * columns).reshape(-1, 6)
    return State(state.p_WB, state.quat_WB, both[:, :3], both[:, 3:])


def _rate_by_others(Q: Array, nu: Array, row: int) -> float:
    """Return the rate that the other rows give one row."""
    others = np.arange(len(nu)) != row
    return float(Q[row] @ np.linalg.lstsq(Q[others], nu[others], rcond=RANK_TOLERANCE)[0])
