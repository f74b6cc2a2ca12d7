"""Driven motion, inverse kinematics and the history of assembly against closed forms and independent methods."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.optimize

import truth
from consilience.errors import CannotAssemble, InvalidInput
from consilience.mechanism import (
    GROUND,
    JOINT_KINDS,
    Body,
    Control,
    Drive,
    Frame,
    Friction,
    Function,
    Joint,
    JointSpring,
    Load,
    Mechanism,
    assemble_positions,
    body_point,
    constant,
    constraint_residual,
    determinate_reactions,
    drawing_state,
    elementary_rotation,
    free_directions,
    initial_state,
    joint_coordinates,
    joint_frames,
    move,
    quaternion_from_rotation,
    quaternion_from_rotation_vector,
    relative_motion,
    rotation_angle_between,
    rotation_from_quaternion,
    rotation_with_z_axis,
    sine,
)
from consilience.reference.analyses import inverse_dynamics
from consilience.reference.analyses.assembly_history import assemble_with_history
from consilience.reference.analyses.inverse_kinematics import Unreachable, inverse_kinematics
from consilience.reference.analyses.kinematic import SingularDrive, driven_dynamics, kinematic_motion
from mechanisms import ELEMENTS, LOOPS, TREES, chain, four_bar, slider_crank
from oracles import four_bar as four_bar_oracle
from oracles import slider_crank as slider_crank_oracle

ORIGIN = Frame(np.zeros(3), np.eye(3))
DOWN = np.array([0.0, 0.0, -9.81])


def swing(mean, amplitude, rate, phase=0.0):
    """Return the drive ``mean + amplitude sin(rate t + phase)``."""

    def drive(t):
        s, c = np.sin(rate * t + phase), np.cos(rate * t + phase)
        return mean + amplitude * s, amplitude * rate * c, -amplitude * rate**2 * s

    return drive


def turning(speed, jerk=0.0, start=0.0):
    return lambda t: (start + speed * t + jerk * t**3, speed + 3 * jerk * t**2, 6 * jerk * t)


def renamed(mechanism, *names):
    joints = tuple(replace(j, name=n) for j, n in zip(mechanism.joints, names, strict=True))
    return replace(mechanism, joints=joints)


ONE_FREEDOM = {
    "four_bar": (renamed(four_bar(), "crank_pivot", "crank_pin", "rocker_pin", "rocker_pivot"), four_bar_oracle),
    "slider_crank": (renamed(slider_crank(), "crank_pivot", "crank_pin", "wrist_pin", "slide"), slider_crank_oracle),
}
SPANS = {"four_bar": swing(0.1, 0.9, 2.0), "slider_crank": turning(5.0, 0.3)}


def driven_one_freedom(name, times):
    mechanism, oracle = ONE_FREEDOM[name]
    drive = SPANS[name]
    motion = kinematic_motion(mechanism, {("crank_pivot", "angle"): drive}, times, initial_state(mechanism))
    return mechanism, oracle.linkage(SimpleNamespace(mechanism=mechanism)), drive, motion


# ---------------------------------------------------------------- driven motion


@pytest.mark.parametrize("name", ONE_FREEDOM)
def test_a_driven_loop_moves_as_its_closure_equations_say(name):
    times = np.linspace(0.0, 2.0, 9)  # the slider-crank turns by at least 0.2 of a turn between samples
    _, oracle, drive, motion = driven_one_freedom(name, times)
    asked = np.array([drive(t) for t in times])
    assert np.max(np.abs(motion.coordinates["crank_pivot"]["angle"] - asked[:, 0])) < 1e-12
    for i, of_body in enumerate(oracle.motions(asked[:, 0])):
        w = of_body.a_q * asked[:, 1]
        alpha = of_body.a_q * asked[:, 2] + of_body.a_qq * asked[:, 1] ** 2
        normal = oracle.plane.normal
        found_w = np.array([s.w_WB_W[i] for s in motion.states])
        assert np.max(np.abs(found_w - w[:, None] * normal)) < 1e-11 * np.max(np.abs(asked[:, 1]))
        assert np.max(np.abs(motion.alpha_WB_W[:, i] - alpha[:, None] * normal)) < 1e-10 * np.max(asked[:, 1] ** 2)


@pytest.mark.parametrize("name", ONE_FREEDOM)
def test_the_effort_of_a_driven_crank_is_that_of_lagranges_equation(name):
    times = np.linspace(0.0, 2.0, 7)
    mechanism, oracle, drive, motion = driven_one_freedom(name, times)
    q, rate, acceleration = np.array([drive(t) for t in times]).T
    J, h, Q = oracle.coefficients(q)
    efforts = driven_dynamics(mechanism, motion).efforts["crank_pivot"]["angle"]
    expected = J * acceleration + h * rate**2 - Q
    assert np.max(np.abs(efforts - expected)) < 1e-10 * np.max(np.abs(expected))


DRIVEN_LOOPS = {
    "four_bar": [("j0", "angle")],
    "four_bar_spherical": [("j1", "angle")],
    "four_bar_cylindrical": [("j1", "angle")],
    "slider_crank": [("d", "distance")],
    "loop_universal": [("j0", "angle")],
}


def gentle(mechanism, state, joint, name):
    """Return a slow sinusoidal drive that starts from the present value of a joint coordinate."""
    target = mechanism.joints[mechanism.joint_index[joint]]
    value = joint_coordinates(target, relative_motion(mechanism, state, target))[name]
    return swing(float(value), 0.2, 1.7)


@pytest.mark.parametrize("name", DRIVEN_LOOPS)
def test_forces_that_replace_the_drives_make_the_same_motion(name):
    """Drives replaced by loads: an independent solver of forward dynamics gives the same motion and reactions."""
    mechanism = replace(
        LOOPS[name],
        joint_springs=(JointSpring("k", mechanism_pin(LOOPS[name]), "angle", 3.0, 0.4, 0.2),),
        loads=(Load("push", "force", LOOPS[name].bodies[1].name, [0.4, -0.7, 0.2], "body", [0.1, 0.2, 0.0]),),
    )
    start = initial_state(mechanism)
    drives = {key: gentle(mechanism, start, *key) for key in DRIVEN_LOOPS[name]}
    motion = kinematic_motion(mechanism, drives, np.linspace(0.0, 1.0, 4), start)
    found = driven_dynamics(mechanism, motion)
    for k, state in enumerate(motion.states):
        assert np.max(np.abs(constraint_residual(mechanism, state))) < 1e-12
        efforts = {j: {c: e[k] for c, e in by.items()} for j, by in found.efforts.items()}
        a, alpha, force, torque = truth.solve(as_loads(mechanism, state, efforts), state)
        scale = max(np.max(np.abs(a)), np.max(np.abs(alpha)), 1.0)
        assert np.max(np.abs(a - motion.a_WB_W[k])) < 1e-8 * scale
        assert np.max(np.abs(alpha - motion.alpha_WB_W[k])) < 1e-8 * scale
        known = determinate_reactions(mechanism, state)
        wrench, other = np.hstack([found.force_F[k], found.torque_F[k]]), np.hstack([force, torque])
        assert np.max(np.abs(wrench - other)[known]) < 1e-8 * np.max(np.abs(other))


def mechanism_pin(mechanism):
    return next(j.name for j in mechanism.joints if j.kind == "revolute")


def as_loads(mechanism, state, efforts):
    """Return the mechanism with scalar efforts as world-fixed forces and torques on both bodies of each joint."""
    R = dict(zip(mechanism.body_index, [np.eye(3), *rotation_from_quaternion(state.quat_WB)], strict=True))
    p = dict(zip(mechanism.body_index, [np.zeros(3), *state.p_WB], strict=True))
    loads = []
    for name, by_coordinate in efforts.items():
        joint = mechanism.joints[mechanism.joint_index[name]]
        f = joint_frames(mechanism, state, joint)
        at = body_point(mechanism, state, joint.successor, joint.M.p)[0]
        for coordinate, effort in by_coordinate.items():
            axis = {"x": f.U[:, 0], "y": f.U[:, 1], "angle2": f.W[:, 0]}.get(coordinate, f.U[:, 2])
            kind = "torque" if coordinate.startswith("angle") else "force"
            for body, sign in ((joint.successor, 1.0), (joint.predecessor, -1.0)):
                if body != GROUND:
                    point = R[body].T @ (at - p[body])
                    loads.append(Load(f"{name}_{coordinate}_{body}", kind, body, sign * effort * axis, "world", point))
    return replace(mechanism, loads=(*mechanism.loads, *loads))


@pytest.mark.parametrize(("name", "drives"), DRIVEN_LOOPS.items())
def test_velocities_and_accelerations_are_the_derivatives_of_the_poses(name, drives):
    mechanism = LOOPS[name]
    start = initial_state(mechanism)
    functions = {key: gentle(mechanism, start, *key) for key in drives}
    h = 2e-3
    motion = kinematic_motion(mechanism, functions, 0.4 + h * np.arange(-2, 3), start)
    p = np.array([s.p_WB for s in motion.states])
    v, w = (np.array([getattr(s, f) for s in motion.states]) for f in ("v_WB_W", "w_WB_W"))
    weights = np.array([1, -8, 0, 8, -1]) / (12 * h)
    for values, derivative in ((p, v[2]), (v, motion.a_WB_W[2]), (w, motion.alpha_WB_W[2])):
        assert np.max(np.abs(np.tensordot(weights, values, 1) - derivative)) < 1e-8


def test_a_free_base_and_all_kinds_of_coordinates_can_be_driven():
    mechanism = chain("free", "universal", "planar", "cylindrical", "spherical", seed=51, forces=True)
    state = initial_state(mechanism)
    axis = np.array([0.6, 0.0, 0.8])

    def place(t):
        return np.array([t, t**2, 0.3]), np.array([1.0, 2 * t, 0.0]), np.array([0.0, 2.0, 0.0])

    def spin(t):  # rotation about a fixed axis
        return quaternion_from_rotation_vector(2.0 * t * axis), 2.0 * axis, np.zeros(3)

    drives = {("j0", "position"): place, ("j0", "orientation"): spin, ("j4", "orientation"): spin}
    for joint, kind in (("j1", "universal"), ("j2", "planar"), ("j3", "cylindrical")):
        for n, name in enumerate(JOINT_KINDS[kind].coordinates):
            drives[joint, name] = swing(0.1, 0.3 + 0.1 * n, 1.0 + n, 0.4 * n)
    motion = kinematic_motion(mechanism, drives, np.linspace(0.0, 2.0, 5), state)
    assert np.allclose(motion.coordinates["j0"]["position"], [place(t)[0] for t in motion.times], rtol=0, atol=1e-12)
    turned = rotation_angle_between(motion.coordinates["j4"]["orientation"], [spin(t)[0] for t in motion.times])
    assert np.max(turned) < 1e-12
    h = 1e-3
    near = kinematic_motion(mechanism, drives, 1.0 + h * np.arange(-2, 3), state)
    weights = np.array([1, -8, 0, 8, -1]) / (12 * h)
    for field, derivative in (("v_WB_W", near.a_WB_W[2]), ("w_WB_W", near.alpha_WB_W[2])):
        values = np.array([getattr(s, field) for s in near.states])
        assert np.max(np.abs(np.tensordot(weights, values, 1) - derivative)) < 1e-8
    a = np.hstack([motion.a_WB_W[2], motion.alpha_WB_W[2]])
    efforts = driven_dynamics(mechanism, motion).efforts
    power = sum(
        float(np.dot(np.ravel(efforts[j][c][2]), np.ravel(drives[j, c](motion.times[2])[1]))) for j, c in drives
    )
    # Jourdain's principle: the power of the efforts equals that of ``M a - f``, assembled by the tests' own equations
    assert power == pytest.approx(power_needed(mechanism, motion.states[2], a), rel=1e-9)


def power_needed(mechanism, state, a):
    """Return ``sum (m a_c - F).v_c + (I alpha + w x I w - T).w`` over the bodies."""
    R = rotation_from_quaternion(state.quat_WB)
    wrench = truth.applied_wrenches(mechanism, state)
    total = 0.0
    for i, body in enumerate(mechanism.bodies):
        c, w = R[i] @ body.com, state.w_WB_W[i]
        inertia = R[i] @ body.inertia @ R[i].T
        a_c = a[i, :3] + np.cross(a[i, 3:], c) + np.cross(w, np.cross(w, c))
        v_c = state.v_WB_W[i] + np.cross(w, c)
        total += body.mass * a_c @ v_c + (inertia @ a[i, 3:] + np.cross(w, inertia @ w)) @ w
        total -= wrench[i, :3] @ state.v_WB_W[i] + wrench[i, 3:] @ w
    return total


def test_trees_agree_with_inverse_dynamics():
    mechanism = chain("revolute", "prismatic", "universal", "cylindrical", "planar", seed=33)
    drives = {
        (j.name, c): swing(0.0, 0.4, 1.0 + 0.3 * n, 0.2 * n)
        for n, j in enumerate(mechanism.joints)
        for c in JOINT_KINDS[j.kind].coordinates
    }
    motion = kinematic_motion(mechanism, drives, [0.0, 0.7], initial_state(mechanism))
    found = driven_dynamics(mechanism, motion)
    asked: dict = {}
    for (joint, coordinate), drive in drives.items():
        asked.setdefault(joint, {})[coordinate] = drive(0.7)[2]
    other = inverse_dynamics(mechanism, motion.states[1], asked)
    for joint, by_coordinate in other.efforts.items():
        for coordinate, effort in by_coordinate.items():
            assert found.efforts[joint][coordinate][1] == pytest.approx(effort, rel=1e-9, abs=1e-9)
    assert np.max(np.abs(found.force_F[1] - other.force_F)) < 1e-9


def test_angles_and_their_springs_are_counted_over_full_turns():
    mechanism = ONE_FREEDOM["slider_crank"][0]
    spring = JointSpring("k", "crank_pivot", "angle", 2.0, 0.0, 0.3)
    sprung = replace(mechanism, joint_springs=(spring,))
    drives, times = {("crank_pivot", "angle"): turning(-9.0, start=7.0)}, np.linspace(0.0, 3.0, 4)
    start = initial_state(mechanism)
    plain, motion = (kinematic_motion(m, drives, times, start) for m in (mechanism, sprung))
    angle = 7.0 - 9.0 * times  # three turns, with more than one turn between samples
    assert np.max(np.abs(motion.coordinates["crank_pivot"]["angle"] - angle)) < 1e-12
    sum_of_pins = angle + sum(motion.coordinates[j]["angle"] for j in ("crank_pin", "wrist_pin"))
    assert np.ptp(sum_of_pins) < 1e-11  # the slider does not rotate
    with_spring, without = (
        driven_dynamics(m, x).efforts["crank_pivot"]["angle"] for m, x in ((sprung, motion), (mechanism, plain))
    )
    assert with_spring - without == pytest.approx(2.0 * (angle - 0.3), rel=1e-9)


def two_speeds(t):
    return sine(0.3, 4.0, 0.1).at(t) + Function(np.array([0.2, 1.5])).at(t)


def power_mechanism():
    """Return a mechanism with two drives of its own and forces of every kind that depends on time."""
    base, loaded = ELEMENTS["driven"], ELEMENTS["powered"]
    wave = sine(2.0, 3.0, 0.4)
    return replace(
        base,
        springs=tuple(replace(s, successor="b2", actuator=wave) for s in loaded.springs),
        loads=tuple(replace(load, body="b1") for load in loaded.loads),
        joint_springs=(JointSpring("k", "j0", "angle", 3.0, 0.2, 0.1, wave),),
        frictions=(Friction("f", "j0", "angle", 0.3, 1.1, 0.2),),
        controls=(Control("c", "j0", "angle", wave, 5.0, 0.0, 0.7),),
    )


def spin(t):
    axis = np.array([0.6, 0.0, 0.8])
    return quaternion_from_rotation_vector(2.0 * t * axis), 2.0 * axis, np.zeros(3)


def counted(by_joint, k):
    return {joint: {name: series[k] for name, series in by.items()} for joint, by in by_joint.items()}


def test_a_mechanism_that_drives_itself_moves_by_its_own_drives_under_forces_that_depend_on_time():
    """Drives of the mechanism and drives from Python: accelerations and reactions of an independent solver."""
    mechanism = power_mechanism()
    mine = {("j1", "orientation"): spin, ("j2", "angle"): turning(0.7)}
    motion = kinematic_motion(mechanism, mine, [0.0, 0.2, 0.45], initial_state(mechanism))
    assert motion.drives == (("j0", "angle"), ("j2", "distance"), *mine)
    angle = np.array([two_speeds(t)[0] for t in motion.times])
    assert np.max(np.abs(motion.coordinates["j0"]["angle"] - angle)) < 1e-12
    found = driven_dynamics(mechanism, motion)
    for k, (t, state) in enumerate(zip(motion.times, motion.states, strict=True)):
        efforts = counted(found.efforts, k)
        orientation = as_torque(mechanism, state, "j1", efforts.pop("j1")["orientation"])
        free = replace(mechanism, drives=())  # the efforts replace all drives
        a, alpha, force, torque = truth.solve(as_loads(orientation(free), state, efforts), state, float(t))
        scale = max(np.max(np.abs(a)), np.max(np.abs(alpha)))
        assert np.max(np.abs(a - motion.a_WB_W[k])) < 1e-9 * scale
        assert np.max(np.abs(alpha - motion.alpha_WB_W[k])) < 1e-9 * scale
        assert np.max(np.abs(np.hstack([found.force_F[k] - force, found.torque_F[k] - torque]))) < 1e-9 * np.max(
            np.abs(torque)
        )


def as_torque(mechanism, state, name, torque_F):
    """Return a function that adds the torque of a driven orientation to a mechanism."""
    joint = mechanism.joints[mechanism.joint_index[name]]
    torque = joint_frames(mechanism, state, joint).U @ torque_F
    loads = tuple(
        Load(f"{name}_{body}", "torque", body, sign * torque, "world", np.zeros(3))
        for body, sign in ((joint.successor, 1.0), (joint.predecessor, -1.0))
    )
    return lambda m: replace(m, loads=(*m.loads, *loads))


def test_own_drives_and_the_same_functions_in_python_are_one_motion():
    mechanism = power_mechanism()
    rest = {("j1", "orientation"): spin, ("j2", "angle"): turning(0.7)}
    same = {("j0", "angle"): two_speeds, ("j2", "distance"): sine(0.2, 5.0).at}
    one = kinematic_motion(mechanism, rest, [0.0, 3.0], initial_state(mechanism))
    other = kinematic_motion(replace(mechanism, drives=()), same | rest, [0.0, 3.0], initial_state(mechanism))
    assert np.max(np.abs(one.states[1].p_WB - other.states[1].p_WB)) < 1e-12
    assert np.max(np.abs(one.alpha_WB_W - other.alpha_WB_W)) < 1e-9
    with pytest.raises(InvalidInput, match=r"joint 'j0', angle.*driven twice"):
        kinematic_motion(mechanism, same, [0.0], initial_state(mechanism))


def test_gears_racks_and_cams_follow_a_drive_over_full_turns():
    """Couplings ``q = f(q_driver)`` and their first two derivatives; the power of the drive equals the power needed."""
    mechanism = replace(
        ELEMENTS["coupled"], drives=(Drive("motor", "j0", "angle", Function(np.array([0.0, 9.0, 1.0]))),)
    )
    start = initial_state(mechanism)
    times = np.array([0.0, 0.4, 0.8])  # 1.2 turns of the first gear, three backward turns of the second
    motion = kinematic_motion(mechanism, {("j3", "angle"): turning(0.5)}, times, start)
    q0 = 9.0 * times + times**2
    cam = ELEMENTS["coupled"].couplings[2].law
    q = motion.coordinates
    assert q["j1"]["angle"] == pytest.approx(0.1 - 2.5 * q0, abs=1e-11)
    assert q["j2"]["distance"] == pytest.approx(0.2 * (0.1 - 2.5 * q0), abs=1e-11)
    assert q["j3"]["distance"] == pytest.approx([cam.at(x)[0] for x in q0], abs=1e-11)
    rates = [relative_motion(mechanism, s, mechanism.joints[3]).v[2] for s in motion.states]
    assert rates == pytest.approx([cam.at(x)[1] * (9.0 + 2.0 * t) for x, t in zip(q0, times, strict=True)], abs=1e-10)
    found = driven_dynamics(mechanism, motion)
    assert set(found.couplings) == {"gears", "rack", "cam"}
    for k, state in enumerate(motion.states):
        a = np.hstack([motion.a_WB_W[k], motion.alpha_WB_W[k]])
        power = found.efforts["j0"]["angle"][k] * (9.0 + 2.0 * times[k]) + found.efforts["j3"]["angle"][k] * 0.5
        assert power == pytest.approx(power_needed(mechanism, state, a), rel=1e-9)
        efforts = counted(found.efforts, k)  # the couplings are replaced by their efforts on the four joints
        gears, rack, cam_force = (found.couplings[n][k] for n in ("gears", "rack", "cam"))
        efforts["j0"]["angle"] += 2.5 * gears - cam.at(q0[k])[1] * cam_force
        efforts["j1"] = {"angle": gears - 0.2 * rack}
        efforts["j2"] = {"distance": rack}
        efforts["j3"]["distance"] = cam_force
        free = replace(mechanism, drives=(), couplings=())
        a_free, alpha, *_ = truth.solve(as_loads(free, state, efforts), state)
        assert np.max(np.abs(np.hstack([a_free, alpha]) - a)) < 1e-9 * np.max(np.abs(a))


def test_mechanisms_without_a_driven_motion_or_efforts_are_refused():
    for name, message in (("rolling_ball", r"rolling 'contact'.*holds velocities"), ("skating", "skate 'edge'")):
        with pytest.raises(InvalidInput, match=message):
            kinematic_motion(ELEMENTS[name], {}, [0.0], initial_state(ELEMENTS[name]))
    with pytest.raises(InvalidInput, match="2 rows are driven, degrees of freedom are 6"):
        kinematic_motion(ELEMENTS["driven"], {}, [0.0], initial_state(ELEMENTS["driven"]))
    base = four_bar()
    held = replace(
        base,
        drives=(Drive("d", "j0", "angle", constant(0.1)),),
        controls=(Control("c", "j0", "angle", constant(0.0), 1.0, 2.0),),
    )
    with pytest.raises(InvalidInput, match="control 'c': its integral"):
        driven_dynamics(held, kinematic_motion(held, {}, [0.0], initial_state(base)))


def parallelogram():
    """Return a lumpy planar parallelogram linkage: flat, and at a bifurcation, at every half turn."""
    mechanism = four_bar()
    R = mechanism.joints[0].F.R
    p = [R @ np.array(x) for x in ([0, 0, 0], [0.3, 0.8, 0], [1.5, 0.8, 0], [1.2, 0, 0])]
    names = [GROUND, "crank", "coupler", "rocker", GROUND]
    placed = {b.name: b.drawing for b in mechanism.bodies} | {GROUND: ORIGIN}

    def frame(body, at):
        f = placed[body]
        return Frame(f.R.T @ (at - f.p), f.R.T @ R)

    joints = tuple(
        Joint(f"j{n}", "revolute", names[n], names[n + 1], frame(names[n], p[n]), frame(names[n + 1], p[n]))
        for n in range(4)
    )
    return replace(mechanism, joints=joints)


def test_a_parallelogram_passes_its_change_points_on_the_smooth_branch_and_says_so_when_it_stops_on_one():
    mechanism = parallelogram()
    drives, start = {("j0", "angle"): turning(1.0)}, initial_state(mechanism)
    motion = kinematic_motion(mechanism, drives, np.linspace(0.0, 8.0, 9), start)
    rocker = [s.w_WB_W[2] for s in motion.states]
    axis = joint_frames(mechanism, start, mechanism.joints[0]).U[:, 2]
    assert np.max(np.abs(rocker - axis)) < 1e-9
    assert np.max(np.abs([s.w_WB_W[1] for s in motion.states])) < 1e-9
    flat = np.pi - np.arctan2(0.8, 0.3)
    with pytest.raises(SingularDrive, match=rf"{flat:.6g}.* s: the drive of joint 'j0', angle, does not"):
        kinematic_motion(mechanism, drives, [0.0, flat], start)


def test_a_slide_drives_a_crank_no_further_than_its_dead_centre():
    mechanism, oracle = ONE_FREEDOM["slider_crank"]
    linkage = oracle.linkage(SimpleNamespace(mechanism=mechanism))
    points = [(m.drawn, m.anchor) for m in linkage.motions(np.linspace(0, 2 * np.pi, 4001))]
    travel = np.abs(points[2][1] - points[2][0])
    start = initial_state(mechanism)
    reachable = kinematic_motion(mechanism, {("slide", "distance"): turning(-0.05)}, [0.0, 1.0], start)
    assert np.all(reachable.margin > 1e-4)
    with pytest.raises(SingularDrive, match=r"'slide', distance, .* beyond this pose: a dead centre lies ahead"):
        kinematic_motion(mechanism, {("slide", "distance"): turning(1.1 * np.max(travel))}, [0.0, 1.0], start)


@pytest.mark.parametrize(
    ("mechanism", "drives", "error", "message"),
    [
        (four_bar(), {}, InvalidInput, "0 rows are driven, degrees of freedom are 1"),
        (four_bar(), {("j0", "angle"): turning(1), ("j3", "angle"): turning(0)}, InvalidInput, "2 rows are driven"),
        (LOOPS["loop_rod"], {("j0", "angle"): turning(0)}, InvalidInput, "1 rows are driven, .* freedom are 4"),
        (four_bar(), {("j0", "distance"): turning(1)}, InvalidInput, "no 'distance'"),
        (four_bar(), {("j9", "angle"): turning(1)}, InvalidInput, "no joint 'j9'"),
        (four_bar(), {("j0", "angle"): lambda t: (np.zeros(2), 0, 0)}, InvalidInput, "not a value, a rate"),
        (
            LOOPS["loop_spherical"],
            {("j0", "angle"): turning(0), ("j3", "angle"): turning(0)},
            SingularDrive,
            "motion of body 'b': a dead centre, or drives that depend on others",
        ),
    ],
)
def test_drives_that_do_not_fit_are_refused(mechanism, drives, error, message):
    with pytest.raises(error, match=message):
        kinematic_motion(mechanism, drives, [0.0], initial_state(mechanism))


# ---------------------------------------------------------------- inverse kinematics


def arm(*lengths):
    """Return a planar arm with hinges along y of the world and links along x at zero angles."""
    along_y = rotation_with_z_axis([0.0, -1.0, 0.0], [1.0, 0.0, 0.0])  # positive angles turn x towards z
    bodies, joints, at, previous = [], [], 0.0, GROUND
    for n, length in enumerate(lengths):
        name = f"link{n}"
        drawing = Frame(np.array([at, 0.0, 0.0]), np.eye(3))
        bodies.append(Body(name, 1.0, np.array([0.4 * length, 0.1, 0.0]), np.diag([0.1, 0.2, 0.25]), drawing))
        offset = np.array([0.0 if n == 0 else lengths[n - 1], 0.0, 0.0])
        joints.append(Joint(f"q{n}", "revolute", previous, name, Frame(offset, along_y), Frame(np.zeros(3), along_y)))
        at, previous = at + length, name
    return Mechanism("arm", DOWN, tuple(bodies), tuple(joints))


def angles_of(mechanism, state):
    return np.array(
        [float(joint_coordinates(j, relative_motion(mechanism, state, j))["angle"]) for j in mechanism.joints]
    )


def posed(mechanism, *angles):
    from consilience.mechanism import Initial

    return initial_state(
        mechanism, Initial({j.name: {"angle": q} for j, q in zip(mechanism.joints, angles, strict=True)})
    )


@pytest.mark.parametrize("elbow", [-1.0, 1.0])
def test_two_links_reach_a_point_with_the_elbow_on_the_side_of_the_guess(elbow):
    mechanism = arm(0.8, 0.5)
    x, z = 0.3, 0.9
    cosine = (x * x + z * z - 0.8**2 - 0.5**2) / (2 * 0.8 * 0.5)  # by the law of cosines
    q2 = elbow * np.arccos(cosine)
    q1 = np.arctan2(z, x) - np.arctan2(0.5 * np.sin(q2), 0.8 + 0.5 * np.cos(q2))
    guess = posed(mechanism, 0.6, 0.7 * elbow)
    state = inverse_kinematics(mechanism, "link1", [0.5, 0, 0], [x, 0.0, z], guess)
    assert angles_of(mechanism, state) == pytest.approx([q1, q2], abs=1e-10)
    assert not np.any(state.v_WB_W)
    assert np.max(np.abs(constraint_residual(mechanism, state))) < 1e-12


def test_three_links_hold_a_direction_as_well():
    mechanism, L = arm(0.8, 0.5, 0.3), (0.8, 0.5, 0.3)
    p, direction = np.array([0.5, 0.7]), 1.1
    x, z = p - L[2] * np.array([np.cos(direction), np.sin(direction)])
    q2 = np.arccos((x * x + z * z - L[0] ** 2 - L[1] ** 2) / (2 * L[0] * L[1]))
    q1 = np.arctan2(z, x) - np.arctan2(L[1] * np.sin(q2), L[0] + L[1] * np.cos(q2))
    quat = quaternion_from_rotation_vector([0.0, -direction, 0.0])
    state = inverse_kinematics(
        mechanism, "link2", [L[2], 0, 0], [p[0], 0, p[1]], posed(mechanism, 0.3, 0.5, 0.2), orientation=quat
    )
    assert angles_of(mechanism, state) == pytest.approx([q1, q2, direction - q1 - q2], abs=1e-10)


def test_free_coordinates_change_least_from_the_guess():
    """The free coordinates change least from the guess: against a constrained minimiser with closed-form poses."""
    mechanism, L, start, target = arm(0.8, 0.5, 0.3), np.array([0.8, 0.5, 0.3]), (0.2, 0.6, 0.5), (0.5, 0.9)

    def corners(q):
        s = np.cumsum(q)
        return np.vstack([np.zeros(2), np.cumsum(L[:, None] * np.column_stack([np.cos(s), np.sin(s)]), axis=0)])

    def change(q):  # lengths relative to the longest link, 0.8 m
        moved = (corners(q) - corners(start))[:3] / 0.8
        return np.sum(moved**2) + np.sum((np.cumsum(q) - np.cumsum(start)) ** 2)

    best = scipy.optimize.minimize(
        change,
        start,
        method="SLSQP",
        constraints={"type": "eq", "fun": lambda q: corners(q)[3] - target},
        options={"ftol": 1e-15, "maxiter": 200},
    )
    state = inverse_kinematics(mechanism, "link2", [0.3, 0, 0], [target[0], 0, target[1]], posed(mechanism, *start))
    assert angles_of(mechanism, state) == pytest.approx(best.x, abs=2e-6)
    assert change(angles_of(mechanism, state)) <= best.fun + 1e-12


def test_a_straight_arm_folds_though_no_first_step_brings_it_closer():
    mechanism = arm(0.8, 0.5)
    state = inverse_kinematics(mechanism, "link1", [0.5, 0, 0], [0.7, 0, 0], posed(mechanism, 0.0, 0.0))
    assert abs(angles_of(mechanism, state)[1]) == pytest.approx(np.arccos((0.49 - 0.64 - 0.25) / 0.8), abs=1e-9)


def test_a_target_out_of_reach_is_named_with_the_distance_that_remains():
    mechanism = arm(0.8, 0.5)
    with pytest.raises(Unreachable, match=r"'link1' does not reach the target: 0\.7 m are left"):
        inverse_kinematics(mechanism, "link1", [0.5, 0, 0], [1.2, 0, 1.6], posed(mechanism, 0.3, 0.4))
    with pytest.raises(InvalidInput, match="no body 'hand'"):
        inverse_kinematics(mechanism, "hand", [0, 0, 0], [0, 0, 0], posed(mechanism, 0.3, 0.4))
    with pytest.raises(InvalidInput, match="not unit"):
        inverse_kinematics(mechanism, "link1", [0, 0, 0], [1, 0, 0], posed(mechanism, 0, 1), [2.0, 0, 0, 0])


IIWA_JOINTS = (
    ((0, 0, 0), (0, 0, 0.1575)),
    ((90, 0, 180), (0, 0, 0.2025)),
    ((90, 0, 180), (0, 0.2045, 0)),
    ((90, 0, 0), (0, 0, 0.2155)),
    ((-90, 180, 0), (0, 0.1845, 0)),
    ((90, 0, 0), (0, 0, 0.2155)),
    ((-90, 180, 0), (0, 0.081, 0)),
)
"""Joint frames of the KUKA LBR iiwa 14, roll pitch yaw in degrees and origin in m (Drake, `kuka_iiwa_robot`)."""

IIWA_R = np.array(
    [
        [-0.5939002959880204, 0.8043869080239565, -0.015625],
        [-0.8043869080239565, -0.5932991120359317, 0.03094940802395521],
        [0.015625, 0.03094940802395527, 0.9993988160479114],
    ]
)
IIWA_P = np.array([0.2970356451892219, 0.1727696964662288, 1.154681973689345])
"""Pose of the last link of the arm at (60, 30, 60, 30, 60, 30, 60) degrees (MotionGenesis)."""


def iiwa():
    bodies, joints, p, R, previous = [], [], np.zeros(3), np.eye(3), GROUND
    for n, (rpy, xyz) in enumerate(IIWA_JOINTS):
        roll, pitch, yaw = np.radians(rpy)
        turn = elementary_rotation(2, yaw) @ elementary_rotation(1, pitch) @ elementary_rotation(0, roll)
        p, R = p + R @ np.array(xyz), R @ turn
        bodies.append(Body(f"link{n}", 2.0, np.array([0.01, 0.03, 0.1]), np.diag([0.03, 0.03, 0.02]), Frame(p, R)))
        joints.append(Joint(f"q{n}", "revolute", previous, f"link{n}", Frame(np.array(xyz, float), turn), ORIGIN))
        previous = f"link{n}"
    return Mechanism("iiwa", DOWN, tuple(bodies), tuple(joints))


def test_a_seven_axis_robot_reaches_its_published_pose():
    mechanism = iiwa()
    asked = np.radians([60, 30, 60, 30, 60, 30, 60])
    state = posed(mechanism, *asked)
    assert np.max(np.abs(state.p_WB[6] - IIWA_P)) < 1e-13
    assert np.max(np.abs(rotation_from_quaternion(state.quat_WB[6]) - IIWA_R)) < 1e-13
    rng = np.random.default_rng(2)
    guess = posed(mechanism, *(asked + rng.normal(scale=0.4, size=7)))
    found = inverse_kinematics(
        mechanism, "link6", np.zeros(3), IIWA_P, guess, orientation=quaternion_from_rotation(IIWA_R)
    )
    assert np.max(np.abs(found.p_WB[6] - IIWA_P)) < 1e-10
    assert np.max(np.abs(rotation_from_quaternion(found.quat_WB[6]) - IIWA_R)) < 1e-10
    assert np.max(np.abs(found.p_WB[2] - state.p_WB[2])) > 1e-3  # a redundant arm: another pose, same target


@pytest.mark.parametrize("name", ["four_bar", "loop_spherical", "loop_rod", "branched", "floating_chain"])
def test_loops_reach_poses_they_are_known_to_have(name):
    mechanism = (TREES | LOOPS)[name]
    start = initial_state(mechanism)
    rng = np.random.default_rng(9)
    basis = free_directions(mechanism, start)
    reached = assemble_positions(mechanism, move(start, 0.2 * basis @ rng.normal(size=basis.shape[1])))
    body, point = mechanism.bodies[1].name, np.array([0.1, -0.2, 0.3])
    target, _ = body_point(mechanism, reached, body, point)
    state = inverse_kinematics(mechanism, body, point, target, start)
    assert np.max(np.abs(body_point(mechanism, state, body, point)[0] - target)) < 1e-10
    assert np.max(np.abs(constraint_residual(mechanism, state))) < 1e-12


# ---------------------------------------------------------------- assembly history


@pytest.mark.parametrize("name", ["four_bar", "slider_crank", "loop_spherical", "long_chain"])
def test_residuals_square_and_the_state_is_that_of_the_assembly(name):
    mechanism = (TREES | LOOPS)[name]
    rng = np.random.default_rng(1)
    start = drawing_state(mechanism)
    guess = move(start, rng.normal(scale=0.1, size=6 * len(mechanism.bodies)))
    first = mechanism.joints[0]
    found = assemble_with_history(mechanism, guess, {first.name: {"angle": 0.15}})
    assert found.failure is None
    assert np.array_equal(found.state.p_WB, assemble_positions(mechanism, guess, [(first, "angle", 0.15)]).p_WB)
    residuals = np.array([i.residual for i in found.history])
    assert residuals[0] > 0.05
    assert residuals[-1] < 1e-13
    square = [n for n in range(len(residuals) - 1) if 1e-7 < residuals[n] < 0.03]
    assert square
    assert all(residuals[n + 1] < 5.0 * residuals[n] ** 2 for n in square)
    assert [i.number for i in found.history] == list(range(len(found.history)))
    assert all(i.residual >= i.largest for i in found.history)


def test_one_newton_step_by_hand():
    """A body drawn 0.3 m away from its pin: first residual, name of its row, and the step that closes the pin."""
    body = Body(
        "b", 1.0, np.array([0.1, 0.2, 0.3]), np.diag([0.1, 0.2, 0.25]), Frame(np.array([0.0, 0.3, 0.0]), np.eye(3))
    )
    mechanism = Mechanism("pin", DOWN, (body,), (Joint("pin", "revolute", GROUND, "b", ORIGIN, ORIGIN),))
    history = assemble_with_history(mechanism, drawing_state(mechanism)).history
    assert [(i.worst, i.residual, i.step, i.scale) for i in history[:1]] == [
        ("joint 'pin', constraint Y", 0.3, 0.0, 1.0)
    ]
    assert (history[1].step, history[1].scale) == (pytest.approx(0.3, rel=1e-14), 1.0)
    assert history[1].residual < 1e-15


def test_long_steps_are_shortened_and_say_so():
    """A radius of gyration of 1 m is the characteristic length: the body, 4 m away, comes nearer by 1 m a step."""
    body = Body("b", 1.0, np.zeros(3), np.diag([0.5, 0.7, 1.0]), Frame(np.array([0.0, 4.0, 0.0]), np.eye(3)))
    mechanism = Mechanism("pin", DOWN, (body,), (Joint("pin", "revolute", GROUND, "b", ORIGIN, ORIGIN),))
    history = assemble_with_history(mechanism, drawing_state(mechanism)).history
    assert [i.scale for i in history[1:4]] == pytest.approx([1 / 4, 1 / 3, 1 / 2])
    assert [i.residual for i in history[:5]] == pytest.approx([4.0, 3.0, 2.0, 1.0, 0.0], abs=1e-14)


def test_a_failed_assembly_keeps_its_history():
    mechanism = four_bar()
    found = assemble_with_history(mechanism, drawing_state(mechanism), {"j0": {"angle": 0.2}, "j3": {"angle": 2.0}})
    assert isinstance(found.failure, CannotAssemble)
    assert len(found.history) == 31
    assert found.history[-1].worst in str(found.failure)
    with pytest.raises(CannotAssemble):
        assemble_positions(
            mechanism,
            drawing_state(mechanism),
            [(mechanism.joints[0], "angle", 0.2), (mechanism.joints[3], "angle", 2.0)],
        )
    with pytest.raises(InvalidInput, match="no joint 'j9'"):
        assemble_with_history(mechanism, drawing_state(mechanism), {"j9": {"angle": 0.0}})
