"""Condition numbers of the equations of motion: closed forms, and invariance under units."""

from dataclasses import replace

import numpy as np
import pytest

from consilience.audit.random_mechanisms import Recipe, random_mechanism
from consilience.mechanism import (
    GROUND,
    Body,
    Frame,
    Joint,
    Mechanism,
    SpherePlane,
    characteristic_length,
    constraint_jacobian,
    drawing_state,
    initial_state,
    random_states,
    rotation_from_quaternion,
    skew,
    worst_condition,
)
from consilience.mechanism.conditioning import (
    delassus_condition,
    free_condition,
    joint_space_condition,
    mass_matrix_condition,
)
from contact_problems import Lab

E = np.eye(3)


def body(name, at, mass=1.0, inertia=0.1):
    return Body(name, mass, np.zeros(3), inertia * E, Frame(np.array(at, dtype=float), E))


def joint(name, kind, i, j, bodies, at, axes=E):
    place = {GROUND: np.zeros(3)} | {b.name: b.drawing.p for b in bodies}
    return Joint(name, kind, i, j, Frame(at - place[i], axes), Frame(at - place[j], axes))


def straight_chain(count, length=1.0, mass=2.0, inertia=0.3):
    """Return equal bodies in a row along x, hinges along z at both ends of each, mass centres half way."""
    bodies = tuple(body(f"b{n}", [(n + 0.5) * length, 0, 0], mass, inertia) for n in range(count))
    names = [GROUND, *(b.name for b in bodies)]
    joints = tuple(
        joint(f"j{n}", "revolute", names[n], names[n + 1], bodies, np.array([n * length, 0.0, 0.0]))
        for n in range(count)
    )
    return Mechanism("chain", np.zeros(3), bodies, joints)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_a_straight_chain_has_the_inertia_of_the_textbook(count):
    """H_ij = sum of I + m r_ki r_kj over the bodies k outboard of both hinges, with r_ki = (k + 1/2 - i) length."""
    length, m, inertia = 0.8, 2.0, 0.3
    mechanism = straight_chain(count, length, m, inertia)
    H = np.zeros((count, count))
    for i in range(count):
        for j in range(count):
            for k in range(max(i, j), count):
                H[i, j] += inertia + m * (k + 0.5 - i) * (k + 0.5 - j) * length**2
    d = 1.0 / np.sqrt(np.diag(H))
    found = joint_space_condition(mechanism, drawing_state(mechanism))
    assert found == pytest.approx(np.linalg.cond(d[:, None] * H * d), rel=1e-10)


def test_the_longer_a_chain_the_worse_its_joint_coordinates_and_no_worse_its_constraints():
    chains = [straight_chain(n) for n in (3, 6, 12, 24)]
    in_joints = [joint_space_condition(m, drawing_state(m)) for m in chains]
    ratios = np.array(in_joints[1:]) / in_joints[:-1]
    assert np.all(ratios > 8.0)  # growth with the fourth power of the number of bodies
    assert free_condition(chains[-1], drawing_state(chains[-1])) < 1e4 < in_joints[-1]


def test_a_chain_of_one_joint_is_as_well_conditioned_as_can_be():
    mechanism = straight_chain(1)
    assert joint_space_condition(mechanism, drawing_state(mechanism)) == 1.0


@pytest.mark.parametrize("ratio", [1.0, 1e3, 1e6])
def test_heavy_bodies_that_do_not_move_spoil_free_directions(ratio):
    """A body of unit inertia on a hinge through its mass centre, and a heavy body welded to the ground."""
    bodies = (body("light", [0, 0, 0], 1.0, 1.0), body("heavy", [0, 0, 0], ratio, ratio))
    joints = (
        joint("j", "revolute", GROUND, "light", bodies, np.zeros(3)),
        joint("k", "rigid", GROUND, "heavy", bodies, np.zeros(3)),
    )
    mechanism = Mechanism("pair", np.zeros(3), bodies, joints)
    assert free_condition(mechanism, drawing_state(mechanism)) == pytest.approx(ratio, rel=1e-12)
    assert mass_matrix_condition(mechanism, drawing_state(mechanism)) == pytest.approx(1.0)


def test_condition_numbers_are_those_of_dense_matrices():
    """Condition numbers from dense matrices in characteristic lengths, assembled here, with eigenvalues of NumPy."""
    mechanism = random_mechanism(3, 5, Recipe(plain=True))
    state = random_states(mechanism, initial_state(mechanism), 1, 7)[0]
    R = rotation_from_quaternion(state.quat_WB)
    M = np.zeros((30, 30))
    for i, b in enumerate(mechanism.bodies):
        S = skew(R[i] @ b.com)
        block = [[b.mass * E, -b.mass * S], [b.mass * S, R[i] @ b.inertia @ R[i].T - b.mass * S @ S]]
        M[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] = np.block(block)
    sizes = np.tile(np.repeat([characteristic_length(mechanism), 1.0], 3), 5)
    M, Q = sizes[:, None] * M * sizes, constraint_jacobian(mechanism, state) * sizes
    A = Q @ np.linalg.solve(M, Q.T)
    d = 1.0 / np.sqrt(np.diag(A))
    eigenvalues = np.linalg.eigvalsh(d[:, None] * A * d)
    kept = eigenvalues[eigenvalues > 1e-12 * eigenvalues[-1]]
    assert delassus_condition(mechanism, state) == pytest.approx(kept[-1] / kept[0], rel=1e-8)
    N = np.linalg.svd(Q)[2][len(kept) :].T
    least = np.linalg.eigvalsh(N.T @ M @ N)[0]
    assert free_condition(mechanism, state) == pytest.approx(np.linalg.eigvalsh(M)[-1] / least, rel=1e-8)


@pytest.mark.parametrize("angle", [0.9, 0.1, 1e-3])
def test_nearly_parallel_contacts_are_near_singular(angle):
    """Two smooth planes touch a ball about its centre of mass: unit normals n, m have A = [[1, n.m], [n.m, 1]]."""
    lab, radius = Lab(), 0.2
    normals = lab.axes @ np.array([[np.sin(s * 0.5 * angle), 0.0, np.cos(0.5 * angle)] for s in (-1.0, 1.0)]).T
    planes = [
        SpherePlane(f"plane {k}", "body", lab.com, radius, GROUND, lab.com - radius * n, n)
        for k, n in enumerate(normals.T)
    ]
    mechanism = lab.free_body(2.0, (0.03, 0.04, 0.05), (0.0, 0.0, -9.81), planes)
    found = delassus_condition(mechanism, drawing_state(mechanism))
    assert found == pytest.approx(1.0 / np.tan(0.5 * angle) ** 2, rel=1e-6)


@pytest.mark.parametrize("flat", [1e-1, 1e-2])
def test_the_flatter_a_linkage_the_worse_its_constraints(flat):
    def condition(f):
        mechanism = random_mechanism(5, 3, Recipe(("revolute", "prismatic", "spherical"), True, linkages=1.0, flat=f))
        assert len(mechanism.joints) == 4
        return delassus_condition(mechanism, drawing_state(mechanism))

    assert condition(0.1 * flat) > 30.0 * condition(flat)


@pytest.mark.parametrize("seed", [2, 5, 9])
def test_units_do_not_matter_to_joints_and_constraints(seed):
    """Multiplying all masses by 1000 changes no condition number."""
    mechanism = random_mechanism(seed, 4, Recipe(tuple(k for k in Recipe().kinds if k != "screw"), plain=True))
    heavier = replace(
        mechanism, bodies=tuple(replace(b, mass=1e3 * b.mass, inertia=1e3 * b.inertia) for b in mechanism.bodies)
    )
    state = random_states(mechanism, initial_state(mechanism), 1, 7)[0]
    for condition in (joint_space_condition, delassus_condition, free_condition):
        assert condition(heavier, state) == pytest.approx(condition(mechanism, state), rel=1e-9)


def test_a_screw_has_no_joint_space_and_the_others_count():
    bodies = (body("b", [0.0, 0.0, 0.0]),)
    screw = replace(joint("j", "revolute", GROUND, "b", bodies, np.zeros(3)), kind="screw", pitch=0.2)
    mechanism = Mechanism("screw", np.zeros(3), bodies, (screw,))
    state = drawing_state(mechanism)
    assert worst_condition(mechanism, state) == max(
        free_condition(mechanism, state), delassus_condition(mechanism, state)
    )
