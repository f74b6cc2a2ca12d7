"""Functions of elements against closed forms, differences and the definition of a spline; compiled against NumPy."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from consilience.errors import InvalidInput
from consilience.mechanism import Function, Table, constant, linear, sine, through
from consilience.reference.kernel.functions import evaluate, flatten_functions

RNG = np.random.default_rng(11)
KNOTS = np.sort(RNG.uniform(-2.0, 3.0, 14))
VALUES = RNG.normal(size=14)
ROUND = np.array([0.3, 0.9, 1.0, 1.8, 2.1, 3.0, 3.3, 4.4, 5.0])
PROFILE = np.array([0.2, -0.4, 0.1, 0.9, 0.6, -0.3, 0.8, 0.5, 0.2])
POLYNOMIAL = np.array([0.7, -1.2, 0.4, 0.9, -0.3])
HARMONICS = np.array([[0.8, 3.0, 0.4], [-0.5, 1.7, -2.1], [0.1, 11.0, 1.0]])

OPEN = Table(KNOTS, VALUES)
PERIODIC = Table(ROUND, PROFILE, periodic=True)

# all functions share one array in the kernels: a wrong offset reads data of a neighbour
FUNCTIONS = {
    "table": Function(table=OPEN),
    "polynomial": Function(POLYNOMIAL),
    "nothing": Function(),
    "harmonics": Function(harmonics=HARMONICS),
    "periodic": Function(table=PERIODIC),
    "all": Function(POLYNOMIAL, HARMONICS, PERIODIC),
    "some": Function(POLYNOMIAL, table=OPEN),
    "constant": constant(2.5),
    "linear": linear(-2.5, 0.1),
    "sine": sine(0.3, 2.0, 0.7),
}
FLAT = flatten_functions(list(FUNCTIONS.values()))


def compiled(name, x):
    return np.array(evaluate(FLAT, list(FUNCTIONS).index(name), float(x)))


def derivative(f, x, h=1e-2):
    """Return the derivative by an eighth-order central difference."""
    weights = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
    return sum(w * (f(x + k * h) - f(x - k * h)) for k, w in weights.items()) / h


@pytest.mark.parametrize("x", [-3.0, -0.2, 0.0, 0.6, 2.9])
def test_polynomials_and_sines_have_the_derivatives_of_their_closed_forms(x):
    terms = [c * np.array([x**k, k * x ** max(k - 1, 0), k * (k - 1) * x ** max(k - 2, 0)]) for k, c in
             enumerate(POLYNOMIAL)]  # fmt: skip
    np.testing.assert_allclose(FUNCTIONS["polynomial"].at(x), sum(terms), rtol=1e-14, atol=1e-14)
    waves = [(a * np.exp(1j * (w * x + phi)) * np.array([1, 1j * w, -w * w])).imag for a, w, phi in HARMONICS]
    np.testing.assert_allclose(FUNCTIONS["harmonics"].at(x), sum(waves), rtol=1e-14, atol=1e-14)


@pytest.mark.parametrize("x", [-1.7, 0.3, 2.4])
def test_derivatives_of_polynomials_and_sines_by_complex_step(x):
    h = 1e-30
    z = x + 1j * h
    value = Polynomial(POLYNOMIAL)(z) + sum(a * np.sin(w * z + phi) for a, w, phi in HARMONICS)
    found = Function(POLYNOMIAL, HARMONICS).at(x)
    assert found[0] == pytest.approx(value.real, rel=1e-14)
    assert found[1] == pytest.approx(value.imag / h, rel=1e-14)


def test_the_parts_of_a_function_add_up():
    for x in (0.4, 1.9, -6.0):
        parts = FUNCTIONS["polynomial"].at(x) + FUNCTIONS["harmonics"].at(x) + FUNCTIONS["periodic"].at(x)
        np.testing.assert_allclose(FUNCTIONS["all"].at(x), parts, rtol=0, atol=1e-13 * np.max(np.abs(parts)))


def test_short_forms():
    assert constant(2.5).at(7.0).tolist() == [2.5, 0.0, 0.0]
    assert linear(-2.5, 0.1).at(2.0).tolist() == [-4.9, -2.5, 0.0]
    s, c = np.sin(2.7), np.cos(2.7)
    np.testing.assert_allclose(sine(0.3, 2.0, 0.7).at(1.0), [0.3 * s, 0.6 * c, -1.2 * s], rtol=1e-15)
    assert through([0, 1, 2, 3, 4, 5], [0, 1, 0, 1, 0, 0], periodic=True).table.period == 5.0
    assert Function().at(3.0).tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize("table", [OPEN, PERIODIC], ids=["open", "periodic"])
def test_the_curve_goes_through_its_points(table):
    found = [table.at(x)[0] for x in table.x]
    np.testing.assert_allclose(found, table.y, rtol=0, atol=1e-11)


def test_a_curve_through_a_polynomial_of_degree_five_is_that_polynomial():
    p = Polynomial([0.3, -1.0, 0.5, 0.2, -0.4, 0.1])
    table = Table(KNOTS, p(KNOTS))
    for x in np.linspace(KNOTS[0], KNOTS[-1], 41):
        np.testing.assert_allclose(table.at(x), [p(x), p.deriv()(x), p.deriv(2)(x)], rtol=0, atol=1e-9)


def test_a_curve_through_a_sine_comes_nearer_with_the_sixth_power_of_the_spacing():
    def error(n):
        x = np.linspace(0, 2 * np.pi, n + 1)
        y = np.sin(x)
        table = Table(x, y, periodic=True)
        return max(abs(table.at(t)[0] - np.sin(t)) for t in np.linspace(0.01, 6.2, 100))

    order = np.log2(error(16) / error(32))
    assert order == pytest.approx(6.0, abs=0.2)


@pytest.mark.parametrize("name", ["table", "periodic"])
def test_derivatives_of_tables_by_differences_inside_the_pieces(name):
    """Differences inside a piece are exact up to rounding: the piece is a polynomial of degree five."""
    f = FUNCTIONS[name]
    for left, right in f.table.pieces[:, :2]:
        middle, h = 0.5 * (left + right), 0.1 * (right - left)
        found = f.at(middle)
        scale = max(1.0, np.max(np.abs(found)))
        for k in (0, 1):
            difference = derivative(lambda x, k=k: f.at(x)[k], middle, h)
            assert found[k + 1] == pytest.approx(difference, rel=0, abs=1e-13 * scale / h)


def _derivatives(row, x):
    """Return value and five derivatives of the polynomial of a piece."""
    p = Polynomial(row[2:])
    return np.array([p(x - row[0]) if k == 0 else p.deriv(k)(x - row[0]) for k in range(6)])


@pytest.mark.parametrize("table", [OPEN, PERIODIC], ids=["open", "periodic"])
def test_the_curve_is_smooth_to_the_fourth_derivative_at_its_knots(table):
    pieces = table.pieces
    pairs = list(pairwise(pieces))
    if table.periodic:
        pairs.append((pieces[-1], pieces[0]))
    size = np.max([np.abs(_derivatives(row, x)) for row in pieces for x in row[:2]], axis=0)
    fifth = []
    for before, after in pairs:
        jump = _derivatives(after, after[0]) - _derivatives(before, before[1])
        assert np.all(np.abs(jump[:5]) < 1e-11 * size[:5])
        fifth.append(abs(jump[5]) / size[5])
    assert max(fifth) > 1e-3  # the fifth derivative jumps: a spline of degree five


def test_the_pieces_cover_the_table_without_gaps():
    for table in (OPEN, PERIODIC):
        assert table.pieces[0, 0] == table.x[0]
        assert table.pieces[-1, 1] == table.x[-1]
        assert np.array_equal(table.pieces[1:, 0], table.pieces[:-1, 1])


@pytest.mark.parametrize("periods", [-1000, -3, -1, 1, 2, 1000])
def test_a_periodic_curve_repeats_far_away_and_below_zero(periods):
    for x in (0.3, 0.31, 1.0, 2.7, 4.99):
        there = PERIODIC.at(x + periods * PERIODIC.period)
        np.testing.assert_allclose(there, PERIODIC.at(x), rtol=0, atol=abs(periods) * 1e-12)


def test_a_periodic_curve_is_smooth_where_it_starts_again():
    for x in (ROUND[0], ROUND[-1], ROUND[0] - 7 * PERIODIC.period):
        before, after = PERIODIC.at(x - 1e-9), PERIODIC.at(x + 1e-9)
        np.testing.assert_allclose(before, after, rtol=0, atol=1e-6)
        difference = [derivative(lambda s, k=k: PERIODIC.at(s)[k], x, 1e-4) for k in (0, 1)]
        np.testing.assert_allclose(PERIODIC.at(x)[1:], difference, rtol=0, atol=1e-9)


def test_outside_an_open_table_there_is_no_value():
    for x in (KNOTS[0] - 1e-9, KNOTS[-1] + 1e-9, -100.0, 100.0, np.nan):
        assert np.all(np.isnan(FUNCTIONS["table"].at(x)))
        assert np.all(np.isnan(compiled("table", x)))
        assert np.all(np.isnan(compiled("some", x)))
    for x in (KNOTS[0], KNOTS[-1]):
        assert np.all(np.isfinite(FUNCTIONS["table"].at(x)))
        assert np.all(np.isfinite(compiled("table", x)))


def _abscissas(function):
    """Return points over the whole domain, and the ends and knots, where pieces meet."""
    table = function.table
    if table is None:
        return np.linspace(-7.0, 9.0, 33)
    knots = [*table.x, *table.pieces[:, 0], *(0.5 * (table.pieces[:, 0] + table.pieces[:, 1]))]
    if not table.periodic:
        return np.array([*knots, *np.linspace(table.x[0], table.x[-1], 33)])
    return np.array([x + n * table.period for x in knots for n in (-40, -1, 0, 1, 2, 40)])


@pytest.mark.parametrize("name", FUNCTIONS)
def test_compiled_functions_are_those_of_numpy(name):
    function = FUNCTIONS[name]
    for x in _abscissas(function):
        expected = function.at(x)
        scale = np.max(np.abs(expected), initial=1.0)
        np.testing.assert_allclose(compiled(name, x), expected, rtol=0, atol=1e-14 * scale * _digits_lost(function, x))


def _digits_lost(function, x):
    """Return the loss of digits by cancellation: sum of the magnitudes of all terms, at least one."""
    parts = np.abs(function.polynomial) @ np.abs(x) ** np.arange(len(function.polynomial))
    return max(1.0, float(parts)) * (1.0 if function.table is None else _growth(function.table))


def _growth(table):
    lengths = table.pieces[:, 1:2] - table.pieces[:, :1]
    size = np.max(np.abs(table.pieces[:, 2:]) * lengths ** np.arange(6))
    return max(1.0, float(size))


@pytest.mark.parametrize(
    ("x", "y", "periodic", "what"),
    [
        ([0, 1, 2, 3, 4], [0, 0, 0, 0, 0], False, "5 points"),
        ([0, 1, 2, 2, 4, 5], np.zeros(6), False, "do not increase"),
        ([0, 1, 2, 3, 4, 5], [0, 1, 0, 1, 0, 1], True, "starts at 0 and ends at 1"),
        ([0, 1, 2, 3, 4, 5], np.zeros(7), False, "shape"),
        ([0, 1, 2, 3, 4, np.nan], np.zeros(6), False, "not finite"),
    ],
)
def test_points_no_curve_goes_through_are_refused(x, y, periodic, what):
    with pytest.raises(InvalidInput, match=what):
        Table(np.array(x), np.array(y), periodic)


def test_the_rounding_of_the_last_digit_of_a_period_is_removed():
    angle = np.linspace(0.0, 2 * np.pi, 13)
    table = Table(angle, np.sin(angle), periodic=True)  # sin(2 pi) is not zero in floating point
    assert table.y[-1] == table.y[0]
