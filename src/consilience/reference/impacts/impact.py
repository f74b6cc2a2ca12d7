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

from dataclasses import dataclass

import numpy as np

from consilience.errors import NumericalFailure
from consilience.mechanism import (
    RANK_TOLERANCE,
    Array,
    Contact,
    Mechanism,
    State,
    characteristic_length,
    kinetic_energy,
    rotation_from_quaternion,
    skew,
)
from consilience.reference.bodies.arrays import Model, unpack
from consilience.reference.bodies.canonical import joint_wrenches
from consilience.reference.impacts.geometry import ContactMotion, check_contacts, contact_motion
from consilience.reference.impacts.modes import ClosedContacts, solve_modes
from consilience.reference.impacts.stepper import constraint_rows

AT_REST = 1e-10
"""Contact velocities below this fraction of `velocity_scale` count as zero."""

_ENERGY = 1e-10
"""Largest apparent energy gain of an impact by rounding, relative to the energy before."""


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
    check_contacts(mechanism, contacts)
    motions = [contact_motion(mechanism, state, c) for c in contacts]
    at_rest = AT_REST * velocity_scale(mechanism, state)
    active = [n for n, m in enumerate(motions) if m.rate <= at_rest]
    contacts, motions = tuple(contacts[n] for n in active), [motions[n] for n in active]
    model, y, Q = constraint_rows(mechanism, state, time, turns)
    response = _Response(model, Q, _contact_rows(mechanism, y, contacts, motions))
    law = ClosedContacts(
        names=tuple(c.name for c in contacts),
        normal=np.array([m.normal for m in motions]).reshape(-1, 3),
        friction=np.array([c.friction for c in contacts]),
        target=np.array([c.restitution * max(-m.rate, 0.0) for c, m in zip(contacts, motions, strict=True)]),
        before=np.array([m.velocity for m in motions]).reshape(-1, 3),
        compliance=response.K @ response.K.T,
        free_compliance=float(np.max(np.abs(response.load), initial=0.0)) ** 2,
        at_rest=at_rest,
    )
    modes, p, after = solve_modes(law, time)
    y[:, 7:13] += response.velocity_change(p.ravel()).reshape(-1, 6)
    state_after = State(state.p_WB, state.quat_WB, *unpack(mechanism, y)[2:])
    wrenches = joint_wrenches(mechanism, state, response.multipliers(p.ravel()))
    N = np.sum(p * law.normal, axis=1)
    tangential = p - N[:, None] * law.normal
    mean = 0.5 * (law.before + after)
    record = Impact(
        time=time,
        contacts=law.names,
        modes=modes,
        directions=law.normal,
        normal=N,
        tangential=tangential,
        velocity_before=law.before,
        velocity_after=after,
        force_F=wrenches[:, :3],
        torque_F=wrenches[:, 3:],
        before=state,
        after=state_after,
        energy_before=kinetic_energy(mechanism, state),
        energy_after=kinetic_energy(mechanism, state_after),
        restitution_loss=-float(N @ np.sum(mean * law.normal, axis=1)),
        friction_loss=-float(np.sum(tangential * mean)),
    )
    _check_energy(record)
    return record


def velocity_scale(mechanism: Mechanism, state: State) -> float:
    """Return the largest speed of a body, rotation times the characteristic length included, m/s."""
    v, w = np.max(np.abs(state.v_WB_W)), np.max(np.abs(state.w_WB_W))
    return float(max(v, characteristic_length(mechanism) * w))


def _check_energy(record: Impact) -> None:
    allowed = _ENERGY * record.energy_before
    if min(record.restitution_loss, record.friction_loss) < -allowed:
        raise NumericalFailure(
            f"impact of {', '.join(record.contacts)} at t = {record.time:.12g} s: it would create energy, "
            f"{-record.restitution_loss:.3g} J by restitution and {-record.friction_loss:.3g} J by friction"
        )


class _Response:
    """Response of the mechanism to contact impulses.

    Attributes
    ----------
    load : ndarray, shape (6 n_b, 3 n_c)
        ``L^-1 J^T``.
    K : ndarray, shape (3 n_c, 6 n_b)
        ``J L^-T P``.
    """

    def __init__(self, model: Model, Q: Array, J: Array) -> None:
        n_b = len(model.mass)
        self._inverse = np.zeros((6 * n_b, 6 * n_b))  # L^-1
        for b in range(n_b):
            o = 6 * b
            self._inverse[o : o + 3, o : o + 3] = np.eye(3) / np.sqrt(model.mass[b])
            self._inverse[o + 3 : o + 6, o + 3 : o + 6] = np.linalg.inv(model.inertia_factor[b])
        self.load = self._inverse @ J.T
        U, singular, Vt = np.linalg.svd(self._inverse @ Q.T, full_matrices=False)
        rank = int(np.sum(singular > RANK_TOLERANCE * singular[0])) if len(Q) else 0
        self._U, self._pseudo = U[:, :rank], Vt[:rank].T / singular[:rank]
        K = self.load
        for _ in range(2):  # the second pass removes rounding errors along the joints
            K = K - self._U @ (self._U.T @ K)
        self.K = K.T

    def velocity_change(self, p: Array) -> Array:
        """Return the change of (v, w') of all bodies, shape (6 n_b,)."""
        return self._inverse.T @ (self.K.T @ p)

    def multipliers(self, p: Array) -> Array:
        """Return the impulses Lam of the joint rows, of least norm, shape (q,)."""
        return -self._pseudo @ (self._U.T @ (self.load @ p))


def _contact_rows(mechanism: Mechanism, y: Array, contacts: tuple[Contact, ...], motions: list[ContactMotion]) -> Array:
    """Return J, from (v, w') of all bodies to relative velocities of the contact points, shape (3 n_c, 6 n_b)."""
    J = np.zeros((3 * len(contacts), 6 * len(y)))
    A = rotation_from_quaternion(y[:, 3:7])
    for k, (contact, motion) in enumerate(zip(contacts, motions, strict=True)):
        for body, point, sign in ((contact.body, motion.on_body, 1.0), (contact.partner, motion.on_partner, -1.0)):
            b = mechanism.body_index[body]
            if b >= 0:
                J[3 * k : 3 * k + 3, 6 * b : 6 * b + 3] = sign * np.eye(3)
                J[3 * k : 3 * k + 3, 6 * b + 3 : 6 * b + 6] = -sign * skew(point - y[b, 0:3]) @ A[b]
    return J
