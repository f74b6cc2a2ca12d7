"""Impulses of simultaneous impacts by the laws of Newton, Moreau and Poisson, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from consilience.reference.contact.impulse import solve_impulse
from consilience.reference.contact.problem import ContactProblem, FrictionSet
from touching_bodies import CORNERS, LUMPY, rod, total, touching


def test_impact_without_collision():
    # the same rod at 1.1 rad: tip and centre at speed 1; the impulse that stops the tip
    problem = rod(1.1, 1.5)
    found = solve_impulse(replace(problem, free=np.array([0.0, 1.0, 0.0])), np.zeros(1), "moreau")
    np.testing.assert_allclose(found.impulse, [0.303186151432346, -0.404312081029245, 0.0], rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(found.velocity, 0.0, atol=1e-14)


@pytest.mark.parametrize("law", ["newton", "moreau", "poisson"])
@pytest.mark.parametrize(("count", "e"), [(3, 1.0), (3, 0.5), (5, 1.0), (5, 0.5)])
def test_balls_in_a_row(law, count, e):
    # simultaneous: the first keeps (1 - (n - 1) e)/n, the others have (1 + e)/n, by every law
    J = np.eye(count)[1:] - np.eye(count)[:-1]
    v = np.eye(count)[0]
    names = tuple("abcd"[: count - 1])
    problem = ContactProblem(J @ J.T, J @ v, names, tuple(range(count - 1)))
    after = v + J.T @ solve_impulse(problem, np.full(count - 1, e), law).impulse
    np.testing.assert_allclose(after, [(1 - (count - 1) * e) / count, *[(1 + e) / count] * (count - 1)], atol=1e-12)


@pytest.mark.parametrize("law", ["newton", "moreau", "poisson"])
def test_flat_box_drop(law):
    # all corners reverse, no spin; single impulses are undetermined, their sum is (1 + e) m u
    problem = touching(CORNERS, 2.0, LUMPY, np.zeros(6), 0.4)
    before = np.tile([-1.9, 0.0, 0.0], 4)
    found = solve_impulse(replace(problem, free=before), np.full(4, 0.3), law)
    np.testing.assert_allclose(found.velocity, -0.3 * before, atol=1e-12)
    np.testing.assert_allclose(total(problem, found.impulse), [0.0, 0.0, 1.3 * 2.0 * 1.9], atol=1e-12)


@pytest.mark.parametrize(
    ("degrees", "mu", "slip", "law", "impulse", "after"),
    [
        (45.0, 0.3, 0.5, "poisson", (0.731707317073171, -0.219512195121951), (1.04878048780488, 0.5)),
        (45.0, 0.3, 0.5, "newton", (0.731707317073171, -0.219512195121951), (1.04878048780488, 0.5)),
        (45.0, 0.3, -0.2, "poisson", (0.673170731707, -0.148617886179), (0.438211382114, 0.46)),
        (45.0, 0.3, -0.2, "newton", (0.6, 0.0), (0.7, 0.5)),
        (45.0, 0.3, -0.2, "moreau", (0.731707317073171, -0.219512195121951), (0.34878048780488, 0.5)),
        (60.0, 0.8, 0.2, "poisson", None, (0.0, 0.53997040325159)),
    ],
)
def test_rod_hits_the_floor(degrees, mu, slip, law, impulse, after):
    # half-length 1, 1 kg, tip to the right of and below the centre, e 0.5; laws differ where the slip reverses
    problem = replace(rod(np.radians(degrees), mu), free=np.array([-1.0, slip, 0.0]))
    found = solve_impulse(problem, np.array([0.5]), law)
    np.testing.assert_allclose(found.velocity, [after[1], after[0], 0.0], atol=1e-11)
    if impulse:
        np.testing.assert_allclose(found.impulse, [*impulse, 0.0], atol=1e-11)


@pytest.mark.parametrize("turn", [0.0, 0.7])
@pytest.mark.parametrize("slip", [0.0, 1e-15, -1e-15, 1e-9, -1e-9, 0.01, 0.3, -0.3])
@pytest.mark.parametrize("mu", [0.59, 0.597, 0.6 - 1e-9, 0.6, 0.6 + 1e-9, 0.603, 0.62])
def test_friction_that_hardly_holds_the_rod(mu, slip, turn):
    # G_nn = G_tt = 2.5, G_nt = 1.5: sticks from mu = 0.6, and slides on in one line; tangents turned about the normal
    rate = {sense: 1.5 - 2.5 * sense * mu for sense in (1.0, -1.0)}  # of the slip, per normal impulse
    force = -min(mu, 0.6)  # from rest
    first, sense = np.inf, np.copysign(1.0, slip)
    if abs(slip) > 1e-14 and sense * rate[sense] < 0.0:
        first = -slip / rate[sense]  # stops there
    elif abs(slip) > 1e-14:
        force = -sense * mu
    sliding = -sense * mu if abs(slip) > 1e-14 else force
    compressed = 1.0 / (2.5 + 1.5 * sliding)
    if compressed > first:
        compressed = first + (1.0 - first * (2.5 + 1.5 * sliding)) / (2.5 + 1.5 * force)
    N = 1.5 * compressed
    T = sliding * min(first, N) + force * max(N - first, 0.0)
    problem, R = rod(np.pi / 4, mu), np.eye(3)
    R[1:, 1:] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    turned = replace(problem, delassus=R @ problem.delassus @ R.T, free=R @ [-1.0, slip, 0.0])
    found = solve_impulse(turned, np.array([0.5]), "poisson")
    np.testing.assert_allclose(R.T @ found.impulse, [N, T, 0.0], rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("e", [0.0, 0.5])
@pytest.mark.parametrize("speed", [1e-3, 1e-6, 1e-12])
def test_slow_slip_turns_until_friction_just_balances_it(speed, e):
    # Keller's hodograph for mu G_tt = A, the limit kappa = 1 of that below: s(th) = U (1 + cos(th0))/(1 + cos(th)), and
    # dN = s dth/(A sin(th)), so that long before the end of compression U (1 + cos(th0))/2 is left along t1 for good
    A, g_t, first, compressed = 0.45, 2.1, 2.0, 0.4
    before = speed * np.array([np.cos(first), np.sin(first)])
    left = np.array([0.5 * speed * (1.0 + np.cos(first)), 0.0])
    N = np.array([compressed, (1.0 + e) * compressed])
    T = (left - before - np.outer(N, [A, 0.0])) / g_t
    c, s = np.cos(0.4), np.sin(0.4)
    R = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])  # tangents of no meaning
    G = np.array([[1.9, A, 0.0], [A, g_t, 0.0], [0.0, 0.0, g_t]])
    approach = -(G[0] @ [N[0], *T[0]])
    friction = (FrictionSet("c", (1, 2), A / g_t, A / g_t, 0),)
    problem = ContactProblem(R @ G @ R.T, R @ [approach, *before], ("c",) * 3, (0,), friction)
    found = solve_impulse(problem, np.array([e]), "poisson")
    np.testing.assert_allclose(R.T @ found.impulse, [N[1], *T[1]], rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("aside", [0.0, 0.05])
def test_arm_wedged_by_its_ball_joint(aside):
    # a homogeneous rod on a ball joint strikes the floor with its tip: G = 3/m (1 - a a^T). Friction of at least
    # |a_t|/|a_n| holds it for any normal impulse: slip and approach end together, by p = -m u/3 but for what is along a
    m, a, n = 1.3, np.array([-0.36, 0.48, -0.8]), np.eye(3)[0]
    before = aside * np.cross(n, a) - (n - a[0] * a)
    friction = (FrictionSet("c", (1, 2), 3.0, 3.0, 0),)
    problem = ContactProblem(3.0 / m * (np.eye(3) - np.outer(a, a)), before, ("c",) * 3, (0,), friction)
    found = solve_impulse(problem, np.array([0.5]), "poisson")
    np.testing.assert_allclose(found.velocity, 0.0, atol=1e-12)
    np.testing.assert_allclose(found.impulse - (a @ found.impulse) * a, -m / 3.0 * before, atol=1e-12)
    assert np.linalg.norm(found.impulse[1:]) <= 3.0 * found.impulse[0]


def test_tip_that_grazes_is_reversed():
    # an impulse gives the tip of an arm 1e-7 of the speed that a free body would get: Newton's law reverses it by e
    problem = ContactProblem(np.array([[1e-14]]), np.array([-1e-7]), ("c",), (0,), scale=np.ones(1))
    found = solve_impulse(problem, np.array([0.5]), "newton")
    np.testing.assert_allclose(found.velocity, [0.5e-7], rtol=1e-12)
    assert found.impulse[0] == pytest.approx(1.5e7, rel=1e-12)


@pytest.mark.parametrize("kappa", [0.7, 1.6])
def test_slip_that_turns_during_an_impact(kappa):
    # G_tt = g_t 1, G_tn along t1: hodograph s(th) = U sin(th0)/sin(th) (tan(th/2)/tan(th0/2))^kappa (Keller 1986)
    A, g_t, speed, first, last = 0.45, 2.1, 1.3, 2.0, 1.1
    mu = kappa * A / g_t

    def slip(th):
        return speed * np.sin(first) / np.sin(th) * (np.tan(th / 2) / np.tan(first / 2)) ** kappa

    def remaining(s, th):  # normal impulse until the slip would stop
        return s * (kappa + np.cos(th)) / (A * (kappa**2 - 1.0))

    N = remaining(speed, first) - remaining(slip(last), last)
    before, after = (s * np.array([np.cos(th), np.sin(th)]) for s, th in ((speed, first), (slip(last), last)))
    T = (after - before - [A * N, 0.0]) / g_t
    G = np.array([[1.9, A, 0.0], [A, g_t, 0.0], [0.0, 0.0, g_t]])
    approach = -(G[0] @ [N, *T])  # compression ends at that heading
    problem = ContactProblem(G, np.array([approach, *before]), ("c",) * 3, (0,), (FrictionSet("c", (1, 2), mu, mu, 0),))
    found = solve_impulse(problem, np.zeros(1), "poisson")
    np.testing.assert_allclose(found.impulse, [N, *T], rtol=1e-11)
    np.testing.assert_allclose(found.velocity, [0.0, *after], atol=1e-11)


def rod_on_two_walls(mu):
    """Delassus matrix (n, t of the floor; n, t of the wall) of a body whose two tips touch a floor and a wall."""
    tips = np.array([[0.41, 0.38], [-0.03, 0.28]])  # x, z from the centre of mass
    rows = [[(0.0, 1.0), (1.0, 0.0)][k] for k in (0, 1, 1, 0)]
    rates = np.array([[*row, row[0] * z - row[1] * x] for row, (x, z) in zip(rows, tips[[0, 0, 1, 1]], strict=True)])
    sets = tuple(FrictionSet("c", (2 * k + 1,), mu, mu, 2 * k) for k in (0, 1))
    return rates @ np.diag([1.0, 1.0, 1.0 / 0.15]) @ rates.T, rates, sets


def test_contacts_that_act_on_one_another_slide_through_both_phases_of_poissons_law():
    # what slides in one sense throughout has N of compression by u_n = 0, and 1 + e times that in all
    G, rates, sets = rod_on_two_walls(0.1)
    before, e = rates @ np.array([-0.1, -2.3, -2.8]), np.array([0.7, 0.3])
    slide = np.array([[1.0, -0.1 * np.sign(before[1]), 0.0, 0.0], [0.0, 0.0, 1.0, -0.1 * np.sign(before[3])]]).T
    N = np.linalg.solve((G @ slide)[[0, 2]], -before[[0, 2]])
    p = slide @ ((1.0 + e) * N)
    for passed in (before + G @ slide @ N, before + G @ p):
        assert np.min(N) > 0.0
        assert np.all(passed[[1, 3]] * before[[1, 3]] > 0.0)
        assert np.min(passed[[0, 2]]) > -1e-12
    found = solve_impulse(ContactProblem(G, before, ("c",) * 4, (0, 2), sets), e, "poisson")
    assert found.unique is not False
    np.testing.assert_allclose(found.impulse, p, atol=1e-13)


def test_compression_that_friction_leaves_open_leaves_the_rebound_open():
    # both tips stick in compression: three equations for four impulses, and restitution returns a share of two of them
    G, rates, sets = rod_on_two_walls(0.9)
    before = rates @ np.array([-1.0, -1.2, 0.3])
    problem = ContactProblem(G, before, ("c",) * 4, (0, 2), sets)
    np.testing.assert_allclose(solve_impulse(problem, np.zeros(2), "poisson").velocity, 0.0, atol=1e-12)
    assert solve_impulse(problem, np.array([0.7, 0.3]), "poisson").unique is False
    smooth = solve_impulse(replace(problem, friction=()), np.array([0.7, 0.3]), "poisson")
    assert smooth.unique is not False


@pytest.mark.parametrize("seed", range(8))
def test_what_compression_stops_and_restitution_returns_nothing_to_stays_at_rest_by_poissons_law(seed):
    # one freedom: two contacts that approach stop it, however they share the impulse
    row = np.random.default_rng(seed).normal(size=6)
    row[[0, 3]] = np.abs(row[[0, 3]])
    sets = tuple(FrictionSet("c", (k + 1, k + 2), 0.4, 0.4, k) for k in (0, 3))
    problem = ContactProblem(np.outer(row, row), -1.3 * row, ("c",) * 6, (0, 3), sets, size=1.3)
    found = solve_impulse(problem, np.zeros(2), "poisson")
    assert found.unique is not False
    np.testing.assert_allclose(found.velocity, 0.0, atol=1e-12)


@pytest.mark.parametrize("laws", [("newton", "poisson"), ("moreau", "newton"), ("poisson", "moreau")])
def test_contacts_that_do_not_act_on_one_another_keep_their_laws_at_one_instant(laws):
    G = np.array([[2.3, 1.1, 0.3], [1.1, 3.0, 0.0], [0.3, 0.0, 1.0]])
    before, e = np.array([-1.0, 0.2, 0.4]), np.array([0.6])
    one = FrictionSet("c", (1, 2), 0.3, 0.3, 0)
    alone = [solve_impulse(ContactProblem(G, before, ("c",) * 3, (0,), (one,)), e, law).impulse for law in laws]
    assert np.max(np.abs(alone[0] - alone[1])) > 1e-3
    both = ContactProblem(
        *(np.kron(np.eye(2), G), np.tile(before, 2), ("c",) * 6, (0, 3)), (one, FrictionSet("d", (4, 5), 0.3, 0.3, 3))
    )
    np.testing.assert_allclose(solve_impulse(both, np.tile(e, 2), laws).impulse, np.concatenate(alone), atol=1e-14)


@pytest.mark.parametrize("law", ["newton", "moreau"])
@pytest.mark.parametrize("slip", [(0.0, 0.0), (9e-7, 0.0), (-9e-7, 0.0), (3e-7, -8e-7)])
def test_slip_below_that_of_rest_has_no_direction(law, slip):
    # the tip of a rod strikes and sticks: N = (1 + e) u / (G_nn - G_nt^2 / G_tt), T = -G_nt / G_tt N, within the cone
    problem, e = rod(1.3, 0.9), 0.3
    n, t = problem.normals[0], problem.friction[0].rows[0]
    G = problem.delassus
    N = (1.0 + e) / (G[n, n] - G[n, t] ** 2 / G[t, t])
    expected = np.zeros(3)
    expected[[n, t]] = N, -G[n, t] / G[t, t] * N
    assert abs(expected[t]) < 0.9 * N
    free = np.zeros(3)
    free[[n, *problem.friction[0].rows]] = -1.0, *slip
    found = solve_impulse(replace(problem, free=free), np.array([e]), law, at_rest=1e-6)
    np.testing.assert_allclose(found.impulse, expected, atol=1e-5)
    assert found.modes == ("sticking",)
