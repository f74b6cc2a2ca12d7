"""Linkages of few freedoms: acceleration and projection by elimination, against dense equations and multifrontal QR."""

import numpy as np
import pytest

import truth
from consilience.case import load_case
from consilience.mechanism import State, constraint_jacobian, constraint_rates, constraint_residual
from consilience.mechanism.conditioning import mass_matrix_condition
from consilience.reference import simulate
from consilience.reference.bodies.arrays import unpack
from consilience.reference.bodies.canonical import at_origins
from consilience.reference.bodies.records import LARGEST
from consilience.reference.kernel.mechanism_record import record_of
from consilience.reference.kernel.operation import BoundOperation
from consilience.reference.steppers.motion import DERIVATIVE, END_STEP
from consilience.reference.tree.arrays import flatten_relative, tree_system
from consilience.reference.tree.few_freedoms import REGULAR_PIVOT
from consilience.reference.tree.kinematics import fill_euler_parameters, place_bodies, place_links_and_bodies
from consilience.reference.tree.state import pack_relative
from consilience.reference.tree.system import serve, system_record
from mechanisms import driven, four_bar, powered, spatial_loop, states_of

EPS = np.finfo(float).eps


def library(name):
    """Return the mechanism of a case, and four states along its motion."""
    case = load_case(name)
    motion = simulate(case.mechanism, case.initial_state, np.linspace(0.0, 1.0, 4), 1e-12, "relative")
    return case.mechanism, [motion.state(n) for n in range(4)]


def drawn(mechanism):
    return mechanism, states_of(mechanism, 3)


LINKAGES = {
    "one freedom, balls": lambda: drawn(spatial_loop()),
    "one freedom, universals": lambda: drawn(spatial_loop(coupler="universal")),
    "rods, six freedoms": lambda: library("rotary_stewart_platform"),
    "cylinder and ball": lambda: library("four_bar_cylinder_ball"),
    "spinning coupler": lambda: library("rssr_four_bar"),
    "a screw that is cut": lambda: library("single_screw"),
    "a slider on a guide": lambda: library("spatial_slider_crank"),
    "drives alone": lambda: drawn(driven()),
}

UNCHANGING = {"a screw that is cut", "drives alone"}
"""Linkages with constant constraint rows."""


class InSpace:
    """A mechanism on the spatial kernels; NaN left in the fronts of the QR shows that elimination was used."""

    def __init__(self, mechanism):
        self.mechanism = mechanism
        self.links, self.tree, self.model = flatten_relative(mechanism)
        arrays = tree_system(mechanism, self.links, self.tree, self.model)
        self.placed, self.closure, self.spatial, self.elements, _ = map(record_of, arrays)
        self.serve = BoundOperation(serve, system_record(arrays, tree_alone=False))

    def close(self, z, at_sample=True):
        """Project z in place; return whether elimination was used."""
        self.closure.qr.F[:] = np.nan
        self.serve(END_STEP, 0.0, z, np.empty(self.spatial.y.size if at_sample else 0))
        return bool(np.all(np.isnan(self.closure.qr.F)))

    def accelerations(self, z):
        """Return accelerations of origins, angular accelerations, and whether elimination was used."""
        self.closure.qr.F[:] = np.nan
        self.serve(DERIVATIVE, 0.0, z, np.empty_like(z))
        eliminated = bool(np.all(np.isnan(self.closure.qr.F)))
        A, y, link = self.spatial.A, self.spatial.y, self.closure.link
        place_bodies(self.links.layout, link, y, A)
        fill_euler_parameters(A, y)
        a = np.empty((len(self.mechanism.bodies), 6))
        a[self.links.layout["body"]] = link["acceleration"][:-1].reshape(-1, 6)
        a[:, 3:] = np.einsum("bji,bj->bi", A, a[:, 3:])
        return np.hstack(at_origins(self.mechanism, y, a.ravel())), eliminated

    def violation(self, z):
        """Return the largest violation of the constraints and of their rates."""
        place_links_and_bodies(
            self.links.layout,
            self.closure.link,
            self.closure.free,
            self.closure.first_speed,
            z,
            self.spatial.y,
            self.spatial.A,
        )
        found = self.state()
        rates = constraint_jacobian(self.mechanism, found) @ np.hstack([found.v_WB_W, found.w_WB_W]).ravel()
        residual = constraint_residual(self.mechanism, found)
        return np.max(np.abs(residual)), np.max(np.abs(rates - constraint_rates(self.mechanism)))

    def state(self):
        """Return the canonical state of the placed links."""
        place_bodies(self.links.layout, self.closure.link, self.spatial.y, self.spatial.A)
        fill_euler_parameters(self.spatial.A, self.spatial.y)
        return State(*unpack(self.mechanism, self.spatial.y.copy()))


@pytest.mark.parametrize("name", LINKAGES)
def test_accelerations_are_those_of_the_dense_equations_and_of_the_fronts(name):
    mechanism, states = LINKAGES[name]()
    equations = InSpace(mechanism)
    for state in states:
        z = pack_relative(equations.links, equations.tree, equations.model, state)
        equations.closure.best[:] = np.zeros(1, LARGEST)
        assert not equations.close(z)
        pivot = equations.closure.best[0].elimination_pivot
        assert pivot > 0.0
        found, eliminated = equations.accelerations(z)
        assert eliminated
        equations.closure.best[0].elimination_pivot = 1.01 * pivot / REGULAR_PIVOT
        other, eliminated = equations.accelerations(z)
        assert not eliminated
        expected = truth.free_accelerations(mechanism, state)
        bar = (1e-12 + 4 * EPS * mass_matrix_condition(mechanism, state)) * np.max(np.abs(expected))
        assert np.max(np.abs(found - other)) < bar
        assert np.max(np.abs(found - expected)) < bar


@pytest.mark.parametrize("size", [1e-12, 1e-9, 1e-6])
@pytest.mark.parametrize("name", LINKAGES)
def test_elimination_projects_the_error_of_a_step(name, size):
    mechanism, states = LINKAGES[name]()
    equations, rng = InSpace(mechanism), np.random.default_rng(2)
    z = pack_relative(equations.links, equations.tree, equations.model, states[-1])
    assert not equations.close(z)
    pivot = equations.closure.best[0].elimination_pivot
    closed = z.copy()
    for _ in range(3):
        z[:] = closed + size * rng.normal(size=len(z))
        equations.closure.best[0].elimination_pivot = 1.01 * pivot  # larger than the pivot now, so that QR is not tried
        assert equations.close(z)
        found = equations.state()
        rates = constraint_jacobian(mechanism, found) @ np.hstack([found.v_WB_W, found.w_WB_W]).ravel()
        assert np.max(np.abs(constraint_residual(mechanism, found))) < 1e-13
        assert np.max(np.abs(rates - constraint_rates(mechanism))) < 1e-12


@pytest.mark.parametrize("name", LINKAGES)
def test_between_samples_only_a_velocity_residual_of_the_size_of_the_correction_remains(name):
    """Between samples, projection leaves a velocity residual of the size of the position correction."""
    mechanism, states = LINKAGES[name]()
    equations, rng = InSpace(mechanism), np.random.default_rng(3)
    z = pack_relative(equations.links, equations.tree, equations.model, states[-1])
    assert not equations.close(z)
    pivot, closed, left = equations.closure.best[0].elimination_pivot, z.copy(), []
    for size in (1e-12, 1e-10):
        z[:] = closed + size * rng.normal(size=len(z))
        equations.closure.best[0].elimination_pivot = 1.01 * pivot
        assert equations.close(z, at_sample=False)
        position, rate = equations.violation(z)
        assert position < 1e-13
        assert rate < 1e-12 + 100.0 * size * np.max(np.abs(z))
        left.append(rate)
        assert equations.close(z)
        assert max(equations.violation(z)) < 1e-12
    assert (left[1] > 1e-12) == (name not in UNCHANGING)  # constant rows leave no such residual


@pytest.mark.parametrize(
    "mechanism",
    [four_bar(), powered(), load_case("bricard").mechanism, load_case("rolling_disc").mechanism],
    ids=["a flat loop in space", "a tree", "five rows of rank four", "rolling"],
)
def test_dependent_rows_and_velocity_rows_use_the_fronts(mechanism):
    equations = InSpace(mechanism)
    for state in states_of(mechanism, 1):
        z = pack_relative(equations.links, equations.tree, equations.model, state)
        for _ in range(2):
            equations.close(z)
            assert equations.closure.best[0].elimination_pivot == 0.0


@pytest.mark.parametrize(
    "name", ["four_bar", "rsur_four_bar", "parallelogram", "double_pendulum", "acrobot", "bricard"]
)
def test_a_motion_does_not_depend_on_the_one_before(name):
    """Work arrays are reused; results are equal to the last bit."""
    case = load_case(name)
    times = np.linspace(0.0, 1.0, 5)
    first, _, again = (
        simulate(case.mechanism, case.initial_state, t, tolerance, "relative")
        for t, tolerance in ((times, 1e-9), (2.0 * times, 1e-6), (times, 1e-9))
    )
    for field in ("p_WB", "quat_WB", "v_WB_W", "w_WB_W"):
        assert np.array_equal(getattr(first, field), getattr(again, field))
    assert first.counters == again.counters
