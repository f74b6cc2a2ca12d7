"""Elements in Exudyn: trees and loops, lumpy bodies, skew frames, compared with `truth` and the reference."""

from dataclasses import replace

import numpy as np
import pytest

import truth
from consilience.engine import Profile, Question
from consilience.mechanism import (
    GROUND,
    Control,
    Coupling,
    Drive,
    Frame,
    Friction,
    Function,
    Initial,
    Joint,
    JointSpring,
    Load,
    Mechanism,
    Rolling,
    Skate,
    Spring,
    State,
    constant,
    determinate_reactions,
    free_directions,
    initial_state,
    kinetic_energy,
    linear,
    potential_energy,
    rotation_angle_between,
    sine,
    through,
)
from consilience.mechanism.conditioning import mass_matrix_condition
from consilience.reference import simulate
from mechanisms import (
    ELEMENTS,
    GRAVITY,
    chain,
    drawn_joint,
    four_bar,
    hardening,
    lumpy_body,
    rotation,
    slider_crank,
    spatial_loop,
    states_of,
)

pytest.importorskip("exudyn")

from consilience_exudyn import ExudynEngine
from consilience_exudyn.kinematic_tree import is_one_axis_tree
from consilience_exudyn.library import SETTINGS, exu, items, simulation_settings
from consilience_exudyn.maximal import build, full_axes
from consilience_exudyn.redundancy import equations, independent_axes, left_out
from consilience_exudyn.terms import Terms

CURVE = through(np.linspace(-7.0, 7.0, 15), 0.3 * np.sin(np.linspace(-2.0, 3.0, 15) ** 2))


def powered_tree() -> Mechanism:
    """A tree of one-axis joints, one of them passed backwards, with every force law on every joint."""
    base = chain("revolute", "prismatic", "revolute", "cylindrical", seed=71, backwards=(1, 2), forces=True)
    return replace(
        base,
        name="powered_tree",
        springs=tuple(replace(s, actuator=sine(3.0, 9.0, 0.4)) for s in base.springs),
        joint_springs=tuple(replace(s, actuator=CURVE) for s in base.joint_springs),
        loads=tuple(replace(load, history=Function(np.array([0.5, -2.0, 3.0]))) for load in base.loads),
        frictions=(Friction("f1", "j1", "distance", 0.5, 2.0, 0.4), Friction("f2", "j2", "angle", 0.3, 1.1, 0.5)),
        controls=(
            Control("c1", "j1", "distance", sine(0.5, 6.0), 20.0, 90.0, 1.5),
            Control("c2", "j2", "angle", sine(0.4, 5.0, 1.0), 12.0, 70.0, 0.8),
            Control("c3", "j3", "distance", constant(0.2), 30.0, 0.0, 2.0),
        ),
    )


def powered_loop() -> Mechanism:
    base = spatial_loop(seed=72)
    rng = np.random.default_rng(72)
    return replace(
        base,
        name="powered_loop",
        springs=(Spring("s", "a", "c", rng.normal(size=3), rng.normal(size=3), 9.0, 0.4, 0.5, sine(4.0, 8.0, 0.3)),),
        joint_springs=(JointSpring("k", "j3", "angle", 5.0, 0.2, 0.3, CURVE),),
        loads=(
            Load("push", "force", "b", rng.normal(size=3), "body", rng.normal(size=3), sine(5.0, 7.0, 0.2)),
            Load("turn", "torque", "c", rng.normal(size=3), "world", history=Function(np.array([1.0, 4.0]))),
        ),
        frictions=(Friction("f", "j0", "angle", 0.2, 2.0, 0.6),),
        controls=(Control("c", "j3", "angle", sine(0.5, 5.0, 0.6), 15.0, 80.0, 1.0),),
    )


def driven_loop() -> Mechanism:
    motion = Function(np.array([0.1, 2.0]), np.array([[0.2, 6.0, 1.2]]))
    return replace(slider_crank(seed=73), name="driven_loop", drives=(Drive("turn", "a", "angle", motion),))


def coupled_loop() -> Mechanism:
    law = Function(np.array([0.0, -0.4, 0.3]), np.array([[0.1, 2.0, 0.0]]))
    coupling = Coupling("cam", "j0", "angle", "j3", "angle", law)
    return replace(spatial_loop(seed=74, coupler="point_on_line"), name="coupled_loop", couplings=(coupling,))


def screw_loop() -> Mechanism:
    base = spatial_loop(seed=75, coupler="screw")
    *rest, last = base.joints
    return replace(base, name="screw_loop", joints=(*rest, replace(last, kind="universal")))


def screw_jack() -> Mechanism:
    """A revolute spindle, a nut that slides on the same axis, and a screw joint between them, which closes the loop."""
    rng = np.random.default_rng(76)
    bodies = {name: lumpy_body(name, rng) for name in ("spindle", "nut")}
    at, axes = rng.normal(size=3), rotation(rng)
    ends = [("turn", "revolute", GROUND, "spindle"), ("slide", "prismatic", GROUND, "nut")]
    ends.append(("thread", "screw", "spindle", "nut"))
    joints = [drawn_joint(name, kind, bodies, i, j, at, axes) for name, kind, i, j in ends]
    return Mechanism("screw_jack", GRAVITY, tuple(bodies.values()), tuple(joints))


def wheelset() -> Mechanism:
    """Two wheels on one axle roll on a skew plane: both forbid slip along the axle, so that one row is redundant."""
    rng = np.random.default_rng(77)
    bodies = {name: lumpy_body(name, rng) for name in ("axle", "left", "right")}
    R = rotation(rng)
    middle = rng.normal(size=3)
    names = {"left": middle - 0.5 * R[:, 2], "right": middle + 0.6 * R[:, 2]}
    joints = [drawn_joint("float", "free", bodies, GROUND, "axle", middle, R)]
    joints += [drawn_joint(f"hub_{n}", "revolute", bodies, "axle", n, p, R) for n, p in names.items()]
    drawings = {n: bodies[n].drawing for n in names}
    rollings = tuple(
        Rolling(
            f"{n}_rolls", n, drawings[n].R.T @ (p - drawings[n].p), drawings[n].R.T @ R[:, 2],
            0.4, middle - 0.4 * R[:, 0], R[:, 0],
        )
        for n, p in names.items()
    )  # fmt: skip
    return Mechanism("wheelset", GRAVITY, tuple(bodies.values()), tuple(joints), rollings=rollings)


def skating_loop() -> Mechanism:
    base = four_bar(seed=78, closing="spherical")
    first, second, *rest = base.joints
    lateral = np.array([0.4, 0.9, 0.2])
    skate = Skate("edge", "coupler", np.array([0.2, -0.1, 0.3]), lateral)
    joints = (replace(first, kind="universal"), replace(second, kind="spherical"), *rest)
    return replace(base, name="skating_loop", joints=joints, skates=(skate,))


OWN = {
    m.name: m
    for m in (
        powered_tree(), powered_loop(), driven_loop(), coupled_loop(), screw_loop(), screw_jack(), wheelset(),
        skating_loop(),
    )
}  # fmt: skip
ALL = ELEMENTS | OWN | {"hardening": hardening()}


@pytest.fixture
def exudyn_engine():
    return ExudynEngine()


def relative(a, b):
    return np.max(np.abs(a - b)) / np.max(np.abs(b))


@pytest.mark.parametrize("name", ALL)
def test_instants_are_right_to_rounding(exudyn_engine, name):
    mechanism = ALL[name]
    assert exudyn_engine.unsupported(mechanism, Question.INSTANT) == ()
    states = states_of(mechanism)
    for method in exudyn_engine.methods(mechanism, Question.INSTANT):
        answer = exudyn_engine.instant(mechanism, states, method)
        for n, state in enumerate(states):
            a, alpha, force, torque = truth.solve(mechanism, state)
            found = np.hstack([answer.a_WB_W[n], answer.alpha_WB_W[n]])
            bar = 1e-12 + 1e-15 * mass_matrix_condition(mechanism, state)
            assert relative(found, np.hstack([a, alpha])) < bar, method.name
            assert answer.kinetic[n] == pytest.approx(kinetic_energy(mechanism, state), rel=1e-12)
            assert answer.potential[n] == pytest.approx(potential_energy(mechanism, state), rel=1e-12, abs=1e-12)
            known = determinate_reactions(mechanism, state)
            if answer.force_F is not None and np.max(np.abs(np.hstack([force, torque])[known])) > 1e-6:
                found = np.hstack([answer.force_F[n], answer.torque_F[n]])
                assert relative(found[known], np.hstack([force, torque])[known]) < 1e-11, method.name


def turning() -> Mechanism:
    """Angles of several turns, read by a cam that is not periodic, a spring, friction and a controller."""
    base = chain("revolute", "revolute", "prismatic", seed=79, backwards=(1,))
    law = through(np.linspace(-4.0, 20.0, 13), 0.2 * np.sin(0.3 * np.linspace(-4.0, 20.0, 13)))
    return replace(
        base,
        name="turning",
        drives=(Drive("spin", "j0", "angle", Function(np.array([0.3, 14.0, 5.0]))),),
        couplings=(Coupling("cam", "j0", "angle", "j2", "distance", law),),
        joint_springs=(JointSpring("k", "j1", "angle", 2.0, 0.1, 0.4),),
        frictions=(Friction("f", "j1", "angle", 0.1, 0.5, 0.7),),
        controls=(Control("c", "j1", "angle", linear(-12.0), 60.0, 50.0, 4.0),),
    )


def turned_screw() -> Mechanism:
    base = chain("screw", "revolute", seed=80)
    return replace(
        base,
        name="turned_screw",
        joint_springs=(JointSpring("k", "j0", "angle", 0.3, 0.02, 0.1),),
        controls=(Control("c", "j0", "angle", constant(15.0), 2.0, 8.0, 0.1),),
        couplings=(Coupling("gear", "j0", "angle", "j1", "angle", Function(np.array([0.0, 0.3, 0.02]))),),
    )


def start_of(mechanism: Mechanism) -> State:
    """Initial state: the turned screw starts more than two turns from its drawing, other mechanisms near theirs.

    `turning` also holds the angle that its drive leaves free, so that the start is no choice of the assembly.
    """
    if mechanism.name == "turned_screw":
        return initial_state(mechanism, Initial(coordinates={"j0": {"angle": 14.0}}, rates={"j0": {"angle": 3.0}}))
    if mechanism.name == "turning":
        return initial_state(mechanism, Initial(coordinates={"j1": {"angle": 0.0}}, rates={"j1": {"angle": -11.0}}))
    return states_of(mechanism)[0]


MOVING = {m.name: m for m in (*OWN.values(), turning(), turned_screw())}
MOVING |= {name: ELEMENTS[name] for name in ("backward_screw", "coupled", "rolling_torus", "rolling_ball", "skating")}


def errors(answer, reference):
    """Largest errors of poses and of velocities."""
    angle = np.max(rotation_angle_between(answer.quat_WB, reference.quat_WB))
    v, w = np.abs(answer.v_WB_W - reference.v_WB_W), np.abs(answer.w_WB_W - reference.w_WB_W)
    return max(np.max(np.abs(answer.p_WB - reference.p_WB)), angle), max(np.max(v), np.max(w))


@pytest.mark.slow
@pytest.mark.parametrize("name", MOVING)
def test_motions_find_the_reference_with_their_order(exudyn_engine, name):
    mechanism, state = MOVING[name], start_of(MOVING[name])
    sample = 0.2 if name == "turning" else 0.05
    times = sample * np.arange(3)
    expected = simulate(mechanism, state, times, 1e-11)
    methods = [m for m in exudyn_engine.methods(mechanism, Question.TRAJECTORY) if m.profile is Profile.MATCHED]
    assert [m.name for m in methods[:2]] == ["TrapezoidalIndex2", "GeneralizedAlpha"]
    for method in methods:
        steps = [sample / n for n in method.substeps[:2]]
        coarse, fine = (errors(exudyn_engine.trajectory(mechanism, state, times, method, h), expected) for h in steps)
        assert fine[0] < 0.02, method.name
        assert fine[1] < 50 * fine[0] + 1e-4, method.name
        if coarse[0] > 1e-13:  # if all moving bodies are driven, a method of index 3 is exact up to rounding
            assert np.log2(coarse[0] / fine[0]) == pytest.approx(method.order, abs=0.15), (method.name, coarse, fine)


def test_kinematic_trees_take_forces_and_no_constraints(exudyn_engine):
    assert [name for name, mechanism in ALL.items() if is_one_axis_tree(mechanism)] == ["powered_tree", "hardening"]
    names = [method.name for method in exudyn_engine.methods(OWN["powered_tree"], Question.TRAJECTORY)]
    assert "ExplicitRungeKutta44 on KinematicTree" in names


def test_the_turned_screw_counts_its_turns_at_an_instant(exudyn_engine):
    mechanism = turned_screw()
    turned, drawn = start_of(mechanism), initial_state(mechanism)
    method = exudyn_engine.methods(mechanism, Question.INSTANT)[0]
    answer = exudyn_engine.instant(mechanism, [drawn, turned, drawn], method)
    np.testing.assert_array_equal(answer.a_WB_W[0], answer.a_WB_W[2])
    for n, state in enumerate((drawn, turned)):
        assert relative(answer.a_WB_W[n], truth.solve(mechanism, state)[0]) < 1e-11
        assert answer.potential[n] == pytest.approx(potential_energy(mechanism, state), rel=1e-12)


@pytest.mark.parametrize(
    ("name", "dropped", "count"),
    [("screw_jack", {"thread"}, 4), ("wheelset", {"right_rolls"}, 1), ("driven_loop", {"c"}, 3)],
)
def test_dependent_rows_of_elements_are_left_out_and_named(exudyn_engine, name, dropped, count):
    mechanism = OWN[name]
    held = independent_axes(mechanism)
    assert equations(full_axes(mechanism)) - equations(held) == count
    assert set(left_out(mechanism, held)) == dropped
    state = states_of(mechanism)[1]
    J = Terms(build(mechanism, state, held)).constraint_jacobian(state)
    assert np.linalg.matrix_rank(J, 1e-8) == equations(held)
    for method in exudyn_engine.methods(mechanism, Question.TRAJECTORY):
        assert method.settings["constraint equations left out"] == left_out(mechanism, held)


@pytest.mark.parametrize("name", ALL)
def test_the_model_knows_its_freedom(exudyn_engine, name):
    mechanism = ALL[name]
    state = states_of(mechanism)[1]
    answer = exudyn_engine.model(mechanism, state, exudyn_engine.methods(mechanism, Question.MODEL)[0])
    assert answer.freedom == free_directions(mechanism, state).shape[1]


@pytest.mark.parametrize("what", ["drive", "load"])
def test_beyond_its_table_a_function_ends_the_motion(exudyn_engine, what):
    curve = through(np.linspace(0.0, 0.1, 6), np.linspace(0.0, 0.1, 6) ** 2)
    load = Load("l", "force", "b0", np.ones(3), "world", history=curve)
    element = {"drives": (Drive("d", "j0", "angle", curve),)} if what == "drive" else {"loads": (load,)}
    mechanism = replace(chain("revolute", "spherical", seed=82), **element)
    for method in exudyn_engine.methods(mechanism, Question.TRAJECTORY):
        with pytest.raises(RuntimeError, match=r"with 20 steps to 0\.2 s"):
            exudyn_engine.trajectory(mechanism, states_of(mechanism)[0], np.linspace(0.0, 0.2, 3), method, 0.01)


def test_implicit_solvers_step_first_order_equations_with_order_one():
    """Hence the adapter integrates controllers without ObjectGenericODE1. If this fails, update the README."""
    found = []
    for steps in (40, 80):
        system = exu.SystemContainer().AddSystem()
        node = system.AddNode(
            items.NodeGenericODE1(referenceCoordinates=[0.0], initialCoordinates=[1.0], numberOfODE1Coordinates=1)
        )
        system.AddObject(items.ObjectGenericODE1(nodeNumbers=[node], systemMatrix=[[-1.0]]))
        settings = simulation_settings(SETTINGS)
        settings.timeIntegration.endTime = 1.0
        settings.timeIntegration.numberOfSteps = steps
        system.SolveDynamic(settings, solverType=exu.DynamicSolverType.GeneralizedAlpha)
        found.append(system.systemData.GetODE1Coordinates()[0] - np.exp(-1.0))
    assert np.log2(found[0] / found[1]) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize(("name", "wrong"), [("driven_loop", True), ("wheelset", True), ("coupled_loop", False)])
def test_exudyns_initial_accelerations_leave_out_what_drives_and_slip_add(name, wrong):
    """The README describes the error; poses keep their order (`test_motions_find_the_reference_with_their_order`)."""
    mechanism, state = OWN[name], states_of(OWN[name])[0]
    system = build(mechanism, state, independent_axes(mechanism)).system
    exu.MainSolverImplicitSecondOrder().InitializeSolver(system, simulation_settings(SETTINGS))
    found = np.array(system.systemData.GetODE2Coordinates_tt()).reshape(-1, 7)[:, :3]
    assert (relative(found, truth.solve(mechanism, state)[0]) > 1e-2) == wrong


@pytest.mark.parametrize("skew", [False, True])
def test_the_relative_rotation_marker_needs_frames_that_differ_by_the_rotation(skew):
    """Hence the adapter forms the rows of drives and couplings: in skew axes Exudyn's marker has a constant error."""
    rng = np.random.default_rng(81)
    body = lumpy_body("b", rng)
    axes = rotation(rng)
    in_body = rotation(rng) if skew else np.eye(3)
    joint = Joint("j", "revolute", GROUND, "b", Frame(np.zeros(3), axes), Frame(np.zeros(3), in_body.T @ axes))
    mechanism = Mechanism("m", GRAVITY, (replace(body, drawing=Frame(np.zeros(3), in_body)),), (joint,))
    state = initial_state(mechanism, Initial(coordinates={"j": {"angle": 0.7}}))
    system = exu.SystemContainer().AddSystem()
    ground = system.AddObject(items.ObjectGround())
    quat = list(state.quat_WB[0])
    node = system.AddNode(items.NodeRigidBodyEP(referenceCoordinates=[0, 0, 0, *quat]))
    index = system.AddObject(items.ObjectRigidBody(mass=1.0, inertia=[1, 1, 1, 0, 0, 0], nodeNumber=node))
    turned = items.MarkerBodiesRelativeRotationCoordinate(bodyNumbers=[ground, index], axis0=axes[:, 2])
    still = items.MarkerNodeCoordinate(nodeNumber=system.AddNode(items.NodePointGround()), coordinate=0)
    markers = [system.AddMarker(still), system.AddMarker(turned)]
    connector = system.AddObject(items.ObjectConnectorCoordinate(markerNumbers=markers))
    system.Assemble()
    found = system.GetObjectOutput(connector, exu.OutputVariableType.Displacement)
    assert (abs(found - 0.7) > 0.01) == skew
