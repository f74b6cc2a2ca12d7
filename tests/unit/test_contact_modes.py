"""Algebra of contact: modes, forces and accelerations, impulses, against closed forms and planted solutions.

Bodies touch at points: a row is the acceleration of a point along its normal or a tangent, G = J M^-1 J^T. Sources are
named at each test; what is not published there is elementary statics of one body.
"""

from dataclasses import replace

import numpy as np
import pytest

from consilience.errors import NumericalFailure
from consilience.mechanism import skew
from consilience.reference.contact.cones import sticking_margin
from consilience.reference.contact.decision import decide, solutions
from consilience.reference.contact.impulse import solve_impulse
from consilience.reference.contact.inclusion import residual
from consilience.reference.contact.mode_system import sliding_indicator, solve_with_modes
from consilience.reference.contact.problem import ContactProblem, FrictionSet
from consilience.reference.contact.search import PainleveParadox

g = 9.81
LUMPY = np.array([[0.031, 0.004, -0.006], [0.004, 0.042, 0.003], [-0.006, 0.003, 0.055]])
CORNERS = np.array([[x, y, -0.1] for x in (-0.3, 0.3) for y in (-0.2, 0.2)])
FEET = np.array([[0.3, 0.02, -0.1], [-0.14, 0.26, -0.1], [-0.16, -0.25, -0.1]])
FLOOR = np.eye(3)[[2, 0, 1]]
"""Rows n, t1, t2 of a floor."""


def touching(points, mass, inertia, wrench, mu, frames=FLOOR, cone="circle", slip=(0.0, 0.0), angle=0.0):
    """Contact problem of one body at points relative to its centre of mass, slip in the tangents of each frame."""
    frames = np.broadcast_to(frames, (len(points), 3, 3))
    J = np.vstack([np.hstack([R, -R @ skew(s)]) for R, s in zip(frames, points, strict=True)])
    weight = np.zeros((6, 6))
    weight[:3, :3], weight[3:, 3:] = np.eye(3) / mass, np.linalg.inv(inertia)
    friction = []
    for k in range(len(points)):
        n, t = 3 * k, (3 * k + 1, 3 * k + 2)
        if cone == "box":
            friction += [FrictionSet(f"p{k}", (row,), mu, mu, n) for row in t]
        else:
            facets = {"circle": 0, "diamond": 4, "octagon": 8}[cone]
            friction.append(FrictionSet(f"p{k}", t, mu, mu, n, facets=facets, angle=angle))
    names = tuple(f"p{k // 3}" for k in range(3 * len(points)))
    normals = tuple(range(0, 3 * len(points), 3))
    sliding = np.tile([0.0, *slip], len(points))
    return ContactProblem(J @ weight @ J.T, J @ weight @ np.asarray(wrench), names, normals, tuple(friction), sliding)


def total(problem, force, frames=FLOOR):
    """Sum of the forces of all points, axes of the body."""
    frames = np.broadcast_to(frames, (len(problem.normals), 3, 3))
    return np.einsum("kji,kj->i", frames, force.reshape(-1, 3))


def weight_on_incline(mass, slope):
    return np.array([mass * g * np.sin(slope), 0.0, -mass * g * np.cos(slope), 0.0, 0.0, 0.0])


@pytest.mark.parametrize("points", [CORNERS, FEET], ids=["four corners", "three feet"])
@pytest.mark.parametrize(
    ("mu", "slip", "sum_of_friction"),
    [
        (0.5, 0.0, -np.sin(np.radians(20.0))),  # rests: mu > tan 20 deg
        (0.25, 0.0, -0.25 * np.cos(np.radians(20.0))),  # breaks away downwards
        (0.25, -3.0, 0.25 * np.cos(np.radians(20.0))),  # thrown up
        (0.5, 3.0, -0.5 * np.cos(np.radians(20.0))),  # slides down
    ],
)
def test_block_on_an_incline(points, mu, slip, sum_of_friction):
    # a body that only translates slides like a particle
    slope = np.radians(20.0)
    found = decide(touching(points, 2.0, LUMPY, weight_on_incline(2.0, slope), mu, slip=(slip, 0.0)))
    problem_sum = total(touching(points, 2.0, LUMPY, np.zeros(6), mu), found.force)
    np.testing.assert_allclose(problem_sum / (2.0 * g), [sum_of_friction, 0.0, np.cos(slope)], atol=1e-12)
    acceleration = found.acceleration.reshape(-1, 3)
    np.testing.assert_allclose(acceleration - [0.0, g * (np.sin(slope) + sum_of_friction), 0.0], 0.0, atol=1e-11)
    assert not found.others
    single = np.eye(3 * len(points))[0]
    assert found.determined(single) == (len(points) == 3)


@pytest.mark.parametrize(
    ("cone", "degrees", "friction"),
    [
        ("circle", 30.0, (-np.cos(np.pi / 6), -np.sin(np.pi / 6))),
        ("diamond", 30.0, (-1.0, 0.0)),
        ("diamond", 45.0, (-0.5, -0.5)),  # on the bisector both brake, and the heading stays
        ("diamond", 60.0, (0.0, -1.0)),
        ("box", 30.0, (-1.0, -1.0)),
        ("octagon", 30.0, (-np.cos(np.pi / 4), -np.sin(np.pi / 4))),
        ("octagon", 22.5, (-(np.cos(np.pi / 8) ** 2), -np.cos(np.pi / 8) * np.sin(np.pi / 8))),
    ],
)
def test_skew_slide_with_every_cone(cone, degrees, friction):
    # block of 2 kg, mu 0.4, on a plane of normal (1, 2, 2)/3: friction in units of mu m g
    n, mu, mass = np.array([1.0, 2.0, 2.0]) / 3.0, 0.4, 2.0
    t1 = np.array([1.0, 0.0, 0.0]) - n[0] * n
    R = np.array([n, t1 / np.linalg.norm(t1), np.cross(n, t1 / np.linalg.norm(t1))])
    heading = np.radians(degrees)
    slip = 3.0 * np.array([np.cos(heading), np.sin(heading)])
    feet = FEET @ FLOOR.T @ R  # the same feet, under the tilted plane
    problem = touching(feet, mass, LUMPY, [*(-mass * g * n), 0.0, 0.0, 0.0], mu, R, cone, slip)
    found = decide(problem)
    acceleration = found.acceleration.reshape(-1, 3)
    np.testing.assert_allclose(acceleration, np.tile([0.0, *(mu * g * np.array(friction))], (3, 1)), atol=1e-12)
    assert found.unique


def test_pyramid_with_turned_vertices():
    # two feet would do: the vertex nearest to -u_t, at 20 + 180 deg for a heading of 5 deg
    problem = touching(
        FEET, 2.0, LUMPY, weight_on_incline(2.0, 0.0), 0.4, cone="diamond", slip=(1.0, 0.0875), angle=0.35
    )
    a = decide(problem).acceleration[1:3]
    np.testing.assert_allclose(a, -0.4 * g * np.array([np.cos(0.35), np.sin(0.35)]), atol=1e-12)


@pytest.mark.parametrize("cone", ["circle", "diamond", "box"])
@pytest.mark.parametrize("push", [0.999, 1.001])
def test_breakaway(cone, push):
    # force along 30 deg in the plane of the feet: at mu m g for the circle, less for the diamond, more for the box
    bound = {"circle": 1.0, "diamond": 1.0 / (np.cos(np.pi / 6) + 0.5), "box": 1.0 / np.cos(np.pi / 6)}[cone]
    force = push * bound * 0.4 * 2.0 * g * np.array([np.cos(np.pi / 6), 0.5, 0.0])
    wrench = [*(force - [0.0, 0.0, 2.0 * g]), 0.1 * force[1], -0.1 * force[0], 0.0]
    problem = touching(FEET, 2.0, LUMPY, wrench, 0.4, cone=cone)
    margin = sticking_margin(problem, problem.natural_modes())
    assert (margin.value > 0.0) == (push < 1.0)
    assert np.allclose(decide(problem).acceleration, 0.0, atol=1e-12) == (push < 1.0)


def test_static_friction_holds_more_than_kinetic():
    problem = touching(FEET, 2.0, LUMPY, weight_on_incline(2.0, np.radians(20.0)), 0.25)
    held = replace(problem, friction=tuple(replace(f, static=0.4) for f in problem.friction))
    np.testing.assert_allclose(decide(held).acceleration, 0.0, atol=1e-12)
    down = {j: np.array([1.0, 0.0]) for j in range(3)}
    slope = np.radians(20.0)
    slides = decide(held, held.natural_modes(), started=down)
    np.testing.assert_allclose(slides.acceleration[1], g * (np.sin(slope) - 0.25 * np.cos(slope)), rtol=1e-12)


def rod(angle, mu, rate=0.0, slip=1.0):
    """Slender rod of half-length 1, mass 1, its tip on the floor sliding towards +x, centre behind it."""
    tip = np.array([np.cos(angle), 0.0, -np.sin(angle)])
    inertia = np.diag([1.0, 1.0, 1.0]) / 3.0
    problem = touching([tip], 1.0, inertia, [0.0, 0.0, -g, 0.0, 0.0, 0.0], mu, slip=(slip, 0.0))
    return replace(problem, free=problem.free + np.array([rate**2 * np.sin(angle), 0.0, 0.0]))


@pytest.mark.parametrize(
    ("angle", "rate", "A", "B", "normal_forces"),
    [
        (0.9, 0.0, -0.03196031151557, -9.81, ()),
        (1.1, 0.0, -0.201868584477097, -9.81, ()),
        (1.1, 4.0, -0.201868584477097, 4.44931776098297, (0.0, 22.04066458636)),
        (0.9, 4.0, -0.03196031151557, 2.72323055403973, (0.0, 85.2066336309978)),
    ],
)
def test_painleve_rod(angle, rate, A, B, normal_forces):
    # Genot and Brogliato (1999): A = 1 + 3 cos th (cos th - mu sin th), mu 1.5
    problem = rod(angle, 1.5, rate)
    assert sliding_indicator(problem, problem.natural_modes()) * problem.delassus[0, 0] == pytest.approx(A, rel=1e-11)
    assert problem.free[0] == pytest.approx(B, rel=1e-12)
    found = sorted(float(s.force[0]) for s in solutions(problem))
    np.testing.assert_allclose(found, normal_forces, rtol=1e-11)
    if normal_forces:
        assert decide(problem).unique is False
        held = decide(problem, problem.natural_modes())
        assert held.force[0] == pytest.approx(normal_forces[1], rel=1e-11)  # the branch the motion is on
    else:
        with pytest.raises(PainleveParadox, match=r"contact p0: sliding friction jams") as paradox:
            decide(problem)
        assert (paradox.value.slope, paradox.value.constant) == pytest.approx((A, B), rel=1e-11)


def test_impact_without_collision():
    # the same rod at 1.1 rad: tip and centre at speed 1; the impulse that stops the tip
    problem = rod(1.1, 1.5)
    found = solve_impulse(replace(problem, free=np.array([0.0, 1.0, 0.0])), np.zeros(1), "moreau")
    np.testing.assert_allclose(found.impulse, [0.303186151432346, -0.404312081029245, 0.0], rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(found.velocity, 0.0, atol=1e-14)


def test_falling_rod_at_its_first_instant():
    # length 1, 0.2 rad off the vertical, at rest: a pendulum about its tip, rate of turning 3 g sin(th) / (2 L)
    th, mass, inertia = 0.2, 1.3, 1.3 / 12.0
    tip = -0.5 * np.array([np.sin(th), 0.0, np.cos(th)])
    alpha = 1.5 * g * np.sin(th)
    lumpy = np.diag([inertia, inertia, 0.002])
    for mu, sticks in ((0.2, True), (0.05, False)):
        found = decide(touching([tip], mass, lumpy, [0.0, 0.0, -mass * g, 0.0, 0.0, 0.0], mu))
        if sticks:
            N, T = mass * (g - 0.5 * alpha * np.sin(th)), mass * 0.5 * alpha * np.cos(th)
        else:  # the centre falls, the tip slides back: N (1/m + (s - mu c) s h^2/I) = g, moment about the centre
            N = mass * g / (1.0 + 3.0 * np.sin(th) * (np.sin(th) - mu * np.cos(th)))
            T = mu * N
        np.testing.assert_allclose(found.force, [N, T, 0.0], rtol=1e-12, atol=1e-12)
        assert found.unique


def trough(mu, friction_slip=(0.0, 0.0)):
    """Ball of 2 kg and radius 0.1 in a trough of 90 degrees that descends at 20 degrees."""
    slope, n = np.radians(20.0), np.array([[0.0, 1.0, 1.0], [0.0, -1.0, 1.0]]) / np.sqrt(2.0)
    frames = np.array([[m, [1.0, 0.0, 0.0], np.cross(m, [1.0, 0.0, 0.0])] for m in n])
    wrench = weight_on_incline(2.0, slope)
    return touching(-0.1 * n, 2.0, 0.4 * 2.0 * 0.01 * np.eye(3), wrench, mu, frames, slip=friction_slip), frames


def test_ball_in_a_trough():
    slope = np.radians(20.0)
    problem, frames = trough(0.5)
    found = decide(problem, problem.natural_modes())
    assert {f.name for f in found.modes.friction} == {"sticking"}
    np.testing.assert_allclose(
        total(problem, found.force, frames), [-2.98241564979983, 0.0, 18.4367692198195], atol=1e-12
    )
    assert found.undetermined.shape[1] > 0
    assert not found.determined(np.eye(6)[0])
    for mu in (0.5, 0.2):  # for 0.2 the force of least norm leaves the cones, another does not
        problem, frames = trough(mu)
        found = decide(problem)
        sums = total(problem, found.force, frames)
        np.testing.assert_allclose(sums, [-2.98241564979983, 0.0, 18.4367692198195], atol=1e-12)
        forces = found.force.reshape(-1, 3)
        assert np.all(np.linalg.norm(forces[:, 1:], axis=1) <= mu * forces[:, 0] * (1 + 1e-12))
    least = solve_with_modes(problem, problem.natural_modes()).force.reshape(-1, 3)
    assert np.all(np.linalg.norm(least[:, 1:], axis=1) > 0.2 * least[:, 0])
    # without friction across, the ratio needed is c = 0.1143848; with it mu (N - x) = sqrt(T^2 + x^2) at best, and the
    # least mu is c/sqrt(1 + c^2)
    c = 0.114384809244306
    assert -sums[0] / (np.sqrt(2.0) * sums[2]) == pytest.approx(c, rel=1e-12)
    least_mu = c / np.sqrt(1.0 + c * c)
    for factor, sign in ((1.0, 0.0), (1.001, 1.0), (0.999, -1.0)):
        problem, _ = trough(factor * least_mu)
        margin = sticking_margin(problem, problem.natural_modes()).value
        assert abs(margin) < 1e-10 if sign == 0.0 else np.sign(margin) == sign
    problem, frames = trough(0.05)
    found = decide(problem)
    a = g * np.sin(slope) - 0.05 * np.sqrt(2.0) * g * np.cos(slope)
    assert total(problem, found.force, frames)[0] / 2.0 + g * np.sin(slope) == pytest.approx(
        2.70337937909952, rel=1e-12
    )
    assert a == pytest.approx(2.70337937909952, rel=1e-12)


def test_wedged_ball_has_two_answers():
    # friction angle above that of the walls: the ball can hang between them, or fall into them; both walls hold it
    problem, _ = trough(1.2)
    margin = sticking_margin(problem, problem.natural_modes())
    assert margin.value > 0.0
    assert decide(problem).force.reshape(-1, 3)[:, 0].min() > 0.0


def test_spinning_in_a_corner():
    # ball of radius 0.2, 1.5 kg, spinning so that the floor presses it on the wall x = 0: N = m g/(1 + mu^2), mu N
    n = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    frames = np.array([[n[0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], [n[1], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]])
    for spin, normal_forces in ((-30.0, (13.5, 4.05)), (30.0, (14.715, 0.0))):
        problem = touching(
            -0.2 * n, 1.5, 0.4 * 1.5 * 0.04 * np.eye(3), [0.0, 0.0, -1.5 * g, 0.0, 0.0, 0.0], 0.3, frames
        )
        # points at -r n move with w x s: along t1 by -r w at the floor, by r w at the wall
        problem = replace(problem, sliding=np.array([0.0, -0.2 * spin, 0.0, 0.0, 0.2 * spin, 0.0]))
        found = decide(problem)
        np.testing.assert_allclose(found.force[[0, 3]], normal_forces, rtol=1e-12, atol=1e-12)
        assert found.unique


def test_tip_or_slide():
    # box 0.2 x 0.2 x 0.6 on 25 degrees, mu 0.6: tips about the lower edge, which does not slip
    corners = np.array([[x, y, -0.3] for x in (-0.1, 0.1) for y in (-0.1, 0.1)])
    inertia = 2.0 / 12.0 * np.diag([0.4, 0.4, 0.08])
    found = decide(touching(corners, 2.0, inertia, weight_on_incline(2.0, np.radians(25.0)), 0.6))
    assert list(found.modes.closed) == [False, False, True, True]
    sums = total(touching(corners, 2.0, inertia, np.zeros(6), 0.6), found.force)
    np.testing.assert_allclose(sums, [-6.69572107186286, 0.0, 18.313775189489], atol=1e-12)
    # the upper corners rise by the angular acceleration times the width
    np.testing.assert_allclose(found.acceleration[[0, 3]], 0.2 * 2.66008203914944, rtol=1e-12)


@pytest.mark.parametrize("law", ["newton", "moreau", "poisson"])
@pytest.mark.parametrize(("count", "e"), [(3, 1.0), (3, 0.5), (5, 1.0), (5, 0.5)])
def test_balls_in_a_row(law, count, e):
    # simultaneous: the first keeps (1 - (n - 1) e)/n, the others have (1 + e)/n; the laws differ for Poisson
    J = np.eye(count)[1:] - np.eye(count)[:-1]
    v = np.eye(count)[0]
    names = tuple("abcd"[: count - 1])
    problem = ContactProblem(J @ J.T, J @ v, names, tuple(range(count - 1)))
    after = v + J.T @ solve_impulse(problem, np.full(count - 1, e), law).impulse
    if law == "poisson" and count > 2:
        assert np.sum(after) == pytest.approx(1.0, rel=1e-12)
        return
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


def violated(problem, force, acceleration):
    """Largest violation of Signorini's and Coulomb's laws (circles), written down again, in units of the largest."""
    size, rate = np.max(np.abs(force)) or 1.0, np.max(np.abs(problem.free))
    found = [0.0]
    for n in problem.normals:
        N, a = force[n], acceleration[n]
        found += [-N / size, -a / rate, abs(N * a) / (size * rate)]
    for f in problem.friction:
        rows = list(f.rows)
        T, bound, w, u = force[rows], f.kinetic * force[f.load], acceleration[rows], problem.sliding[rows]
        if np.any(u):
            found.append(np.max(np.abs(T + bound * u / np.linalg.norm(u))) / size)
        else:
            found += [(np.linalg.norm(T) - bound) / size, (T @ w + bound * np.linalg.norm(w)) / (size * rate)]
    return max(found)


def planted(rng, contacts, mu):
    """Problem of up to four lumpy bodies between walls with a solution chosen first, and that solution."""
    m, bodies = 3 * contacts, 1 + contacts // 2
    K = rng.normal(size=(m, 6 * bodies)) * rng.uniform(0.5, 2.0, size=6 * bodies)
    G = K @ K.T
    force, acceleration, sliding = np.zeros(m), np.zeros(m), np.zeros(m)
    for n in range(0, m, 3):
        t = slice(n + 1, n + 3)
        mode, heading = rng.choice(["open", "stick", "start", "slide"]), rng.normal(size=2)
        force[n], direction = rng.uniform(0.5, 2.0), heading / np.linalg.norm(heading)
        if mode == "open":
            force[n], acceleration[n], acceleration[t] = 0.0, rng.uniform(0.5, 2.0), heading
        elif mode == "stick":
            force[t] = rng.uniform(0.0, 0.9) * mu * force[n] * direction
        else:
            force[t], acceleration[t] = -mu * force[n] * direction, rng.uniform(0.5, 2.0) * direction
            if mode == "slide":
                sliding[t], acceleration[t] = heading, rng.normal(size=2)
    friction = tuple(FrictionSet(f"c{n // 3}", (n + 1, n + 2), mu, mu, n) for n in range(0, m, 3))
    names = tuple(f"c{row // 3}" for row in range(m))
    problem = ContactProblem(G, acceleration - G @ force, names, tuple(range(0, m, 3)), friction, sliding)
    return problem, force, acceleration


@pytest.mark.parametrize("contacts", [1, 2, 3, 8])
def test_planted_solutions_are_found(contacts):
    rng = np.random.default_rng(350 + contacts)
    for _ in range(6):
        problem, force, acceleration = planted(rng, contacts, mu=0.5)
        assert violated(problem, force, acceleration) < 1e-12
        found = decide(problem)
        assert violated(problem, found.force, found.acceleration) < 1e-10
        size = np.max(np.abs(problem.free))
        answers = [found.acceleration, *(other.acceleration for other in found.others)]
        distances = [np.max(np.abs(answer - acceleration)) for answer in answers]
        assert found.unique is None or min(distances) < 1e-8 * size


@pytest.mark.parametrize(("cone", "contacts"), [("diamond", 2), ("diamond", 8), ("box", 2), ("box", 8)])
def test_planted_solutions_of_pyramids_and_boxes_are_found(cone, contacts):
    # the forces of the planted circles are replaced by those of greatest dissipation in the other cone
    rng = np.random.default_rng(351)
    for _ in range(6):
        problem, force, acceleration = planted(rng, contacts, mu=0.5)
        sets = []
        for f in problem.friction:
            rows, u, N = list(f.rows), problem.sliding[list(f.rows)], force[f.load]
            heading = u if np.any(u) else acceleration[rows]
            if cone == "box":
                sets += [replace(f, rows=(row,)) for row in rows]
                signs = np.where(heading == 0.0, -force[rows] / max(0.5 * N, 1e-300), np.sign(heading))
                force[rows] = -0.5 * N * signs
            else:
                sets.append(replace(f, facets=4))
                corners = 0.5 * N * np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
                force[rows] = corners[np.argmin(corners @ heading)] if np.any(heading) else 0.5 * force[rows]
        problem = replace(problem, friction=tuple(sets), free=acceleration - problem.delassus @ force)
        found = decide(problem)
        assert np.max(np.abs(residual(problem, found.force, found.acceleration))) < 1e-11
        if found.unique:
            np.testing.assert_allclose(found.acceleration, acceleration, atol=1e-8 * np.max(np.abs(problem.free)))


def test_without_friction_the_accelerations_are_unique():
    # G positive semidefinite: two solutions differ by d with d . G d <= 0
    rng = np.random.default_rng(3)
    for _ in range(20):
        K = rng.normal(size=(8, 5))
        force = np.where(rng.random(8) < 0.5, rng.uniform(0.5, 2.0, 8), 0.0)
        acceleration = np.where(force > 0.0, 0.0, rng.uniform(0.5, 2.0, 8))
        problem = ContactProblem(K @ K.T, acceleration - K @ (K.T @ force), tuple("abcdefgh"), tuple(range(8)))
        found = decide(problem)
        assert found.unique
        np.testing.assert_allclose(found.acceleration, acceleration, atol=1e-9)


def test_joint_with_stop_and_dry_friction():
    # one coordinate of inertia 0.5, bound 0.2: it rests, is pressed on a stop, or slides against the bound
    def hinge(torque, stop, rate=0.0):
        G, names = np.full((2, 2), 2.0), ("stop", "dry")
        dry = FrictionSet("dry", (1,), 1.0, 1.0, offset=0.2)
        if stop:
            return ContactProblem(G, 2.0 * torque * np.ones(2), names, (0,), (dry,), np.array([0.0, rate]))
        return ContactProblem(
            G[1:, 1:], 2.0 * torque * np.ones(1), names[1:], (), (replace(dry, rows=(0,)),), np.array([rate])
        )

    assert decide(hinge(0.15, False)).force[0] == pytest.approx(-0.15, rel=1e-12)
    assert decide(hinge(0.5, False)).acceleration[0] == pytest.approx(2.0 * 0.3, rel=1e-12)
    assert decide(hinge(0.5, False, -1.0)).acceleration[0] == pytest.approx(2.0 * 0.7, rel=1e-12)
    pressed = decide(hinge(-0.5, True))
    np.testing.assert_allclose(pressed.acceleration, 0.0, atol=1e-12)
    assert np.sum(pressed.force) == pytest.approx(0.5, rel=1e-12)
    assert pressed.undetermined.shape[1] == 1  # stop and friction share the effort


def test_what_has_no_answer_names_the_contact():
    # a driven row pushes into a stop that nothing can move
    problem = ContactProblem(np.zeros((1, 1)), -np.ones(1), ("door",), (0,))
    with pytest.raises(NumericalFailure, match="door"):
        decide(problem)
