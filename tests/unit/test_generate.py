"""Random mechanisms: assembled in the drawing, physically possible, reproducible, with every element and joint kind."""

from collections import Counter

import numpy as np
import pytest

from consilience.audit.random_mechanisms import GAP, LINKAGES, MOST_BODIES, random_mechanism
from consilience.mechanism import (
    GROUND,
    JOINT_KINDS,
    check_inertia,
    constraint_jacobian,
    constraint_rates,
    constraint_residual,
    drawing_state,
    free_directions,
    initial_state,
    random_states,
)

SEEDS = range(1, 201)

ELEMENTS = {
    *("spring", "joint spring", "load", "actuator", "load in time", "friction", "control"),
    *("drive", "coupling", "rolling", "skate"),
}


@pytest.fixture(scope="module")
def mechanisms():
    return [random_mechanism(seed) for seed in SEEDS]


def test_every_joint_kind_and_element_occurs(mechanisms):
    features = Counter(feature for mechanism in mechanisms for feature in mechanism.features)
    assert set(features) == {f"{kind} joint" for kind in JOINT_KINDS} | ELEMENTS
    assert min(features.values()) >= 10
    assert {len(mechanism.bodies) for mechanism in mechanisms} == set(range(1, MOST_BODIES + 1))


def test_every_element_occurs_in_every_variety(mechanisms):
    found = Counter()
    for m in mechanisms:
        found.update(f"{load.kind} {load.frame}" for load in m.loads)
        found.update("disc" if r.rounding == 0 else "ball" if r.radius == 0 else "torus" for r in m.rollings)
        found.update(f"spring from {GROUND}" for s in m.springs if GROUND in (s.predecessor, s.successor))
        found.update("gear" if c.law.table is None else "cam" for c in m.couplings)
        found.update(f"drive {d.coordinate}" for d in m.drives)
    kinds = {f"{kind} {frame}" for kind in ("force", "torque") for frame in ("world", "body")}
    kinds |= {"disc", "ball", "torus", f"spring from {GROUND}", "gear", "cam", "drive angle", "drive distance"}
    assert set(found) == kinds


def test_half_of_them_have_only_what_every_formulation_knows(mechanisms):
    more = {"actuator", "load in time", "friction", "control", "drive", "coupling", "rolling", "skate"}
    plain = sum(not more & set(m.features) for m in mechanisms)
    assert 0.4 * len(mechanisms) < plain < 0.75 * len(mechanisms)


def test_trees_branch_close_and_are_listed_in_any_order(mechanisms):
    loops = Counter(len(m.joints) - len(m.bodies) for m in mechanisms)
    assert {0, 1, 2, 3} <= set(loops)
    names = [[b.name for b in m.bodies] for m in mechanisms if len(m.bodies) > 3]
    assert sum(listed != sorted(listed, key=lambda name: int(name[1:])) for listed in names) > 0.9 * len(names)
    on_ground = [j for m in mechanisms for j in m.joints if GROUND in (j.predecessor, j.successor)]
    assert 0.25 < np.mean([j.successor == GROUND for j in on_ground]) < 0.55
    degrees = [Counter(body for j in m.joints for body in (j.predecessor, j.successor)) for m in mechanisms]
    assert max(max(count.values()) for count in degrees) >= 4


def test_dependent_rows_occur_with_a_clear_rank(mechanisms):
    redundant = 0
    for m in mechanisms:
        Q = constraint_jacobian(m, drawing_state(m))
        if len(Q):
            singular = np.linalg.svd(Q, compute_uv=False)
            singular /= singular[0]
            assert not np.any((singular > 1e-11) & (singular < GAP / 2)), m.name
            redundant += len(Q) > np.sum(singular > GAP / 2)
    assert redundant > 0.1 * len(mechanisms)


def test_planar_and_spherical_linkages_have_three_dependent_rows_and_move():
    """Four-bars with parallel or concurrent axes: 3 x 6 - 4 x 5 = -2 by Gruebler-Kutzbach, and still one freedom."""
    shapes = Counter()
    for seed in SEEDS:
        m = random_mechanism(seed, bodies=3)
        kinds = sorted(j.kind for j in m.joints)
        known = [sorted(joints) for joints in LINKAGES.values()]
        bare = not (m.drives or m.couplings or m.rollings or m.skates)
        if kinds in known and bare and _ring(m):
            rank = constraint_jacobian(m, drawing_state(m)).shape[1] - free_directions(m, drawing_state(m)).shape[1]
            assert (m.constraint_count(), rank) == (20, 17)
            shapes[_shape(m)] += 1
    assert set(shapes) == set(LINKAGES)


def _ring(m):
    """Return whether the joints form one loop through all bodies and the ground."""
    return all(count == 2 for count in Counter(b for j in m.joints for b in (j.predecessor, j.successor)).values())


def _shape(m):
    axes = [_axis(m, j) for j in m.joints]
    if any(j.kind == "prismatic" for j in m.joints):
        return "slider"
    return "planar" if np.linalg.norm(np.cross(axes[0], axes[1])) < 1e-12 else "spherical"


def _axis(m, joint):
    if joint.predecessor == GROUND:
        return joint.F.R[:, 2]
    return m.bodies[m.body_index[joint.predecessor]].drawing.R @ joint.F.R[:, 2]


def test_random_mechanisms_are_assembled_possible_and_free_to_move(mechanisms):
    for m in mechanisms:
        state = drawing_state(m)
        assert np.max(np.abs(constraint_residual(m, state)), initial=0.0) < 1e-12, m.name
        assert free_directions(m, state).shape[1] >= 1, m.name
        for body in m.bodies:
            check_inertia(body.inertia, body.name)
            assert np.linalg.norm(body.com) > 1e-3, m.name
            assert np.min(np.abs(body.inertia)) > 0.0, m.name
        moving = initial_state(m)
        v = np.hstack([moving.v_WB_W, moving.w_WB_W]).ravel()
        np.testing.assert_allclose(
            constraint_jacobian(m, moving) @ v, constraint_rates(m), rtol=0, atol=1e-10, err_msg=m.name
        )


def test_the_same_seed_gives_the_same_mechanism_and_another_seed_another():
    first, again, other = random_mechanism(12), random_mechanism(12), random_mechanism(13)
    assert [j.kind for j in first.joints] == [j.kind for j in again.joints]
    assert first.features == again.features
    np.testing.assert_array_equal([j.F.p for j in first.joints], [j.F.p for j in again.joints])
    np.testing.assert_array_equal([b.inertia for b in first.bodies], [b.inertia for b in again.bodies])
    assert not np.array_equal(first.gravity, other.gravity)


def test_the_number_of_bodies_can_be_asked_for():
    assert [len(random_mechanism(seed, bodies=5).bodies) for seed in range(4)] == [5] * 4


@pytest.mark.parametrize("seed", [1, 11, 12, 14])
def test_random_states_are_consistent(seed):
    m = random_mechanism(seed)
    for state in random_states(m, initial_state(m), 2, seed):
        assert np.max(np.abs(constraint_residual(m, state)), initial=0.0) < 1e-11
