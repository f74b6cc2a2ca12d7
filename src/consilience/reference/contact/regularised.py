"""Motion with regularised contacts: the law of `Regularisation`, integrated without events.

The rows E of all contacts that overlap are those of the law: the normal n of a contact without friction, the four edges
``n + mu t1``, ``n - mu t1``, ``n + mu t2``, ``n - mu t2`` of one with friction. At each state their forces f obey

    0 <= f  _|_  E u' + R f - a_ref >= 0,      u' = E J a_0 + G f,      G = E K K^T E^T,

in the notation of `equations`: as G + R is positive definite, f is the one solution of a least-squares problem with
f >= 0 (C. Lawson, R. Hanson, Solving Least Squares Problems, 1974). The contact point is in the middle of the overlap,
and u' is that of the velocities of the bodies' origins: its convective part is left out. Where a contact closes or
opens the acceleration jumps; the control of errors finds the instant.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from consilience.engine import TrajectoryAnswer
from consilience.errors import InvalidInput, NumericalFailure
from consilience.mechanism import (
    Array,
    Mechanism,
    Regularisation,
    State,
    kept_in_units,
    motion_units,
    rotation_from_quaternion,
    telling_si,
)
from consilience.reference.bodies.arrays import pack, unpack
from consilience.reference.bodies.canonical import sample_times
from consilience.reference.contact.equations import ContactEquations
from consilience.reference.contact.layout import layout_of
from consilience.reference.integrators.adaptive import integrate

LEAST_TOLERANCE = 1e-10
"""Least tolerance: where an acceleration jumps a smaller one costs steps that end in rounding."""

MOST_EVALUATIONS = 4_000
"""Evaluations of a motion that does not chatter. A contact whose bodies turn may: what the law leaves out of its
acceleration opens it under load, and the load closes it at once."""


def simulate_regularised(
    mechanism: Mechanism, laws: Sequence[Regularisation], state: State, times: Array, tolerance: float = 1e-10
) -> TrajectoryAnswer:
    """Integrate the motion of a mechanism whose contacts are regularised.

    Parameters
    ----------
    mechanism : Mechanism
        Without stops and dry friction; contacts of friction have pyramids of four facets.
    laws : sequence of Regularisation
        One for each elementary contact, in the order of `contact_parts`.
    state : State
        Consistent state at ``times[0]``; contacts may overlap.
    times : ndarray, shape (n_t,), s
    tolerance : float
        Bound on the scaled local error of a step, `LEAST_TOLERANCE` at least.

    Raises
    ------
    InvalidInput
        A law that the regularisation does not cover, or another number of laws.
    NumericalFailure
        A contact chatters, or the integration fails.
    """
    times = sample_times(times)
    units = motion_units(mechanism, times)
    own, start, grid = kept_in_units(mechanism, units), units.convert(state), units.time * times
    with telling_si(units):
        motion = _Regularised(own, [units.convert(law) for law in laws], start)
        found = integrate(motion, motion.start, grid, max(tolerance, LEAST_TOLERANCE), "dop853")
    bodies = unpack(motion.smooth, found.samples[:, : motion.count].reshape(len(times), *motion.shape))
    return replace(units.inverse.convert(TrajectoryAnswer(grid, *bodies, {**found.counters})), time=times)


class _Regularised:
    """Equations of motion in packed states, for the integrators that call Python."""

    def __init__(self, mechanism: Mechanism, laws: Sequence[Regularisation], state: State) -> None:
        _check(mechanism)
        layout = layout_of(mechanism)
        if len(laws) != len(layout.parts):
            what = f"{len(laws)} laws of {len(layout.parts)} contacts"
            raise InvalidInput("regularisation", what, "Give one for each elementary contact.")
        self._laws, self._parts, self.smooth = laws, layout.parts, layout.smooth
        self._equations = ContactEquations(layout)
        y = pack(layout.smooth, state)
        self.shape, self.count = y.shape, y.size
        self.start = np.concatenate([y.ravel(), np.zeros(layout.sums)])
        self._turns = np.zeros(len(self._equations.model.coordinate))
        self._equations.follow(y, self._turns)
        sides = [(part.body, part.partner) for part in layout.parts]
        self._sides = [tuple(mechanism.body_index[name] for name in pair) for pair in sides]
        self._bodies = len(mechanism.bodies)
        self._evaluations = 0

    def derivative(self, t: float, u: Array) -> Array:
        """Return the derivative of a packed state."""
        self._evaluations += 1
        if self._evaluations > MOST_EVALUATIONS:
            raise NumericalFailure(f"regularised contacts chatter, t = {t:.12g} s")
        u = np.ascontiguousarray(u)
        rates, bodies = self._equations.rates(t, u, self._turns), self._bodies
        pushed = self._pushed(t, u[: self.count].reshape(self.shape))
        if pushed is not None:
            rates[: 13 * bodies].reshape(bodies, 13)[:, 7:13] += pushed.reshape(bodies, 6)
        return rates

    def settle(self, t: float, u: Array) -> Array:
        """Return a packed state projected onto the joints."""
        settled = np.array(u)
        self._equations.project(t, settled, self._turns)
        return settled

    def state(self, u: Array) -> State:
        """Return the canonical state."""
        return State(*unpack(self.smooth, u[: self.count].reshape(self.shape)))

    def _pushed(self, t: float, y: Array) -> Array | None:
        """Return what the contacts add to the accelerations (v', w') of the bodies; None where nothing overlaps."""
        equations = self._equations
        gap = equations.move(t, y, self._turns).gap[: len(self._parts)]
        low = np.flatnonzero(gap < 0.0)
        if not len(low):
            return None
        response, bodies = equations.respond(t, y, self._turns), y[: self._bodies]
        A = rotation_from_quaternion(bodies[:, 3:7])
        J, aims, soft = (
            np.concatenate(parts) for parts in zip(*(self._edges(int(k), A, bodies) for k in low), strict=True)
        )
        load = equations.inverse @ J.T
        K = equations.held_by_joints(load)
        f = _pushes(K.T @ K + np.diag(soft), aims - load.T @ response.z)
        return np.asarray(equations.inverse.T @ (K @ f))

    def _edges(self, k: int, A: Array, bodies: Array) -> tuple[Array, Array, Array]:
        """Return the rows J of a contact that overlaps, a_ref, and the diagonal of R."""
        law, mu, rows = self._laws[k], self._parts[k].friction, self._equations.rows
        frame, J, overlap = rows.frame[k], rows.J[3 * k : 3 * k + 3].copy(), -float(rows.gap[k])
        lever = np.cross(0.5 * overlap * frame[0], frame)  # from the surface of the body to the middle of the overlap
        for sign, b in zip((1.0, -1.0), self._sides[k], strict=True):
            if b >= 0:
                J[:, 6 * b + 3 : 6 * b + 6] += sign * lever @ A[b]
        along, soft = np.array([[1.0, 0.0, 0.0]]), 1.0
        if mu > 0.0:
            along = np.array([[1.0, s * mu * a, s * mu * (1.0 - a)] for a in (1.0, 0.0) for s in (1.0, -1.0)])
            soft = 2.0 * mu**2 * (1.0 + mu**2)
        d, J = law.impedance(overlap), along @ J
        aims = law.pull * d * overlap - law.decay * (J @ bodies[:, 7:13].ravel())
        return J, aims, np.full(len(along), soft * (1.0 - d) / d * law.inverse_mass)


def _check(mechanism: Mechanism) -> None:
    """Refuse what the regularised rows do not cover."""
    for contact in mechanism.contacts:
        pyramid = contact.cone.kind == "pyramid" and contact.cone.facets == 4 and contact.cone.offset == 0.0
        if (contact.friction > 0.0 and not pyramid) or max(contact.torsional, contact.rolling) > 0.0:
            what = "its friction is no pyramid of four facets"
            raise InvalidInput(f"contact '{contact.name}'", what, "Give such a cone, or no friction.")
    if mechanism.stops or mechanism.dry_frictions:
        raise InvalidInput("regularisation", "stops and dry friction have none", "Leave them out.")


def _pushes(system: Array, wanted: Array) -> Array:
    """Return ``f >= 0`` with ``system f >= wanted``, one of them equal in each row; the matrix is positive definite."""
    factor = np.linalg.cholesky(system)
    found: Array = scipy.optimize.nnls(factor.T, scipy.linalg.solve_triangular(factor, wanted, lower=True))[0]
    return found
