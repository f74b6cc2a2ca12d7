"""Point coordinates: ten-particle bodies by identities; motion against dense NumPy, the solver and a closed form."""

import functools
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import DOP853

import truth
from consilience.case import load_case
from consilience.errors import InvalidInput
from consilience.mechanism import (
    GROUND,
    JOINT_KINDS,
    Frame,
    JointKind,
    Mechanism,
    State,
    determinate_reactions,
    joint_frames,
    joint_spring_motion,
    rotation_angle_between,
    rotation_from_quaternion,
    skew,
)
from consilience.mechanism.conditioning import mass_matrix_condition
from consilience.mechanism.observables import angular_momentum, linear_momentum
from consilience.reference import simulate
from consilience.reference.formulations import particle_chain, particles
from consilience.reference.formulations.point_coordinates import PointCoordinates, unsupported
from mechanisms import ELEMENTS, GRAVITY, LOOPS, TREES, chain, drawn_joint, lumpy_body, rotation, states_of
from oracles import rotating_end_pendulum

EPS = np.finfo(float).eps


def tree_of_the_source(seed):
    """Return a branched tree of the joint kinds in ATTIA, in random order, some of them backwards."""
    rng = np.random.default_rng(seed)
    bodies = {f"b{n}": lumpy_body(f"b{n}", rng) for n in range(5)}
    names = [GROUND, *bodies]
    joints = []
    for n in range(5):
        ends = [names[rng.integers(n + 1)], names[n + 1]]
        i, j = ends[:: rng.choice([-1, 1])]
        kind = str(rng.choice(["revolute", "spherical", "prismatic"]))
        joints.append(drawn_joint(f"j{n}", kind, bodies, i, j, rng.normal(scale=0.5, size=3), rotation(rng)))
    return Mechanism(f"tree_{seed}", GRAVITY, tuple(bodies.values()), tuple(joints))


ALL = TREES | LOOPS | {"powered": ELEMENTS["powered"]} | {f"tree_{n}": tree_of_the_source(n) for n in range(4)}


@functools.cache
def states(name):
    return states_of(ALL[name])


@functools.cache
def formulation(name):
    return PointCoordinates(ALL[name])


def difference(found, wanted):
    """Return the largest difference over the largest expected component."""
    found, wanted = np.hstack(found), np.hstack(wanted)
    return np.max(np.abs(found - wanted)) / np.max(np.abs(wanted))


# ---------------------------------------------------------------- ten particles


@pytest.fixture(params=range(5))
def body_and_primary(request):
    rng = np.random.default_rng(request.param)
    return lumpy_body("b", rng), rng.normal(scale=0.4, size=(4, 3)) + rng.normal(scale=0.5, size=3)


def test_ten_particles_have_the_mass_properties_of_the_body(body_and_primary):
    body, primary = body_and_primary
    m = particles.particle_masses(body, primary)
    xi = particles.ten_particles(primary)
    c = xi - body.com
    inertia = np.einsum("k,kij->ij", m, np.array([-skew(a) @ skew(a) for a in c]))
    size = np.sum(np.abs(m))  # masses of both signs: rounding scales with the sum of their magnitudes
    assert abs(m.sum() - body.mass) < 1e-13 * size
    np.testing.assert_allclose(m @ c, 0.0, rtol=0, atol=1e-13 * size)
    np.testing.assert_allclose(inertia, body.inertia, rtol=0, atol=1e-13 * size)


def test_masses_may_be_negative(body_and_primary):
    """The centre of mass of the body is far from all its particles."""
    body, primary = body_and_primary
    assert np.min(particles.particle_masses(body, primary + 5.0)) < 0


def test_masses_do_not_depend_on_the_body_frame(body_and_primary):
    body, primary = body_and_primary
    p, R = np.array([0.3, -1.2, 0.8]), rotation(np.random.default_rng(9))
    moved = replace(body, com=p + R @ body.com, inertia=R @ body.inertia @ R.T)
    wanted = particles.particle_masses(body, primary)
    found = particles.particle_masses(moved, p + primary @ R.T)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * np.sum(np.abs(wanted)))


def test_primary_mass_matrix_is_that_of_affine_coordinates(body_and_primary):
    """``X^T mu X = [[m, m c], [m c, J]]`` for ``X = [1 | xi]`` by the kinetic energy, without the ten equations."""
    body, primary = body_and_primary
    mu = particles.primary_mass_matrix(particles.particle_masses(body, primary))
    second = 0.5 * np.trace(body.inertia) * np.eye(3) - body.inertia + body.mass * np.outer(body.com, body.com)
    first = body.mass * body.com
    X = np.column_stack([np.ones(4), primary])
    wanted = np.linalg.inv(X.T) @ np.block([[body.mass, first], [first[:, None], second]]) @ np.linalg.inv(X)
    np.testing.assert_allclose(mu, wanted, rtol=0, atol=1e-12 * np.max(np.abs(wanted)))


def test_coplanar_primary_particles_are_refused():
    rng = np.random.default_rng(3)
    body, corners = lumpy_body("plate", rng), rng.normal(size=(3, 3))
    flat = np.vstack([corners, corners[0] + 0.4 * (corners[1] - corners[0]) - 0.7 * (corners[2] - corners[0])])
    with pytest.raises(InvalidInput, match=r"'plate': primary particles: they lie in one plane"):
        particles.particle_masses(body, flat)


def test_particle_3_follows_from_the_others(body_and_primary):
    """In any pose, particle 3 is a constant combination of the others and their normal [ATTIA (10.2), (12)]."""
    _, primary = body_and_primary
    basis = particles.generators(primary)
    constants = particles.combination(basis, primary[2:3])[0]
    normal = np.cross(primary[1] - primary[0], primary[3] - primary[0])
    assert constants[3] == pytest.approx((primary[2] - primary[0]) @ normal / (normal @ normal), rel=1e-12)
    turned = 2.0 + primary @ rotation(np.random.default_rng(1)).T
    np.testing.assert_allclose(constants @ particles.generators(turned), turned[2], rtol=0, atol=1e-13)


# ---------------------------------------------------------------- shared particles, numbers of equations

OWN = {"spherical": 2, "universal": 2, "revolute": 1, "rigid": 0, "prismatic": 3, "cylindrical": 3, "free": 3}


@pytest.mark.parametrize("kind", OWN)
def test_joints_share_the_particles_of_the_source(kind):
    """Spherical joints share one particle, revolute joints two; the rest of particles 1, 2 and 4 are coordinates."""
    assert PointCoordinates(chain("universal", kind, "revolute", seed=1)).model.size == 3 * (2 + OWN[kind] + 1)


@pytest.mark.parametrize("name", ALL)
def test_there_is_an_equation_for_every_coordinate(name):
    """A tree has as many momentum equations as degrees of freedom; with its constraint rows, as many as coordinates."""
    model = formulation(name).model
    tree_rows = len(model.distance) + len(model.rows) - len(model.multiplied)
    assert len(model.equation) + tree_rows == model.size


@pytest.mark.parametrize("name", ALL)
def test_particles_carry_the_momentum_of_the_bodies(name):
    mechanism, f = ALL[name], formulation(name)
    for state in states(name):
        u, n = f.coordinates(state), f.model.size
        momentum = f._momentum_rates(particle_chain.motion(f.model, u[:n], u[n : 2 * n]))[..., n].sum(axis=0)
        wanted = np.concatenate([linear_momentum(mechanism, state), angular_momentum(mechanism, state)])
        np.testing.assert_allclose(momentum, wanted, rtol=0, atol=1e-12 * np.max(np.abs(wanted)))


@pytest.mark.parametrize("name", ALL)
def test_particles_give_back_the_state(name):
    f = formulation(name)
    for state in states(name):
        found = f.state(f.coordinates(state))
        for field in ("p_WB", "v_WB_W", "w_WB_W"):
            wanted = getattr(state, field)
            np.testing.assert_allclose(getattr(found, field), wanted, rtol=0, atol=1e-12 * (1 + np.max(np.abs(wanted))))
        assert np.max(rotation_angle_between(found.quat_WB, state.quat_WB)) < 1e-12


# ---------------------------------------------------------------- accelerations and reactions


@pytest.mark.parametrize("name", ALL)
def test_accelerations_and_reactions_are_those_of_dense_numpy(name):
    mechanism, f, t = ALL[name], formulation(name), 0.7
    for state in states(name):
        a, alpha, force, torque = truth.solve(mechanism, state, t)
        bar = 1e-10 + 10 * EPS * mass_matrix_condition(mechanism, state)
        assert difference(f.accelerations(state, t), (a, alpha)) < bar
        wanted = np.hstack([force, torque])
        error = np.abs(np.hstack(f.reactions(state, t)) - wanted) * determinate_reactions(mechanism, state)
        assert np.max(error) <= 1e-10 * np.max(np.abs(wanted))


@pytest.mark.parametrize("name", ["four_bar", "four_bar_cylindrical"])
def test_reactions_that_dependent_rows_leave_open_still_balance_every_body(name):
    """Newton and Euler about each body's origin, with all joint wrenches, determinate or not."""
    mechanism, f = ALL[name], formulation(name)
    for state in states(name):
        assert not np.all(determinate_reactions(mechanism, state))
        a, alpha = f.accelerations(state)
        rest = -truth.applied_wrenches(mechanism, state)
        R = rotation_from_quaternion(state.quat_WB)
        for n, body in enumerate(mechanism.bodies):
            c, w = R[n] @ body.com, state.w_WB_W[n]
            a_c = a[n] + np.cross(alpha[n], c) + np.cross(w, np.cross(w, c))
            inertia = R[n] @ body.inertia @ R[n].T
            spin = inertia @ alpha[n] + np.cross(w, inertia @ w)
            rest[n] += np.concatenate([body.mass * a_c, spin + np.cross(c, body.mass * a_c)])
        size = np.max(np.abs(rest))
        for joint, force_F, torque_F in zip(mechanism.joints, *f.reactions(state), strict=True):
            frames = joint_frames(mechanism, state, joint)
            force, torque = frames.U @ force_F, frames.U @ torque_F
            for body, sign, arm in ((joint.predecessor, 1, frames.s_i + frames.d), (joint.successor, -1, frames.s_j)):
                if body != GROUND:
                    rest[mechanism.body_index[body]] += sign * np.hstack([force, torque + np.cross(arm, force)])
        assert np.max(np.abs(rest)) < 1e-12 * size


@pytest.mark.parametrize("scale", [1e-3, 1e3])
@pytest.mark.parametrize("name", ["branched", "four_bar", "loop_universal", "loop_rod"])
def test_a_scaled_mechanism_moves_alike(name, scale):
    """Lengths and gravity times L, masses times L^3: same angular accelerations, linear ones times L."""

    def frame(drawn):
        return Frame(scale * drawn.p, drawn.R)

    mechanism, L = ALL[name], scale
    scaled = Mechanism(
        "scaled",
        L * mechanism.gravity,
        tuple(
            replace(b, mass=L**3 * b.mass, com=L * b.com, inertia=L**5 * b.inertia, drawing=frame(b.drawing))
            for b in mechanism.bodies
        ),
        tuple(replace(j, F=frame(j.F), M=frame(j.M), length=L * j.length) for j in mechanism.joints),
    )
    f = PointCoordinates(scaled)
    for s in states(name)[:2]:
        a, alpha = f.accelerations(State(L * s.p_WB, s.quat_WB, L * s.v_WB_W, s.w_WB_W))
        assert difference((a / L, alpha), formulation(name).accelerations(s)) < 1e-12


@pytest.mark.parametrize("rows", [("X", "Y", "Z", "D12"), ("D21",), ("X", "Y"), ("Z", "D31"), ("D13", "D23")])
@pytest.mark.parametrize("backwards", [(), (1,)])
def test_any_choice_of_basic_constraints_is_a_joint(rows, backwards, monkeypatch):
    monkeypatch.setitem(JOINT_KINDS, "chosen", JointKind(rows, ()))
    mechanism = chain("revolute", "chosen", "spherical", seed=30, backwards=backwards)
    f = PointCoordinates(mechanism)
    for state in states_of(mechanism, 2):
        a, alpha, force, torque = truth.solve(mechanism, state)
        assert difference(f.accelerations(state), (a, alpha)) < 1e-10
        assert difference(f.reactions(state), (force, torque)) < 1e-10


def test_bodies_that_cannot_move_have_no_coordinates():
    mechanism = chain("rigid", "rigid", seed=73)
    f, state = PointCoordinates(mechanism), states_of(mechanism, 1)[0]
    u = f.coordinates(state)
    assert u.size == f.derivative(0.0, u).size == f.settle(0.0, u).size == 0
    np.testing.assert_array_equal(f.accelerations(state), np.zeros((2, 2, 3)))
    assert difference(f.reactions(state), truth.solve(mechanism, state)[2:]) < 1e-12


# ---------------------------------------------------------------- projection


@pytest.mark.parametrize("name", ["four_bar", "floating_chain", "loop_rod", "loop_universal"])
def test_settling_brings_constraints_back(name):
    f, n = formulation(name), formulation(name).model.size
    for state in states(name):
        u = f.coordinates(state)
        np.testing.assert_allclose(f.settle(0.0, u), u, rtol=0, atol=1e-12 * (1 + np.max(np.abs(u))))
        disturbed = u + 1e-4 * np.random.default_rng(5).normal(size=u.size)
        settled = f.settle(0.0, disturbed)
        assert np.max(np.abs(settled - disturbed)) < 1e-2
        rows = particle_chain.constraint_rows(f.model, particle_chain.motion(f.model, settled[:n], settled[n : 2 * n]))
        assert np.max(np.abs(rows.value)) < 1e-14
        assert np.max(np.abs(rows.D[:, n])) < 1e-13
        # the mechanism, too, is assembled: dense NumPy gives the same accelerations
        assert difference(f.accelerations(f.state(settled)), truth.solve(ALL[name], f.state(settled))[:2]) < 1e-9


# ---------------------------------------------------------------- motion


def motion_of(mechanism, state, duration, tolerance=1e-11):
    """Return the final state by DOP853 with projection after every step, and the counted angles of joint springs."""
    f = PointCoordinates(mechanism)
    solver = DOP853(f.derivative, 0.0, f.coordinates(state), duration, rtol=tolerance, atol=tolerance)
    while solver.status == "running":
        assert solver.step() is None
        solver.y = f.settle(solver.t, solver.y)
        solver.f = f.derivative(solver.t, solver.y)
    return f.state(solver.y), solver.y[2 * f.model.size :]


def assert_moves_like_the_solver(mechanism, state, duration=2.0):
    found, angles = motion_of(mechanism, state, duration)
    wanted = simulate(mechanism, state, np.array([0.0, duration]), tolerance=1e-12)
    for field in ("p_WB", "v_WB_W", "w_WB_W"):
        target = getattr(wanted, field)[-1]
        atol = 1e-9 * max(1.0, np.max(np.abs(target)))
        np.testing.assert_allclose(getattr(found, field), target, rtol=0, atol=atol)
    assert np.max(rotation_angle_between(found.quat_WB, wanted.quat_WB[-1])) < 1e-9
    return angles


@pytest.mark.parametrize("name", [pytest.param("powered", marks=pytest.mark.slow), "branched", "four_bar"])
def test_trajectories_are_those_of_the_solver(name):
    assert_moves_like_the_solver(ALL[name], states(name)[0])


def test_joint_springs_count_full_turns():
    mechanism = chain("revolute", seed=31, forces=True)
    s = states_of(mechanism, 1)[0]
    turning = 15.0 / np.linalg.norm(s.w_WB_W)
    fast = State(s.p_WB, s.quat_WB, turning * s.v_WB_W, turning * s.w_WB_W)
    f = PointCoordinates(mechanism)
    rate = joint_spring_motion(mechanism, fast, "j0", "angle")[1]
    assert f.derivative(0.0, f.coordinates(fast))[-1] == pytest.approx(rate, rel=1e-12)
    (angle,) = assert_moves_like_the_solver(mechanism, fast, duration=0.7)
    assert abs(angle) > 2 * np.pi


def test_the_pendulum_with_a_rotating_end_is_that_of_the_source():
    """Six particles: one fixed, two eliminated; the motion in closed form by elliptic functions."""
    case = load_case("rotating_end_pendulum")
    f = PointCoordinates(case.mechanism)
    assert f.model.shared.tolist() == [1, 2]
    assert f.model.size == 3 * (6 - 1 - 2)
    found, _ = motion_of(case.mechanism, case.initial_state, 2.0)
    p, R = rotating_end_pendulum.trajectory(case, [2.0])
    np.testing.assert_allclose(found.p_WB, p[0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(rotation_from_quaternion(found.quat_WB), R[0], rtol=0, atol=1e-9)


# ---------------------------------------------------------------- refusals


REFUSED = {
    "single_screw": ("joint 'j0': kind screw", "not all products of vectors between particles"),
    "driven": ("drives", "no place"),
    "coupled": ("couplings", "no place"),
    "rolling_disc": ("rollings", "no place"),
    "skating": ("skates", "no place"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_has_no_equation_is_refused_with_the_reason(name):
    feature, reason = REFUSED[name]
    assert (feature, True) in [(r.feature, reason in r.reason) for r in unsupported(ELEMENTS[name])]
    with pytest.raises(InvalidInput, match=r"Choose another formulation"):
        PointCoordinates(ELEMENTS[name])


@pytest.mark.parametrize("name", ALL)
def test_everything_else_is_supported(name):
    assert unsupported(ALL[name]) == ()
