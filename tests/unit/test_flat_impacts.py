"""Impacts of boxes that land flat on four corners, beside Moreau's law solved by sweeps over the corners."""

import numpy as np
import pytest

from consilience.errors import NumericalFailure
from consilience.reference.contact.impulse import solve_impulse
from consilience.reference.contact.problem import ContactProblem, FrictionSet

MASS = 1.3
INERTIA = np.array([[0.02, 0.001, -0.002], [0.001, 0.03, 0.0015], [-0.002, 0.0015, 0.025]])
CORNERS = np.array([[x, y, -0.1] for x in (-0.2, 0.2) for y in (-0.15, 0.15)]) - [0.01, -0.02, 0.03]
"""From the centre of mass, rows (normal, first, second) of a corner: z, x, y."""


def rows_of_corners() -> np.ndarray:
    """Rows of the corners' velocities to (v, w), shape (12, 6)."""
    found = []
    for x, y, z in CORNERS:
        across = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])  # w x s = across w
        found.append(np.hstack([np.eye(3), across])[[2, 0, 1]])
    return np.vstack(found)


def landing(before: np.ndarray, mu: float) -> tuple[ContactProblem, np.ndarray, np.ndarray]:
    """Problem of a box with velocities (v, w) before, its Delassus matrix and the velocities of its corners."""
    J = rows_of_corners()
    M = np.block([[MASS * np.eye(3), np.zeros((3, 3))], [np.zeros((3, 3)), INERTIA]])
    G, u = J @ np.linalg.solve(M, J.T), J @ before
    normals = (0, 3, 6, 9)
    sets = tuple(FrictionSet(f"friction of corner {n}", (n + 1, n + 2), mu, mu, load=n) for n in normals)
    names = tuple(f"corner[{k // 3}]" for k in range(12))
    size = float(np.sqrt(before @ M @ before))
    return ContactProblem(G, u, names, normals, sets, size=size), G, u


def swept(G: np.ndarray, u: np.ndarray, mu: float, e: float, seed: int) -> np.ndarray:
    """Velocities after the impact by Moreau's law: sweeps of projections from impulses drawn at random."""
    free, random = u.copy(), np.random.default_rng(seed)
    free[::3] += e * np.minimum(u[::3], 0.0)
    p = np.zeros(12)
    p[::3] = random.uniform(0.0, 1.0, 4) * np.max(np.abs(u)) * MASS
    for _ in range(4000):
        last = p.copy()
        for n in range(0, 12, 3):
            p[n] = max(0.0, p[n] - (free[n] + G[n] @ p) / G[n, n])
            at = [n + 1, n + 2]
            moved = p[at] - 0.9 / np.linalg.norm(G[np.ix_(at, at)], 2) * (free[at] + G[at] @ p)
            p[at] = moved * min(1.0, mu * p[n] / max(np.linalg.norm(moved), 1e-300))
        if np.max(np.abs(p - last)) < 1e-15:
            break
    after = free + G @ p
    assert np.min(after[::3]) > -1e-11  # all laws hold: no corner sinks or pulls, what slides is opposed by mu N
    np.testing.assert_allclose(after[::3] * p[::3], 0.0, atol=1e-11)
    for n in range(0, 12, 3):
        slip, T = after[n + 1 : n + 3], p[n + 1 : n + 3]
        np.testing.assert_allclose(np.linalg.norm(slip) * T, -mu * p[n] * slip, atol=1e-11)
    return u + G @ p


def is_refused(problem: ContactProblem, e: float, law: str = "moreau") -> bool:
    """Whether velocities are told to be open, as one of several or as no answer."""
    try:
        return solve_impulse(problem, np.full(4, e), law).unique is False
    except NumericalFailure as failure:
        return "several accelerations" in str(failure)


@pytest.mark.parametrize(
    ("velocity", "spin", "mu", "e", "several"),
    [
        ((0.9, -0.4, -0.5), (0.0, 0.0, 0.0), 0.2, 0.8, False),
        ((0.02, 0.01, -0.5), (0.2, 0.1, 0.02), 0.2, 0.8, False),
        ((0.9, -0.4, -0.5), (0.0, 0.0, 2.0), 0.2, 0.8, True),
        ((1.5, 0.3, -0.4), (0.3, -0.2, 1.0), 0.2, 0.8, True),
        ((-1.693, -0.364, -0.718), (-4.236, -0.629, 0.0), 0.8, 0.0, True),
        ((0.071, 1.486, -0.342), (-1.293, 0.634, 0.0), 0.8, 0.0, True),
        ((-2.526, 1.907, -0.396), (0.0, 0.0, -1e-4), 0.8, 0.4, True),
    ],
    ids=["slides", "sticks", "turns", "rocks and turns", "one corner idle", "another idle", "hardly turns"],
)
def test_a_flat_impact_is_refused_exactly_where_sweeps_from_several_starts_end_in_several_velocities(
    velocity, spin, mu, e, several
):
    """Corners that slide in different directions share their impulse in several ways, each with its own velocities."""
    problem, G, u = landing(np.array([*velocity, *spin]), mu)
    found = np.array([swept(G, u, mu, e, seed) for seed in range(3)])
    apart = float(np.max(np.ptp(found, axis=0)))
    assert (apart > 1e-6) if several else (apart < 1e-10)
    if several:
        assert is_refused(problem, e)
        assert e > 0.0 or is_refused(problem, e, "poisson")  # without rebound the same law
    else:
        solution = solve_impulse(problem, np.full(4, e), "moreau")
        assert solution.unique is not False
        np.testing.assert_allclose(solution.velocity, found[0], atol=1e-10)
