"""Every oracle fulfils the Newton-Euler equations, keeps its joints closed and its energy constant.

Velocities and accelerations are differences of eighth order of the oracle's poses in time; the equations are those of
`truth`, which no oracle uses.
"""

import functools

import numpy as np
import pytest

import truth
from consilience.case import case_names, load_case
from consilience.mechanism import (
    State,
    constraint_residual,
    kinetic_energy,
    potential_energy,
    quaternion_from_rotation,
    rotation_angle_between,
)
from oracles.shipped import TRAJECTORIES, answer

H = 0.002
CENTRES = (0.35, 1.7, 3.05, 4.9)
FIRST = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280]) / H
SECOND = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560]) / H**2


def axial(tensors):
    """Axial vector of the antisymmetric part."""
    A = (tensors - np.swapaxes(tensors, -1, -2)) / 2
    return np.stack([A[..., 2, 1], A[..., 0, 2], A[..., 1, 0]], axis=-1)


@functools.cache
def moving(name):
    """The case, and (state, a_WB_W, alpha_WB_W) at the times `CENTRES`."""
    case = load_case(name)
    times = (np.array(CENTRES)[:, None] + H * np.arange(-4, 5)).ravel()
    p, R = TRAJECTORIES[name](case, times)
    p, R = p.reshape(len(CENTRES), 9, -1, 3), R.reshape(len(CENTRES), 9, -1, 3, 3)
    found = []
    for p_i, R_i in zip(p, R, strict=True):
        R_dot, R_ddot = np.tensordot(FIRST, R_i, 1), np.tensordot(SECOND, R_i, 1)
        back = np.swapaxes(R_i[4], -1, -2)
        state = State(p_i[4], quaternion_from_rotation(R_i[4]), np.tensordot(FIRST, p_i, 1), axial(R_dot @ back))
        found.append((state, np.tensordot(SECOND, p_i, 1), axial(R_ddot @ back)))
    return case, found


def test_every_oracle_is_of_a_shipped_case():
    assert set(TRAJECTORIES) <= set(case_names())


@pytest.mark.parametrize("name", TRAJECTORIES)
def test_starts_where_assembly_does(name):
    case, p, R = answer(name)
    start = case.initial_state
    assert np.max(np.abs(p[0] - start.p_WB)) < 1e-14
    assert np.max(rotation_angle_between(quaternion_from_rotation(R[0]), start.quat_WB)) < 1e-14


@pytest.mark.parametrize("name", TRAJECTORIES)
def test_starts_with_the_velocities_of_assembly(name):
    case = load_case(name)
    p, R = TRAJECTORIES[name](case, np.arange(5) * H)
    forward = np.array([-25 / 12, 4, -3, 4 / 3, -1 / 4]) / H  # one-sided, fourth order
    start = case.initial_state
    assert np.max(np.abs(np.tensordot(forward, p, 1) - start.v_WB_W)) < 1e-6
    assert np.max(np.abs(axial(np.tensordot(forward, R, 1) @ np.swapaxes(R[0], -1, -2)) - start.w_WB_W)) < 1e-6


@pytest.mark.parametrize("name", TRAJECTORIES)
def test_joints_stay_closed(name):
    case, p, R = answer(name)
    zeros = np.zeros_like(p[0])
    for p_i, R_i in zip(p[::10], R[::10], strict=True):
        state = State(p_i, quaternion_from_rotation(R_i), zeros, zeros)
        assert np.max(np.abs(constraint_residual(case.mechanism, state))) < 4e-14


@pytest.mark.parametrize("name", TRAJECTORIES)
def test_energy_is_constant(name):
    case, found = moving(name)

    def energy(state):
        return kinetic_energy(case.mechanism, state) + potential_energy(case.mechanism, state)

    start = energy(case.initial_state)
    peak = max(kinetic_energy(case.mechanism, state) for state, _, _ in found)
    for state, _, _ in found:
        assert abs(energy(state) - start) < 1e-11 * max(peak, abs(start))


@pytest.mark.parametrize("name", TRAJECTORIES)
def test_obeys_newton_and_euler(name):
    case, found = moving(name)
    for state, a, alpha in found:
        a_true, alpha_true, _, _ = truth.solve(case.mechanism, state)
        scale = max(1.0, np.max(np.abs(a_true)), np.max(np.abs(alpha_true)))
        assert np.max(np.abs(a - a_true)) < 2e-9 * scale
        assert np.max(np.abs(alpha - alpha_true)) < 2e-9 * scale
