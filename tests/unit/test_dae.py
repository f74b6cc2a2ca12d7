"""Integrators of the descriptor form as a DAE: Radau IIA on index 2 and 3, generalised-alpha on index 3."""

import functools

import numpy as np
import pytest

from consilience.engine import TrajectoryAnswer
from consilience.errors import InvalidInput, NumericalFailure
from consilience.mechanism import (
    GROUND,
    Body,
    Frame,
    Joint,
    Mechanism,
    State,
    constraint_jacobian,
    constraint_rates,
    constraint_residual,
    kinetic_energy,
    potential_energy,
    quaternion_from_rotation,
    quaternion_from_rotation_vector,
    rotation_angle_between,
    rotation_from_euler_zxz,
)
from consilience.reference.bodies.arrays import pack, unpack
from consilience.reference.bodies.lie_group import displaced, exponential, increment_rates
from consilience.reference.formulations.body_terms import BodyTerms, least_norm_multipliers
from consilience.reference.formulations.coordinates import DescriptorForm
from consilience.reference.formulations.dae_generalised_alpha import GeneralisedAlpha, generalised_alpha
from consilience.reference.formulations.dae_radau import DescriptorDae, integrate_dae
from consilience.reference.integrators.adaptive import integrate
from mechanisms import ELEMENTS, LOOPS, TREES, states_of
from oracles.closed_forms.heavy_top import HeavyTop

ALL = TREES | LOOPS | ELEMENTS
SPAN = 0.2
STATES = 5  # drawn of each mechanism


@functools.cache
def start(name, drawn=0):
    return states_of(ALL[name], STATES)[drawn]


def at(answer, k):
    return State(answer.p_WB[k], answer.quat_WB[k], answer.v_WB_W[k], answer.w_WB_W[k])


def explicit(mechanism, state, times):
    """Return the motion by an explicit method of order eight on the index-1 form, which has tests of its own."""
    one = DescriptorForm(mechanism, "descriptor_euler_parameters")
    motion = integrate(one, one.coordinates(state), times, 1e-13, "dop853")
    parts = (np.array([getattr(s, part) for s in motion.states]) for part in ("p_WB", "quat_WB", "v_WB_W", "w_WB_W"))
    return TrajectoryAnswer(times, *parts)


@functools.cache
def reference(name, t, drawn):
    """Return the state and the least-norm multipliers at the time t."""
    mechanism = ALL[name]
    state = at(explicit(mechanism, start(name, drawn), np.array([0.0, t])), 1)
    terms, y = BodyTerms(mechanism), pack(mechanism, state)
    angles = terms.count_turns(pack(mechanism, start(name, drawn)), np.zeros(terms.turns))
    found = terms.evaluate(t, y, terms.count_turns(y, angles))
    Q = found.Q.copy()
    return state, least_norm_multipliers(Q, Q.T @ terms.accelerations(found)[1])


def errors(name, motion, drawn=0):
    """Return the largest errors of poses, velocities and multipliers."""
    state, lam = reference(name, round(motion.t, 12), drawn)
    p, quat, v, w = unpack(ALL[name], motion.y)
    return (
        max(np.max(np.abs(p - state.p_WB)), np.max(rotation_angle_between(quat, state.quat_WB))),
        max(np.max(np.abs(v - state.v_WB_W)), np.max(np.abs(w - state.w_WB_W))),
        np.max(np.abs(motion.multipliers() - lam)),
    )


def orders(steps, found):
    return -np.polyfit(np.log(steps), np.log(found), 1)[0]


def violations(mechanism, answer, k=-1):
    """Return the largest ``|g|`` and ``|Q v - nu|``, computed by NumPy."""
    state, t = at(answer, k), answer.time[k]
    Q = constraint_jacobian(mechanism, state, t=t)
    rate = Q @ np.hstack([state.v_WB_W, state.w_WB_W]).ravel() - constraint_rates(mechanism, t)
    return np.max(np.abs(constraint_residual(mechanism, state, t))), np.max(np.abs(rate))


def differences(found, wanted):
    """Return the largest differences of poses and of velocities."""
    return (
        max(np.max(np.abs(found.p_WB - wanted.p_WB)), np.max(rotation_angle_between(found.quat_WB, wanted.quat_WB))),
        max(np.max(np.abs(found.v_WB_W - wanted.v_WB_W)), np.max(np.abs(found.w_WB_W - wanted.w_WB_W))),
    )


# ---------------------------------------------------------------- increments of poses


def test_increments_are_those_of_the_exponential_map():
    rng = np.random.default_rng(1)
    phi = rng.normal(size=(5, 3))
    phi[0] *= 1e-9
    wanted = [quaternion_from_rotation_vector(part) for part in phi]
    np.testing.assert_allclose(exponential(phi), wanted, rtol=0, atol=1e-15)


@pytest.mark.parametrize("size", [1e-3, 0.049, 0.051, 0.5, 2.5])
def test_rates_of_increments_give_the_angular_velocity_back(size):
    """``q exp(xi(t))`` has the angular velocity w', by central differences, on both sides of the switch to series."""
    rng = np.random.default_rng(2)
    xi, speeds, t = rng.normal(size=6), rng.normal(size=6), 1e-5
    xi[3:] *= size / np.linalg.norm(xi[3:])
    rates = increment_rates(xi, speeds)
    y = np.zeros((1, 13))
    y[0, 3:7] = quaternion_from_rotation_vector(rng.normal(size=3))
    before, now, after = (displaced(y, 1, xi + s * rates, speeds)[0] for s in (-t, 0.0, t))
    p_dot, (e0, *e) = (after[3:7] - before[3:7]) / (2 * t), now[3:7]
    w = 2 * (e0 * p_dot[1:] - p_dot[0] * np.array(e) - np.cross(e, p_dot[1:]))  # w' = 2 G p' [MASS (38)]
    np.testing.assert_allclose(w, speeds[3:], rtol=0, atol=1e-9)
    np.testing.assert_allclose(rates[:3], speeds[:3], rtol=0, atol=0)


# ---------------------------------------------------------------- Radau IIA

ORDERS = {2: (5, 5, 3), 3: (5, 3, 2)}
"""Orders of positions, velocities and multipliers by index [Hairer, Lubich & Roche 1989]."""


@pytest.mark.parametrize("index", ORDERS)
@pytest.mark.parametrize("name", ["single_universal", "four_bar"])
def test_radau_converges_with_the_orders_of_its_index(name, index):
    steps, found = np.array([10, 14, 20]), []
    for n in steps:
        motion = DescriptorDae(ALL[name], start(name), 0.0, index, 1e-11)
        for _ in range(n):
            z, _ = motion.attempt(SPAN / n)
            motion.accept(SPAN / n, z)
        found.append(errors(name, motion))
    measured = [orders(steps, part) for part in np.array(found).T]
    np.testing.assert_allclose(measured, ORDERS[index], atol=0.35)


@pytest.mark.parametrize("name", ["four_bar", "rolling_disc", "coupled", "driven"])
def test_ggl_keeps_to_the_motion_and_to_both_levels_of_constraints(name):
    mechanism, times = ALL[name], np.linspace(0.0, 0.3, 4)
    answer = integrate_dae(mechanism, start(name), times, 1e-10, 2)
    assert max(differences(answer, explicit(mechanism, start(name), times))) < 1e-8
    for k in range(1, 4):
        assert max(violations(mechanism, answer, k)) < 1e-12


@pytest.mark.parametrize("name", ["four_bar", "rolling_disc"])
def test_index_3_keeps_positions_and_speeds_to_third_order(name):
    mechanism, times = ALL[name], np.linspace(0.0, 0.3, 4)
    answer = integrate_dae(mechanism, start(name), times, 1e-10, 3)
    poses, speeds = differences(answer, explicit(mechanism, start(name), times))
    assert poses < 1e-8
    assert speeds < 1e-6
    g, rate = violations(mechanism, answer)
    assert g < 1e-12
    assert 1e-12 < rate < 1e-6  # index 3 does not impose the velocity constraint


def test_integrals_of_controllers_are_unknowns_of_radau():
    mechanism, times = ALL["powered"], np.array([0.0, 0.1])
    answer = integrate_dae(mechanism, start("powered"), times, 1e-8, 2)
    assert max(differences(answer, explicit(mechanism, start("powered"), times))) < 1e-7


def test_tolerances_steer_radau():
    mechanism, times = ALL["single_universal"], np.array([0.0, 0.5])
    wanted = explicit(mechanism, start("single_universal"), times)
    loose, tight = (integrate_dae(mechanism, start("single_universal"), times, tol, 2) for tol in (1e-5, 1e-8))
    assert max(differences(loose, wanted)) < 1e-4
    assert max(differences(tight, wanted)) < 1e-7
    assert tight.counters["steps"] > 2 * loose.counters["steps"]
    assert set(tight.counters) == {"steps", "rejected", "evaluations", "jacobians", "factorisations"}


@pytest.mark.parametrize(
    "change", [{"tolerance": 1e-14}, {"index": 1}, {"times": np.array([0.0, 0.0])}, {"times": np.array([np.nan])}]
)
def test_radau_refuses_what_makes_no_sense(change):
    arguments = {"times": np.array([0.0, 0.1]), "tolerance": 1e-8, "index": 2} | change
    with pytest.raises(InvalidInput):
        integrate_dae(ALL["four_bar"], start("four_bar"), **arguments)


# ---------------------------------------------------------------- generalised-alpha


@pytest.mark.parametrize("rho", [0.0, 0.8, 1.0])
@pytest.mark.parametrize("name", ["four_bar", "rolling_torus", "driven"])
def test_generalised_alpha_is_of_order_two_from_the_first_step_on(name, rho):
    """Order 2 of poses, velocities and multipliers; inconsistent starting values reduce the latter two to order 1.

    Errors of multipliers after two steps are taken over several states: in a single one their h^2 may nearly cancel.
    """
    steps, end, second = np.array([32, 48, 64]), [], []
    for n in steps:
        motions = [GeneralisedAlpha(ALL[name], start(name, k), 0.0, SPAN / n, rho) for k in range(STATES)]
        for motion in motions:
            motion.advance()
            motion.advance()
        second.append(max(errors(name, motion, k)[2] for k, motion in enumerate(motions)))
        for _ in range(n - 2):
            motions[0].advance()
        end.append(errors(name, motions[0]))
    measured = [orders(steps, part) for part in np.array(end).T]
    np.testing.assert_allclose(measured, 2.0, atol=0.15)
    assert orders(steps, second) > 1.85  # above 2 where the next term of the error is not yet small


def heavy_top():
    """Return the top of Brüls & Cardona (2010): 15 kg, 1 m from its tip, 150 rad/s; with its closed form."""
    mass, length, gravity = 15.0, 1.0, 9.81
    inertia = np.diag([0.234375, 0.234375, 0.46875])
    still = Frame(np.zeros(3), np.eye(3))
    mechanism = Mechanism(
        "heavy top",
        np.array([0.0, 0.0, -gravity]),
        (Body("top", mass, np.array([0.0, 0.0, length]), inertia, still),),
        (Joint("tip", "spherical", GROUND, "top", still, still),),
    )
    angles, rates = (0.2, 1.3, -0.4), (-4.6, 0.3, 150.0)
    R = rotation_from_euler_zxz(angles)
    phi = angles[0]
    nodes = np.array([np.cos(phi), np.sin(phi), 0.0])
    w = rates[0] * np.array([0.0, 0.0, 1.0]) + rates[1] * nodes + rates[2] * R[:, 2]
    state = State(np.zeros((1, 3)), quaternion_from_rotation(R)[None], np.zeros((1, 3)), w[None])
    transverse = inertia[0, 0] + mass * length**2
    return mechanism, state, HeavyTop(transverse, inertia[2, 2], mass * gravity * length, angles, rates)


def test_generalised_alpha_follows_the_heavy_top():
    mechanism, state, closed = heavy_top()
    times = np.array([0.0, 0.05, 0.1])
    axes = np.array([rotation_from_euler_zxz(x)[:, 2] for x in closed.solve(times)])
    steps, found = np.array([100, 150, 200]), []
    for n in steps:
        answer = generalised_alpha(mechanism, state, times, 0.1 / n, 0.8)
        e = answer.quat_WB[:, 0].T
        axis = np.stack(
            [2 * (e[1] * e[3] + e[0] * e[2]), 2 * (e[2] * e[3] - e[0] * e[1]), 1 - 2 * (e[1] ** 2 + e[2] ** 2)]
        )
        found.append(np.max(np.abs(axis.T - axes)))
    assert orders(steps, found) == pytest.approx(2.0, abs=0.15)
    assert found[-1] < 1e-3


@pytest.mark.parametrize("index", [2, 3])
def test_radau_follows_the_heavy_top(index):
    mechanism, state, closed = heavy_top()
    times = np.array([0.0, 0.05])
    wanted = rotation_from_euler_zxz(closed.solve(times)[-1])
    answer = integrate_dae(mechanism, state, times, 1e-8, index)
    assert rotation_angle_between(answer.quat_WB[-1, 0], quaternion_from_rotation(wanted)) < 1e-6


def test_samples_between_steps_keep_the_order():
    mechanism, times = ALL["single_universal"], np.array([0.0, 0.0637, 0.1411, 0.2])
    wanted = explicit(mechanism, start("single_universal"), times)
    steps = np.array([32, 48, 64])
    found = [
        differences(generalised_alpha(mechanism, start("single_universal"), times, SPAN / n, 0.8), wanted)
        for n in steps
    ]
    measured = [orders(steps, part) for part in np.array(found).T]
    np.testing.assert_allclose(measured, 2.0, atol=0.15)


def test_generalised_alpha_loses_energy_only_with_damping_and_never_leaves_the_constraints():
    mechanism, state = ALL["loop_universal"], start("loop_universal")
    times = np.linspace(0.0, 2.0, 41)
    energies = {}
    for rho in (0.0, 1.0):
        answer = generalised_alpha(mechanism, state, times, 0.005, rho)
        states = [at(answer, k) for k in range(len(times))]
        energies[rho] = np.array([kinetic_energy(mechanism, s) + potential_energy(mechanism, s) for s in states])
        assert max(violations(mechanism, answer, k)[0] for k in range(len(times))) < 1e-12
        assert max(violations(mechanism, answer, k)[1] for k in range(len(times))) < 0.05
    change = {rho: e - e[0] for rho, e in energies.items()}
    assert np.max(np.abs(change[1.0])) < 0.3 * np.max(np.abs(change[0.0]))


@pytest.mark.parametrize("change", [{"step": 0.0}, {"rho_inf": 1.2}, {"times": np.array([1.0, 0.0])}])
def test_generalised_alpha_refuses_what_makes_no_sense(change):
    arguments = {"times": np.array([0.0, 0.1]), "step": 0.01} | change
    with pytest.raises(InvalidInput):
        generalised_alpha(ALL["four_bar"], start("four_bar"), **arguments)


def test_a_step_far_too_long_is_reported():
    with pytest.raises(NumericalFailure, match="at t = 0 s Newton's method does not converge"):
        generalised_alpha(ALL["four_bar"], start("four_bar"), np.array([0.0, 10.0]), 5.0)
