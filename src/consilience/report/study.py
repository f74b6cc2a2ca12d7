"""Many motions of one mechanism as users of the library meet them: as data with dimensions, and in one picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from itertools import product
from math import prod
from typing import TYPE_CHECKING

import numpy as np

from consilience.case import Case
from consilience.engine import TrajectoryAnswer
from consilience.errors import InvalidInput, nearest
from consilience.mechanism import (
    GROUND,
    JOINT_KINDS,
    Array,
    Frame,
    Mechanism,
    rotation_from_quaternion,
    with_full_turns,
)
from consilience.report.dataframes import QUANTITIES, many_to_xarray
from consilience.report.exports.studyplot import Panel, study_figure
from consilience.report.simulation import Simulation

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure

_UNITS = {"distance": "m", "x": "m", "y": "m"}
"""Units of joint coordinates that are no angles."""


@dataclass(frozen=True, eq=False, repr=False)
class Study:
    """Motions of a mechanism with many parameter sets, or from many states.

    Sets are numbered in the order of the dimensions, the last one fastest.

    Attributes
    ----------
    case : Case
        The mechanism that the sets are changes of.
    parameters : mapping of str to ndarray
        Values by name: of each dimension of a grid, or of each set. Empty where states differ.
    grid : bool
        Whether sets are all combinations of the values.
    mechanisms : sequence of Mechanism
        One for each set.
    time : ndarray, shape (n_t,), s
    arrays : mapping of str to ndarray, shape (n, n_t, n_b, 3 or 4)
        ``p_WB``, ``quat_WB``, ``v_WB_W``, ``w_WB_W``, as in a `Simulation`; NaN where a set has no motion.
    failures : mapping of int to str
        Why a set has no motion.
    rebuilt : tuple of int
        Sets whose parameters change the structure of the model, which were prepared on their own.
    """

    case: Case
    parameters: Mapping[str, Array]
    grid: bool
    mechanisms: Sequence[Mechanism]
    time: Array
    arrays: Mapping[str, Array]
    failures: Mapping[int, str] = field(default_factory=dict)
    rebuilt: tuple[int, ...] = ()

    @property
    def shape(self) -> tuple[int, ...]:
        """Sizes of the grid, or the number of sets alone."""
        return tuple(map(len, self.parameters.values())) if self.grid else (len(self),)

    def __len__(self) -> int:
        return len(self.mechanisms)

    def __repr__(self) -> str:
        what = f"{len(self)} motions of '{self.case.name}', {self.time[-1] - self.time[0]:g} s each"
        over = f", over {' x '.join(map(str, self.shape))} values of {', '.join(self.parameters)}"
        notes = [f"{len(self.failures)} have none" * bool(self.failures)]
        notes.append(f"{len(self.rebuilt)} of another structure" * bool(self.rebuilt))
        return f"Study: {what}{over if self.parameters else ''}" + "".join(f"; {note}" for note in notes if note)

    def _repr_html_(self) -> str:
        first = [f"<li>set {n}: {escape(why)}</li>" for n, why in list(self.failures.items())[:10]]
        return f"<p>{escape(repr(self))}</p>" + (f"<ul>{''.join(first)}</ul>" if first else "")

    def values(self, n: int) -> dict[str, float]:
        """Return the parameters of set n by name."""
        return {name: float(column[n]) for name, column in self._columns().items()}

    def motion(self, n: int) -> Simulation:
        """Return the motion of set n with its mechanism.

        Raises
        ------
        InvalidInput
            The set has no motion, with the reason.
        """
        if not 0 <= n < len(self):
            raise InvalidInput(f"set {n}", "there is none of that number", f"Sets are 0 to {len(self) - 1}.")
        if n in self.failures:
            raise InvalidInput(f"set {n}", f"it has no motion: {self.failures[n]}", "Take another set.")
        p, quat, v, w = (self.arrays[name][n] for name in QUANTITIES)
        answer = TrajectoryAnswer(self.time, p, quat, v, w)
        return Simulation.of(self.mechanisms[n], answer)

    def coordinates(self, joint: str, coordinate: str | None = None) -> Array:
        """Return a joint coordinate, shape (..., n_t): m, or rad with full turns counted from the first sample on.

        Parameters
        ----------
        joint : str
        coordinate : str, optional
            Name in `JOINT_KINDS`; not needed where the joint has one coordinate.

        Raises
        ------
        InvalidInput
            There is no such joint or coordinate, or the coordinate is an orientation or a position.
        """
        known = self._scalars()
        names = [name for of, name in known if of == joint and coordinate in (None, name)]
        if len(names) != 1:
            words = [f"{of}.{name}" for of, name in known]
            what = "there is no such scalar coordinate" if not names else "the joint has several coordinates"
            raise InvalidInput(f"joint '{joint}'", what, nearest(f"{joint}.{coordinate or ''}", words, "Coordinates"))
        return self._coordinate(joint, names[0]).reshape(*self.shape, -1)

    def to_xarray(self) -> xarray.Dataset:
        """Return poses and velocities as a dataset.

        Its dimensions are the parameters of a grid, or ``set`` with the parameters as coordinates; then those of
        `Simulation.to_xarray`.

        Raises
        ------
        InvalidInput
            If xarray is not installed.
        """
        arrays = {name: values.reshape(*self.shape, *values.shape[1:]) for name, values in self.arrays.items()}
        return many_to_xarray(self.case.mechanism, self.time, arrays, self.parameters, self.grid)

    def plot(self, *joints: str) -> Figure:
        """Draw joint coordinates over time: all sets as bands, and beside them the effect of each parameter.

        A band holds all sets, a darker one the middle half; a line is the median. The effect of a parameter is the
        change of the coordinate with a change of the parameter by its standard deviation, by linear regression over all
        sets at each time.

        Parameters
        ----------
        joints : str
            Default: all with scalar coordinates, the first six panels.

        Raises
        ------
        InvalidInput
            There is no such joint, nothing to draw, or matplotlib is not installed.
        """
        known = self._scalars()
        names = list(dict.fromkeys(of for of, _ in known))
        for joint in joints:
            if joint not in names:
                raise InvalidInput("plot", f"there is no '{joint}' to draw", nearest(joint, names, "Joints"))
        chosen = [(of, name) for of, name in known if not joints or of in joints][:6]
        sound = [n for n in range(len(self)) if n not in self.failures]
        if not chosen or not sound:
            why = "no joint has a scalar coordinate" if sound else "no set has a motion"
            raise InvalidInput("plot", f"there is nothing to draw: {why}", "See failures, or draw motion(n).")
        spread = {name: column[sound] for name, column in self._columns().items() if np.ptp(column[sound]) > 0.0}
        panels = []
        for of, name in chosen:
            values = self._coordinate(of, name)[sound]
            label = of if name in ("angle", "distance") else f"{of} {name}"
            panels.append(Panel(label, _UNITS.get(name, "rad"), values, _effects(spread, values)))
        return study_figure(self.time, panels, repr(self))

    def _columns(self) -> dict[str, Array]:
        """Return the values of each parameter in each set."""
        if not self.grid:
            return dict(self.parameters)
        grid = np.array(list(product(*self.parameters.values()))).reshape(prod(self.shape), -1)
        return dict(zip(self.parameters, grid.T, strict=True))

    def _scalars(self) -> list[tuple[str, str]]:
        """Return joints and names of their scalar coordinates."""
        found = [(joint.name, c) for joint in self.case.mechanism.joints for c in JOINT_KINDS[joint.kind].coordinates]
        return [one for one in found if one[1] not in ("position", "orientation")]

    def _coordinate(self, name: str, coordinate: str) -> Array:
        """Return a scalar coordinate of a joint, shape (n, n_t)."""
        k = self.case.mechanism.joint_index[name]
        joints = [mechanism.joints[k] for mechanism in self.mechanisms]
        p_F, R_F = self._frames(joints[0].predecessor, [joint.F for joint in joints])
        p_M, R_M = self._frames(joints[0].successor, [joint.M for joint in joints])
        p = np.einsum("...ji,...j->...i", R_F, p_M - p_F)
        if coordinate in ("distance", "x", "y"):
            return np.asarray(p[..., {"x": 0, "y": 1, "distance": 2}[coordinate]])
        if joints[0].kind == "screw":
            return np.asarray(2.0 * np.pi * p[..., 2] / np.array([[joint.pitch] for joint in joints]))
        R = np.swapaxes(R_F, -1, -2) @ R_M
        w = np.einsum("...ji,...j->...i", R_F, self._spin(joints[0].successor) - self._spin(joints[0].predecessor))
        if coordinate == "angle2":
            angle, rate = np.arctan2(R[..., 2, 1], R[..., 2, 2]), np.einsum("...i,...i->...", R[..., 0], w)
        else:
            angle, rate = np.arctan2(R[..., 1, 0], R[..., 0, 0]), w[..., 2]
        return with_full_turns(angle, rate, self.time)

    def _spin(self, body: str) -> Array:
        """Return the angular velocity of a body of each set in world axes, (n, n_t, 3); zero of the ground."""
        if body == GROUND:
            return np.zeros(3)
        return np.asarray(self.arrays["w_WB_W"][:, :, self.case.mechanism.body_index[body]])

    def _frames(self, body: str, frames: Sequence[Frame]) -> tuple[Array, Array]:
        """Return origins and axes of a frame on a body of each set in the world, (n, n_t, 3) and (n, n_t, 3, 3)."""
        p, R = (np.array([getattr(frame, name) for frame in frames])[:, None] for name in ("p", "R"))
        if body == GROUND:
            return p, R
        b = self.case.mechanism.body_index[body]
        R_WB = rotation_from_quaternion(self.arrays["quat_WB"][:, :, b])
        return self.arrays["p_WB"][:, :, b] + np.einsum("...ij,...j->...i", R_WB, p), R_WB @ R


def _effects(parameters: Mapping[str, Array], values: Array) -> dict[str, Array]:
    """Return the effect of each parameter on values (n, n_t), each of shape (n_t,)."""
    if not parameters or len(values) <= len(parameters):
        return {}
    columns = np.array([(c - c.mean()) / c.std() for c in parameters.values()]).T
    slopes = np.linalg.lstsq(columns, values - values.mean(axis=0), rcond=None)[0]
    return dict(zip(parameters, slopes, strict=True))
