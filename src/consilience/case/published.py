"""Expected values of a case, each with an uncertainty and a source, and their counterparts in an answer.

Values are read at a sample time. Accelerations and reactions of the initial state are those of an answer at instants,
later ones follow from the states of a motion.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from consilience.case.equations import later_equations, unwrapped
from consilience.engine import InstantAnswer, TrajectoryAnswer
from consilience.mechanism import JOINT_KINDS, Array, Mechanism, State, body_point, joint_rates, relative_motion

Origin = Literal["printed", "closed form", "computed"]
"""A source prints the value; a formula gives it; or two independent computations agree on it."""

Scale = Literal["size", "speed", "spin", ""]
"""Scale of a motion by which an uncertainty without unit is multiplied; none for an angle."""


@dataclass(frozen=True)
class Published:
    """One expected value.

    Attributes
    ----------
    observable : str
        A name of `OF_A_BODY`, `OF_A_JOINT`, `ACCELERATIONS` or `REACTIONS`, or `CONTACT_FORCE`.
    of : str
        Name of the body, joint or contact.
    component : int
        0, 1 or 2 of a vector; 0 of a scalar.
    time : float, s
        On the sample grid.
    value, uncertainty : float
        SI units.
    source : str
        A closed form, a publication, a computation.
    origin : {"printed", "closed form", "computed"}
    second : str
        Second, independent computation of a computed value.
    """

    observable: str
    of: str
    component: int
    time: float
    value: float
    uncertainty: float
    source: str
    origin: Origin = "printed"
    second: str = ""

    @property
    def at_start(self) -> bool:
        """Whether the value belongs to the equations at the initial state, not to the motion."""
        return self.of_equations and self.time == 0.0

    @property
    def of_equations(self) -> bool:
        """Whether the value is an acceleration, a reaction or a contact force."""
        return self.observable in (*ACCELERATIONS, *REACTIONS, CONTACT_FORCE)

    @property
    def name(self) -> str:
        """Observable, component, body or joint, and time, in words."""
        axis = "" if self.observable in OF_A_JOINT else f", {'xyz'[self.component]}"
        return f"{self.observable} of {self.of}{axis} at {self.time:g} s"

    def off(self, found: float) -> float:
        """Return the distance of a found value to the expected value.

        Angles within half a turn are compared modulo full turns, others, which count turns, as they are.
        """
        difference = found - self.value
        if self.observable in ("angle", "angle1", "angle2") and abs(self.value) <= np.pi:
            difference = float(np.remainder(difference + np.pi, 2.0 * np.pi) - np.pi)
        return abs(difference)


def _center(mechanism: Mechanism, state: State, i: int) -> tuple[Array, Array]:
    """Position and velocity of the centre of mass of a body, world axes."""
    return body_point(mechanism, state, mechanism.bodies[i].name, mechanism.bodies[i].com)


OF_A_BODY: dict[str, tuple[Callable[[Mechanism, State, int], Array], Scale]] = {
    "p_WB": (lambda mechanism, state, i: state.p_WB[i], "size"),
    "v_WB_W": (lambda mechanism, state, i: state.v_WB_W[i], "speed"),
    "w_WB_W": (lambda mechanism, state, i: state.w_WB_W[i], "spin"),
    "w_WB_B": (lambda mechanism, state, i: state.R_WB[i].T @ state.w_WB_W[i], "spin"),
    "p_WBcm": (lambda mechanism, state, i: _center(mechanism, state, i)[0], "size"),
    "v_WBcm_W": (lambda mechanism, state, i: _center(mechanism, state, i)[1], "speed"),
    "x_axis": (lambda mechanism, state, i: state.R_WB[i][:, 0], ""),
    "y_axis": (lambda mechanism, state, i: state.R_WB[i][:, 1], ""),
    "z_axis": (lambda mechanism, state, i: state.R_WB[i][:, 2], ""),
}
"""Vectors of a body in a motion: pose and velocities of the origin and of the centre of mass, axes in the world.

They are in world axes, but the angular velocity w_WB_B, which is in axes of the body."""

_COORDINATES = ("angle", "distance", "x", "y", "angle1", "angle2")

OF_A_JOINT: dict[str, tuple[str, Scale]] = {
    **{name: (name, "" if name.startswith("angle") else "size") for name in _COORDINATES},
    **{f"{name}_rate": (name, "spin" if name.startswith("angle") else "speed") for name in _COORDINATES},
}
"""Scalars of a joint in a motion, each the value or the rate of a joint coordinate: that coordinate, and the scale."""

ACCELERATIONS = ("a_WB_W", "alpha_WB_W")
"""Acceleration of the origin of a body, and its angular acceleration."""

REACTIONS = ("force_F", "torque_F")
"""Reaction of a joint on the successor, at the origin of M, in axes of F."""

CONTACT_FORCE = "contact_force"
"""Force of a contact on its body at the start, the sum over its parts, in world axes."""


def owner_of(observable: str) -> str:
    """Return whose observable it is: ``body``, ``joint`` or ``contact``."""
    if observable == CONTACT_FORCE:
        return "contact"
    return "joint" if observable in OF_A_JOINT or observable in REACTIONS else "body"


def owners(mechanism: Mechanism, observable: str) -> dict[str, int]:
    """Return the index of each body, joint or contact that has an observable, by its name."""
    of_contacts = {contact.name: n for n, contact in enumerate(mechanism.contacts)}
    own = {"body": mechanism.body_index, "joint": mechanism.joint_index, "contact": of_contacts}
    return own[owner_of(observable)]


def has_coordinate(mechanism: Mechanism, joint: str, observable: str) -> bool:
    """Tell whether a joint has the coordinate of an observable of `OF_A_JOINT`."""
    return OF_A_JOINT[observable][0] in JOINT_KINDS[mechanism.joints[mechanism.joint_index[joint]].kind].coordinates


def scale_of(observable: str) -> Scale:
    """Return the scale of an observable of a motion."""
    return OF_A_BODY[observable][1] if observable in OF_A_BODY else OF_A_JOINT[observable][1]


def read_motion(mechanism: Mechanism, known: Published, motion: TrajectoryAnswer) -> float:
    """Return the value of a motion for an expected value that is not `at_start`; an angle counts full turns."""
    n = sample_of(known, motion)
    if known.of_equations:
        index = owners(mechanism, known.observable)[known.of]
        return float(later_equations(mechanism, motion, n)[known.observable][index, known.component])
    state = motion.state(n)
    if known.observable in OF_A_BODY:
        read, _ = OF_A_BODY[known.observable]
        return float(read(mechanism, state, mechanism.body_index[known.of])[known.component])
    coordinate, _ = OF_A_JOINT[known.observable]
    joint = mechanism.joints[mechanism.joint_index[known.of]]
    if known.observable.endswith("_rate"):
        return float(joint_rates(joint, relative_motion(mechanism, state, joint))[coordinate])
    return unwrapped(mechanism, motion, joint, coordinate, n)


def sample_of(known: Published, motion: TrajectoryAnswer) -> int:
    """Return the sample of a motion at the time of an expected value."""
    return int(abs(motion.time - motion.time[0] - known.time).argmin())


def read_start(mechanism: Mechanism, known: Published, answer: InstantAnswer) -> Array:
    """Return the vector of an answer, first state, for an expected value that is `at_start`; NaN without answer."""
    values = getattr(answer, known.observable)
    return (
        np.full(3, np.nan) if values is None else np.asarray(values[0, owners(mechanism, known.observable)[known.of]])
    )
