"""Elements that the Pinocchio adapter adds to Pinocchio, and screws, which Pinocchio has; on trees and loops.

Accelerations and reactions are compared with `truth`, motions with the reference solver; neither shares code with the
adapter.
"""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import truth
from consilience.engine import Profile, Question, Route
from consilience.mechanism import (
    GROUND,
    Control,
    Coupling,
    Drive,
    Friction,
    Function,
    Initial,
    Joint,
    JointSpring,
    Load,
    Mechanism,
    constraint_residual,
    determinate_reactions,
    free_directions,
    initial_state,
    linear,
    potential_energy,
    rotation_angle_between,
    sine,
    through,
)
from consilience.mechanism.conditioning import mass_matrix_condition
from consilience.reference import simulate
from consilience_pinocchio import PinocchioEngine
from consilience_pinocchio.dynamics import PROXIMAL
from consilience_pinocchio.mimic import MIMIC
from mechanisms import ELEMENTS, LOOPS, PITCH, chain, force_elements, hardening, rolling, skating, states_of

WAVE = sine(2.0, 3.0, 0.4)
BUMP = Function(np.array([0.2, 1.5]), np.array([[0.3, 4.0, 0.1]]))
CURVE = through(np.linspace(-1.0, 4.0, 9), [0.3, 1.0, -0.5, 0.2, 0.9, 1.4, 0.1, -0.7, 0.5])


def powered_loop() -> Mechanism:
    """A slider-crank with every force element that is not constant, some on the joint that closes the loop."""
    base = LOOPS["slider_crank"]
    forces = force_elements(list(base.joints), [b.name for b in base.bodies], np.random.default_rng(4))
    return replace(
        base,
        springs=tuple(replace(s, actuator=CURVE) for s in forces["springs"]),
        joint_springs=tuple(replace(s, actuator=WAVE) for s in forces["joint_springs"]),
        loads=tuple(replace(load, history=BUMP) for load in forces["loads"]),
        frictions=(Friction("f0", "a", "angle", 0.3, 1.1, 0.4), Friction("f1", "d", "distance", 0.5, 2.0, 0.5)),
        controls=(
            Control("c0", "a", "angle", WAVE, 4.0, 7.0, 1.5),
            Control("c1", "d", "distance", BUMP, 9.0, 4.0, 2.0),
        ),
    )


def driven_backwards() -> Mechanism:
    """Drives on joints that the tree passes from successor to predecessor, and a force on a driven joint."""
    base = chain("revolute", "cylindrical", "prismatic", seed=61, backwards=(0, 1), forces=True)
    drives = (Drive("turn", "j0", "angle", BUMP), Drive("push", "j1", "distance", sine(0.2, 5.0, 0.3)))
    return replace(base, drives=drives)


def geared() -> Mechanism:
    """Linear couplings of joints passed either way, one with its driver further out in the tree, and forces."""
    base = chain("revolute", "revolute", "prismatic", "cylindrical", seed=62, backwards=(1, 3), forces=True)
    couplings = (
        Coupling("gears", "j0", "angle", "j1", "angle", linear(-2.5, 0.1)),
        Coupling("rack", "j3", "angle", "j0", "angle", linear(0.7, -0.2)),
        Coupling("pinion", "j0", "angle", "j2", "distance", linear(-0.3, 0.05)),
    )
    return replace(base, couplings=couplings)


def screw_loop() -> Mechanism:
    """Two screws in a spatial loop, one with friction."""
    base = LOOPS["loop_spherical"]
    screws = {"j0": PITCH, "j3": 0.8}
    joints = tuple(replace(j, kind="screw", pitch=screws[j.name]) if j.name in screws else j for j in base.joints)
    return replace(base, joints=joints, frictions=(Friction("f", "j3", "angle", 0.3, 1.1, 0.5),))


def tied(mechanism: Mechanism, body: str) -> Mechanism:
    """The same mechanism with a rod from a body to the ground, which closes a loop."""
    rod = LOOPS["loop_rod"].joints[2]
    drawn = next(b for b in mechanism.bodies if b.name == body).drawing
    at, end = drawn.p + drawn.R @ rod.M.p, drawn.p + drawn.R @ rod.M.p + np.array([0.3, -0.9, 0.4])
    F = replace(rod.F, p=end)
    tie = Joint("tie", "rod", GROUND, body, F, rod.M, float(np.linalg.norm(at - end)))
    return replace(mechanism, joints=(*mechanism.joints, tie))


def driven(name: str, *drives: Drive) -> Mechanism:
    return replace(LOOPS[name], drives=drives)


MECHANISMS = {
    "powered": ELEMENTS["powered"],
    "powered_loop": powered_loop(),
    "hardening": hardening(),
    "driven": ELEMENTS["driven"],
    "driven_backwards": driven_backwards(),
    "driven_crank": driven("slider_crank", Drive("turn", "a", "angle", BUMP)),
    "driven_slider": driven("slider_crank", Drive("push", "d", "distance", sine(0.2, 3.0, 0.5))),
    "driven_rocker": driven("four_bar", Drive("turn", "j3", "angle", sine(0.3, 3.0))),
    "driven_cylinder": driven("four_bar_cylindrical", Drive("turn", "j3", "angle", sine(0.3, 3.0))),
    "driven_spatial": driven("loop_universal", Drive("turn", "j3", "angle", sine(0.3, 3.0))),
    "driven_screw": replace(
        chain("revolute", "screw", seed=63, backwards=(1,), forces=True), drives=(Drive("turn", "j1", "angle", BUMP),)
    ),
    "coupled": ELEMENTS["coupled"],
    "coupled_loop": replace(
        LOOPS["loop_spherical"], couplings=(Coupling("gear", "j0", "angle", "j3", "angle", Function([0.1, -0.6, 0.2])),)
    ),
    "geared": geared(),
    "single_screw": ELEMENTS["single_screw"],
    "backward_screw": ELEMENTS["backward_screw"],
    "screw_loop": screw_loop(),
    "rolling_torus": ELEMENTS["rolling_torus"],
    "rolling_disc": ELEMENTS["rolling_disc"],
    "rolling_ball": ELEMENTS["rolling_ball"],
    "rolling_loop": tied(rolling(), "b1"),
    "rolling_driven": replace(rolling(seed=39), drives=(Drive("turn", "j1", "angle", BUMP),)),
    "skating": ELEMENTS["skating"],
    "skating_loop": tied(skating(), "b1"),
}


def relative(a, b):
    return np.max(np.abs(a - b)) / np.max(np.abs(b))


def methods(mechanism, question):
    engine = PinocchioEngine()
    assert engine.unsupported(mechanism, question) == ()
    return [m for m in engine.methods(mechanism, question) if m.profile is Profile.MATCHED]


@pytest.mark.parametrize("name", MECHANISMS)
def test_instant(name):
    mechanism = MECHANISMS[name]
    states = states_of(mechanism, 3)
    for method in methods(mechanism, Question.INSTANT):
        answer = PinocchioEngine().instant(mechanism, states, method)
        for n, state in enumerate(states):
            a, alpha, force, torque = truth.solve(mechanism, state)
            found = np.hstack([answer.a_WB_W[n], answer.alpha_WB_W[n]])
            bar = 1e-11 + 4 * np.finfo(float).eps * mass_matrix_condition(mechanism, state)
            assert relative(found, np.hstack([a, alpha])) < bar, method.name
            known = determinate_reactions(mechanism, state)
            found = np.hstack([answer.force_F[n], answer.torque_F[n]])
            assert relative(found[known], np.hstack([force, torque])[known]) < 1e-10, method.name


@pytest.mark.parametrize("name", MECHANISMS)
def test_model_counts_every_row(name):
    mechanism = MECHANISMS[name]
    (state,) = states_of(mechanism, 1)
    (method,) = methods(mechanism, Question.MODEL)
    found = PinocchioEngine().model(mechanism, state, method)
    assert found.freedom == free_directions(mechanism, state).shape[1]


def trajectory(mechanism, state, times, substeps):
    (method,) = methods(mechanism, Question.TRAJECTORY)
    return PinocchioEngine().trajectory(mechanism, state, times, method, (times[1] - times[0]) / substeps)


def difference(a, b):
    """Largest difference of positions and orientations, and of velocities."""
    angle = rotation_angle_between(a.quat_WB.reshape(-1, 4), b.quat_WB.reshape(-1, 4))
    return max(np.max(np.abs(a.p_WB - b.p_WB)), np.max(angle)), np.max(
        np.abs([a.v_WB_W - b.v_WB_W, a.w_WB_W - b.w_WB_W])
    )


def leads_to_the_reference(mechanism, state, times, substeps, bar):
    """Check the order of the positions on two levels, and errors on the finer level: positions below `bar`."""
    expected = simulate(mechanism, state, times, 1e-12)
    answers = [trajectory(mechanism, state, times, n) for n in substeps]
    (coarse, _), (fine, velocities) = (difference(answer, expected) for answer in answers)
    assert np.log2(coarse / fine) == pytest.approx(4, abs=0.15)
    assert fine < bar
    assert velocities < 20 * bar
    return answers[-1]


@pytest.mark.parametrize("name", MECHANISMS)
def test_trajectory(name):
    mechanism = MECHANISMS[name]
    leads_to_the_reference(mechanism, states_of(mechanism, 1)[0], np.linspace(0.0, 0.4, 5), (10, 20), 2e-7)


def test_the_clock_starts_at_the_first_sample():
    mechanism = MECHANISMS["powered"]
    leads_to_the_reference(mechanism, states_of(mechanism, 1)[0], 0.7 + np.linspace(0.0, 0.4, 5), (10, 20), 2e-7)


def test_a_table_may_end_with_the_motion():
    """Accumulated steps can pass the final time by rounding, as three times 0.1 does; a table has no value there."""
    mechanism, times = chain("revolute", seed=4), np.linspace(0.0, 0.3, 4)
    history = through(np.linspace(0.0, times[-1], 8), np.cos(np.linspace(0.0, 9.0, 8)))
    load = Load("push", "torque", "b0", [1.0, 2.0, 3.0], "world", history=history)
    mechanism = replace(mechanism, loads=(load,))
    for n in (1, 3, 10):
        assert np.all(np.isfinite(trajectory(mechanism, states_of(mechanism, 1)[0], times, n).w_WB_W))


@pytest.mark.parametrize("name", ["driven_crank", "driven_rocker"])
def test_a_drive_is_followed_for_seconds(name):
    """Drives are constrained at acceleration level: the drift of positions is of the order of the integrator."""
    mechanism, times = MECHANISMS[name], np.linspace(0.0, 3.0, 31)
    (state,) = states_of(mechanism, 1)
    drift = []
    for n in (8, 16):
        last = trajectory(mechanism, state, times, n).state(-1)
        drift.append(np.max(np.abs(constraint_residual(mechanism, last, times[-1]))))
    assert drift[1] < 1e-6
    assert np.log2(drift[0] / drift[1]) == pytest.approx(4, abs=0.15)


def test_a_coupling_counts_full_turns():
    """The law is nonlinear, so that a lost turn changes the ratio; the motion covers two and a half turns."""
    mechanism = replace(
        chain("revolute", "cylindrical", seed=71, backwards=(0,)),
        gravity=np.zeros(3),
        couplings=(Coupling("gear", "j0", "angle", "j1", "distance", Function([0.0, 0.03, 0.002])),),
    )
    state = initial_state(mechanism, Initial(rates={"j0": {"angle": 20.0}}))
    found = leads_to_the_reference(mechanism, state, np.linspace(0.0, 1.0, 11), (20, 40), 1e-5)
    turned = np.sum(rotation_angle_between(found.quat_WB[1:, 0], found.quat_WB[:-1, 0]))
    assert turned > 4 * np.pi


def test_a_screw_has_the_turns_of_its_displacement():
    """The screw starts 1.75 turns from the drawing; the spring pulls it back all the way."""
    for backwards in ((), (0,)):
        base = chain("screw", seed=72, backwards=backwards)
        spring = JointSpring("k", "j0", "angle", 3.0, 0.2, 0.1)
        mechanism = replace(base, joint_springs=(spring,), controls=(Control("c", "j0", "angle", WAVE, 2.0, 1.0),))
        state = initial_state(mechanism, Initial(coordinates={"j0": {"angle": 11.0}}, rates={"j0": {"angle": 4.0}}))
        (method,) = [m for m in methods(mechanism, Question.INSTANT) if m.route is Route.NATIVE]
        found = PinocchioEngine().instant(mechanism, [state], method)
        assert found.potential[0] == pytest.approx(potential_energy(mechanism, state), rel=1e-12)
        assert relative(found.alpha_WB_W[0], truth.solve(mechanism, state)[1]) < 1e-11
        leads_to_the_reference(mechanism, state, np.linspace(0.0, 1.0, 11), (20, 40), 1e-6)


def test_a_change_of_charts_keeps_the_time_and_the_integrals():
    base = chain("rod", "revolute", seed=73)
    mechanism = replace(
        base,
        loads=(Load("push", "force", "b1", [3.0, -2.0, 1.0], "body", [0.1, 0.2, 0.0], WAVE),),
        controls=(Control("c", "j1", "angle", BUMP, 3.0, 8.0, 0.5),),
    )
    state = initial_state(mechanism, Initial(velocities={"b0": ([1.0, 2.0, 0.5], [0.3, 1.0, -2.0])}))
    found = leads_to_the_reference(mechanism, state, np.linspace(0.0, 2.0, 21), (20, 40), 1e-4)
    assert found.counters["chart changes"] > 0


def test_routes_say_who_forms_the_rows():
    engine = PinocchioEngine()
    tuned, own, native, lent = Route.TUNED, Route.HARNESS_SOLVE, Route.NATIVE, Route.HARNESS_INTEGRATOR
    for name, instant in (
        ("powered", [native, own]),
        ("driven_crank", [tuned, tuned, own, native]),
        ("rolling_disc", [tuned, tuned, own, native]),
        ("coupled", [tuned, own, native]),
        ("skating", [tuned, own, native]),
        ("geared", [tuned, own, native, own]),
    ):
        found = {q: [m.route for m in engine.methods(MECHANISMS[name], q)] for q in Question}
        expected = {Question.MODEL: [native if name == "powered" else own], Question.INSTANT: instant}
        assert found == expected | {Question.TRAJECTORY: [lent]}, name
        for question in (Question.INSTANT, Question.TRAJECTORY):
            headline = engine.methods(MECHANISMS[name], question)[0]
            assert headline.settings == ({} if name == "powered" else PROXIMAL)
    for element in ("drive", "rolling", "friction", "control", "screw", "coupling", "skate"):
        assert any(text.startswith(element) for m in MECHANISMS.values() for text in engine.manifest(m).exact)


def test_defaults_do_for_independent_rows_and_fail_on_dependent_ones():
    """`forwardDynamics` neither regularises nor checks: with dependent rows its result is wrong or NaN."""
    engine, error = PinocchioEngine(), {}
    for name in ("driven", "coupled", "rolling_torus", "driven_spatial", "driven_crank", "driven_slider"):
        mechanism, error[name] = MECHANISMS[name], []
        (method,) = [m for m in engine.methods(mechanism, Question.INSTANT) if m.profile is Profile.DEFAULT]
        for state in states_of(mechanism, 3):
            found = engine.instant(mechanism, [state], method)
            both = np.hstack([found.a_WB_W[0], found.alpha_WB_W[0]])
            error[name].append(relative(both, np.hstack(truth.solve(mechanism, state)[:2])))
    assert np.max([error[name] for name in ("driven", "coupled", "rolling_torus", "driven_spatial")]) < 1e-11
    assert not np.max([error["driven_crank"], error["driven_slider"]]) < 1e-3


def two_hinges():
    model, joint = pin.Model(), 0
    for n in range(2):
        joint = model.addJoint(joint, pin.JointModelRZ(), pin.SE3(np.eye(3), np.array([1.0, 0.2, 0.1])), f"j{n}")
        model.appendBodyToJoint(joint, pin.Inertia(1.0, np.array([0.3, 0.1, 0.2]), np.eye(3)), pin.SE3.Identity())
    return model


def test_the_acceleration_of_a_contact_is_read_from_its_data_and_not_from_its_model():
    model = two_hinges()
    data, constraints, contacts = (
        model.createData(),
        pin.StdVec_RigidConstraintModel(),
        pin.StdVec_RigidConstraintData(),
    )
    ends = 2, pin.SE3.Identity(), 1, model.jointPlacements[2]
    constraints.append(pin.RigidConstraintModel(pin.ContactType.CONTACT_6D, model, *ends, pin.ReferenceFrame.LOCAL))
    contacts.append(constraints[0].createData())
    pin.initConstraintDynamics(model, data, constraints, contacts)
    q, v, asked = np.array([0.3, 0.7]), np.array([1.1, -0.4]), pin.Motion(np.zeros(3), np.array([0.0, 0.0, 2.0]))

    def accelerations():
        settings = pin.ProximalSettings(*PROXIMAL.values())
        return pin.constraintDynamics(model, data, q, v, np.zeros(2), constraints, contacts, settings)

    constraints[0].desired_contact_acceleration = asked
    assert accelerations()[1] == pytest.approx(0.0, abs=1e-12)
    contacts[0].contact_acceleration_desired = asked
    assert accelerations()[1] == pytest.approx(2.0, abs=1e-12)


def test_forward_dynamics_refuse_a_mimic():
    geared = pin.transformJointIntoMimic(two_hinges(), 1, 2, 2.0, 0.0)
    data, one = geared.createData(), np.ones(1)
    with pytest.raises(RuntimeError, match="Mimic"):
        pin.aba(geared, data, one, one, one)
    with pytest.raises(RuntimeError, match="Mimic"):
        pin.forwardDynamics(geared, data, one, one, one, np.zeros((0, 1)), np.zeros(0))


def geared_mass_matrix(middle):
    """Mass matrix of hinge, `middle` joint and mimicking hinge: by `crba`, and projected from the full model."""
    model, joint = pin.Model(), 0
    for n, kind in enumerate((pin.JointModelRZ, middle, pin.JointModelRZ)):
        joint = model.addJoint(joint, kind(), pin.SE3(np.eye(3), np.array([1.0, 0.2 * n, 0.1])), f"j{n}")
        model.appendBodyToJoint(joint, pin.Inertia(1.0, np.array([0.3, 0.1, 0.2]), np.eye(3)), pin.SE3.Identity())
    geared = pin.transformJointIntoMimic(model, 1, 3, -2.0, 0.0)
    q = pin.integrate(model, pin.neutral(model), np.linspace(0.1, 0.6, model.nv))
    q[-1] = -2.0 * q[0]
    G = np.vstack([np.eye(model.nv - 1), -2.0 * np.eye(model.nv - 1)[0]])
    full = np.array(pin.crba(model, model.createData(), q))
    return np.array(pin.crba(geared, geared.createData(), q[:-1])), G.T @ full @ G


def test_the_mass_matrix_under_a_mimic_is_wrong_across_a_ball():
    found, expected = geared_mass_matrix(pin.JointModelRX)
    np.testing.assert_allclose(found, expected, atol=1e-13)
    found, expected = geared_mass_matrix(pin.JointModelSpherical)
    assert np.max(np.abs(found - expected)) > 0.1


def test_the_mass_matrix_under_a_mimic_needs_fresh_data():
    """`crba` adds to the old content of its data if a joint follows the mimicking one: the second call is wrong."""
    model, joint = pin.Model(), 0
    for n in range(3):
        joint = model.addJoint(joint, pin.JointModelRZ(), pin.SE3(np.eye(3), np.array([1.0, 0.2 * n, 0.0])), f"j{n}")
        model.appendBodyToJoint(joint, pin.Inertia(1.0, np.array([0.3, 0.1, 0.2]), np.eye(3)), pin.SE3.Identity())
    geared, q = pin.transformJointIntoMimic(model, 1, 2, -2.0, 0.0), np.array([0.1, 0.2])
    G = np.array([[1.0, 0.0], [-2.0, 0.0], [0.0, 1.0]])
    expected = G.T @ np.array(pin.crba(model, model.createData(), G @ q)) @ G
    data = geared.createData()
    np.testing.assert_allclose(np.array(pin.crba(geared, data, q)), expected, atol=1e-13)
    assert np.max(np.abs(np.array(pin.crba(geared, data, q)) - expected)) > 0.1


def test_a_mimic_joint_is_offered_only_for_what_it_can_represent():
    """No mimic joint for loops, cams, driven joints, a slave of a slave, or trees with a ball joint."""
    engine, offered, to_third = PinocchioEngine(), set(), ("j0", "angle", "j2", "angle")
    slave_of_slave = Coupling("more", "j1", "angle", "j3", "distance", linear(0.4))
    drive = Drive("turn", "j3", "distance", WAVE)
    tried = MECHANISMS | {
        "slave_of_slave": replace(geared(), couplings=(*geared().couplings, slave_of_slave)),
        "ball": replace(chain("revolute", "spherical", "revolute"), couplings=(Coupling("g", *to_third, linear(2.0)),)),
        "driven_gears": replace(geared(), drives=(drive,)),
        "constant": replace(geared(), couplings=(Coupling("held", "j0", "angle", "j1", "angle", Function([0.3])),)),
    }
    for name, mechanism in tried.items():
        if any(m.settings == MIMIC for m in engine.methods(mechanism, Question.INSTANT)):
            offered.add(name)
    assert offered == {"geared"}
