"""Impacts of more contacts than combinations of modes can be tried for: they have the solution that theory promises.

Without rebound the problem of Stewart and Trinkle (1996) has one for any number of contacts: its matrix is copositive,
and velocities of bodies do no work on impulses that move nothing.
"""

from __future__ import annotations

import numpy as np
import pytest

from consilience.mechanism import Array, skew
from consilience.reference.contact.modes import ClosedContacts, solve_modes

ROUNDED = 1e-8


def _impact(seed: int, count: int, restitution: float) -> tuple[ClosedContacts, Array, Array, Array]:
    """Return contacts of two bodies that all strike, with J, the inverse masses (12,) and velocities (12,) of both."""
    rng = np.random.default_rng(seed)
    J = np.zeros((3 * count, 12))
    for k in range(count):
        rows, body = slice(3 * k, 3 * k + 3), int(rng.integers(2))
        J[rows, 6 * body : 6 * body + 6] = np.hstack([np.eye(3), -skew(rng.normal(size=3))])
        if rng.random() < 0.4:
            other = 1 - body
            J[rows, 6 * other : 6 * other + 6] = -np.hstack([np.eye(3), -skew(rng.normal(size=3))])
    lightness = np.concatenate([np.full(6, 1.0 / mass) * [1, 1, 1, 2, 3, 4] for mass in rng.uniform(0.5, 3.0, 2)])
    velocity = rng.normal(size=12)
    before = (J @ velocity).reshape(-1, 3)
    normal = rng.normal(size=(count, 3))
    normal[::3] = before[::3]  # they strike without slip
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    approach = np.sum(before * normal, axis=1)
    normal *= -np.sign(approach)[:, None]
    G = J * lightness @ J.T
    names, friction = tuple(f"contact {k}" for k in range(count)), rng.uniform(0.05, 0.9, count)
    target = restitution * np.abs(approach)
    law = ClosedContacts(names, normal, friction, target, before, G, float(np.max(np.diag(G))), 1e-12)
    return law, J, lightness, velocity


@pytest.mark.parametrize("restitution", [0.0, 0.4])
@pytest.mark.parametrize("count", [6, 9])
@pytest.mark.parametrize("seed", range(12))
def test_many_contacts_that_strike_at_once_have_impulses_that_satisfy_the_laws(
    seed: int, count: int, restitution: float
) -> None:
    law, J, lightness, velocity = _impact(seed, count, restitution)
    modes, p, after = solve_modes(law, 0.0)
    N, rate = np.sum(p * law.normal, axis=1), np.sum(after * law.normal, axis=1) - law.target
    largest = float(np.max(N))
    assert np.min(N) >= -ROUNDED * largest
    assert np.min(rate) >= -ROUNDED
    assert np.max(N * rate) <= ROUNDED * largest
    T, slip = p - N[:, None] * law.normal, after - (rate + law.target)[:, None] * law.normal
    assert np.all(np.linalg.norm(T, axis=1) <= law.friction * N + ROUNDED * largest)
    for k in np.flatnonzero([mode == "starting" for mode in modes]):
        np.testing.assert_allclose(T[k] * np.linalg.norm(slip[k]), -law.friction[k] * N[k] * slip[k], atol=ROUNDED)
    moved = velocity + lightness * (J.T @ p.ravel())
    np.testing.assert_allclose(J @ moved, after.ravel(), atol=ROUNDED)
    assert moved @ (moved / lightness) < velocity @ (velocity / lightness)
