"""Kernels for mechanisms in parallel planes, against dense equations and the spatial kernels."""

from dataclasses import replace

import numpy as np
import pytest

import truth
from consilience.case import load_case
from consilience.mechanism import (
    State,
    constraint_jacobian,
    constraint_rates,
    constraint_residual,
    quaternion_from_rotation_vector,
    rotation_from_quaternion,
)
from consilience.mechanism.conditioning import mass_matrix_condition
from consilience.reference import simulate
from consilience.reference.bodies.arrays import unpack
from consilience.reference.bodies.canonical import at_origins
from consilience.reference.kernel.mechanism_record import record_of
from consilience.reference.kernel.operation import BoundOperation
from consilience.reference.steppers.motion import DERIVATIVE, END_STEP
from consilience.reference.tree.arrays import flatten_relative
from consilience.reference.tree.kinematics import fill_euler_parameters
from consilience.reference.tree.planar import place_planar_bodies
from consilience.reference.tree.planar_detection import planar_system
from consilience.reference.tree.projection import find_rank
from consilience.reference.tree.state import pack_relative
from consilience.reference.tree.system import serve, system_record
from flat import PLANAR, flat_chain
from mechanisms import states_of

EPS = np.finfo(float).eps


def find_rank_of(equations, z):
    """Select independent rows at a state."""
    find_rank(equations.closure, None, None, equations.planar, 0.0, z)


class InPlane:
    """A mechanism on the planar kernels."""

    def __init__(self, mechanism):
        self.mechanism = mechanism
        self.links, self.tree, self.model = flatten_relative(mechanism)
        system = planar_system(mechanism, self.links, self.tree, self.model)
        self.placed, self.closure, self.planar = system.tree, record_of(system.closure), record_of(system.planar)
        self.serve = BoundOperation(serve, system_record(system, tree_alone=False))

    def packed(self, state):
        return pack_relative(self.links, self.tree, self.model, state)

    def accelerations(self, state, t=0.0):
        closure, placed, z = self.closure, self.placed, self.packed(state)
        find_rank(closure, None, None, self.planar, t, z)
        self.serve(DERIVATIVE, t, z, np.empty_like(z))
        place_planar_bodies(self.planar.body, closure.link, placed.y, placed.A)
        fill_euler_parameters(placed.A, placed.y)
        a = np.empty((len(self.mechanism.bodies), 6))
        for row, found in zip(self.planar.body, closure.link, strict=False):
            basis, acceleration = row[11:].reshape(3, 3), found["acceleration"]
            b = int(row[0])
            a[b, :3], a[b, 3:] = acceleration[:2] @ basis[:2], placed.A[b].T @ basis[2] * acceleration[2]
        return at_origins(self.mechanism, placed.y, a.ravel())

    def state(self):
        """Return the arrays of the canonical state of the placed links."""
        place_planar_bodies(self.planar.body, self.closure.link, self.placed.y, self.placed.A)
        fill_euler_parameters(self.placed.A, self.placed.y)
        return unpack(self.mechanism, self.placed.y.copy())


@pytest.mark.parametrize("name", PLANAR)
def test_accelerations_are_those_of_the_dense_equations(name):
    mechanism = PLANAR[name]
    equations = InPlane(mechanism)
    for state in states_of(mechanism, 3):
        a, alpha, _, _ = truth.solve(mechanism, state)
        bar = 1e-11 + 4 * EPS * mass_matrix_condition(mechanism, state)
        expected = np.hstack([a, alpha])
        assert np.max(np.abs(np.hstack(equations.accelerations(state)) - expected)) < bar * np.max(np.abs(expected))


@pytest.mark.parametrize("name", PLANAR)
def test_a_state_comes_back_from_its_coordinates(name):
    mechanism = PLANAR[name]
    equations = InPlane(mechanism)
    for state in states_of(mechanism, 2):
        equations.accelerations(state)
        p, _, v, w = equations.state()
        for found, given in ((p, state.p_WB), (v, state.v_WB_W), (w, state.w_WB_W)):
            assert np.max(np.abs(found - given)) < 1e-12


@pytest.mark.parametrize("size", [1e-4, 1e-7])
@pytest.mark.parametrize("name", [n for n in PLANAR if n.startswith("closed")] + ["two_loops", "driven", "branches"])
def test_projection_closes_open_loops(name, size):
    """Projected twice: factors are recognised as regular by comparison with the factors before."""
    mechanism, rng = PLANAR[name], np.random.default_rng(5)
    equations = InPlane(mechanism)
    (state,) = states_of(mechanism, 1)
    z = equations.packed(state)
    count = 2 * len(equations.closure.u)
    find_rank_of(equations, z)
    for _ in range(2):
        z[:count] += size * rng.normal(size=count)
        equations.serve(END_STEP, 0.0, z, np.empty(equations.placed.y.size))
        found = State(*equations.state())
        rates = constraint_jacobian(mechanism, found) @ np.hstack([found.v_WB_W, found.w_WB_W]).ravel()
        assert np.max(np.abs(constraint_residual(mechanism, found))) < 1e-13
        assert np.max(np.abs(rates - constraint_rates(mechanism))) < 1e-12


@pytest.mark.parametrize("name", PLANAR)
def test_motions_are_those_of_space_by_another_integrator(name):
    mechanism = PLANAR[name]
    (state,), times = states_of(mechanism, 1), np.linspace(0.0, 0.5, 6)
    found, other = (simulate(mechanism, state, times, 1e-12, "relative", by) for by in (None, "gauss"))
    for field, bar in (("p_WB", 1e-11), ("v_WB_W", 1e-10), ("w_WB_W", 1e-10), ("quat_WB", 1e-11)):
        scale = max(1.0, np.max(np.abs(getattr(other, field))))
        assert np.max(np.abs(getattr(found, field) - getattr(other, field))) < bar * scale, field


def tilted(mechanism, joint, angle):
    """Return the mechanism with both frames of a joint rotated about their first axis."""
    turn = rotation_from_quaternion(quaternion_from_rotation_vector(angle * np.array([1.0, 0.0, 0.0])))
    joints = [
        replace(j, F=replace(j.F, R=j.F.R @ turn), M=replace(j.M, R=j.M.R @ turn)) if j.name == joint else j
        for j in mechanism.joints
    ]
    return replace(mechanism, joints=tuple(joints))


def raised(mechanism, joint, height):
    """Return the mechanism with frame M of a joint displaced along its axis, which opens the loop by `height`."""
    joints = [
        replace(j, M=replace(j.M, p=j.M.p + height * j.M.R[:, 2])) if j.name == joint else j for j in mechanism.joints
    ]
    return replace(mechanism, joints=tuple(joints))


@pytest.mark.parametrize(
    "mechanism",
    [
        tilted(PLANAR["chain"], "j4", 1e-9),
        tilted(PLANAR["closed_revolute"], "j3", 1e-9),
        tilted(PLANAR["chain"], "j1", 1e-9),
        raised(PLANAR["closed_revolute"], "c0", 1e-9),
        flat_chain("revolute", "cylindrical", seed=40),
        flat_chain("revolute", "spherical", seed=41),
        load_case("rolling_disc").mechanism,
        load_case("single_screw").mechanism,
    ],
    ids=lambda m: m.name,
)
def test_mechanisms_that_leave_the_plane_use_the_kernels_of_space(mechanism):
    assert planar_system(mechanism, *flatten_relative(mechanism)) is None


def test_a_mechanism_tilted_by_rounding_is_planar():
    assert planar_system(*(m := tilted(PLANAR["chain"], "j4", 1e-16),), *flatten_relative(m)) is not None
