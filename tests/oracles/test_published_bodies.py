"""The reference solver on published pendulums, tops and free bodies.

A printed value is compared to all its digits. Where a problem was published without a trajectory, the tables here were
computed from its definition independently. Both the solver and these tables are also compared with a closed form or
with equations in few coordinates, integrated in `oracles.benchmarks`.
"""

import numpy as np
import pytest

from consilience.mechanism import GROUND, rotation_from_quaternion
from oracles.benchmarks.build import X, Y, Z, body, mechanism, placed, run, run_disguised, started
from oracles.benchmarks.compare import BAR, apart, far, table
from oracles.closed_forms.free_body import Asymmetric, symmetric
from oracles.closed_forms.heavy_top import HeavyTop
from oracles.integrate import integrate
from oracles.test_published_values import A01

# --- A01: simple pendulum -------------------------------------------------------------------------------------------


def point_mass():
    """Point mass on a massless rod; the body does not rotate, so that its inertia has no effect."""
    rod = np.column_stack([Y, Z, X])
    return mechanism(
        "a01", -9.81 * Y, [body("mass", 1, -X, (0.1, 0.2, 0.25))], [("rod", "rod", GROUND, "mass", 0 * X, rod, -X)]
    )


def equivalent_body():
    """Body on a pin with reduced length J / (m l) = 1 m: it swings as the point mass does."""
    return mechanism(
        "a01", -9.81 * Y, [body("mass", 2, -0.4 * X, 3 * (2 * 0.24,))], [("pin", "revolute", GROUND, "mass", 0 * X, Z)]
    )


@pytest.mark.parametrize("make", [point_mass, equivalent_body])
def test_a01_simple_pendulum(make):
    plain = make()
    times = np.array(list(A01))
    for motion in (run(plain, started(plain), times), run_disguised(plain, started(plain), times, seed=2)):
        found = np.column_stack([motion.point("mass", -X)[:, :2], motion.point_velocity("mass", -X)])
        expected = np.array(list(A01.values()))
        assert far(found[:, :2], expected[:, :2]) < BAR
        # at a radius of 1 m the speed equals |phi'|
        assert far(np.linalg.norm(found[:, 2:], axis=1), np.abs(expected[:, 2])) < BAR


# --- heavy top ------------------------------------------------------------------------------------------------------

# centre of mass, angular velocity in world axes; computed independently in long double [Bruels, Cardona & Arnold 2012]
HEAVY_TOP = [
    (0.2, 0.605550561377119770, 0.598957681794919158, -0.523983027430003185,
     86.3716932570613419, 92.4316581220029613, -80.7944509109773862),
    (0.8, -0.418162424317115400, 0.907207967946476336, -0.0459770571443834391,
     -64.1485311685308134, 135.201596966414634, -11.2997367694526692),
    (1, 0.173343964098386042, 0.640088592070568781, -0.748490791133581312,
     20.1397865057640207, 96.2433438658260551, -113.434425787882206),
    (2, -0.150416822745641763, -0.724165591636895654, -0.673022269560444092,
     -27.6585155258232697, -106.163804143124448, -102.462463805326103),
]  # fmt: skip
HEAVY_TOP_QUATERNIONS = [
    (0.2, -0.708279152974312562, 0.438781088126581897, 0.545728396145417673, 0.0893997528240050102),
    (1, 0.732943980679663718, -0.278285719337612680, 0.531824611334162617, -0.320176142736249282),
    (2, 0.122947135041533465, -0.491079892550027017, 0.350430030343620960, -0.787986887550485669),
]
W0 = np.array([0.0, 150.0, -4.61538])


@pytest.fixture(scope="module")
def topped():
    top = body("top", 15, Y, (0.234375, 0.46875, 0.234375), at=0 * Y)
    plain = mechanism("heavy_top", -9.81 * Z, [top], [("ball", "spherical", GROUND, "top", 0 * Y, np.eye(3))])
    state = placed(plain, {"top": (np.zeros(3), W0)})
    return run(plain, state, [0.01, 0.2, 0.8, 1.0, 2.0])


def heavy_top_equations(times):
    """Quaternion and angular velocity in body axes from Euler's equations about the fixed point."""
    side, along, weight = 15.234375, 0.46875, 15 * 9.81

    def rhs(y):
        # plain numbers: NumPy's overhead for small arrays would take most of the time
        p, a, b, c, u, v, w = y.tolist()
        norm = p * p + a * a + b * b + c * c
        # the vertical in body axes, and the moment of the weight at the end of y
        down = -weight / norm
        x, z = down * 2 * (a * c - p * b), down * (p * p - a * a - b * b + c * c)
        spin = (side - along) * v
        return np.array(
            [
                -0.5 * (a * u + b * v + c * w),
                0.5 * (p * u + b * w - c * v),
                0.5 * (p * v + c * u - a * w),
                0.5 * (p * w + a * v - b * u),
                (z - spin * w) / side,
                0.0,
                (-x + spin * u) / side,
            ]
        )

    y = integrate(rhs, np.concatenate([[1.0, 0, 0, 0], W0]), times, longest=0.01)
    return rotation_from_quaternion(y[:, :4] / np.linalg.norm(y[:, :4], axis=1)[:, None]), y[:, 4:]


def test_heavy_top(topped):
    times, expected = table(HEAVY_TOP)
    found = np.hstack([topped.point("top", Y), topped.spin("top")])[1:]
    assert far(found[:, :3], expected[:, :3]) < BAR
    assert far(found[:, 3:], expected[:, 3:]) < BAR
    asked, quats = table(HEAVY_TOP_QUATERNIONS)
    rows = np.searchsorted([0.01, 0.2, 0.8, 1.0, 2.0], asked)
    assert apart(topped.R[rows, 0], quats) < BAR * 150
    R, w = heavy_top_equations(times)
    assert far(topped.R[1:, 0], R) < 2 * BAR
    assert far(topped.spin("top")[1:], np.einsum("tij,tj->ti", R, w)) < BAR
    # height of the centre of mass in closed form; no azimuth, which is undetermined where the axis passes straight down
    angles = (np.pi, np.pi / 2, 0.0)
    top = HeavyTop(15.234375, 0.46875, 15 * 9.81, angles, (-4.61538, 0.0, 150.0))
    assert far(found[:, 2], np.cos(top.solve(times)[:, 1])) < BAR


def test_heavy_top_against_printed_values(topped):
    # a regression test of Kynema prints 15 digits from steps of 2e-6, of which six are right
    assert topped.point("top", Y)[-1] - Y == pytest.approx(
        (-0.150416985652933, -1.724164450779749, -0.673023460701136), abs=2e-6
    )
    # from Exudyn: 12 digits at 2 s; at 0.01 s from a coarse step
    assert topped.spin("top")[-1, 1] == pytest.approx(-106.163804143, abs=1e-8)
    assert topped.spin("top")[0, 1] == pytest.approx(149.8473939540758, rel=1e-7)


# --- free bodies ----------------------------------------------------------------------------------------------------

# quaternion, angular velocity in body axes; computed independently for Drake's symmetric body, OSRF's box and
# a rotation about the intermediate axis
KANE = [
    (1, -0.670395090985309167, -0.374160606343273625, -0.603126566220264944, -0.216362214268076944,
     -3.03862037694336302, 0.725800389104727928, 5),
]  # fmt: skip
KANE_LATER = (-0.848238737814345660, -0.283963115314360500, 0.318635398175574431, -0.313572122232800060)
BOX = [
    (1, 3.42379844155459835, 2.81918543839796545, 3.92838444946703323),
    (2, 0.336649760783955604, -4.98493293518989948, 0.382181881304556466),
    (5, 0.374990779685940981, 4.98094688100954058, -0.426603245322205413),
    (10, 2.75584040514685120, -3.73596351921621798, -3.16180900346752039),
]
BOX_QUATERNIONS = [
    (5, 0.895698731785681943, -0.0151546505110984117, -0.443235083728962313, 0.0321990527374211969),
    (10, 0.225164563413958327, -0.619927562499452423, -0.277029150687194808, 0.698745723640310061),
]
MIDDLE = [
    (1, -0.00730936993731357212, 2.00001164324388859, 0.00919106248628712518),
    (5, -1.08357528612950452, 1.68106055788878778, 0.625655762836252096),
    (10, -0.0410499679707795174, -1.99960368576615651, 0.0250672420395092802),
]
MIDDLE_QUATERNIONS = [(5, 0.271638471781739093, 0.0658515187286083238, -0.918905493601580891, -0.278368123099704185)]


def free(mass, moments, gravity):
    joints = [("f", "free", GROUND, "b", np.zeros(3), np.eye(3))]
    return mechanism("free", gravity, [body("b", mass, np.zeros(3), moments)], joints)


def test_symmetric_body_of_drake():
    times = np.array([1.0, 5.0])
    quats, w = symmetric(0.04, 0.02, (2, -2.4, 5), times)
    assert far(np.hstack([quats, w])[:1], table(KANE)[1]) < 1e-14
    assert far(quats[1], np.array(KANE_LATER)) < 1e-14
    plain = free(1.0, (0.04, 0.04, 0.02), 0 * Z)
    motion = run(plain, placed(plain, {"b": (0 * X, (2, -2.4, 5))}), times)
    assert apart(motion.R[:, 0], quats) < BAR


@pytest.mark.parametrize(
    ("moments", "w0", "rates", "quats"),
    [
        ((0.97, 0.82, 0.17), (0.1, 5, 0.1), BOX, BOX_QUATERNIONS),
        ((1, 2, 3), (0.01, 2, 0.01), MIDDLE, MIDDLE_QUATERNIONS),
    ],
    ids=["box", "intermediate axis"],
)
def test_asymmetric_free_body(moments, w0, rates, quats):
    times, expected = table(rates)
    asked, orientations = table(quats)
    rows = np.searchsorted(times, asked)
    top = Asymmetric(moments, w0)
    # near the separatrix an initial error, at rounding level, grows 100-fold in every half-period
    assert far(top.rates(times), expected) < 3e-12
    assert apart(top.orientations(times)[rows], orientations) < 3e-12
    plain = free(12.0, moments, -9.8 * Z)
    motion = run(plain, placed(plain, {"b": ((-2, 2, 8), w0)}), times)
    found = np.einsum("tji,tj->ti", motion.R[:, 0], motion.spin("b"))
    assert far(found, expected) < BAR
    assert apart(motion.R[rows, 0], orientations) < BAR
    t = times[:, None]
    assert far(motion.p[:, 0], np.array([-2, 2, 8]) * t - 4.9 * t * t * Z) < BAR


def test_period_of_the_intermediate_axis():
    top = Asymmetric((1, 2, 3), (0.01, 2, 0.01))
    period = 21.9551458793539326
    assert far(top.rates(np.array([period])), np.array([[0.01, 2, 0.01]])) < 1e-11
