"""A motion as users of the library meet it: with its mechanism, its quantities by name, plots and a replay."""

from __future__ import annotations

from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from consilience.compare.energies import turned_springs
from consilience.engine import TrajectoryAnswer
from consilience.errors import InvalidInput, nearest
from consilience.mechanism import (
    JOINT_KINDS,
    Array,
    Joint,
    Mechanism,
    joint_coordinates,
    joint_rates,
    kinetic_energy,
    potential_energies,
    relative_motion,
    with_full_turns,
)
from consilience.report.contact_values import OpenForces, open_forces
from consilience.report.curves import KINDS, curve_sets
from consilience.report.exports.motionplot import motion_figure, one_kind
from consilience.report.html import render_replay
from consilience.report.picture import picture
from consilience.report.reactions import reactions_over_samples
from consilience.report.replay import replay_of_motion

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class ReplayPage:
    """A self-contained HTML page with a mechanism in motion; a notebook shows it in a cell."""

    html: str

    def __repr__(self) -> str:
        return f"ReplayPage: {len(self.html) / 1000:.0f} kB of HTML; save(path) writes it"

    def save(self, path: str | Path) -> Path:
        """Write the page to a file."""
        target = Path(path)
        target.write_text(self.html, encoding="utf-8")
        return target

    def _repr_html_(self) -> str:
        look = 'title="Mechanism in motion" width="100%" height="640" style="border:0"'
        return f'<iframe srcdoc="{escape(self.html)}" {look}></iframe>'


@dataclass(frozen=True, eq=False, repr=False)
class Simulation(TrajectoryAnswer):
    """Motion of a mechanism: poses and velocities of the bodies at sample times, and what follows from them.

    Attributes
    ----------
    mechanism : Mechanism
    """

    mechanism: Mechanism = field(kw_only=True)

    @classmethod
    def of(cls, mechanism: Mechanism, answer: TrajectoryAnswer) -> Simulation:
        """Return an answer together with its mechanism."""
        return cls(**vars(answer), mechanism=mechanism)

    def __repr__(self) -> str:
        m, t = self.mechanism, self.time
        return f"Simulation of '{m.name}': {len(m.bodies)} bodies, {len(t)} samples from {t[0]:g} to {t[-1]:g} s"

    def _repr_html_(self) -> str:
        drawn = picture(self.mechanism, self.state(0), f"{self.mechanism.name} at {self.time[0]:g} s")
        return f"<p>{escape(repr(self))}</p>{drawn}"

    def coordinates(self, joint: str, coordinate: str | None = None) -> Array:
        """Return a joint coordinate over time, shape (n_t,), (n_t, 3) or (n_t, 4).

        Parameters
        ----------
        joint : str
        coordinate : str, optional
            Name in `JOINT_KINDS`; not needed where the joint has one coordinate.

        Returns
        -------
        ndarray
            m, or rad with full turns counted from the first sample on; an orientation is a unit quaternion of M in F.

        Raises
        ------
        InvalidInput
            There is no such joint or coordinate.
        """
        found, name = self._coordinate(joint, coordinate)
        states = [self.state(k) for k in range(len(self.time))]
        values = np.array([joint_coordinates(found, relative_motion(self.mechanism, s, found))[name] for s in states])
        turns = name.startswith("angle") and not found.pitch  # a screw tells its turns by its distance
        return with_full_turns(values, self.rates(joint, coordinate), self.time) if turns else values

    def rates(self, joint: str, coordinate: str | None = None) -> Array:
        """Return the rate of a joint coordinate over time; of an orientation the angular velocity in axes of F.

        Parameters, shapes and errors are those of `coordinates`; m/s or rad/s.
        """
        found, name = self._coordinate(joint, coordinate)
        states = [self.state(k) for k in range(len(self.time))]
        return np.array([joint_rates(found, relative_motion(self.mechanism, s, found))[name] for s in states])

    def reactions(self, joint: str | None = None) -> Array:
        """Return force and torque of a joint on its successor over time, shape (n_t, 6); of all joints, (n_t, n_j, 6).

        About the origin of M, in axes of F, N and N m: constraint forces alone, of least norm where equilibrium leaves
        them open.

        Raises
        ------
        InvalidInput
            There is no such joint, or states do not determine reactions (integral controllers, contacts, stops, dry
            friction; of these three `consilience.accelerations` has them at single states).
        """
        chosen = ... if joint is None else self.mechanism.joints.index(self._joint(joint))
        found: Array = reactions_over_samples(self.mechanism, self)[:, chosen]
        return found

    def energy(self) -> dict[str, Array]:
        """Return kinetic, potential and total energy over time, J, each of shape (n_t,).

        Potential energy is that of gravity and springs, full turns of joint springs counted from the first sample on,
        without what springs of compliant contacts store.
        """
        states = [self.state(k) for k in range(len(self.time))]
        kinetic = np.array([kinetic_energy(self.mechanism, s) for s in states])
        springs = turned_springs(self.mechanism, self).T
        potential = np.array([potential_energies(self.mechanism, *at) for at in zip(states, springs, strict=True)])
        return {"kinetic": kinetic, "potential": potential, "total": kinetic + potential}

    def open_forces(self) -> OpenForces:
        """Tell which impulses of contacts, sums of them, and losses equilibrium leaves open.

        Joints, drives or other contacts share the load there: what the motion holds is one choice of many.
        """
        return open_forces(self.mechanism, self)

    def plot(self, *names: str, what: str = "coordinates") -> Figure:
        """Draw curves over time, a panel for each coordinate, joint or body.

        A panel says by how much its peak may be off where the samples are too far apart to tell.

        Parameters
        ----------
        names : str
            Joints, or for positions and velocities bodies; default: all, the first twelve panels.
        what : str
            A key of `consilience.report.curves.KINDS`.

        Raises
        ------
        InvalidInput
            There is no such name or kind, nothing of it can be drawn, or matplotlib is not installed.
        """
        if what not in KINDS:
            raise InvalidInput("plot", f"'{what}' is no kind of curves", nearest(what, KINDS, "Kinds"))
        bodies, joints = ([x.name for x in own] for own in (self.mechanism.bodies, self.mechanism.joints))
        known = bodies if what in ("positions", "velocities") else joints
        for name in names:
            if name not in known:
                raise InvalidInput("plot", f"there is no '{name}' to draw", nearest(name, known, "Names"))
        found = list(curve_sets(self.mechanism, self, [what], names))
        return motion_figure(one_kind(found, what, self.mechanism.name))

    def animate(self) -> ReplayPage:
        """Return a page with the mechanism in motion."""
        name, title = self.mechanism.name, f"{self.time[0]:g} to {self.time[-1]:g} s"
        return ReplayPage(render_replay(name, title, replay_of_motion(self.mechanism, self.state(0), self)))

    def to_xarray(self) -> xarray.Dataset:
        """Return poses and velocities as a dataset with units (`consilience.report.dataframes`)."""
        from consilience.report.dataframes import to_xarray  # noqa: PLC0415 - an extra

        return to_xarray(self.mechanism, self)

    def _joint(self, name: str) -> Joint:
        if name not in self.mechanism.joint_index:
            known = ", ".join(self.mechanism.joint_index)
            raise InvalidInput("motion", f"there is no joint '{name}'", f"Joints are: {known}.")
        return self.mechanism.joints[self.mechanism.joint_index[name]]

    def _coordinate(self, joint: str, coordinate: str | None) -> tuple[Joint, str]:
        found = self._joint(joint)
        names = JOINT_KINDS[found.kind].coordinates
        if coordinate is None and len(names) == 1:
            return found, names[0]
        if coordinate not in names:
            known = ", ".join(names) or "none"
            what = f"a {found.kind} joint has {len(names)} coordinates"
            raise InvalidInput(f"joint '{joint}'", what, f"Name one of: {known}.")
        assert coordinate is not None
        return found, coordinate
