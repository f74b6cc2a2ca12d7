"""Modes, forces and accelerations of contacts at one instant, against closed forms.

Sources are named at each test; what is not published there is elementary statics of one body.
"""

import re
from dataclasses import replace

import numpy as np
import pytest

from consilience.errors import NumericalFailure
from consilience.mechanism import skew
from consilience.reference.contact.cones import sticking_margin
from consilience.reference.contact.decision import decide, solutions
from consilience.reference.contact.mode_system import columns_and_rows, sliding_indicator, solve_with_modes
from consilience.reference.contact.problem import ContactProblem, FrictionSet, in_words
from consilience.reference.contact.search import PainleveParadox
from consilience.reference.contact.uniqueness import proven_unique
from touching_bodies import CORNERS, FEET, FLOOR, LUMPY, g, rod, total, touching, weight_on_incline


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
    found = decide(problem, exhaustive=True)
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


def test_two_discs_of_constant_bounds_share_a_force():
    # T1 + A T2 = F within C1 and C2: the least of C - |T| is largest where both are equal, and T1 along some vector,
    # here (1, 1), T2 along A (1, 1) (Lagrange's multipliers of a concave problem)
    T, A, margin = np.array([0.6, 0.6, 0.2, 0.4]), np.diag([1.0, 2.0]), 1.000002 - 0.6 * np.sqrt(2.0)
    K = np.vstack([np.eye(2), A])  # the largest bound, 1.000002, is the unit of the forces: near one, but not one
    bounds = (margin + np.linalg.norm(part) for part in (T[:2], T[2:]))
    discs = tuple(FrictionSet("", (2 * k, 2 * k + 1), 1.0, 1.0, None, float(C)) for k, C in enumerate(bounds))
    problem = ContactProblem(K @ K.T, -K @ (K.T @ T), ("a", "a", "b", "b"), (), discs)
    found = sticking_margin(problem, problem.natural_modes())
    assert found.value == pytest.approx(margin, rel=1e-13)
    np.testing.assert_allclose(found.force, T, rtol=1e-13)


def test_static_friction_holds_more_than_kinetic():
    problem = touching(FEET, 2.0, LUMPY, weight_on_incline(2.0, np.radians(20.0)), 0.25)
    held = replace(problem, friction=tuple(replace(f, static=0.4) for f in problem.friction))
    np.testing.assert_allclose(decide(held).acceleration, 0.0, atol=1e-12)
    down = {j: np.array([1.0, 0.0]) for j in range(3)}
    slope = np.radians(20.0)
    slides = decide(held, held.natural_modes(), started=down)
    np.testing.assert_allclose(slides.acceleration[1], g * (np.sin(slope) - 0.25 * np.cos(slope)), rtol=1e-12)


@pytest.mark.parametrize("signs", [(1, 1, 1), (-1, 1, -1), (1, -1, -1)])
def test_what_can_stick_sticks_though_another_slip_is_admissible_and_was_there_before(signs):
    # Two blocks of 1 kg in a row: the first on a brake of 1 N and pushed by 3.2 N, a joint between them that holds 2 N
    # and slips by 1 N, the second on a brake of 3.3 N and pushed by 2 N. The joint slips and the second brake holds, or
    # the joint holds and both go at (5.2 - 4.3)/2 m/s^2, with 3.2 - 1 - 0.45 N in the joint.
    rows, push = np.diag(signs) @ np.array([[1.0, 0.0], [1.0, -1.0], [0.0, 1.0]]), np.array([3.2, 2.0])
    laws = [(1.0, 1.0, 1.0), (0.5, 1.0, 2.0), (1.0, 1.0, 3.3)]
    sets = tuple(FrictionSet("", (k,), slides, sticks, None, C) for k, (slides, sticks, C) in enumerate(laws))
    problem = ContactProblem(rows @ rows.T, rows @ push, ("a", "b", "c"), (), sets)
    slid = problem.natural_modes()
    for j in (0, 1):
        slid = slid.with_friction(j, sets[j].sliding(problem.free[[j]]))
    found = decide(problem, slid)
    assert not found.others
    np.testing.assert_allclose(found.acceleration, rows @ [0.45, 0.45], atol=1e-13)
    np.testing.assert_allclose(found.force, -np.array(signs) * [1.0, 1.75, 3.3], atol=1e-12)


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
    _, S, E = columns_and_rows(problem, problem.natural_modes())
    indicator = sliding_indicator(problem.delassus, problem.row_scale(), S, E)
    assert indicator * problem.delassus[0, 0] == pytest.approx(A, rel=1e-11)
    assert problem.free[0] == pytest.approx(B, rel=1e-12)
    found = sorted(float(s.force[0]) for s in solutions(problem))
    np.testing.assert_allclose(found, normal_forces, rtol=1e-11)
    if normal_forces:
        assert decide(problem, exhaustive=True).unique is False
        held = decide(problem, problem.natural_modes())
        assert held.force[0] == pytest.approx(normal_forces[1], rel=1e-11)  # the branch the motion is on
    else:
        with pytest.raises(PainleveParadox, match=r"p0: sliding friction jams") as paradox:
            decide(problem)
        told = re.search(r"A = (\S+) 1/kg and B = (\S+) m/s\^2", str(paradox.value))
        assert [float(number) for number in told.groups()] == pytest.approx([A, B], rel=1e-11)


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


def test_wedged_ball_hangs_or_falls():
    # a trough upside down: with friction angles above the 45 degrees of the walls, these can hold the ball between them
    def hung(mu):
        problem, _ = trough(mu)
        return replace(problem, free=-problem.free)

    accelerations = [decide(hung(1.2), exhaustive=True).acceleration, *(s.acceleration for s in solutions(hung(1.2)))]
    assert decide(hung(1.2)).unique is False
    for expected in (np.zeros(6), hung(1.2).free):
        assert min(np.max(np.abs(one - expected)) for one in accelerations) < 1e-11
    np.testing.assert_allclose(decide(hung(0.8), exhaustive=True).acceleration, hung(0.8).free, atol=1e-11)
    assert (
        sticking_margin(hung(0.8), hung(0.8).natural_modes()).value
        < 0.0
        < sticking_margin(hung(1.2), hung(1.2).natural_modes()).value
    )


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
        found = decide(problem, exhaustive=True)
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


def test_two_boxes_the_lower_one_pulled():
    # 1 kg on 3 kg, mu 0.35 and 0.2, four corners each: the upper one slips for pulls above (0.35 + 0.2) 4 kg g
    J, size = [], np.zeros((12, 12))
    for x in (-0.3, 0.3):
        for y in (-0.2, 0.2):
            J.append(np.hstack([FLOOR, -FLOOR @ skew(np.array([x, y, -0.1])), np.zeros((3, 6))]))
    for x in (-0.1, 0.1):
        for y in (-0.1, 0.1):
            below, above = (np.hstack([FLOOR, -FLOOR @ skew(np.array([x, y, z]))]) for z in (0.1, -0.1))
            J.append(np.hstack([-below, above]))
    for b, mass in enumerate((3.0, 1.0)):
        size[6 * b : 6 * b + 3, 6 * b : 6 * b + 3] = np.eye(3) / mass
        size[6 * b + 3 : 6 * b + 6, 6 * b + 3 : 6 * b + 6] = np.linalg.inv(mass * LUMPY)
    J = np.vstack(J)
    friction = [
        FrictionSet(f"c{k}", (3 * k + 1, 3 * k + 2), mu, mu, 3 * k) for k, mu in enumerate([0.2] * 4 + [0.35] * 4)
    ]
    names = tuple(f"c{row // 3}" for row in range(24))
    for pull, lower, upper in ((7.0, 0.0, 0.0), (20.0, 3.038, 3.038), (30.0, 6.2395, 3.4335)):
        wrenches = np.array([pull, 0.0, -3.0 * g, 0.0, -0.1 * pull, 0.0, 0.0, 0.0, -g, 0.0, 0.0, 0.0])
        problem = ContactProblem(J @ size @ J.T, J @ size @ wrenches, names, tuple(range(0, 24, 3)), tuple(friction))
        found = decide(problem)
        relative = found.acceleration.reshape(-1, 3)
        np.testing.assert_allclose(relative[:4, 1], lower, atol=1e-11)
        np.testing.assert_allclose(relative[4:, 1], upper - lower, atol=1e-11)
        np.testing.assert_allclose(np.delete(relative, 1, axis=1), 0.0, atol=1e-11)
        assert not found.others


def test_spin_against_drilling_friction():
    # ball of 1.5 kg on the floor, torque 0.4 N m about the normal, drilling bound 0.02 m N
    mass, inertia = 1.5, 0.4 * 1.5 * 0.04 * np.eye(3)
    rows = np.vstack([np.hstack([FLOOR, -FLOOR @ skew(np.array([0.0, 0.0, -0.2]))]), np.eye(6)[5]])
    size = np.diag([*[1.0 / mass] * 3, *[1.0 / inertia[0, 0]] * 3])
    drill = FrictionSet("ball", (3,), 0.02, 0.02, 0)
    friction = (FrictionSet("ball", (1, 2), 0.3, 0.3, 0), drill)
    for torque, rate in ((0.4, (0.4 - 0.02 * mass * g) / inertia[0, 0]), (0.2, 0.0)):
        free = rows @ size @ np.array([0.0, 0.0, -mass * g, 0.0, 0.0, torque])
        found = decide(ContactProblem(rows @ size @ rows.T, free, ("ball",) * 4, (0,), friction), exhaustive=True)
        np.testing.assert_allclose(found.acceleration, [0.0, 0.0, 0.0, rate], atol=1e-11)
        assert found.unique


def test_parts_of_one_contact_are_named_together():
    corners = [f"contact 'floor[{n}]'" for n in (0, 3, 0)]
    assert in_words([*corners, "stop 'end'", "stop 'end'"]) == "contact 'floor[0, 3]', stop 'end'"
    assert in_words(["floor[2]", "wall", "floor[1]"]) == "floor[2, 1], wall"


def test_what_has_no_answer_names_the_contact():
    # a driven row pushes into a stop that nothing can move
    problem = ContactProblem(np.zeros((1, 1)), -np.ones(1), ("door",), (0,))
    with pytest.raises(NumericalFailure, match="door"):
        decide(problem)


def test_a_dry_joint_at_rest_beside_a_contact_that_slides_has_one_solution():
    """``x . M x > 0`` for all x: the sliding is known, and the bound of the joint is constant."""
    G = np.array([[1.0, 0.1, 0.2], [0.1, 1.0, 0.3], [0.2, 0.3, 1.0]])
    sets = (FrictionSet("slides", (1,), 0.3, 0.3, 0), FrictionSet("rests", (2,), 1.0, 1.0, None, 2.0))
    names, sliding = ("slides", "slides", "rests"), np.array([0.0, 0.5, 0.0])
    problem = ContactProblem(G, np.array([-3.0, 0.1, 0.4]), names, (0,), sets, sliding)
    assert proven_unique(problem)
    found = decide(problem)
    N, T = np.linalg.solve([[1.0 - 0.03, 0.2], [0.2 - 0.09, 1.0]], [3.0, -0.4])
    np.testing.assert_allclose(found.force, [N, -0.3 * N, T], rtol=1e-12)


@pytest.mark.parametrize(("mu", "unique"), [(0.0, True), (0.5, False)])
def test_friction_of_a_preload_that_is_open_is_told(mu, unique):
    """A ball of mass 2 and inertia 2/5 m r^2 between two planes: any load of the rough one above satisfies the laws.

    Its friction brakes the ball by 7/2 mu N/m along the slip; without friction the accelerations are zero whatever N.
    """
    mass = 2.0
    G = np.diag([1.0, 1.0, 3.5, 3.5]) / mass
    G[0, 1] = G[1, 0] = -1.0 / mass
    free, sliding = np.array([-g, g, 0.0, 0.0]), np.array([0.0, 0.0, 0.24, 0.18])
    friction = (FrictionSet("ceiling", (2, 3), mu, mu, 1),) if mu else ()
    problem = ContactProblem(G, free, ("floor", *["ceiling"] * 3), (0, 1), friction, sliding)
    assert proven_unique(problem) == unique
    if unique:
        np.testing.assert_allclose(decide(problem).acceleration, 0.0, atol=1e-14)
        return
    with pytest.raises(NumericalFailure, match=r"floor, ceiling allow several accelerations: how .* share their load"):
        decide(problem)
