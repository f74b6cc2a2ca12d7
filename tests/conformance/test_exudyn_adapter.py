"""Conventions and pitfalls of the Exudyn adapter: one test for each row of its README."""

from itertools import pairwise

import numpy as np
import pytest

from consilience.case import load_case
from consilience.engine import Profile, Question, Route
from consilience.mechanism import (
    GROUND,
    Body,
    Frame,
    Initial,
    Joint,
    JointSpring,
    Load,
    Mechanism,
    State,
    constraint_gamma,
    constraint_jacobian,
    initial_state,
    kinetic_energy,
    potential_energy,
    rotation_from_quaternion,
)
from linkages import platform
from mechanisms import GRAVITY, LOOPS, TREES, chain, drawn_joint, lumpy_body, rotation, states_of

pytest.importorskip("exudyn")

from consilience_exudyn import ExudynEngine
from consilience_exudyn.kinematic_tree import is_one_axis_tree
from consilience_exudyn.library import POINTWISE, QUIET, SETTINGS, exu, simulation_settings
from consilience_exudyn.maximal import build, full_axes, inertia_about_origin, inertia_vector
from consilience_exudyn.redundancy import independent_axes, left_out
from consilience_exudyn.terms import Terms, velocity_map
from consilience_exudyn.trajectory import Integration, maximal_answer, refuse_lost_rank

OUTPUT = exu.OutputVariableType
ALL = TREES | LOOPS


@pytest.fixture
def exudyn_engine():
    return ExudynEngine()


def body_output(terms, body, name, local=(0.0, 0.0, 0.0)):
    return np.array(
        terms.model.system.GetObjectOutputBody(terms.model.bodies[body], getattr(OUTPUT, name), list(local))
    )


def test_pose_and_velocity_arrive():
    mechanism = TREES["branched"]
    state = states_of(mechanism)[2]
    terms = Terms(build(mechanism, state))
    terms.mass_matrix(state)
    for b in range(len(mechanism.bodies)):
        R = rotation_from_quaternion(state.quat_WB[b])
        np.testing.assert_allclose(body_output(terms, b, "Position"), state.p_WB[b], atol=1e-14)
        np.testing.assert_allclose(body_output(terms, b, "RotationMatrix").reshape(3, 3), R, atol=1e-14)
        np.testing.assert_allclose(body_output(terms, b, "Velocity"), state.v_WB_W[b], atol=1e-13)
        np.testing.assert_allclose(body_output(terms, b, "AngularVelocity"), state.w_WB_W[b], atol=1e-13)


@pytest.mark.parametrize("name", ["branched", "loop_rod"])
def test_exudyn_outputs_the_solved_accelerations(exudyn_engine, name):
    mechanism = ALL[name]
    state = states_of(mechanism)[1]
    method = exudyn_engine.methods(mechanism, Question.INSTANT)[0]
    answer = exudyn_engine.instant(mechanism, [state], method)
    terms = Terms(build(mechanism, state))
    terms.mass_matrix(state)
    a = np.hstack([answer.a_WB_W[0], answer.alpha_WB_W[0]])
    terms.model.system.systemData.SetODE2Coordinates_tt(velocity_map(state) @ a.ravel())
    for b in range(len(mechanism.bodies)):
        found = np.concatenate([body_output(terms, b, "Acceleration"), body_output(terms, b, "AngularAcceleration")])
        np.testing.assert_allclose(found, a[b], atol=1e-12 * np.max(np.abs(a)))


def test_inertia_is_about_the_origin_in_exudyns_order():
    body = lumpy_body("b", np.random.default_rng(1))
    I = inertia_about_origin(body)
    w = np.array([0.3, -1.1, 0.7])
    joint = Joint("j", "free", GROUND, "b", Frame(np.zeros(3), np.eye(3)), Frame(np.zeros(3), np.eye(3)))
    mechanism = Mechanism("m", np.zeros(3), (body,), (joint,))
    state = State(np.zeros((1, 3)), np.array([[1.0, 0, 0, 0]]), np.zeros((1, 3)), w[None])
    terms = Terms(build(mechanism, state))
    np.testing.assert_allclose(terms.mass_matrix(state)[3:, 3:], I, rtol=1e-13)
    assert body_output(terms, 0, "KineticEnergy") == pytest.approx(0.5 * w @ I @ w, rel=1e-14)
    distinct = np.array([[1.0, 6, 5], [6, 2, 4], [5, 4, 3]])
    assert inertia_vector(distinct) == [1, 2, 3, 4, 5, 6]


@pytest.mark.parametrize("name", ALL)
def test_joints_hold_the_same_motions(name):
    """Exudyn's and the package's constraint Jacobians have equal row spaces; the convective terms are equal."""
    mechanism = ALL[name]
    state = states_of(mechanism)[3]
    found = Terms(build(mechanism, state)).equations(state)
    Q, gamma = constraint_jacobian(mechanism, state), constraint_gamma(mechanism, state)
    rank = np.linalg.matrix_rank(Q, 1e-8) if len(Q) else 0
    assert (np.linalg.matrix_rank(found.J, 1e-8) if len(found.J) else 0) == rank
    if rank:
        assert np.linalg.matrix_rank(np.vstack([Q, found.J]), 1e-8) == rank
        a = np.linalg.lstsq(Q, gamma, rcond=1e-8)[0]
        np.testing.assert_allclose(found.J @ a, found.gamma, atol=1e-11 * max(1.0, np.max(np.abs(gamma))))


@pytest.mark.parametrize("kind", ["rigid", "revolute", "prismatic"])
@pytest.mark.parametrize("ground_first", [True, False])
def test_a_hanging_body_is_held_up(exudyn_engine, kind, ground_first):
    """A body at rest, its centre of mass off the joint: the reaction on the successor carries the weight."""
    com = np.array([0.2, 0.0, 0.0])
    body = Body("b", 2.0, com, np.diag([0.3, 0.4, 0.5]), Frame(np.zeros(3), np.eye(3)))
    here = Frame(np.zeros(3), np.eye(3))
    ends = (GROUND, "b") if ground_first else ("b", GROUND)
    g = np.array([0.0, -10.0, 0.0])
    # the spring's 1.5 N along the free axis is no reaction, but its moment about the centre of mass is one
    springs = (JointSpring("k", "j", "distance", 5.0, 0.0, 0.3),) if kind == "prismatic" else ()
    mechanism = Mechanism("m", g, (body,), (Joint("j", kind, *ends, here, here),), joint_springs=springs)
    state = initial_state(mechanism)
    method = exudyn_engine.methods(mechanism, Question.INSTANT)[0]
    answer = exudyn_engine.instant(mechanism, [state], method)
    sign = 1.0 if ground_first else -1.0
    I_z = 0.5 + 2.0 * 0.2**2
    falling = -2.0 * 10.0 * 0.2 / I_z * 0.2 if kind == "revolute" else 0.0
    tilting = -0.2 * 5.0 * 0.3 if kind == "prismatic" else 0.0
    moment = 0.0 if kind == "revolute" else 2.0 * 10.0 * 0.2
    np.testing.assert_allclose(answer.force_F[0, 0], [0, sign * 2.0 * (10.0 + falling), 0], atol=1e-12)
    np.testing.assert_allclose(answer.torque_F[0, 0], [0, tilting, sign * moment], atol=1e-12)


def test_native_torque_output_is_not_the_documented_torque(exudyn_engine):
    """The documentation says torque in the frame of marker 0. If this fails, Exudyn has changed: update the README."""
    mechanism = TREES["single_revolute"]
    state = states_of(mechanism)[0]
    answer = exudyn_engine.instant(mechanism, [state], exudyn_engine.methods(mechanism, Question.INSTANT)[0])
    model = exudyn_engine._terms[1].model
    native = np.array(model.system.GetObjectOutput(model.joints[0][0], OUTPUT.TorqueLocal))
    assert np.max(np.abs(np.abs(native) - np.abs(answer.torque_F[0, 0]))) > 1e-3 * np.max(np.abs(native))
    force = np.array(model.system.GetObjectOutput(model.joints[0][0], OUTPUT.ForceLocal))
    np.testing.assert_allclose(-force, answer.force_F[0, 0], rtol=1e-10, atol=1e-12)


def test_potential_energy_is_zero_at_the_world_origin(exudyn_engine):
    """Potential energy: gravity relative to the world's origin, plus springs; constant forces do not count."""
    base = TREES["forced_chain"]
    state = states_of(base)[1]
    pushed = Load("more", "force", "b3", np.array([3.0, 4.0, 5.0]), "world", np.array([0.1, 0.2, 0.3]))
    energies = []
    for loads in (base.loads, (), (*base.loads, pushed)):
        mechanism = Mechanism("m", GRAVITY, base.bodies, base.joints, base.springs, base.joint_springs, loads)
        method = exudyn_engine.methods(mechanism, Question.INSTANT)[0]
        energies.append(exudyn_engine.instant(mechanism, [state], method).potential[0])
    np.testing.assert_allclose(energies, potential_energy(base, state), rtol=1e-13)


def turning(seed=4):
    mechanism = chain("revolute", "revolute", "prismatic", seed=seed, backwards=(1,), forces=True)
    angles = {"j0": {"angle": 2.5}, "j1": {"angle": -3.0}}
    rates = {"j0": {"angle": 9.0}, "j1": {"angle": -8.0}}
    return mechanism, initial_state(mechanism, Initial(coordinates=angles, rates=rates))


def limit(engine, mechanism, state, times, method):
    """Richardson limit of the positions from the two finest levels, and the observed order."""
    step = times[1] - times[0]
    runs = [engine.trajectory(mechanism, state, times, method, step / n) for n in method.substeps]
    coarse, fine = (np.max(np.abs(b.p_WB - a.p_WB)) for a, b in pairwise(runs))
    factor = 2**method.order
    return (factor * runs[-1].p_WB - runs[-2].p_WB) / (factor - 1), np.log2(coarse / fine), runs[-1]


def test_joint_springs_count_full_turns(exudyn_engine):
    """Kinematic trees have unbounded angles: torsional springs on rigid bodies must agree beyond half a turn."""
    mechanism, state = turning()
    times = np.linspace(0.0, 1.0, 21)
    methods = exudyn_engine.methods(mechanism, Question.TRAJECTORY)
    limits = [limit(exudyn_engine, mechanism, state, times, method)[0] for method in methods]
    np.testing.assert_allclose(limits[0], limits[2], atol=1e-7)
    np.testing.assert_allclose(limits[1], limits[2], atol=1e-6)


def test_instants_do_not_remember_turns(exudyn_engine):
    """Another state, with the angle beyond half a turn, asked in between does not change the answer."""
    mechanism, state = turning()
    beyond = initial_state(mechanism, Initial(coordinates={"j0": {"angle": -2.5}, "j1": {"angle": 3.0}}))
    method = exudyn_engine.methods(mechanism, Question.INSTANT)[0]
    answer = exudyn_engine.instant(mechanism, [state, beyond, state], method)
    np.testing.assert_array_equal(answer.a_WB_W[0], answer.a_WB_W[2])
    for n, s in enumerate((state, beyond)):
        assert answer.potential[n] == pytest.approx(potential_energy(mechanism, s), rel=1e-12)


@pytest.mark.parametrize(
    "kinds", [("revolute", "prismatic", "revolute"), ("universal", "cylindrical"), ("planar", "revolute")]
)
def test_kinematic_tree_moves_as_the_rigid_bodies(exudyn_engine, kinds):
    mechanism = chain(*kinds, seed=31, backwards=(1,), forces=True)
    state = states_of(mechanism)[0]
    times = np.linspace(0.0, 0.4, 9)
    implicit, _, tree, _ = exudyn_engine.methods(mechanism, Question.TRAJECTORY)
    expected, _, last = limit(exudyn_engine, mechanism, state, times, implicit)
    found, order, answer = limit(exudyn_engine, mechanism, state, times, tree)
    assert tree.route is Route.NATIVE
    assert order == pytest.approx(4.0, abs=0.3)
    np.testing.assert_allclose(found, expected, atol=3e-8)
    fine = 20 * np.max(np.abs(last.p_WB - expected))
    np.testing.assert_allclose(np.abs(np.sum(answer.quat_WB * last.quat_WB, axis=2)), 1.0, atol=fine)
    np.testing.assert_allclose(answer.w_WB_W, last.w_WB_W, atol=100 * fine)
    np.testing.assert_allclose(answer.v_WB_W, last.v_WB_W, atol=100 * fine)


def test_only_trees_of_one_axis_joints_become_kinematic_trees():
    assert is_one_axis_tree(TREES["backward_universal"])
    assert not is_one_axis_tree(TREES["long_chain"])
    assert not is_one_axis_tree(LOOPS["four_bar"])


def bricard():
    """Bricard's mechanism, six revolutes along the edges of a cube: over-constrained, one degree of freedom."""
    corners = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 1, 1), (0, 1, 1), (0, 0, 1)], float)
    rng = np.random.default_rng(0)
    bodies = {f"b{n}": lumpy_body(f"b{n}", rng) for n in range(5)}
    names = [GROUND, *bodies, GROUND]
    joints = []
    for n in range(6):
        x = corners[(n + 1) % 6] - corners[n]
        z = np.cross(corners[n] - corners[n - 1], x)
        axes = np.column_stack([x, np.cross(z, x), z])
        joints.append(drawn_joint(f"j{n}", "revolute", bodies, names[n], names[n + 1], corners[n], axes))
    return Mechanism("bricard", GRAVITY, tuple(bodies.values()), tuple(joints))


@pytest.mark.parametrize(
    ("mechanism", "count"),
    [
        (bricard(), 1),
        *((LOOPS[n], c) for n, c in (("four_bar", 3), ("slider_crank", 3), ("loop_rod", 0))),
        (platform(0.8), 7),  # six hinges of four bodies that move in the drawing alone: 30 rows of rank 23 there
    ],
    ids=lambda value: getattr(value, "name", str(value)),
)
def test_dependent_rows_are_left_out_and_named(exudyn_engine, mechanism, count):
    held = independent_axes(mechanism)
    assert sum(map(sum, full_axes(mechanism))) - sum(map(sum, held)) == count
    for method in exudyn_engine.methods(mechanism, Question.TRAJECTORY):
        assert method.settings.get("constraint equations left out", {}) == left_out(mechanism, held)
    state = initial_state(mechanism)
    J = Terms(build(mechanism, state, held)).constraint_jacobian(state)
    assert np.linalg.matrix_rank(J, 1e-6) == sum(map(sum, held))


def test_the_over_constrained_mechanism_does_not_lock(exudyn_engine):
    """With all rows TrapezoidalIndex2 locks or stops; with independent rows the energy error is of second order."""
    mechanism = bricard()
    state = initial_state(mechanism, Initial(rates={"j0": {"angle": 1.0}}))
    times = np.linspace(0.0, 1.0, 11)
    for method in exudyn_engine.methods(mechanism, Question.TRAJECTORY):
        a = exudyn_engine.trajectory(mechanism, state, times, method, 0.001)
        states = [State(a.p_WB[n], a.quat_WB[n], a.v_WB_W[n], a.w_WB_W[n]) for n in range(len(times))]
        energy = [kinetic_energy(mechanism, s) + potential_energy(mechanism, s) for s in states]
        assert np.ptp(energy) < 1e-4
        assert np.max(np.abs(a.w_WB_W[-1])) > 0.01


def test_rows_that_weaken_along_a_motion_are_replaced(exudyn_engine):
    """The rows kept at the start are dependent later in the motion of the 6R loop; its energy stays all the same."""
    mechanism = bricard()
    state = initial_state(mechanism, Initial(rates={"j0": {"angle": 2.0}}))
    times = np.linspace(0.0, 3.0, 61)
    method = exudyn_engine.methods(mechanism, Question.TRAJECTORY)[0]
    errors = []
    for step in (0.005, 0.0025):
        a = exudyn_engine.trajectory(mechanism, state, times, method, step)
        states = [State(a.p_WB[n], a.quat_WB[n], a.v_WB_W[n], a.w_WB_W[n]) for n in range(len(times))]
        errors.append(np.ptp([kinetic_energy(mechanism, s) + potential_energy(mechanism, s) for s in states]))
        (chosen,) = (name for name in a.counters if "left out" in name)
        assert chosen.removeprefix("'j3': left out ") not in left_out(mechanism, independent_axes(mechanism))["j3"]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.3)


def test_exudyn_stops_at_dependent_rows_and_the_failure_says_where():
    mechanism = LOOPS["four_bar"]
    state = states_of(mechanism)[0]
    times = np.linspace(0.0, 0.2, 5)
    with pytest.raises(RuntimeError, match="TrapezoidalIndex2"):
        maximal_answer(
            build(mechanism, state), full_axes(mechanism), Integration("TrapezoidalIndex2", SETTINGS), times, 0.01
        )


def test_lost_rank_on_the_way_is_a_failure(exudyn_engine):
    """As many axes as the independent ones, but dependent: axes out of the plane instead of axes in it."""
    mechanism = LOOPS["four_bar"]
    state = states_of(mechanism)[0]
    times = np.linspace(0.0, 0.1, 3)
    method = exudyn_engine.methods(mechanism, Question.TRAJECTORY)[0]
    answer = exudyn_engine.trajectory(mechanism, state, times, method, 0.001)
    held = independent_axes(mechanism)
    refuse_lost_rank(build(mechanism, state, held), held, answer)
    wrong = tuple(a if a == f else (0, 0, 1, 1, 0, 0) for a, f in zip(held, full_axes(mechanism), strict=True))
    with pytest.raises(RuntimeError, match="dependent"):
        refuse_lost_rank(build(mechanism, state, wrong), wrong, answer)


def flat(settings, prefix=""):
    found = {}
    for key, value in settings.items():
        found |= flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {prefix + key: str(value)}
    return found


@pytest.mark.parametrize("settings", [QUIET, SETTINGS, POINTWISE])
def test_settings_name_every_knob(settings):
    default = flat(exu.SimulationSettings().GetDictionary())
    ours = flat(simulation_settings(settings).GetDictionary())
    changed = {key: value for key, value in ours.items() if default[key] != value}
    assert changed == {key: str(value) for key, value in settings.items()}


def test_nothing_is_written_or_printed(exudyn_engine, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    mechanism, state = turning()
    for method in exudyn_engine.methods(mechanism, Question.TRAJECTORY):
        exudyn_engine.trajectory(mechanism, state, np.linspace(0.0, 0.1, 3), method, 0.01)
    exudyn_engine.instant(mechanism, [state], exudyn_engine.methods(mechanism, Question.INSTANT)[0])
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr() == ("", "")


def test_long_grids_are_sampled_on_time(exudyn_engine):
    """Accumulated rounding of steps must not skip or repeat a sample."""
    body = Body("b", 1.0, np.array([0.1, 0.2, 0.3]), np.diag([0.3, 0.4, 0.5]), Frame(np.zeros(3), np.eye(3)))
    rng = np.random.default_rng(2)
    axis = Frame(np.array([0.1, 0, 0]), rotation(rng))
    mechanism = Mechanism("m", GRAVITY, (body,), (Joint("j", "revolute", GROUND, "b", axis, axis),))
    state = initial_state(mechanism)
    for interval, count in ((0.05, 200), (0.01, 700), (1 / 30, 300), (0.07, 150)):
        times = interval * np.arange(count + 1)
        for method in exudyn_engine.methods(mechanism, Question.TRAJECTORY):
            answer = exudyn_engine.trajectory(mechanism, state, times, method, interval / 7)
            assert len(answer.p_WB) == count + 1


def test_large_models_are_solved_by_the_sparse_solver_to_the_same_motion(exudyn_engine):
    """From seven bodies on the matched methods use the sparse solver; Exudyn's defaults are kept."""
    mechanism = chain("revolute", "spherical", "revolute", "universal", "revolute", "cylindrical", "revolute", seed=5)
    start, times, held = states_of(mechanism)[0], np.linspace(0.0, 0.2, 5), full_axes(mechanism)
    methods = {m.name: m for m in exudyn_engine.methods(mechanism, Question.TRAJECTORY)}
    for name in ("TrapezoidalIndex2", "GeneralizedAlpha"):
        assert methods[name].settings["linearSolver.solverType"] == "EigenSparse"
        sparse = exudyn_engine.trajectory(mechanism, start, times, methods[name], 0.005)
        dense = maximal_answer(build(mechanism, start, held), held, Integration(name, SETTINGS), times, 0.005)
        assert np.max(np.abs(sparse.p_WB - dense.p_WB)) < 1e-12
        assert np.max(np.abs(sparse.v_WB_W - dense.v_WB_W)) < 1e-10
    assert "linearSolver.solverType" not in methods["GeneralizedAlpha, defaults"].settings


def test_shortened_steps_that_miss_samples_are_said_to_be_so(exudyn_engine):
    """By default Exudyn halves a step whose Newton iteration fails; all later samples are then half a step late."""
    case = load_case("mass_ratio")
    methods = exudyn_engine.methods(case.mechanism, Question.TRAJECTORY)
    (defaults,) = (method for method in methods if method.profile is Profile.DEFAULT)
    coarse = (case.times[1] - case.times[0]) / 5
    with pytest.raises(RuntimeError, match=r"\d+ of 101 samples miss their times, .* shorter steps"):
        exudyn_engine.trajectory(case.mechanism, case.initial_state, case.times, defaults, coarse)
