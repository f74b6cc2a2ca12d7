"""Descriptor forms in orientation coordinates against dense NumPy, the compiled solver and closed forms."""

import functools

import numpy as np
import pytest

import truth
from consilience.mechanism import (
    State,
    constraint_jacobian,
    constraint_rates,
    constraint_residual,
    determinate_reactions,
    quaternion_from_rotation,
    rotation_angle_between,
    rotation_from_bryant_xyz,
    rotation_from_euler_zxz,
    skew,
)
from consilience.mechanism.conditioning import mass_matrix_condition
from consilience.reference.formulations.coordinates import VARIANTS, DescriptorForm
from consilience.reference.formulations.orientations import ORIENTATIONS, SingularOrientation
from consilience.reference.formulations.stabilisation import ALPHA, BETA
from consilience.reference.integrators.adaptive import integrate
from consilience.reference.solver import simulate
from mechanisms import ELEMENTS, LOOPS, TREES, chain, states_of

ALL = TREES | LOOPS | ELEMENTS
EPS = np.finfo(float).eps
PROJECTED = [name for name, variant in VARIANTS.items() if variant.stabilisation == "projection"]


@functools.cache
def states(name):
    return states_of(ALL[name], 3)


def solved(name):
    """Yield state, dense accelerations and reactions, and the tolerance of accelerations."""
    mechanism = ALL[name]
    for s in states(name):
        yield s, truth.solve(mechanism, s), 1e-10 + 10 * EPS * mass_matrix_condition(mechanism, s)


# ---------------------------------------------------------------- equations


@pytest.mark.parametrize("name", ALL)
def test_accelerations_and_reactions_are_those_of_dense_numpy(name):
    mechanism = ALL[name]
    forms = [DescriptorForm(mechanism, variant) for variant in VARIANTS]
    for state, (a, alpha, force, torque), bar in solved(name):
        size, load = np.max(np.abs([a, alpha])), max(np.max(np.abs([force, torque])), 1e-3)
        free = determinate_reactions(mechanism, state)
        for one in forms:
            found = one.accelerations(state)
            assert np.max(np.abs(np.subtract(found, [a, alpha]))) < bar * size, one.name
            wrong = np.hstack(one.reactions(state)) - np.hstack([force, torque])
            assert np.max(np.abs(wrong[free]), initial=0.0) < bar * load, one.name


@pytest.mark.parametrize("orientation", ORIENTATIONS)
@pytest.mark.parametrize("name", ["branched", "four_bar", "coupled", "rolling_torus"])
def test_plain_and_symmetrised_forms_have_the_same_second_derivatives(name, orientation):
    symmetrised, plain = (DescriptorForm(ALL[name], f"descriptor_{orientation}{suffix}") for suffix in ("", "_plain"))
    for state in states(name):
        u = symmetrised.coordinates(state)
        wanted = symmetrised.derivative(0.0, u)
        np.testing.assert_allclose(plain.derivative(0.0, u), wanted, rtol=0, atol=1e-10 * np.max(np.abs(wanted)))


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("name", ["floating_chain", "powered"])
def test_state_inverts_coordinates(name, variant):
    one = DescriptorForm(ALL[name], variant)
    for state in states(name):
        again = one.state(one.coordinates(state))
        for part in ("p_WB", "v_WB_W", "w_WB_W"):
            np.testing.assert_allclose(getattr(again, part), getattr(state, part), rtol=0, atol=1e-13)
        assert np.max(rotation_angle_between(again.quat_WB, state.quat_WB)) < 1e-13


@pytest.mark.parametrize("orientation", ORIENTATIONS)
def test_the_derivative_of_the_state_is_that_of_the_coordinates(orientation):
    """Velocities and accelerations of the canonical state are central differences along ``x + t x' + t^2/2 x''``."""
    mechanism, name = ALL["floating_chain"], f"descriptor_{orientation}"
    one = DescriptorForm(mechanism, name)
    state = states("floating_chain")[0]
    u, t = one.coordinates(state), 1e-5
    slope = one.derivative(0.0, u)
    n = 4 * (3 + ORIENTATIONS[orientation].size)
    ends = []
    for time in (-t, t):
        moved = u + time * slope
        moved[:n] += 0.5 * time**2 * slope[n : 2 * n]
        ends.append(one.state(moved))
    a, alpha = one.accelerations(state)
    for part, wanted in (("p_WB", state.v_WB_W), ("v_WB_W", a), ("w_WB_W", alpha)):
        found = (getattr(ends[1], part) - getattr(ends[0], part)) / (2 * t)
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-6 * max(1.0, np.max(np.abs(wanted))))


# ---------------------------------------------------------------- motions


@functools.cache
def reference(name):
    return simulate(ALL[name], states(name)[0], np.linspace(0.0, 1.0, 5), 1e-13)


def error_of(one, name, method="dop853", tolerance=1e-12):
    """Return the largest error of poses and velocities over one second, and the motion."""
    wanted = reference(name)
    motion = integrate(one, one.coordinates(states(name)[0]), wanted.time, tolerance, method)
    wrong = [np.max(rotation_angle_between(np.array([s.quat_WB for s in motion.states]), wanted.quat_WB))]
    for part in ("p_WB", "v_WB_W", "w_WB_W"):
        wrong.append(np.max(np.abs([getattr(s, part) for s in motion.states] - getattr(wanted, part))))
    return max(wrong), motion


@pytest.mark.parametrize("variant", [name for name, variant in VARIANTS.items() if variant.mass == "symmetrised"])
def test_a_loop_with_dependent_rows_moves_as_in_the_compiled_solver(variant):
    one = DescriptorForm(ALL["four_bar"], variant)
    error, motion = error_of(one, "four_bar")
    assert error < 1e-9
    if variant in PROJECTED:
        assert np.max(np.abs(constraint_residual(ALL["four_bar"], motion.states[-1]))) < 1e-14


@pytest.mark.parametrize(
    ("name", "variant"),
    [
        ("powered", "descriptor_euler_parameters_plain"),
        ("powered", "descriptor_rotation_vector"),
        ("coupled", "descriptor_euler_angles_plain"),
        ("driven", "descriptor_bryant_angles_plain"),
        ("rolling_torus", "descriptor_rodrigues_parameters"),
    ],
)
def test_elements_are_carried_along_over_turns_and_charts(name, variant):
    """Controller integrals, counted angles, contacts and slip survive full turns and changes of chart."""
    assert error_of(DescriptorForm(ALL[name], variant), name)[0] < 1e-9


def spinning():
    """Return a lumpy body on a ball joint, and a state in which it turns at 13 rad/s.

    It spins about the axis of its largest inertia about the joint: stable, so that it completes its turns.
    """
    mechanism = chain("spherical", seed=60)
    rest = states_of(mechanism, 1)[0]
    (body,), M = mechanism.bodies, mechanism.joints[0].M
    arm = skew(body.com - M.p)
    R = ORIENTATIONS["euler_parameters"].rotation(rest.quat_WB[0])
    w = 13.0 * (R @ np.linalg.eigh(body.inertia - body.mass * arm @ arm)[1][:, -1])[None]
    pivot = R @ M.p
    return mechanism, State(rest.p_WB, rest.quat_WB, np.cross(w, -pivot), w)


@pytest.mark.parametrize(
    ("orientation", "method", "tolerance", "bar"),
    [
        ("rodrigues_parameters", "dop853", 1e-12, 1e-9),
        ("rotation_vector", "dop853", 1e-12, 1e-9),
        ("rodrigues_parameters", "radau", 1e-6, 1e-5),
    ],
)
def test_charts_are_exchanged_on_the_way_to_a_singularity(orientation, method, tolerance, bar):
    mechanism, state = spinning()
    times = np.array([0.0, 0.4, 1.0])
    wanted = simulate(mechanism, state, times, 1e-13)
    one = DescriptorForm(mechanism, f"descriptor_{orientation}")
    motion = integrate(one, one.coordinates(state), times, tolerance, method)
    assert one.chart[0] >= 2
    quats = np.array([s.quat_WB for s in motion.states])
    assert np.max(rotation_angle_between(quats, wanted.quat_WB)) < bar
    assert np.max(np.abs([s.w_WB_W for s in motion.states] - wanted.w_WB_W)) < 10 * bar


def test_a_rotation_vector_is_exchanged_without_projection_too():
    """Replacing a rotation vector by its equivalent of less than half a turn changes no state."""
    mechanism, state = spinning()
    one = DescriptorForm(mechanism, "descriptor_rotation_vector")
    u = one.coordinates(state)
    u[3:6] *= 1.2 * np.pi / np.linalg.norm(u[3:6])
    u[9:12] = np.linalg.solve(ORIENTATIONS["rotation_vector"].H(u[3:6]), state.w_WB_W[0])
    before = one.state(u)
    after = one._change_charts(u.copy(), one._packed(u)[0])
    assert np.linalg.norm(after[3:6]) < np.pi
    assert one.chart[0] == 1
    assert rotation_angle_between(one.state(after).quat_WB[0], before.quat_WB[0]) < 1e-14
    np.testing.assert_allclose(one.state(after).w_WB_W, before.w_WB_W, rtol=0, atol=1e-13)


# ---------------------------------------------------------------- singular orientations

SINGULAR = {
    "euler_angles": (rotation_from_euler_zxz([0.3, 0.0, 0.4]), "theta"),
    "bryant_angles": (rotation_from_bryant_xyz([0.3, np.pi / 2, 0.4]), "beta"),
    "rodrigues_parameters": (rotation_from_bryant_xyz([np.pi, 0.0, 0.0]), "|phi|"),
}


@pytest.mark.parametrize("orientation", SINGULAR)
def test_a_singular_orientation_names_body_and_angle(orientation):
    R, angle = SINGULAR[orientation]
    mechanism = chain("free", seed=61)
    state = State(np.zeros((1, 3)), quaternion_from_rotation(R)[None], np.zeros((1, 3)), np.ones((1, 3)))
    one = DescriptorForm(mechanism, f"descriptor_{orientation}")
    with pytest.raises(SingularOrientation) as caught:
        one.coordinates(state)
    assert caught.value.body == "b0"
    assert caught.value.angle == angle


def test_a_motion_into_gimbal_lock_ends_with_the_name_of_the_body():
    """Rotation about the second Bryant axis from zero reaches gimbal lock at beta = pi/2."""
    mechanism = chain("free", seed=61)
    still = np.zeros((1, 3))
    state = State(still, np.array([[1.0, 0.0, 0.0, 0.0]]), still, np.array([[0.0, 1.0, 0.0]]))
    one = DescriptorForm(mechanism, "descriptor_bryant_angles")
    u = one.coordinates(state)
    u[4] = np.pi / 2 - 1e-7
    assert np.all(np.isnan(one.derivative(0.0, u)))
    with pytest.raises(SingularOrientation, match=r"b0: Bryant angles.* beta"):
        one.settle(0.0, u)


# ---------------------------------------------------------------- stabilisation


@pytest.mark.parametrize("name", ["four_bar", "branched", "driven"])
def test_baumgarte_changes_nothing_at_consistent_states(name):
    stabilised, plain = (DescriptorForm(ALL[name], f"descriptor_{kind}") for kind in ("baumgarte", "unprojected"))
    for state in states(name):
        u = plain.coordinates(state)
        wanted = plain.derivative(0.0, u)
        np.testing.assert_allclose(stabilised.derivative(0.0, u), wanted, rtol=0, atol=1e-10 * np.max(np.abs(wanted)))


@pytest.mark.parametrize("name", ["loop_universal", "driven"])
def test_baumgarte_makes_violations_obey_a_damped_oscillator(name):
    """``g'' + 2 alpha g' + beta^2 g = 0`` off the manifold, with g by NumPy along ``x + t x' + t^2/2 x''``."""
    mechanism, rng = ALL[name], np.random.default_rng(5)
    one = DescriptorForm(mechanism, "descriptor_baumgarte")
    u, n_b = one.coordinates(states(name)[0]), len(mechanism.bodies)
    bodies = u[: 14 * n_b].reshape(2, n_b, 7)
    bodies[:, :, :3] += rng.normal(scale=0.02, size=(2, n_b, 3))
    slope, t = one.derivative(0.0, u), 1e-4

    def g(time):
        moved = u + time * slope
        moved[: 7 * n_b] += 0.5 * time**2 * slope[7 * n_b : 14 * n_b]
        return constraint_residual(mechanism, one.state(moved), time)

    first, second = (g(t) - g(-t)) / (2 * t), (g(t) - 2 * g(0.0) + g(-t)) / t**2
    assert np.max(np.abs(g(0.0))) > 1e-3
    size = np.max(np.abs(2 * ALPHA * first + BETA**2 * g(0.0)))
    np.testing.assert_allclose(second, -2 * ALPHA * first - BETA**2 * g(0.0), rtol=0, atol=1e-4 * size)


def violation(mechanism, state, t):
    Q = constraint_jacobian(mechanism, state, t=t)
    rate = Q @ np.hstack([state.v_WB_W, state.w_WB_W]).ravel() - constraint_rates(mechanism, t)
    return np.max(np.abs(constraint_residual(mechanism, state, t))), np.max(np.abs(rate))


def test_drift_is_left_damped_or_removed():
    """Coarse tolerance, 3 s: index 1 drifts, Baumgarte stabilisation limits the drift, projection leaves rounding."""
    mechanism, state = ALL["loop_universal"], states("loop_universal")[0]
    found = {}
    for kind in ("unprojected", "baumgarte", "euler_parameters"):
        one = DescriptorForm(mechanism, f"descriptor_{kind}")
        motion = integrate(one, one.coordinates(state), np.linspace(0.0, 3.0, 4), 1e-6, "rkf45")
        found[kind] = np.max([violation(mechanism, s, 0.0) for s in motion.states[1:]], axis=0)
    assert np.all(found["euler_parameters"] < 1e-13)
    assert np.all(found["baumgarte"] > 1e-10)
    assert np.all(found["unprojected"] > 5 * found["baumgarte"])
