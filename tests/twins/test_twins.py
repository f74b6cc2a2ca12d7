"""Twins: two descriptions of one mechanism must give the same accelerations, reactions and motions.

A twin is a second mechanism with two maps: of a state of the first mechanism to the same state of the second, and of
accelerations of the first to those of the second. Accelerations must agree to 1e-11, motions to 1e-9.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from consilience.mechanism import (
    GROUND,
    Body,
    Frame,
    Joint,
    Mechanism,
    State,
    determinate_reactions,
    joint_frames,
    quaternion_from_rotation,
    quaternion_product,
    rotation_angle_between,
    skew,
)
from consilience.reference import accelerations, simulate
from consilience.reference.formulations.compiled_choice import FORMULATIONS
from mechanisms import LOOPS, TREES, chain, drawn_joint, four_bar, lumpy_body, rotation, states_of
from reframing import arms, compose, in_frames, inverse, reframed, state_in_frames, symmetric

ALL = TREES | LOOPS
ORIGIN = Frame(np.zeros(3), np.eye(3))
TURN = rotation(np.random.default_rng(51))


@dataclass(frozen=True)
class Twin:
    first: Mechanism
    second: Mechanism
    state: Callable[[State], State]
    acceleration: Callable[[State, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]] = lambda s, a, alpha: (
        a,
        alpha,
    )
    time: float = 1.0


def rotated_world(mechanism: Mechanism) -> Twin:
    """World axes turned and the world origin moved; gravity, loads and the drawing are transformed with them."""
    new = Frame(np.array([0.3, -0.7, 1.1]), TURN)  # the new world in the old one
    back = inverse(new)
    turned = reframed(mechanism, GROUND, new)
    second = replace(
        turned,
        gravity=back.R @ mechanism.gravity,
        bodies=tuple(replace(b, drawing=compose(back, b.drawing)) for b in mechanism.bodies),
        loads=tuple(replace(x, vector=back.R @ x.vector) if x.frame == "world" else x for x in turned.loads),
    )
    quat = quaternion_from_rotation(back.R)

    def state(s):
        return State(
            s.p_WB @ back.R.T + back.p, quaternion_product(quat, s.quat_WB), s.v_WB_W @ back.R.T, s.w_WB_W @ back.R.T
        )

    return Twin(mechanism, second, state, lambda s, a, alpha: (a @ back.R.T, alpha @ back.R.T))


def moved_origins(mechanism: Mechanism) -> Twin:
    """The frame of every body moved and turned in the body."""
    rng = np.random.default_rng(52)
    offsets = [Frame(rng.normal(scale=0.4, size=3), rotation(rng)) for _ in mechanism.bodies]

    def acceleration(s, a, alpha):
        r = arms(s, offsets)
        return a + np.cross(alpha, r) + np.cross(s.w_WB_W, np.cross(s.w_WB_W, r)), alpha

    return Twin(mechanism, in_frames(mechanism, offsets), lambda s: state_in_frames(s, offsets), acceleration)


def reordered(mechanism: Mechanism) -> Twin:
    """Bodies, joints and force elements listed in another order."""
    order = np.random.default_rng(53).permutation(len(mechanism.bodies))
    second = replace(
        mechanism,
        bodies=tuple(mechanism.bodies[k] for k in order),
        joints=mechanism.joints[::-1],
        joint_springs=mechanism.joint_springs[::-1],
        loads=mechanism.loads[::-1],
    )
    return Twin(
        mechanism,
        second,
        lambda s: State(s.p_WB[order], s.quat_WB[order], s.v_WB_W[order], s.w_WB_W[order]),
        lambda s, a, alpha: (a[order], alpha[order]),
    )


L, T, M = 3.0, 0.5, 7.0
FORCE, TORQUE = M * L / T**2, M * L**2 / T**2


def other_units(mechanism: Mechanism) -> Twin:
    """Other units: a third of a metre, two seconds, a seventh of a kilogram."""

    def frame(f):
        return Frame(L * f.p, f.R)

    second = replace(
        mechanism,
        gravity=mechanism.gravity * L / T**2,
        bodies=tuple(
            Body(b.name, M * b.mass, L * b.com, M * L**2 * b.inertia, frame(b.drawing)) for b in mechanism.bodies
        ),
        joints=tuple(replace(j, F=frame(j.F), M=frame(j.M), length=L * j.length) for j in mechanism.joints),
        springs=tuple(
            replace(
                s,
                point_predecessor=L * s.point_predecessor,
                point_successor=L * s.point_successor,
                stiffness=s.stiffness * FORCE / L,
                damping=s.damping * FORCE * T / L,
                free_length=s.free_length * L,
            )
            for s in mechanism.springs
        ),
        joint_springs=tuple(_joint_spring_in_units(s) for s in mechanism.joint_springs),
        loads=tuple(
            replace(x, vector=x.vector * (FORCE if x.kind == "force" else TORQUE), point=L * x.point)
            for x in mechanism.loads
        ),
    )
    return Twin(
        mechanism,
        second,
        lambda s: State(L * s.p_WB, s.quat_WB, s.v_WB_W * L / T, s.w_WB_W / T),
        lambda s, a, alpha: (a * L / T**2, alpha / T**2),
        time=T,
    )


def _joint_spring_in_units(s):
    length = L if s.coordinate == "distance" else 1.0
    effort = FORCE if s.coordinate == "distance" else TORQUE
    return replace(
        s,
        stiffness=s.stiffness * effort / length,
        damping=s.damping * effort * T / length,
        rest=s.rest * length,
        higher_stiffness=tuple(k * effort / length**n for n, k in enumerate(s.higher_stiffness, start=2)),
        higher_damping=tuple(c * effort * (T / length) ** n for n, c in enumerate(s.higher_damping, start=2)),
    )


Z_TO_X = np.array([[0.0, 0, 1], [0, -1, 0], [1, 0, 0]])  # columns z, -y, x: exchanges the axes x and z


def swapped(mechanism: Mechanism) -> Twin:
    """Predecessor and successor of every joint exchanged; coordinates, rests of joint springs and k1 change sign.

    A universal joint turns about z of F, then about x of M: an exchange of the sides also exchanges these axes.
    """
    joints = []
    for j in mechanism.joints:
        turn = Z_TO_X if j.kind == "universal" else np.eye(3)
        F, M_ = Frame(j.M.p, j.M.R @ turn), Frame(j.F.p, j.F.R @ turn)
        joints.append(Joint(j.name, j.kind, j.successor, j.predecessor, F, M_, j.length))
    springs = tuple(
        replace(s, rest=-s.rest, higher_stiffness=tuple(-k if n == 0 else k for n, k in enumerate(s.higher_stiffness)))
        for s in mechanism.joint_springs
    )
    return Twin(mechanism, replace(mechanism, joints=tuple(joints), joint_springs=springs), lambda s: s)


DESCRIPTIONS = (rotated_world, moved_origins, reordered, other_units, swapped)


def merged(mechanism: Mechanism) -> Twin:
    """The two bodies of the rigid joint merged: masses add, inertias add by the parallel axis theorem."""
    (joint,) = (j for j in mechanism.joints if j.kind == "rigid")
    a, b = (mechanism.bodies[mechanism.body_index[n]] for n in (joint.predecessor, joint.successor))
    pose = compose(joint.F, inverse(joint.M))  # of b in a
    mass = a.mass + b.mass
    parts = [(a.mass, a.com, a.inertia), (b.mass, pose.p + pose.R @ b.com, pose.R @ b.inertia @ pose.R.T)]
    com = sum(m * c for m, c, _ in parts) / mass
    inertia = sum(I - m * skew(c - com) @ skew(c - com) for m, c, I in parts)
    one = replace(a, mass=mass, com=com, inertia=symmetric(inertia))
    moved = reframed(mechanism, b.name, inverse(pose))
    joints = tuple(
        replace(
            j,
            predecessor=a.name if j.predecessor == b.name else j.predecessor,
            successor=a.name if j.successor == b.name else j.successor,
        )
        for j in moved.joints
        if j is not moved.joints[mechanism.joint_index[joint.name]]
    )
    bodies = tuple(one if x is a else x for x in mechanism.bodies if x is not b)
    keep = [k for k, x in enumerate(mechanism.bodies) if x is not b]
    return Twin(
        mechanism,
        replace(moved, bodies=bodies, joints=joints),
        lambda s: State(s.p_WB[keep], s.quat_WB[keep], s.v_WB_W[keep], s.w_WB_W[keep]),
        lambda s, acc, alpha: (acc[keep], alpha[keep]),
    )


def assert_same_accelerations(twin: Twin, formulation: str, count: int = 3) -> None:
    states = states_of(twin.first, count)
    one = accelerations(twin.first, states, formulation)
    two = accelerations(twin.second, [twin.state(s) for s in states], formulation)
    for n, s in enumerate(states):
        expected = np.hstack(twin.acceleration(s, one.a_WB_W[n], one.alpha_WB_W[n]))
        found = np.hstack([two.a_WB_W[n], two.alpha_WB_W[n]])
        assert np.max(np.abs(found - expected)) < 1e-11 * np.max(np.abs(expected))


def last_state(mechanism, state, duration, formulation="descriptor"):
    answer = simulate(mechanism, state, np.array([0.0, duration]), 1e-13, formulation)
    return State(*(getattr(answer, n)[-1] for n in ("p_WB", "quat_WB", "v_WB_W", "w_WB_W")))


def assert_same_motion(twin: Twin, duration: float = 0.5) -> None:
    start = states_of(twin.first)[0]
    expected = twin.state(last_state(twin.first, start, duration))
    found = last_state(twin.second, twin.state(start), duration * twin.time)
    size = np.max(np.abs(expected.p_WB))
    assert np.max(np.abs(found.p_WB - expected.p_WB)) < 1e-9 * size
    assert np.max(rotation_angle_between(found.quat_WB, expected.quat_WB)) < 1e-9
    speed = max(np.max(np.abs(expected.v_WB_W)), np.max(np.abs(expected.w_WB_W)))
    assert np.max(np.abs(found.v_WB_W - expected.v_WB_W)) < 1e-8 * speed


ONE_SIDED = {"point_on_line", "point_in_plane"}
"""Joint kinds whose line or plane belongs to the predecessor: with the sides exchanged they are other joints."""


def two_sided(mechanisms):
    return [name for name, m in mechanisms.items() if not ONE_SIDED & {j.kind for j in m.joints}]


@pytest.mark.parametrize(
    ("name", "describe"), [(name, d) for d in DESCRIPTIONS for name in (two_sided(ALL) if d is swapped else ALL)]
)
def test_another_description_has_the_same_accelerations(name, describe):
    assert_same_accelerations(describe(ALL[name]), "descriptor")


def test_only_the_one_sided_joints_have_no_exchanged_twin():
    left_out = ALL.keys() - set(two_sided(ALL))
    assert {j.kind for name in left_out for j in ALL[name].joints} >= ONE_SIDED
    assert len(left_out) == 2 * len(ONE_SIDED)


@pytest.mark.parametrize("describe", DESCRIPTIONS)
@pytest.mark.parametrize("name", ["forced_chain", "hardening_chain", "four_bar", "loop_rod", "branched"])
def test_another_description_moves_the_same(name, describe):
    assert_same_motion(describe(ALL[name]))


@pytest.mark.parametrize("name", ["rigid_between", "backward_rigid"])
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_two_bodies_welded_together_are_one(name, formulation):
    twin = merged(ALL[name])
    assert len(twin.second.bodies) == len(twin.first.bodies) - 1
    assert_same_accelerations(twin, formulation)


def test_two_bodies_welded_together_move_as_one():
    assert_same_motion(merged(ALL["rigid_between"]))


@pytest.mark.parametrize(
    "name", ["long_chain", "forced_chain", "branched", "slider_crank", "loop_universal", "loop_rod"]
)
def test_the_two_formulations_move_the_same(name):
    mechanism = ALL[name]
    start = states_of(mechanism)[0]
    one, two = (last_state(mechanism, start, 0.5, f) for f in FORMULATIONS)
    assert np.max(np.abs(one.p_WB - two.p_WB)) < 1e-9 * np.max(np.abs(one.p_WB))
    assert np.max(rotation_angle_between(one.quat_WB, two.quat_WB)) < 1e-9


# ---------------------------------------------------------------- reactions


def wrench_in_world(mechanism, state, answer, n, k):
    """Force on the successor and its torque about the world origin."""
    joint = mechanism.joints[k]
    f = joint_frames(mechanism, state, joint)
    at = f.s_j + (0 if joint.successor == GROUND else state.p_WB[mechanism.body_index[joint.successor]])
    force = f.U @ answer.force_F[n, k]
    return np.concatenate([force, f.U @ answer.torque_F[n, k] + np.cross(at, force)])


@pytest.mark.parametrize("name", two_sided(TREES))
def test_reactions_of_exchanged_sides_are_action_and_reaction(name):
    """All reactions of a tree are determined. Reversed, the wrench has the opposite sign about the same world point."""
    twin = swapped(TREES[name])
    states = states_of(twin.first, 3)
    one, two = accelerations(twin.first, states), accelerations(twin.second, states)
    size = max(np.max(np.abs(one.force_F)), np.max(np.abs(one.torque_F)), 1e-3)
    for n, s in enumerate(states):
        for k in range(len(twin.first.joints)):
            action = wrench_in_world(twin.first, s, one, n, k)
            reaction = wrench_in_world(twin.second, s, two, n, k)
            np.testing.assert_allclose(reaction, -action, rtol=0, atol=1e-10 * size)


@pytest.mark.parametrize("describe", [rotated_world, moved_origins])
@pytest.mark.parametrize("name", ["long_chain", "forced_chain", "four_bar", "loop_rod"])
def test_reactions_do_not_see_the_frames_of_world_and_bodies(name, describe):
    twin = describe(ALL[name])
    states = states_of(twin.first, 3)
    one = accelerations(twin.first, states)
    two = accelerations(twin.second, [twin.state(s) for s in states])
    for n, s in enumerate(states):
        known = determinate_reactions(twin.first, s)
        np.testing.assert_array_equal(known, determinate_reactions(twin.second, twin.state(s)))
        a, b = (np.hstack([x.force_F[n], x.torque_F[n]])[known] for x in (one, two))
        assert np.max(np.abs(a - b)) < 1e-10 * np.max(np.abs(a))


# ---------------------------------------------------------------- joints made of other joints


def doubled(kind: str) -> tuple[tuple[str, np.ndarray, np.ndarray], ...]:
    """Joints (kind, origin, axes in the frame of the joint they replace) that together allow the same motion."""
    one, along = np.eye(3), np.array([0, 0, 0.4])
    turn_y = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    return {
        "revolute": (("cylindrical", along, one), ("spherical", 0 * along, one)),
        "prismatic": (("cylindrical", 0 * along, one), ("cylindrical", np.array([0.3, 0.2, 0.0]), one)),
        "rigid": (("revolute", 0 * along, one), ("revolute", along, turn_y)),
        "cylindrical": (("cylindrical", 0 * along, one), ("cylindrical", along, one)),
        "spherical": (("spherical", 0 * along, one), ("spherical", 0 * along, turn_y)),
    }[kind]


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("kind", ["revolute", "prismatic", "rigid", "cylindrical", "spherical"])
def test_a_joint_is_what_two_joints_together_allow(kind, formulation):
    """The pair of joints may be redundant; together they allow the same motion as the single joint."""
    first = chain("revolute", kind, "universal", seed=54)
    joint = first.joints[1]
    parts = [
        replace(joint, name=f"part{n}", kind=k, F=compose(joint.F, Frame(p, R)), M=compose(joint.M, Frame(p, R)))
        for n, (k, p, R) in enumerate(doubled(kind))
    ]
    second = replace(first, joints=(first.joints[0], *parts, first.joints[2]))
    assert_same_accelerations(Twin(first, second, lambda s: s), formulation)


def test_six_rods_hold_a_body_as_a_weld_does():
    """Six rods in general position: six independent rows, none of them equal to a row of the weld."""
    rng = np.random.default_rng(55)
    bodies = {n: lumpy_body(n, rng) for n in ("a", "b")}
    hinge = drawn_joint("hinge", "revolute", bodies, GROUND, "a", rng.normal(size=3), rotation(rng))
    weld = drawn_joint("weld", "rigid", bodies, "a", "b", rng.normal(size=3), rotation(rng))
    rods = [
        drawn_joint(f"rod{n}", "rod", bodies, "a", "b", rng.normal(size=3), np.eye(3), rng.normal(size=3))
        for n in range(6)
    ]
    gravity = np.array([0.0, 0.0, -9.81])
    first = Mechanism("weld", gravity, tuple(bodies.values()), (hinge, weld))
    second = replace(first, joints=(hinge, *rods))
    for formulation in FORMULATIONS:
        assert_same_accelerations(Twin(first, second, lambda s: s), formulation)


@pytest.mark.parametrize("closing", ["spherical", "cylindrical"])
def test_a_planar_linkage_moves_the_same_whatever_holds_it_in_its_plane(closing):
    """Three parallel hinges keep all bodies in the plane, so that the fourth joint may be a ball or a sleeve.

    Reaction forces in the plane agree as well.
    """
    twin = Twin(four_bar(), four_bar(closing=closing), lambda s: s)
    assert_same_accelerations(twin, "descriptor")
    states = states_of(twin.first, 3)
    one, two = accelerations(twin.first, states), accelerations(twin.second, states)
    for n in range(3):
        in_plane = one.force_F[n][:, :2]
        assert np.max(np.abs(two.force_F[n][:, :2] - in_plane)) < 1e-10 * np.max(np.abs(in_plane))


def test_a_spring_is_the_same_from_either_end():
    first = TREES["forced_chain"]
    turned = tuple(
        replace(
            s,
            predecessor=s.successor,
            successor=s.predecessor,
            point_predecessor=s.point_successor,
            point_successor=s.point_predecessor,
        )
        for s in first.springs
    )
    assert_same_accelerations(Twin(first, replace(first, springs=turned), lambda s: s), "descriptor")


def test_a_force_on_a_body_is_the_same_at_any_point_of_its_line():
    first = TREES["forced_chain"]
    slid = tuple(
        replace(x, point=x.point + 0.7 * x.vector) if (x.kind, x.frame) == ("force", "body") else x for x in first.loads
    )
    assert_same_accelerations(Twin(first, replace(first, loads=slid), lambda s: s), "descriptor")
