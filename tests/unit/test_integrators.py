"""Integrators on problems with closed forms: orders, dense output, projection, charts, counters, failures."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import BDF, solve_ivp
from scipy.special import ellipj

from consilience.errors import InvalidInput
from consilience.mechanism import rotation_angle_between
from consilience.reference import formulation
from consilience.reference.integrators.adaptive import METHODS, integrate, state_at
from consilience.reference.integrators.coefficients import DORMAND_PRINCE
from consilience.reference.integrators.tableaus import RADAU, RKF45
from consilience.reference.integrators.tsitouras import TSITOURAS
from consilience.reference.solver import NumericalFailure, simulate
from mechanisms import LOOPS, TREES, states_of
from oracles.simple_pendulum import swing

ONE_STEP = [name for name, tableau in METHODS.items() if tableau is not None]


class Ode:
    """An ordinary differential equation as a formulation: no projection, and the coordinates are the state."""

    def __init__(self, derivative):
        self.derivative = derivative

    def settle(self, t, u):
        return u

    def state(self, u):
        return u


# --- problems with closed forms: formulation, u(t) of shape (n_t, n_u)

MOMENTS = np.array([1.0, 2.0, 3.5])


def torque_free_body():
    """Euler's equations in Jacobi elliptic functions [Landau & Lifshitz, Mechanics, section 37, I1 < I2 < I3]."""
    I1, I2, I3 = MOMENTS
    twice_energy, momentum2 = 6.0, 17.0  # between 2 E I2 and 2 E I3
    a, b = twice_energy * I3 - momentum2, momentum2 - twice_energy * I1
    m = (I2 - I1) * a / ((I3 - I2) * b)

    def closed(t):
        sn, cn, dn, _ = ellipj(0.3 + np.asarray(t) * np.sqrt((I3 - I2) * b / (I1 * I2 * I3)), m)
        amplitudes = np.sqrt([a / (I1 * (I3 - I1)), a / (I2 * (I3 - I2)), b / (I3 * (I3 - I1))])
        return np.stack([cn, sn, dn], axis=-1) * amplitudes

    def derivative(t, w):
        return np.array([(I2 - I3) / I1 * w[1] * w[2], (I3 - I1) / I2 * w[2] * w[0], (I1 - I2) / I3 * w[0] * w[1]])

    return Ode(derivative), closed


def pendulum():
    """Return a pendulum of 1 m, released at 1.2 rad, and its closed form."""

    def closed(t):
        sine, cosine, rate = swing(1.2, 1.0, 9.81, t)
        return np.stack([np.arctan2(sine, cosine), rate], axis=-1)

    return Ode(lambda t, u: np.array([u[1], -9.81 * np.sin(u[0])])), closed


def driven():
    """Return a system with explicit time: u' = A u + f(t) with the solution (sin 2t, exp(-t) cos t)."""

    def closed(t):
        t = np.asarray(t)
        return np.stack([np.sin(2 * t), np.exp(-t) * np.cos(t)], axis=-1)

    matrix = np.array([[-0.3, 0.8], [-1.1, 0.2]])

    def derivative(t, u):
        rates = np.array([2 * np.cos(2 * t), -np.exp(-t) * (np.cos(t) + np.sin(t))])
        return rates + matrix @ (u - closed(t))

    return Ode(derivative), closed


PROBLEMS = {"torque-free body": torque_free_body, "pendulum": pendulum, "driven": driven}


# --- orders


def order(sizes, errors):
    """Return the order: slope of log error over log step size by least squares."""
    return np.polyfit(np.log(sizes), np.log(errors), 1)[0]


def errors_of(formulation, closed, method, step, span):
    """Return the largest errors at the ends of steps and between them, for a constant step size."""
    motion = integrate(formulation, closed(0.0), np.array([0.0, span]), 1e-12, method, step=step)
    ends, between = motion.dense.ends, np.linspace(0.0, span, 1013)
    return [np.max(np.abs(motion.dense(t) - closed(t))) for t in (ends, between)]


# Numbers of steps over 3 s: inside the asymptotic range, above rounding. At the ends of the steps the pendulum by
# dop853 and the driven problem by tp86 have no such range: their leading error term is small there, and the next
# order shows.
STEPS = {
    **{("rkf45", problem): (96, 120, 144, 192) for problem in PROBLEMS},
    **{("radau", problem): (48, 72, 96, 144) for problem in PROBLEMS},
    ("dop853", "torque-free body"): (12, 18, 24, 36, 48),
    ("dop853", "driven"): (6, 9, 12, 18, 24),
    ("tp86", "torque-free body"): (9, 12, 18, 24, 36),
}


@pytest.mark.parametrize(("method", "problem"), STEPS)
def test_one_step_methods_and_their_dense_output_converge_with_their_order(method, problem):
    formulation, closed = PROBLEMS[problem]()
    sizes = 3.0 / np.array(STEPS[method, problem])
    errors = np.array([errors_of(formulation, closed, method, h, 3.0) for h in sizes])
    assert order(sizes, errors[:, 0]) == pytest.approx(METHODS[method].order, abs=0.15)
    assert order(sizes, errors[:, 1]) == pytest.approx(METHODS[method].dense_order, abs=0.15)


@pytest.mark.parametrize("problem", PROBLEMS)
def test_the_other_member_of_fehlberg_s_pair_is_of_order_four(problem, monkeypatch):
    fourth = replace(RKF45, b=RKF45.b - RKF45.E[0])
    monkeypatch.setitem(METHODS, "fourth", fourth)
    formulation, closed = PROBLEMS[problem]()
    sizes = 3.0 / np.array([192, 256, 384, 576])
    errors = np.array([errors_of(formulation, closed, "fourth", h, 3.0)[0] for h in sizes])
    assert order(sizes, errors) == pytest.approx(4, abs=0.15)


@pytest.mark.parametrize("tableau", [RKF45, DORMAND_PRINCE, TSITOURAS], ids=["rkf45", "dop853", "tp86"])
def test_coefficients_meet_the_quadrature_conditions_of_their_order(tableau):
    c, A, b = tableau.c, tableau.A, tableau.b
    np.testing.assert_allclose(A.sum(axis=1), c, atol=1e-14)
    np.testing.assert_allclose(
        [b @ c**k for k in range(tableau.order)], 1 / np.arange(1, tableau.order + 1), atol=1e-13
    )
    lower = [(b - E) @ c**k for E in tableau.E[:1] for k in range(4)]
    if tableau is RKF45:
        np.testing.assert_allclose(lower, 1 / np.arange(1, 5), atol=1e-14)


def test_radau_is_collocation_at_the_nodes_of_radau():
    c, A = RADAU.c, RADAU.A
    powers = np.arange(1, 4)
    np.testing.assert_allclose(A @ c[:, None] ** (powers - 1), c[:, None] ** powers / powers, atol=1e-15)
    np.testing.assert_allclose([A[-1] @ c**k for k in range(5)], 1 / np.arange(1, 6), atol=1e-15)


@pytest.mark.parametrize("k", [1, 2, 3, 4, 5])
def test_the_formula_of_bdf_of_order_k_converges_with_order_k(k):
    """SciPy's BDF at fixed order k and constant steps, started from exact values."""
    formulation, closed = torque_free_body()

    def error(count):
        h, end, big = 3.0 / count, 3.0, 1e6
        solver = BDF(formulation.derivative, 0.0, closed(0.0), end, rtol=big, atol=big, first_step=h, max_step=h)
        history = closed(-h * np.arange(k + 1))
        for j in range(k + 1):
            solver.D[j] = history[0]
            history = history[:-1] - history[1:]
        solver.D[k + 1 :] = 0.0
        solver.order, solver.newton_tol = k, 1e-13 / big
        while solver.status == "running":
            solver.n_equal_steps = 0  # keeps SciPy from changing the order after k + 1 equal steps
            solver.step()
        assert solver.order == k
        return np.max(np.abs(solver.y - closed(end)))

    counts = np.array([400, 600, 800, 1200]) if k < 5 else np.array([150, 200, 300, 400])
    assert order(3.0 / counts, [error(n) for n in counts]) == pytest.approx(k, abs=0.15)


def test_bdf_works_at_order_five_where_the_tolerance_is_tight():
    """Error control with a local error of order 6 makes the number of steps grow as tolerance^(-1/6)."""
    formulation, closed = torque_free_body()
    tolerances, times = np.geomspace(1e-7, 1e-12, 6), np.array([0.0, 10.0])
    steps = [integrate(formulation, closed(0.0), times, tol, "bdf").counters["steps"] for tol in tolerances]
    assert -1 / order(tolerances, steps) == pytest.approx(6, abs=0.5)


# --- control of the step size

REACHED = {
    "rkf45": (1e-12, 1e-10),
    "dop853": (1e-12, 3e-11),
    "tp86": (1e-12, 3e-11),
    "radau": (1e-10, 1e-10),
    "bdf": (1e-13, 3e-9),
}
"""By method: tolerance, and the bound for the error over 5 s."""


@pytest.mark.parametrize("problem", PROBLEMS)
@pytest.mark.parametrize("method", METHODS)
def test_accuracy_follows_the_tolerance_on_samples_and_between(method, problem):
    formulation, closed = PROBLEMS[problem]()
    times = np.linspace(0.0, 5.0, 23)
    tolerance, reached = REACHED[method]
    errors, errors_between = [], []
    for level in (1e-6, tolerance):
        motion = integrate(formulation, closed(0.0), times, level, method)
        between = np.random.default_rng(4).uniform(0.0, 5.0, 500)
        errors.append(np.max(np.abs(motion.samples - closed(times))))
        errors_between.append(np.max(np.abs(motion.dense(between) - closed(between))))
    assert max(errors[1], errors_between[1]) < reached
    assert errors[1] < 1e-2 * errors[0]
    assert max(errors[0], errors_between[0]) < 1e-2


@pytest.mark.parametrize("method", ONE_STEP)
def test_the_step_size_follows_the_problem(method):
    """A narrow peak in the derivative: short steps in the peak, rejected ones before it, long steps elsewhere."""
    width = 1e-3
    formulation = Ode(lambda t, u: np.array([width / (width**2 + (t - 1.0) ** 2)]))
    motion = integrate(formulation, np.array([0.0]), np.array([0.0, 2.0]), 1e-8, method)
    assert motion.samples[-1, 0] == pytest.approx(2 * np.arctan(1 / width), abs=1e-6)
    assert motion.counters["rejected"] > 0
    lengths = np.diff(motion.dense.ends)
    middle = motion.dense.ends[:-1] + lengths / 2
    assert np.min(lengths[np.abs(middle - 1) < 2 * width]) < width < 5e-2 < np.max(lengths)
    assert np.all(lengths > 0)


@pytest.mark.parametrize("method", ["radau", "bdf"])
def test_implicit_methods_take_wide_steps_where_the_problem_is_stiff(method):
    """``u' = -1e6 (u - cos t) - sin t``: an explicit method needs 3e5 steps a second."""
    formulation = Ode(lambda t, u: -1e6 * (u - np.cos(t)) - np.sin(t))
    motion = integrate(formulation, np.array([1.0]), np.array([0.0, 3.0]), 1e-8, method)
    assert motion.samples[-1, 0] == pytest.approx(np.cos(3.0), abs=1e-7)
    assert motion.counters["steps"] < 1000


def test_radau_renews_its_jacobian_where_the_stiffness_changes():
    """Van der Pol's equation, mu = 1000, through a relaxation: value and work are about those of SciPy's Radau."""
    formulation = Ode(lambda t, u: np.array([u[1], 1000.0 * (1 - u[0] ** 2) * u[1] - u[0]]))
    motion = integrate(formulation, np.array([2.0, 0.0]), np.array([0.0, 1000.0]), 1e-6, "radau")
    other = solve_ivp(formulation.derivative, (0.0, 1000.0), [2.0, 0.0], method="Radau", rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(motion.samples[-1], other.y[:, -1], atol=1e-6)
    assert motion.counters["evaluations"] < 1.4 * (other.nfev + 2 * other.njev)


@pytest.mark.parametrize("method", METHODS)
def test_counters_count(method):
    formulation, closed = torque_free_body()
    calls = []
    counted = Ode(lambda t, u: calls.append(t) or formulation.derivative(t, u))
    motion = integrate(counted, closed(0.0), np.linspace(0.0, 4.0, 5), 1e-7, method)
    counters, tableau = motion.counters, METHODS[method]
    assert counters["evaluations"] == len(calls)
    assert counters["steps"] == len(motion.dense.pieces) == len(motion.dense.ends) - 1
    if method in ("rkf45", "dop853", "tp86"):
        stages, dense = len(tableau.b), len(tableau.c_dense)
        assert set(counters) == {"steps", "rejected", "evaluations"}
        attempts = counters["steps"] + counters["rejected"]
        assert counters["evaluations"] == 1 + (stages - 1) * attempts + (1 + dense) * counters["steps"]
    else:
        assert 1 <= counters["jacobians"] <= counters["factorisations"] < 2 * counters["steps"]


# --- dense output


@pytest.mark.parametrize("method", METHODS)
def test_dense_output_is_one_function_of_time(method):
    formulation, closed = torque_free_body()
    times = np.linspace(0.0, 2.0, 6)
    dense = integrate(formulation, closed(0.0), times, 1e-9, method).dense
    shuffled = np.random.default_rng(1).permutation(np.linspace(0.0, 2.0, 101))
    one_by_one = np.array([dense(t) for t in shuffled])
    assert dense(0.3).shape == (3,)
    np.testing.assert_array_equal(dense(shuffled), one_by_one)
    assert dense(np.empty(0)).shape == (0, 3)
    # jumps between steps stay within the tolerance; one-step methods have none
    inner = dense.ends[1:-1]
    after = np.array([piece(np.array([t]))[0] for t, piece in zip(inner, dense.pieces[1:], strict=True)])
    np.testing.assert_allclose(after, dense(inner), atol=1e-15 if method in ONE_STEP else 1e-8)
    for t in (-1e-9, 2.0 + 1e-9, np.nan):
        with pytest.raises(InvalidInput, match="outside"):
            dense(t)


def test_a_single_time_asks_for_no_step():
    formulation, closed = pendulum()
    for method in METHODS:
        motion = integrate(formulation, closed(0.0), np.array([0.0]), 1e-9, method)
        np.testing.assert_array_equal(motion.samples, closed(0.0)[None])
        assert motion.counters["steps"] == 0
        with pytest.raises(InvalidInput, match="outside"):
            motion.dense(0.0)


# --- projection and charts


class Circle(Ode):
    """A point that moves on the unit circle at unit rate; without projection the norm drifts."""

    def __init__(self, settles):
        super().__init__(lambda t, u: np.array([-u[1], u[0]]))
        self.settles, self.seen = settles, []

    def settle(self, t, u):
        self.seen.append(t)
        return u / np.linalg.norm(u) if self.settles else u


@pytest.mark.parametrize("method", METHODS)
def test_every_accepted_step_is_settled_and_goes_on_from_there(method):
    times = np.linspace(0.0, 30.0, 31)
    tolerance = 1e-4 if method == "tp86" else 1e-6  # the error estimate of tp86 is very conservative
    free = integrate(Circle(False), np.array([1.0, 0.0]), times, tolerance, method)
    formulation = Circle(True)
    settled = integrate(formulation, np.array([1.0, 0.0]), times, tolerance, method)
    radius = np.linalg.norm(settled.samples, axis=1) - 1
    assert np.max(np.abs(radius)) < 1e-15
    assert np.max(np.abs(np.linalg.norm(free.samples, axis=1) - 1)) > 1e-7
    # projection happens in order of time, at the end of each step; BDF also projects samples
    assert np.all(np.diff(formulation.seen) >= 0)
    assert set(formulation.seen) == set(settled.dense.ends[1:]) | (set(times[1:]) if method == "bdf" else set())
    # dense output starts each step from a projected value: the radius does not drift between samples
    starts = np.array([p(np.array([t]))[0] for t, p in zip(settled.dense.ends, settled.dense.pieces, strict=False)])
    if method in ONE_STEP:
        assert np.max(np.abs(np.linalg.norm(starts, axis=1) - 1)) < 1e-15
    assert np.max(np.abs(np.linalg.norm(settled.dense(np.linspace(0, 30, 997)), axis=1) - 1)) < 1e-5


@pytest.mark.parametrize("method", ONE_STEP)
def test_settling_keeps_the_order(method):
    closed = lambda t: np.stack([np.cos(t), np.sin(t)], axis=-1)  # noqa: E731
    sizes = 3.0 / np.array([24, 36, 48, 72] if method not in ("dop853", "tp86") else [6, 9, 12, 18])
    errors = [errors_of(Circle(True), closed, method, h, 3.0)[0] for h in sizes]
    # even orders gain one: the leading error is radial, and projection removes it
    assert order(sizes, errors) > METHODS[method].order - 0.15


def test_bdf_keeps_its_order_and_its_cost_when_it_is_settled():
    times, errors, steps = np.array([0.0, 10.0]), {}, {}
    for settles in (False, True):
        motions = [integrate(Circle(settles), np.array([1.0, 0.0]), times, tol, "bdf") for tol in (1e-7, 1e-11)]
        errors[settles] = [np.max(np.abs(m.samples[-1] - [np.cos(10.0), np.sin(10.0)])) for m in motions]
        steps[settles] = [m.counters["steps"] for m in motions]
    assert np.all(np.array(steps[True]) < 1.1 * np.array(steps[False]))
    assert np.all(np.array(errors[True]) < 1.5 * np.array(errors[False]))


class OverTheTop(Ode):
    """A rotating pendulum in Rodrigues' parameter of its angle, which is singular at half a turn: two charts.

    ``phi = chart pi + 2 arctan(g)``, ``g' = (1 + g^2) w / 2``, ``w' = -9.81 sin(phi)``; the chart changes at |g| > 1.
    From hanging at w = 9: ``phi = 2 am(9 t / 2, k^2)`` with ``k = 2 sqrt(9.81) / 9``.
    """

    def __init__(self):
        self.chart, self.changes = 0, 0

    def derivative(self, t, u):
        return np.array([0.5 * (1 + u[0] ** 2) * u[1], -9.81 * np.sin(self.angle(u))])

    def angle(self, u):
        return self.chart * np.pi + 2 * np.arctan(u[0])

    def settle(self, t, u):
        if abs(u[0]) <= 1.0:
            return u
        self.chart, self.changes = 1 - self.chart, self.changes + 1
        return np.array([-1.0 / u[0], u[1]])

    def state(self, u):
        return np.array([np.cos(self.angle(u)), np.sin(self.angle(u)), u[1]])

    @staticmethod
    def closed(t):
        _, _, dn, half = ellipj(4.5 * np.asarray(t), 4 * 9.81 / 81)
        return np.stack([np.cos(2 * half), np.sin(2 * half), 9 * dn], axis=-1)


@pytest.mark.parametrize("method", METHODS)
def test_a_formulation_may_change_its_chart(method):
    formulation, times = OverTheTop(), np.linspace(0.0, 3.0, 14)
    motion = integrate(formulation, np.array([0.0, 9.0]), times, 1e-10, method)
    assert formulation.changes > 6
    last = formulation.chart
    np.testing.assert_allclose(np.array(motion.states), formulation.closed(times), atol=1e-6)
    between = np.linspace(0.0, 3.0, 61)
    states = np.array([state_at(formulation, motion, t) for t in between])
    np.testing.assert_allclose(states, formulation.closed(between), atol=1e-6)
    assert formulation.chart == last
    assert len(set(motion.dense.charts)) == 2


# --- a mechanism


def differences(states, answer):
    """Return the largest differences of positions, angles, velocities and angular velocities."""
    p, quat, v, w = (np.array([getattr(s, n) for s in states]) for n in ("p_WB", "quat_WB", "v_WB_W", "w_WB_W"))
    return [
        np.max(np.abs(p - answer.p_WB)),
        np.max(rotation_angle_between(quat, answer.quat_WB)),
        np.max(np.abs(v - answer.v_WB_W)),
        np.max(np.abs(w - answer.w_WB_W)),
    ]


@pytest.mark.parametrize(
    ("method", "tolerance", "bound"),
    [
        ("dop853", 1e-12, 1e-10),
        ("tp86", 1e-12, 1e-10),
        ("rkf45", 1e-12, 1e-10),
        ("radau", 1e-9, 1e-8),
        ("bdf", 1e-11, 1e-7),
    ],
)
@pytest.mark.parametrize("name", ["forced_chain", "four_bar"])
def test_mechanisms_move_as_by_the_compiled_solver(name, method, tolerance, bound):
    mechanism = (TREES | LOOPS)[name]
    state = states_of(mechanism, count=1)[0]
    times = np.linspace(0.0, 0.5, 6)
    answer = simulate(mechanism, state, times, 1e-12)
    equations = formulation("descriptor", mechanism)
    motion = integrate(equations, equations.coordinates(state), times, tolerance, method)
    assert max(differences(motion.states, answer)) < bound


# --- refusals and failures


@pytest.mark.parametrize(
    ("change", "where"),
    [
        ({"method": "euler"}, "method 'euler'"),
        ({"tolerance": 1e-14}, "tolerance"),
        ({"tolerance": 1e-2}, "tolerance"),
        ({"tolerance": np.nan}, "tolerance"),
        ({"times": np.array([0.0, 1.0, 1.0])}, "times"),
        ({"times": np.array([0.0, np.inf])}, "times"),
        ({"times": np.array([])}, "times"),
        ({"step": 0.1, "method": "bdf"}, "step"),
        ({"step": -0.1}, "step"),
    ],
)
def test_invalid_arguments_are_refused(change, where):
    formulation, closed = pendulum()
    asked = {"times": np.array([0.0, 1.0]), "tolerance": 1e-8, "method": "dop853"} | change
    with pytest.raises(InvalidInput) as refusal:
        integrate(formulation, closed(0.0), **asked)
    assert refusal.value.where == where


@pytest.mark.parametrize("method", METHODS)
def test_a_motion_that_grows_without_bound_fails_when_it_does(method):
    formulation = Ode(lambda t, u: u**2)  # solution 1 / (1 - t)
    with pytest.raises(
        NumericalFailure, match=rf"{method}, tolerance 1e-06: at t = (1|0\.999\d*|1\.000\d*) s .*step size"
    ):
        integrate(formulation, np.array([1.0]), np.array([0.0, 2.0]), 1e-6, method)


@pytest.mark.parametrize("method", METHODS)
def test_a_derivative_that_is_not_finite_fails(method):
    with pytest.raises(NumericalFailure, match=rf"{method}, .*at t = 0 s .*not finite"):
        integrate(Ode(lambda t, u: np.array([np.nan])), np.array([1.0]), np.array([0.0, 1.0]), 1e-6, method)


@pytest.mark.parametrize("method", ["radau", "bdf"])
def test_a_jacobian_that_is_not_finite_fails(method):
    formulation = Ode(lambda t, u: np.where(u > 1.0, np.nan, -1.0))
    with pytest.raises(NumericalFailure, match=rf"{method}, .*at t = 0 s .*not finite"):
        integrate(formulation, np.array([1.0]), np.array([0.0, 1.0]), 1e-6, method)


@pytest.mark.parametrize("method", ONE_STEP)
def test_a_step_of_constant_length_that_fails_says_so(method):
    formulation = Ode(lambda t, u: np.array([1.0 if t < 0.5 else np.inf]))
    with pytest.raises(NumericalFailure, match=rf"{method}, steps of 0.2 s: at t = 0.4 s "):
        integrate(formulation, np.array([1.0]), np.array([0.0, 1.0]), 1e-6, method, step=0.2)
