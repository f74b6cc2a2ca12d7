"""Forward dynamics in joint coordinates against dense equations and Pinocchio, for one state and for many."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import truth
from consilience.errors import InvalidInput
from consilience.mechanism import GROUND, Mechanism, rotation_angle_between, rotation_from_quaternion
from consilience.mechanism.conditioning import mass_matrix_condition
from consilience.reference import ForwardDynamics
from consilience.reference.bodies.arrays import workspace
from consilience.reference.tree.arrays import flatten_relative, tree_system
from mechanisms import ELEMENTS, GRAVITY, LOOPS, TREES, chain, drawn_joint, lumpy_body, rotation, states_of

ALL = TREES | LOOPS | ELEMENTS
EPS = np.finfo(float).eps
FREE_TREE = chain("revolute", "spherical", "prismatic", "universal", "free", seed=3, backwards=(1, 3))


def relative(a, b):
    return np.max(np.abs(a - b)) / np.max(np.abs(b))


def drawn_states(dynamics, count, seed=0):
    """Return random coordinates and speeds of a tree."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=(count, dynamics.n_q)), rng.normal(size=(count, dynamics.n_v))


@pytest.mark.parametrize("name", ALL)
def test_body_accelerations_are_those_of_the_dense_equations(name):
    mechanism = ALL[name]
    dynamics = ForwardDynamics(mechanism)
    for state in states_of(mechanism, 3):
        a, alpha, _, _ = truth.solve(mechanism, state)
        bar = 1e-12 + 4 * EPS * mass_matrix_condition(mechanism, state)
        found = dynamics.body_accelerations(*dynamics.coordinates(state))
        expected = np.hstack([a, alpha])
        # rounding is relative to the largest term, gravity included
        assert np.max(np.abs(np.hstack(found) - expected)) < bar * max(10.0, np.max(np.abs(expected)))


@pytest.mark.parametrize("name", ALL)
def test_a_state_comes_back_from_its_coordinates(name):
    mechanism = ALL[name]
    dynamics = ForwardDynamics(mechanism)
    for state in states_of(mechanism, 2):
        found = dynamics.state(*dynamics.coordinates(state))
        assert np.max(rotation_angle_between(found.quat_WB, state.quat_WB)) < 1e-12
        for field in ("p_WB", "v_WB_W", "w_WB_W"):
            assert np.max(np.abs(getattr(found, field) - getattr(state, field))) < 1e-11, field


def branched_tree(count, seed):
    """Return a tree of random revolute and spherical joints, with each body on a random earlier one."""
    rng = np.random.default_rng(seed)
    bodies = {f"b{n}": lumpy_body(f"b{n}", rng) for n in range(count)}
    names, joints = [GROUND, *bodies], []
    for n in range(count):
        kind, on = ("revolute", "spherical")[int(rng.integers(2))], names[int(rng.integers(n + 1))]
        joints.append(drawn_joint(f"j{n}", kind, bodies, on, f"b{n}", rng.normal(size=3), rotation(rng)))
    return Mechanism("branched", GRAVITY, tuple(bodies.values()), tuple(joints))


def pinocchio_model(mechanism, joints):
    """Return the same tree in Pinocchio, with each joint at frame M."""
    model, number, end = pin.Model(), {GROUND: 0}, {GROUND: pin.SE3.Identity()}
    model.gravity.linear = mechanism.gravity
    for name in joints:
        joint = mechanism.joints[mechanism.joint_index[name]]
        body = mechanism.bodies[mechanism.body_index[joint.successor]]
        kind = {"revolute": pin.JointModelRZ, "spherical": pin.JointModelSpherical}[joint.kind]
        place = end[joint.predecessor] * pin.SE3(joint.F.R, joint.F.p)
        at = model.addJoint(number[joint.predecessor], kind(), place, name)
        to_body = pin.SE3(joint.M.R, joint.M.p).inverse()
        model.appendBodyToJoint(at, pin.Inertia(body.mass, body.com, body.inertia), to_body)
        number[joint.successor], end[joint.successor] = at, to_body
    return model


@pytest.mark.parametrize(("count", "seed"), [(2, 0), (7, 1), (20, 2), (60, 3)])
def test_accelerations_are_those_of_pinocchio(count, seed):
    """In Pinocchio, quaternions of ball joints have the scalar last, and angular velocities are in axes of M."""
    mechanism = branched_tree(count, seed)
    dynamics = ForwardDynamics(mechanism)
    model = pinocchio_model(mechanism, dynamics.joints)
    for q, v in zip(*drawn_states(dynamics, 3), strict=True):
        theirs_q, theirs_v, turns, at, n = [], [], [], 0, 0
        for name in dynamics.joints:
            if mechanism.joints[mechanism.joint_index[name]].kind == "revolute":
                theirs_q.append(q[at])
                theirs_v.append(v[n])
                turns.append(np.eye(1))
                at, n = at + 1, n + 1
            else:
                quat = q[at : at + 4] / np.linalg.norm(q[at : at + 4])
                turns.append(rotation_from_quaternion(quat))
                theirs_q += [*quat[1:], quat[0]]
                theirs_v += [*(turns[-1].T @ v[n : n + 3])]
                at, n = at + 4, n + 3
        theirs = pin.aba(model, model.createData(), np.array(theirs_q), np.array(theirs_v), np.zeros(n))
        parts = np.split(theirs, np.cumsum([len(R) for R in turns])[:-1])
        expected = np.concatenate([R @ part for R, part in zip(turns, parts, strict=True)])
        assert relative(dynamics.accelerations(q, v), expected) < 1e-12


@pytest.mark.parametrize("name", ["long_chain", "floating_chain", "four_bar", "forced_chain", "powered", "driven"])
def test_many_states_give_the_accelerations_of_single_states(name):
    mechanism = ALL[name]
    dynamics = ForwardDynamics(mechanism)
    pairs = [dynamics.coordinates(state) for state in states_of(mechanism, 5)]
    q, v = (np.array(x) for x in zip(*pairs, strict=True))
    one_by_one = np.array([dynamics.accelerations(*pair, t=0.3) for pair in pairs])
    for threads in (None, 1, 2, 3, 9):
        assert np.array_equal(dynamics.accelerations_of(q, v, t=0.3, threads=threads), one_by_one)
    assert dynamics.accelerations_of(q[:0], v[:0]).shape == (0, dynamics.n_v)


def test_sets_of_parameters_give_the_accelerations_of_their_mechanisms():
    rng = np.random.default_rng(8)

    def changed(mechanism):
        bodies = tuple(
            replace(b, mass=b.mass * rng.uniform(0.5, 2), com=b.com + 0.1 * rng.normal(size=3))
            for b in mechanism.bodies
        )
        joints = tuple(
            replace(j, F=replace(j.F, p=j.F.p + 0.2 * rng.normal(size=3), R=rotation(rng))) for j in mechanism.joints
        )
        return replace(mechanism, bodies=bodies, joints=joints, gravity=rng.normal(size=3))

    mechanisms = [changed(FREE_TREE) for _ in range(5)]
    dynamics = ForwardDynamics(FREE_TREE)
    q, v = drawn_states(dynamics, 5)
    before = dynamics.accelerations(q[0], v[0])
    expected = [ForwardDynamics(m).accelerations(*x) for m, *x in zip(mechanisms, q, v, strict=True)]
    assert relative(expected[0], before) > 1e-3
    parameters = dynamics.parameters(mechanisms)
    for threads in (1, 2):
        assert np.array_equal(dynamics.accelerations_of(q, v, parameters, threads=threads), expected)
    assert np.array_equal(dynamics.accelerations(q[0], v[0]), before)


def test_sets_of_parameters_are_of_the_same_tree():
    dynamics = ForwardDynamics(FREE_TREE)
    with pytest.raises(InvalidInput, match="its tree is not that of"):
        dynamics.parameters([chain("revolute", "spherical", "prismatic", "universal", "spherical", seed=3)])
    with pytest.raises(InvalidInput, match="loops or elements"):
        ForwardDynamics(ALL["four_bar"]).parameters([])
    q, v = drawn_states(dynamics, 2)
    with pytest.raises(InvalidInput, match="parameters"):
        dynamics.accelerations_of(q, v, dynamics.parameters([FREE_TREE]))


def test_any_number_type_is_accepted_and_wrong_shapes_are_refused():
    dynamics = ForwardDynamics(FREE_TREE)
    (q,), (v,) = drawn_states(dynamics, 1)
    found, strided = dynamics.accelerations(q, v), np.repeat(q, 2)[::2]
    assert np.array_equal(dynamics.accelerations(strided, v.tolist()), found)
    whole = np.ones(dynamics.n_q, dtype=int)
    assert np.array_equal(dynamics.accelerations(whole, v), dynamics.accelerations(whole.astype(float), v))
    out = np.empty(dynamics.n_v)
    assert dynamics.accelerations(q, v, out=out) is out
    assert np.array_equal(out, found)
    for wrong in ((q[1:], v), (q, v[1:]), (q[None], v[None])):
        with pytest.raises(InvalidInput, match="q, v"):
            dynamics.accelerations(*wrong)
    with pytest.raises(InvalidInput, match="out"):
        dynamics.accelerations(q, v, out=np.empty(2))
    with pytest.raises(InvalidInput, match="q, v"):
        dynamics.accelerations_of(q[None], v)


def all_bytes(arrays):
    return sum(all_bytes(x) if isinstance(x, tuple) else getattr(x, "nbytes", 0) for x in arrays)


def test_the_memory_of_a_chain_is_that_of_the_number_of_its_bodies():
    sizes = []
    for count in (20, 40):
        mechanism = chain(*["revolute"] * count)
        links, tree, model = flatten_relative(mechanism)
        sizes.append(all_bytes([links, tree, model, tree_system(mechanism, links, tree, model), workspace(tree.cut)]))
    assert sizes[1] < 2.05 * sizes[0]
