"""Screws and elements beyond constant forces in MuJoCo: trees and loops, compared with `truth` and the reference."""

import functools
from dataclasses import replace

import numpy as np
import pytest

import truth
from consilience.engine import Profile, Question, Route, defects
from consilience.mechanism import (
    GROUND,
    Control,
    Coupling,
    Drive,
    Friction,
    Function,
    Initial,
    JointSpring,
    Load,
    Mechanism,
    Rolling,
    Skate,
    constant,
    determinate_reactions,
    drawing_state,
    free_directions,
    initial_state,
    kinetic_energy,
    linear,
    potential_energy,
    rotation_angle_between,
    rotation_from_quaternion,
    sine,
    through,
)
from consilience.mechanism.conditioning import reaction_condition
from consilience.reference import simulate
from mechanisms import (
    ELEMENTS,
    GRAVITY,
    PITCH,
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

pytest.importorskip("mujoco")

import mujoco

from consilience_mujoco import MujocoEngine
from consilience_mujoco.functions import jet_of
from consilience_mujoco.messages import EngineWarningError

TURN = 2 * np.pi
CAM = through(np.linspace(0.0, TURN, 13), 0.1 * np.cos(np.linspace(0.0, TURN, 13)), True)


def with_screw(mechanism, k):
    joints = list(mechanism.joints)
    joints[k] = replace(joints[k], kind="screw", pitch=PITCH)
    return replace(mechanism, joints=tuple(joints))


def backward():
    """Every element, on joints that the tree passes from successor to predecessor."""
    return replace(
        chain("revolute", "screw", "cylindrical", seed=50, backwards=(1, 2)),
        couplings=(
            Coupling("g", "j1", "angle", "j2", "angle", Function(np.array([0.0, 0.3, 0.5, 0.3]))),
            Coupling("h", "j0", "angle", "j2", "distance", sine(0.3, 2.0)),
        ),
    )


def backward_forces():
    return replace(
        chain("revolute", "screw", "cylindrical", seed=50, backwards=(1, 2)),
        drives=(Drive("d", "j1", "angle", Function(np.array([0.0, 1.0, 3.0]))),),
        frictions=(Friction("f", "j2", "angle", 0.3, 1.0, 0.3), Friction("n", "j1", "angle", 0.3, 1.0, 0.3)),
        controls=(Control("c", "j2", "distance", sine(0.4, 2.0), 20.0, 9.0, 1.0),),
        joint_springs=(
            JointSpring("k", "j2", "distance", 3.0, 0.1, 0.2, sine(1.0, 2.0)),
            JointSpring("l", "j1", "angle", 3.0, 0.1, 0.2, sine(1.0, 2.0)),
        ),
        loads=tuple(
            Load(kind, kind, "b2", np.array([3.0, -2.0, 1.0]), "body", np.array([0.1, 0.2, 0.3]), sine(1.5, 2.0, 0.7))
            for kind in ("force", "torque")
        ),
    )


def powered_crank():
    """Slider-crank with controllers on its first and on its closing joint, friction and an actuator."""
    return replace(
        slider_crank(),
        controls=(
            Control("c", "a", "angle", sine(0.5, 2.0), 20.0, 7.0, 1.5),
            Control("e", "d", "distance", constant(0.1), 10.0, 7.0, 1.5),
        ),
        frictions=(Friction("f", "d", "distance", 0.3, 1.0, 0.3),),
        joint_springs=(JointSpring("k", "b", "angle", 3.0, 0.2, 0.1, sine(1.0, 3.0)),),
    )


def two_wheels():
    """A body that rolls as a torus carries a second body that rolls as a torus."""
    torus = ELEMENTS["rolling_torus"].rollings[0]
    smaller = replace(torus, name="second", body="b2", radius=0.3, rounding=0.03)
    return replace(chain("free", "revolute", "revolute", seed=61), rollings=(torus, smaller))


def two_trees():
    """A cam couples two bodies on the ground: each is a tree, and a constraint island, of its own in MuJoCo."""
    rng = np.random.default_rng(70)
    bodies = {n: lumpy_body(n, rng) for n in ("cam", "follower")}
    joints = (
        drawn_joint("a", "revolute", bodies, GROUND, "cam", np.zeros(3), rotation(rng)),
        drawn_joint("b", "prismatic", bodies, GROUND, "follower", np.ones(3), rotation(rng)),
    )
    law = Coupling("cam", "a", "angle", "b", "distance", CAM)
    return Mechanism("two_trees", GRAVITY, tuple(bodies.values()), joints, couplings=(law,))


def skate_behind_a_ball_and_a_slide():
    """A mechanism for which MuJoCo's `mj_jacDot` is wrong (`reports/findings/mujoco_ball_then_slide`)."""
    edge = Skate("edge", "b2", np.array([0.1, 0.2, 0.3]), np.array([1.0, 0.3, 0.2]))
    return replace(chain("revolute", "point_on_line", "revolute", seed=3, backwards=(1,)), skates=(edge,))


TURNING = Function(np.array([0.1, 2.0]), np.array([[0.2, 5.0, 0.3]]))
LOOP = spatial_loop()
QUARTIC = Function(np.array([0, 0.3, 0.5, -0.2, 0.1]))
WITH_LOOPS = {
    "driven_four_bar": replace(four_bar(), drives=(Drive("d", "j0", "angle", TURNING),)),
    "driven_at_the_end": replace(four_bar(), drives=(Drive("d", "j3", "angle", sine(0.2, 5.0)),)),
    "powered_crank": powered_crank(),
    "screw_closes": with_screw(LOOP, 3),
    "screw_in_a_loop": with_screw(LOOP, 0),
    "coupled_loop": replace(LOOP, couplings=(Coupling("g", "j3", "angle", "j0", "angle", QUARTIC),)),
    "skate_in_a_loop": replace(LOOP, skates=(Skate("s", "b", np.array([0.1, 0.2, 0.3]), np.array([1.0, 0.3, 0.2])),)),
}
ALL = {
    **ELEMENTS,
    "backward": backward(),
    "hardening": hardening(),
    "backward_forces": backward_forces(),
    "two_wheels": two_wheels(),
    "two_trees": two_trees(),
    "skate_behind_a_ball_and_a_slide": skate_behind_a_ball_and_a_slide(),
    **WITH_LOOPS,
}


@pytest.fixture(scope="module")
def engine():
    return MujocoEngine()


def matched(engine, mechanism, question):
    return [m for m in engine.methods(mechanism, question) if m.profile is Profile.MATCHED]


def relative(a, b):
    return np.max(np.abs(a - b)) / np.max(np.abs(b))


def soft_error(method, mechanism, state):
    """Expected error of a regularisation of 1e-4 times the factor, relative to the inverse inertia of the rows."""
    factor = max((x for name, x in method.settings.items() if "invweight0" in name), default=0.0)
    return 1e-4 * factor * reaction_condition(mechanism, state)


@pytest.mark.parametrize("name", ALL)
def test_accelerations_and_reactions(engine, name):
    mechanism = ALL[name]
    states = states_of(mechanism, 3)
    assert engine.unsupported(mechanism, Question.INSTANT) == ()
    for method in matched(engine, mechanism, Question.INSTANT):
        answer = engine.instant(mechanism, states, method)
        assert defects(answer, Question.INSTANT, mechanism, len(states)) == []
        for n, state in enumerate(states):
            a, alpha, force, torque = truth.solve(mechanism, state)
            bar = 1e-11 + soft_error(method, mechanism, state)
            found = np.hstack([answer.a_WB_W[n], answer.alpha_WB_W[n]])
            assert relative(found, np.hstack([a, alpha])) < bar, method.name
            known = determinate_reactions(mechanism, state)
            found = np.hstack([answer.force_F[n], answer.torque_F[n]])
            assert relative(found[known], np.hstack([force, torque])[known]) < 10 * bar, method.name
            assert answer.kinetic[n] == pytest.approx(kinetic_energy(mechanism, state), rel=1e-12)
            assert answer.potential[n] == pytest.approx(potential_energy(mechanism, state), rel=1e-12, abs=1e-11)


@pytest.mark.parametrize("name", ALL)
def test_freedom(engine, name):
    mechanism = ALL[name]
    (state,) = states_of(mechanism, 1)
    found = engine.model(mechanism, state, engine.methods(mechanism, Question.MODEL)[0])
    assert found.freedom == free_directions(mechanism, state).shape[1]


@functools.cache
def motion(name):
    mechanism = ALL[name]
    start = initial_state(mechanism) if mechanism.drives else states_of(mechanism, 1)[0]
    times = np.arange(9) * 0.05
    return times, start, simulate(mechanism, start, times, 1e-12)


def difference(a, b):
    angle = np.max(rotation_angle_between(a.quat_WB, b.quat_WB))
    return max(np.max(np.abs(a.p_WB - b.p_WB)), angle)


def errors(engine, name, method, substeps):
    times, start, expected = motion(name)
    found = [engine.trajectory(ALL[name], start, times, method, 0.05 / n) for n in substeps]
    return [difference(answer, expected) for answer in found]


@pytest.mark.slow
@pytest.mark.parametrize("name", ALL)
def test_motions_come_to_the_reference_with_the_declared_order(engine, name):
    for method in matched(engine, ALL[name], Question.TRAJECTORY):
        coarse, fine = errors(engine, name, method, method.substeps[:2])
        assert fine < (1e-5 if method.order == 4 else 1e-2)
        assert np.log2(coarse / fine) == pytest.approx(method.order, abs=0.15), method.name


@pytest.mark.parametrize("name", ["driven", "coupled", "rolling_disc", "skating", "two_trees", "single_screw"])
def test_the_defaults_made_hard_come_to_the_reference(engine, name):
    method = engine.methods(ALL[name], Question.TRAJECTORY)[-1]
    assert (method.profile, method.settings) == (Profile.DEFAULT, {})
    coarse, fine = errors(engine, name, replace(method, softness=1e-4), method.substeps[:2])
    assert fine < 1e-2
    assert np.log2(coarse / fine) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("name", [n for n in ALL if n not in ("powered", "powered_crank", "hardening")])
def test_every_path_of_mujoco_finds_the_one_solution_of_the_soft_problem(engine, name):
    mechanism = ALL[name]
    states = states_of(mechanism, 2)
    plain, *others = [m for m in engine.methods(mechanism, Question.INSTANT) if m.profile is Profile.DEFAULT]
    assert others
    expected = engine.instant(mechanism, states, plain).a_WB_W
    for method in others:
        assert relative(engine.instant(mechanism, states, method).a_WB_W, expected) < 1e-9, method.name


@pytest.mark.parametrize("name", ["driven", "coupled", "rolling_torus", "skating", "single_screw"])
def test_softness_of_every_row_is_linear(engine, name):
    mechanism = ALL[name]
    (state,) = states_of(mechanism, 1)
    a = truth.solve(mechanism, state)[0]
    method = engine.methods(mechanism, Question.INSTANT)[0]
    near, far = (
        relative(engine.instant(mechanism, [state], replace(method, softness=s)).a_WB_W[0], a) for s in (1e5, 1e6)
    )
    assert far / near == pytest.approx(10.0, rel=0.01)


def test_a_loop_with_dependent_rows_keeps_the_order_and_the_energy(engine):
    """Hooke's joint between two bearings: six rows of rank three, inconsistent off the constraint manifold."""
    rng = np.random.default_rng(72)
    bodies = {n: lumpy_body(n, rng) for n in ("in", "out")}
    turned = rotation(rng)
    across = turned @ np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    beside = turned @ np.array([[1.0, 0.0, 0.0], [0.0, 0.8, -0.6], [0.0, 0.6, 0.8]])  # z at an angle to the other shaft
    joints = (
        drawn_joint("a", "revolute", bodies, GROUND, "in", turned @ np.array([0.0, 0.0, -0.5]), turned),
        drawn_joint("cross", "universal", bodies, "in", "out", np.zeros(3), across),
        drawn_joint("b", "revolute", bodies, GROUND, "out", beside @ np.array([0.0, 0.0, 0.5]), beside),
    )
    mechanism = Mechanism("hooke", np.zeros(3), tuple(bodies.values()), joints)
    start = initial_state(mechanism, Initial(rates={"a": {"angle": 4.0}}))
    assert free_directions(mechanism, start).shape[1] == 1
    method = engine.methods(mechanism, Question.TRAJECTORY)[0]
    times = np.arange(11) * 0.05
    x, y, z = (engine.trajectory(mechanism, start, times, method, 0.05 / n) for n in (5, 10, 20))
    assert np.log2(difference(x, y) / difference(y, z)) == pytest.approx(4.0, abs=0.15)
    energy = [kinetic_energy(mechanism, z.state(n)) for n in range(len(times))]
    np.testing.assert_allclose(energy, energy[0], rtol=1e-6)
    assert not np.allclose(z.w_WB_W[-1], z.w_WB_W[0], rtol=0.01)


def hard_default(engine, mechanism, state):
    """Accelerations with MuJoCo's default gains and almost no softness."""
    (plain, *_) = [m for m in engine.methods(mechanism, Question.INSTANT) if m.profile is Profile.DEFAULT]
    answer = engine.instant(mechanism, [state], replace(plain, softness=1e-8))
    return answer.a_WB_W[0], answer.alpha_WB_W[0]


WIDTH, TIME = 0.95, 0.02  # last impedance of `solimp`; time constant of `solref`, whose damping ratio is one
B, K = 2.0 / (WIDTH * TIME), 1.0 / (WIDTH * TIME) ** 2


def test_drives_are_pulled_back_by_mujocos_gains(engine):
    drive = Drive("d", "j0", "angle", Function(np.array([0.3, 1.0, 2.0])))
    mechanism = replace(chain("revolute", seed=2), drives=(drive,))
    free = replace(mechanism, drives=())
    for angle, rate in ((0.31, 1.0), (0.3, 1.2), (0.28, 0.9)):
        state = initial_state(free, Initial(coordinates={"j0": {"angle": angle}}, rates={"j0": {"angle": rate}}))
        expected = 4.0 - B * (rate - 1.0) - K * WIDTH * (angle - 0.3)
        _, alpha = hard_default(engine, mechanism, state)
        axis = rotation_from_quaternion(state.quat_WB[0]) @ mechanism.joints[0].M.R[:, 2]
        assert alpha[0] @ axis == pytest.approx(expected, rel=1e-6)


def test_bodies_off_the_plane_and_slipping_edges_are_pulled_back_by_mujocos_gains(engine):
    rolling = ELEMENTS["rolling_ball"]
    (contact,) = rolling.rollings
    rest = initial_state(rolling)
    away = replace(rest, p_WB=rest.p_WB + 0.01 * contact.normal)
    a, alpha = hard_default(engine, rolling, away)
    arm = rotation_from_quaternion(rest.quat_WB[0]) @ contact.center - contact.rounding * contact.normal
    assert (a[0] + np.cross(alpha[0], arm)) @ contact.normal == pytest.approx(-K * WIDTH * 0.01, rel=1e-6)

    skating = ELEMENTS["skating"]
    (edge,) = skating.skates
    state = states_of(replace(skating, skates=()), 1)[0]
    a, alpha = hard_default(engine, skating, state)
    R, w = rotation_from_quaternion(state.quat_WB[0]), state.w_WB_W[0]
    arm, lateral = R @ edge.point, R @ edge.lateral
    velocity = state.v_WB_W[0] + np.cross(w, arm)
    acceleration = a[0] + np.cross(alpha[0], arm) + np.cross(w, np.cross(w, arm))
    slip = lateral @ velocity
    assert abs(slip) > 0.1
    assert lateral @ acceleration + np.cross(w, lateral) @ velocity == pytest.approx(-B * slip, rel=1e-6)


def wound(**elements):
    """Two lumpy bodies on revolute joints to the ground, and one on a prismatic joint."""
    rng = np.random.default_rng(71)
    bodies = {n: lumpy_body(n, rng) for n in ("a", "b", "c")}
    kinds = {"a": "revolute", "b": "revolute", "c": "prismatic"}
    joints = tuple(
        drawn_joint(f"j{k}", kinds[n], bodies, GROUND, n, rng.normal(size=3), rotation(rng))
        for k, n in enumerate(kinds)
    )
    return Mechanism("wound", GRAVITY, tuple(bodies.values()), joints, **elements)


WOUND = {
    "drive": wound(drives=(Drive("d", "j0", "angle", Function(np.array([0.4, 3.0, 12.0]))),)),
    "coupling": wound(
        couplings=(
            Coupling("g", "j0", "angle", "j1", "angle", linear(-2.5, 0.1)),
            Coupling("r", "j0", "angle", "j2", "distance", linear(0.02)),
        )
    ),
    "cam": wound(couplings=(Coupling("c", "j0", "angle", "j2", "distance", CAM),)),
    "control": wound(controls=(Control("c", "j0", "angle", Function(np.array([0.0, 15.0])), 30.0, 5.0, 1.0),)),
    "spring": wound(joint_springs=(JointSpring("s", "j0", "angle", 1.0, 0.0, 2.0, constant(5.0)),)),
    "screw": replace(
        with_screw(chain("prismatic", "revolute", seed=5), 1),
        controls=(Control("c", "j1", "angle", Function(np.array([0.0, 15.0])), 30.0, 5.0, 1.0),),
    ),
}


@pytest.mark.parametrize("name", WOUND)
def test_angles_are_counted_over_full_turns(engine, name):
    mechanism = WOUND[name]
    joint = "j1" if name == "screw" else "j0"
    fast = Initial(rates={joint: {"angle": 15.0}}) if not mechanism.drives else None
    start = initial_state(mechanism, fast)
    times = np.arange(17) * 0.05
    expected = simulate(mechanism, start, times, 1e-11)
    k = mechanism.body_index[mechanism.joints[mechanism.joint_index[joint]].successor]
    assert np.sum(np.linalg.norm(expected.w_WB_W[:, k], axis=1)) * 0.05 > TURN
    method = engine.methods(mechanism, Question.TRAJECTORY)[0]
    assert difference(engine.trajectory(mechanism, start, times, method, 0.05 / 40), expected) < 1e-5


def test_full_turns_between_coupled_angles_do_not_pull(engine):
    """At 2 rad of the pinion the gear is at -4.9 rad, which MuJoCo's hinge represents as 1.38 rad."""
    mechanism = WOUND["coupling"]
    state = initial_state(mechanism, Initial(coordinates={"j0": {"angle": 2.0}}, rates={"j0": {"angle": 1.0}}))
    assert relative(hard_default(engine, mechanism, state)[0], truth.solve(mechanism, state)[0]) < 1e-6


def test_the_turns_of_a_screw_are_those_of_its_displacement(engine):
    spring = JointSpring("s", "j0", "angle", 2.0, 0.0, 0.3)
    mechanism = replace(chain("screw", seed=35), joint_springs=(spring,))
    start = initial_state(mechanism)
    axis = mechanism.bodies[0].drawing.R @ mechanism.joints[0].M.R[:, 2]
    moved = replace(start, p_WB=start.p_WB + 3 * PITCH * axis)  # three turns further, same orientation
    found = engine.instant(mechanism, [start, moved], engine.methods(mechanism, Question.INSTANT)[0])
    for n, state in enumerate((start, moved)):
        assert relative(found.a_WB_W[n], truth.solve(mechanism, state)[0]) < 1e-11
    assert relative(found.a_WB_W[1], found.a_WB_W[0]) > 0.1


def test_functions_are_those_of_the_case():
    table = through(np.linspace(-1.0, 4.0, 9), [0.3, 1.0, -0.5, 0.2, 0.9, 1.4, 0.1, -0.7, 0.5])
    whole = Function(np.array([1.0, -0.4, 0.3, 0.2]), np.array([[0.3, 4.0, 0.1], [0.1, 1.0, 2.0]]), CAM.table)
    for function, ends in ((table, (-1.0, 4.0)), (whole, (-20.0, 20.0)), (Function(), (-1.0, 1.0))):
        jet = jet_of(function)
        for x in np.linspace(*ends, 57):
            np.testing.assert_allclose(jet(float(x)), function.at(x), rtol=1e-11, atol=1e-11)
    assert np.all(np.isnan(jet_of(table)(4.1)))
    assert np.all(np.isnan(jet_of(table)(-1.1)))


def test_a_table_may_end_with_the_motion_but_not_before(engine):
    def loaded(end):
        history = through(np.linspace(0.0, end, 7), np.cos(np.linspace(0.0, end, 7)))
        return replace(
            chain("revolute", seed=2), loads=(Load("l", "force", "b0", np.ones(3), "body", history=history),)
        )

    times = np.arange(12) * 0.1
    for end in (1.1, 1.05):
        mechanism = loaded(end)
        method = engine.methods(mechanism, Question.TRAJECTORY)[0]
        start = initial_state(mechanism)
        if end == 1.1:
            assert np.all(np.isfinite(engine.trajectory(mechanism, start, times, method, 0.1 / 7).p_WB))
        else:
            with pytest.raises(EngineWarningError, match="CTRL"):
                engine.trajectory(mechanism, start, times, method, 0.1 / 7)


def test_the_callback_is_mujocos_only_while_it_is_asked(engine):
    mechanism = ALL["powered"]
    engine.instant(mechanism, states_of(mechanism, 1), engine.methods(mechanism, Question.INSTANT)[0])
    assert mujoco.get_mjcb_control() is None
    held = replace(
        chain("rigid"), rollings=(Rolling("r", "b0", np.zeros(3), np.ones(3), 0.1, np.zeros(3), np.ones(3)),)
    )
    with pytest.raises(EngineWarningError, match="cannot move"):
        engine.instant(held, [drawing_state(held)], engine.methods(held, Question.INSTANT)[0])
    assert mujoco.get_mjcb_control() is None


def test_routes_say_who_states_and_who_solves(engine):
    """Forces are MuJoCo's own; the settings name the constraint rows that the callback of the adapter adds."""
    puts = {"powered": None, "single_screw": None, "driven": "efc_aref", "coupled_loop": "efc_aref"}
    puts |= {"coupled": "efc_aref, efc_J", "rolling_disc": "efc_aref, efc_J", "skating": "efc_aref, efc_J"}
    for name, expected in puts.items():
        for question in (Question.INSTANT, Question.TRAJECTORY):
            method = engine.methods(ALL[name], question)[0]
            assert method.settings.get("mjcb_control") == expected
            assert method.route is (Route.NATIVE if name == "powered" else Route.TUNED)
    assert matched(engine, ALL["driven"], Question.INSTANT)[1].route is Route.HARNESS_SOLVE


def test_rows_that_a_sparse_jacobian_has_no_room_for_have_no_defaults(engine):
    for count, profiles in ((59, {Profile.MATCHED, Profile.DEFAULT}), (60, {Profile.MATCHED})):
        mechanism = replace(chain(*["revolute"] * count), couplings=(Coupling("c", "j0", "angle", "j1", "angle", CAM),))
        assert {m.profile for m in engine.methods(mechanism, Question.INSTANT)} == profiles
        assert {m.profile for m in engine.methods(mechanism, Question.TRAJECTORY)} == profiles


def test_polynomials_of_one_rest_add_up_and_those_of_several_are_refused(engine):
    """A MuJoCo joint has one polynomial and one rest; a damper and a constant effort need none."""
    base = hardening()
    first = base.joint_springs[1]
    more = replace(first, name="more", stiffness=4.0, higher_stiffness=(0.7, 0.9), higher_damping=(0.2,), actuator=None)
    damper = replace(first, name="damper", stiffness=0.0, rest=9.0, higher_stiffness=())
    together = replace(base, joint_springs=(*base.joint_springs, more, damper))
    apart = replace(base, joint_springs=(*base.joint_springs, replace(more, rest=first.rest + 0.1)))
    states, method = states_of(together, 3), engine.methods(together, Question.INSTANT)[0]
    assert engine.unsupported(together, Question.INSTANT) == ()
    answer = engine.instant(together, states, method)
    for n, state in enumerate(states):
        a, alpha, force, torque = truth.solve(together, state)
        assert relative(np.hstack([answer.a_WB_W[n], answer.alpha_WB_W[n]]), np.hstack([a, alpha])) < 1e-11
        assert relative(np.hstack([answer.force_F[n], answer.torque_F[n]]), np.hstack([force, torque])) < 1e-10
        assert answer.potential[n] == pytest.approx(potential_energy(together, state), rel=1e-12)
    (refusal,) = engine.unsupported(apart, Question.INSTANT)
    assert refusal.feature == "springs on joint 'j1', not all linear, of several rests"
    assert "one polynomial and one rest" in refusal.reason
