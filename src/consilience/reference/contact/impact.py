"""Simultaneous impacts: velocities after an instant at which contacts close [MASS (40)-(50)].

Momentum balance with the impulses Lam of the joints and p_k of the contacts, joint constraints at velocity level, and
restitution of each contact:

    M (v+ - v-) = Q^T Lam + sum J_k^T p_k,     Q v+ = Q v-,     vn+ = -s vn-,     p_k = N_k (n_k + mu_k t_k),

J_k v is the relative velocity of the contact *points* (velocity of the centre of mass plus ``w x r``), as in Newton's
law; MASS (43) uses the velocities of the centres of mass alone. As in MASS, t is opposite to the relative tangential
velocity *before* the impact, d = -t along it.

Extension of the source: each closed contact is in one mode:

==============  ==========================================================  =====================================
mode            impulse and velocity after                                  admissible while
==============  ==========================================================  =====================================
released        p = 0 (a contact does not pull)                             vn+ >= b
frictionless    p = N n, vn+ = b (only if mu = 0)                           N >= 0
sliding         p = N (n + mu t), vn+ = b: the law of the source            N >= 0, d . vt+ >= 0
sticking        vn+ = b, vt+ = 0                                            N >= 0, |pt| <= mu N, pt . vt- <= 0
halted          p = N n + beta t, vn+ = b, d . vt+ = 0                      N >= 0, 0 <= beta <= mu N
unopposed       p = N n, vn+ = b                                            N >= 0, d . vt+ <= 0
starting        p = N (n - mu vt+/|vt+|), vn+ = b (only if vt- = 0)         N >= 0
==============  ==========================================================  =====================================

- ``b = -s vn-`` for an approaching contact, 0 for a closed contact at rest; N >= 0 is complementary to vn+ >= b. A
  separating contact does not take part; if it closes again, that is the next impact, at the same instant.
- Sliding is tried first; sticking if friction would reverse the sliding; halted (friction just stops the sliding) if
  the sticking impulse is outside the friction cone or would do positive work; unopposed if the normal impulses alone
  reverse the sliding. A contact without sliding before (t undefined) sticks, or starts to slide against friction.
- In every mode ``N (vn+ + vn-) <= 0`` and ``pt . (vt+ + vt-) <= 0`` for s <= 1. With joints at rest,
  ``T+ - T- = 1/2 sum p . (u+ + u-)``, so energy cannot grow, which Newton's restitution together with Coulomb
  friction does not guarantee (Kane and Levinson 1985; Brach 1989).

Contacts act simultaneously: for a ball that strikes two touching equal balls in a row, s = 1, the velocities are -1/3,
2/3, 2/3 of the striker's speed, not 0, 0, 1, which requires a gap. With ``M = L L^T`` and P the
projector onto the null space of ``Q L^-T`` (by singular values, so dependent joint rows are harmless),
``K = J L^-T P`` maps contact impulses to velocities: ``u+ = u- + K K^T p``. Impulses of dependent contacts and
joints are of least norm.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from consilience.errors import NumericalFailure
from consilience.mechanism import Array, Contact, Mechanism, State, Units, characteristic_length
from consilience.reference.bodies.arrays import unpack
from consilience.reference.bodies.canonical import joint_wrenches
from consilience.reference.contact.equations import ContactEquations
from consilience.reference.contact.impulse import has_table, solve_impulse
from consilience.reference.contact.layout import RowLayout, layout_of
from consilience.reference.contact.problem import in_words
from consilience.reference.contact.response import Response
from consilience.reference.contact.row_modes import open_modes
from consilience.reference.contact.stepper import Stepper

AT_REST = 1e-10
"""Contact velocities below this fraction of `velocity_scale` count as zero."""

_ENERGY = 1e-10
"""Largest apparent energy gain of an impact by rounding, relative to the energy before."""


_ACROSS = 1e-9
"""Impulse of a joint across its axis that is none, over the largest."""


@dataclass(frozen=True, eq=False)
class Impact:
    """Impact of all contacts that are closed at one instant.

    Attributes
    ----------
    time : float, s
    contacts : tuple of str, length n_c
        Names of the contacts that take part, approaching or closed at rest.
    modes : tuple of str, length n_c
        Mode of each contact, see the module.
    directions : ndarray, shape (n_c, 3)
        Unit normals from `partner` to `body`, world axes.
    normal, tangential : ndarray, shape (n_c,) and (n_c, 3), N s
        Impulses on `body` of each contact: normal component, and tangential vector in world axes.
    velocity_before, velocity_after : ndarray, shape (n_c, 3), m/s
        Relative velocities of the contact points, world axes.
    force_F, torque_F : ndarray, shape (n_j, 3), N s and N m s
        Joint impulses on the successors, at the origins of M, axes of F.
    before, after : State
        States just before and just after, of equal poses.
    energy_before, energy_after : float, J
        Kinetic energies.
    restitution_loss, friction_loss : float, J
        Sums of ``-1/2 N (vn+ + vn-)`` and ``-1/2 pt . (vt+ + vt-)``. Together the loss of energy, unless impulses of
        driven joints do work.
    """

    time: float
    contacts: tuple[str, ...]
    modes: tuple[str, ...]
    directions: Array
    normal: Array
    tangential: Array
    velocity_before: Array
    velocity_after: Array
    force_F: Array
    torque_F: Array
    before: State
    after: State
    energy_before: float
    energy_after: float
    restitution_loss: float
    friction_loss: float

    def in_units(self, units: Units) -> Impact:
        """Return the impact in other units."""
        speed = units.length / units.time
        impulse, energy = units.mass * speed, units.mass * speed**2
        return replace(
            self,
            time=units.time * self.time,
            normal=impulse * self.normal,
            tangential=impulse * self.tangential,
            velocity_before=speed * self.velocity_before,
            velocity_after=speed * self.velocity_after,
            force_F=impulse * self.force_F,
            torque_F=impulse * units.length * self.torque_F,
            before=units.convert(self.before),
            after=units.convert(self.after),
            energy_before=energy * self.energy_before,
            energy_after=energy * self.energy_after,
            restitution_loss=energy * self.restitution_loss,
            friction_loss=energy * self.friction_loss,
        )


def solve_impact(
    mechanism: Mechanism, state: State, contacts: tuple[Contact, ...], time: float = 0.0, turns: Array | None = None
) -> Impact:
    """Solve the impact of contacts that are closed at a state.

    Parameters
    ----------
    mechanism : Mechanism
    state : State
        State just before the impact, consistent with the joints.
    contacts : tuple of contacts
        Closed contacts (gaps are not checked); separating ones are left out.
    time : float, s
        Time of the impact, for the result, messages and time-dependent rows.
    turns : ndarray, optional
        Joint coordinates that elements read, full turns counted (m, rad), shape (n_c,).

    Returns
    -------
    Impact

    Raises
    ------
    InvalidInput
        Unknown bodies, duplicate names.
    NumericalFailure
        If no combination of modes is admissible: bodies are wedged.
    """
    layout = layout_of(replace(mechanism, contacts=contacts, stops=(), dry_frictions=()))
    equations = ContactEquations(layout)
    stepper = Stepper(equations, state, time, 1e-12, open_modes(layout))
    if turns is not None:
        stepper.turns[:] = turns
    response = stepper.respond(time, stepper.y)
    at_rest = AT_REST * velocity_scale(mechanism, state)
    rate = equations.rows.u[layout.normal_rows]
    return apply_impact(equations, response, stepper, rate <= at_rest, layout.rebounds(-rate), at_rest).record(layout)


@dataclass(frozen=True, eq=False)
class AppliedImpact:
    """Impact at a packed state: what a motion goes on with, and what its record is made of.

    Attributes
    ----------
    time : float, s
    normals : ndarray of int, shape (n_c,)
        Of the layout, those that take part.
    modes : tuple of str, length n_c
    force : ndarray, shape (m,), N s
        Impulses of all rows.
    lam : ndarray, shape (q,), N s
        Impulses of the joints' rows.
    before, after : ndarray, shape (n_b + n_e, 13)
        Packed states.
    u, u_after : ndarray, shape (m,)
        Rates of all rows before and after.
    frame : ndarray, shape (n, 3, 3)
        Of the parts.
    energy, energy_after : float, J
        Kinetic energies before and after.
    """

    time: float
    normals: Array
    modes: tuple[str, ...]
    force: Array
    lam: Array
    before: Array
    after: Array
    u: Array
    u_after: Array
    frame: Array
    energy: float
    energy_after: float

    def losses(self, layout: RowLayout) -> tuple[float, float]:
        """Return the losses by restitution and by friction, J."""
        lost = -0.5 * self.force * (self.u + self.u_after)
        along = float(np.sum(lost[layout.normal_rows]))
        lost[layout.normal_rows] = 0.0
        return along, float(np.sum(lost))

    def record(self, layout: RowLayout) -> Impact:
        """Return the record of the impact: a stop has no direction, its impulse is one of the joint coordinate."""
        parts = [layout.part_of(int(k)) for k in self.normals]
        frames = np.array([np.zeros((3, 3)) if k is None else self.frame[k] for k in parts]).reshape(-1, 3, 3)
        own = list(zip(self.normals, parts, strict=True))
        at = np.array([[layout.normals[n] + (0 if k is None else i) for i in range(3)] for n, k in own])
        at = at.astype(np.int64).reshape(-1, 3)
        before, after = (State(*unpack(layout.smooth, packed)) for packed in (self.before, self.after))
        wrenches = joint_wrenches(layout.smooth, before, self.lam)
        restitution_loss, friction_loss = self.losses(layout)
        return Impact(
            time=self.time,
            contacts=_names(layout, self.normals),
            modes=self.modes,
            directions=frames[:, 0],
            normal=self.force[at[:, 0]],
            tangential=np.einsum("ki,kij->kj", self.force[at[:, 1:]], frames[:, 1:]),
            velocity_before=np.einsum("ki,kij->kj", self.u[at], frames),
            velocity_after=np.einsum("ki,kij->kj", self.u_after[at], frames),
            force_F=wrenches[:, :3],
            torque_F=wrenches[:, 3:],
            before=before,
            after=after,
            energy_before=self.energy,
            energy_after=self.energy_after,
            restitution_loss=restitution_loss,
            friction_loss=friction_loss,
        )


def apply_impact(
    equations: ContactEquations,
    response: Response,
    stepper: Stepper,
    taking: Array,
    restitution: Array,
    at_rest: float,
    law: str = "newton",
) -> AppliedImpact:
    """Solve the impact of normals that touch, at the state of a stepper.

    Parameters
    ----------
    equations : ContactEquations
        Rows evaluated at that state.
    response : Response
        At that state.
    stepper : Stepper
    taking : ndarray of bool, shape (n_n,)
        Normals that take part: closed ones that approach or are at rest.
    restitution : ndarray, shape (n_n,)
    at_rest : float
        Rates below this count as zero.
    law : str
        Of contacts that do not ask for Moreau's or Poisson's, and of stops: newton or moreau (`impulse`).
    """
    layout, u = equations.layout, equations.rows.u
    normals = np.flatnonzero(taking)
    problem, at, _ = equations.problem(response, taking, u)
    parts = [layout.part_of(int(k)) for k in normals]
    asked = ["newton" if k is None else layout.parts[k].impact_law for k in parts]
    laws = [law if own == "newton" else own for own in asked]
    size = float(np.sqrt(2.0 * equations.energy(stepper.y)))
    found = solve_impulse(replace(problem, free=u[at], size=size), restitution[normals], laws, at_rest, stepper.t)
    if found.unique is False:
        raise NumericalFailure(
            f"impact of {in_words(_names(layout, normals))} at t = {stepper.t:.12g} s: the laws of contact and "
            "friction allow several accelerations, here velocities afterwards, as where contacts share an impulse and "
            "slide in different directions: the motion is not unique from here on"
        )
    force = np.zeros(len(layout.names))
    force[at] = found.impulse
    _refuse_friction_of_reactions(layout, response, force, stepper.t)
    before, count, lam = stepper.y.copy(), len(equations.model.mass), equations.multipliers_of_impulse(response, force)
    after, answer = before.copy(), response.K.T @ force
    velocity = before[:count, 7:13].ravel() + equations.inverse.T @ answer
    # on the joints: impacts in a chain take up the speed, and what one rounds off the joints is more and more of it
    after[:count, 7:13] = equations.free_velocities(response, velocity, 0.0)[1].reshape(-1, 6)
    rates, energies = (u.copy(), u + response.K @ answer), (equations.energy(before), equations.energy(after))
    impact = AppliedImpact(
        *(stepper.t, normals, found.modes, force, lam, before, after, *rates, equations.rows.frame.copy(), *energies)
    )
    if set(laws) <= {"newton"} and not any(one.associated for one in problem.friction):
        _check_energy(impact, layout, at_rest, has_table(problem))
    return impact


def _refuse_friction_of_reactions(layout: RowLayout, response: Response, force: Array, time: float) -> None:
    """Refuse impulses that load a joint whose reaction bounds its friction, which has one then by no stated law.

    Raises
    ------
    NumericalFailure
    """
    for j, reaction in response.reactions.items():
        if np.linalg.norm(reaction.linear @ force) > _ACROSS * np.max(np.abs(force), initial=0.0):
            raise NumericalFailure(
                f"{layout.friction[j].name}: the impact at t = {time:.12g} s loads its joint across the axis, and what "
                "friction of a reaction does in an impact is not stated; friction of a constant bound has no impulse"
            )


def _names(layout: RowLayout, normals: Array) -> tuple[str, ...]:
    return tuple(layout.names[layout.normals[k]].split("'")[1] for k in normals)


def velocity_scale(mechanism: Mechanism, state: State) -> float:
    """Return the largest speed of a body, rotation times the characteristic length included, m/s."""
    v, w = np.max(np.abs(state.v_WB_W)), np.max(np.abs(state.w_WB_W))
    return float(max(v, characteristic_length(mechanism) * w))


def _check_energy(impact: AppliedImpact, layout: RowLayout, at_rest: float, by_table: bool) -> None:
    """Refuse an impact that creates energy, but for what impulses do on rates that count as zero.

    By Newton's table neither restitution nor friction creates any; by Moreau's law what friction gives a slip that it
    reverses may be less than what restitution takes.
    """
    losses = impact.losses(layout)
    slack = _ENERGY * impact.energy + at_rest * float(np.sum(np.abs(impact.force)))
    if (min(losses) if by_table else sum(losses)) < -slack:
        by_restitution, by_friction = (-loss / impact.energy for loss in losses)
        raise NumericalFailure(
            f"impact of {in_words(_names(layout, impact.normals))} at t = {impact.time:.12g} s: it would create "
            f"energy: of that before, {by_restitution:+.3g} by restitution and {by_friction:+.3g} by friction"
        )
