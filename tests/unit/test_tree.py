"""The tree of elementary joints: its forward kinematics reproduces the poses of the mechanism."""

import numpy as np
import pytest

from consilience.mechanism import (
    constraint_jacobian,
    constraint_residual,
    coordinates,
    elementary_rotation,
    rotation_from_quaternion,
    to_elementary_tree,
)
from mechanisms import LOOPS, TREES, states_of

ALL = TREES | LOOPS


def forward_kinematics(tree, coords):
    """Return world pose and twist (w, velocity of the link's origin) of every link."""
    result = []
    for link, c in zip(tree.links, coords, strict=True):
        R, p, w, v = (np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3)) if link.parent < 0 else result[link.parent]
        R_J, p_J = R @ link.placement.R, p + R @ link.placement.p
        v_J = v + np.cross(w, p_J - p)
        if link.elementary == "R":
            R_L, p_L, w_L, v_L = R_J @ elementary_rotation(2, c.q), p_J, w + R_J[:, 2] * c.rate, v_J
        elif link.elementary == "P":
            slide = R_J[:, 2] * c.q
            R_L, p_L, w_L, v_L = R_J, p_J + slide, w, v_J + np.cross(w, slide) + R_J[:, 2] * c.rate
        elif link.elementary == "W":
            R_L, p_L, w_L, v_L = R_J, p_J, w, v_J
        else:
            R_L = R_J @ rotation_from_quaternion(c.quat)
            slide = R_J @ (np.zeros(3) if c.p is None else c.p)
            p_L, w_L = p_J + slide, w + R_L @ c.w
            v_L = v_J + np.cross(w, slide) + R_J @ (np.zeros(3) if c.v is None else c.v)
        result.append((R_L, p_L, w_L, v_L))
    return result


@pytest.mark.parametrize("name", ALL)
def test_forward_kinematics_of_the_tree_gives_the_state_back(name):
    mechanism = ALL[name]
    tree = to_elementary_tree(mechanism)
    for state in states_of(mechanism):
        placed = forward_kinematics(tree, coordinates(mechanism, tree, state))
        for (R_L, p_L, w_L, v_L), link in zip(placed, tree.links, strict=True):
            if link.body < 0:
                continue
            arm = R_L @ link.body_frame.p
            np.testing.assert_allclose(p_L + arm, state.p_WB[link.body], atol=1e-12)
            R_WB = rotation_from_quaternion(state.quat_WB[link.body])
            np.testing.assert_allclose(R_L @ link.body_frame.R, R_WB, atol=1e-12)
            np.testing.assert_allclose(w_L, state.w_WB_W[link.body], atol=1e-11)
            np.testing.assert_allclose(v_L + np.cross(w_L, arm), state.v_WB_W[link.body], atol=1e-11)


@pytest.mark.parametrize("name", ALL)
def test_links_stand_depth_first_and_carry_the_whole_mass(name):
    mechanism = ALL[name]
    tree = to_elementary_tree(mechanism)
    open_path = [-1]
    for i, link in enumerate(tree.links):
        while open_path[-1] != link.parent:
            open_path.pop()  # IndexError: the links are not in depth-first order
        open_path.append(i)
    for b, body in enumerate(mechanism.bodies):
        assert sum(link.mass for link in tree.links if link.body == b) == pytest.approx(body.mass, rel=1e-15)
    assert len(tree.welds) == len(mechanism.joints) - len(mechanism.bodies)


@pytest.mark.parametrize("name", ALL)
def test_random_states_are_consistent(name):
    mechanism = ALL[name]
    for state in states_of(mechanism):
        velocity = np.hstack([state.v_WB_W, state.w_WB_W]).ravel()
        assert np.max(np.abs(constraint_residual(mechanism, state)), initial=0) < 1e-13
        assert np.max(np.abs(constraint_jacobian(mechanism, state) @ velocity), initial=0) < 1e-12
