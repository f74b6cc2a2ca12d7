"""Oracles against values computed independently from published definitions; A01 also against published results."""

import numpy as np
import pytest
from scipy.special import ellipk

from consilience.case import load_case
from oracles import double_pendulum, four_bar
from oracles.planar import held
from oracles.shipped import TRAJECTORIES
from oracles.simple_pendulum import swing

# x, y and angular velocity of problem A01 of the IFToMM library. Over 2000 s the result file of the library, printed
# to 6 digits, agrees to that rounding; the further digits come from an independent evaluation
A01 = {
    0.5: (-0.391048791550546, -0.920369948785192, 4.249430361256138),
    1.0: (0.986291751131875, -0.165010853125541, 1.799309016907079),
    2.0: (-0.793566195343322, -0.608483930443792, -3.455206899059330),
    5.0: (-0.942305435043757, -0.334754338414001, 2.562787568192630),
    10.0: (-0.275087462576117, -0.961419205099125, 4.343160692864683),
    20.0: (0.996907173990992, -0.078588080809334, 1.241731913691167),
}


def test_pendulum_a01():
    times = np.array(list(A01))
    expected = np.array(list(A01.values()))
    p, _ = TRAJECTORIES["simple_pendulum-large"](load_case("simple_pendulum-large"), times)
    assert np.max(np.abs(p[:, 0, :2] - expected[:, :2])) < 2e-14
    rate = swing(-np.pi / 2, 1.0, 9.81, times)[2]
    assert np.max(np.abs(rate - expected[:, 2])) < 1e-13


def test_pendulum_period():
    # computed independently in higher precision
    assert 4 * ellipk(0.5) / np.sqrt(9.81) == pytest.approx(2.36784194757623744930, rel=1e-15)


# crank and rocker angle from x toward z, and their rates, of the four-bar of RigidBodyDynamics.jl's tests, crank
# started at 0.5 rad/s. The tests publish no trajectory: these values were integrated independently at two tolerances
FOUR_BAR = {
    0.5: (2.052084586088, 1.794731895228, 1.271685983740, 0.823861498720),
    1.0: (-2.840060364400, 2.422082792650, 5.113775574560, 0.926318468205),
    2.0: (0.941097706977, 1.057513978096, 2.055120467786, 1.220520846337),
    3.0: (1.773200649240, 1.609392344975, 0.623493851933, 0.422398210172),
}


def test_four_bar():
    case = load_case("four_bar")
    linkage = four_bar.linkage(case)
    y = linkage.solve(held(case, "crank_pivot"), list(FOUR_BAR))
    crank, _, rocker = linkage.motions(y[:, 0])
    angles = [np.angle(m.turn * np.exp(1j * a)) for m, a in ((crank, 1.6707963267948966), (rocker, 1.5397303602625536))]
    found = np.column_stack([*angles, y[:, 1], rocker.a_q * y[:, 1]])
    assert np.max(np.abs(found - list(FOUR_BAR.values()))) < 5e-12
    kinetic, potential = linkage.energy(y)
    assert np.max(np.abs(kinetic + potential - 10.202114330749)) < 1e-11


def test_four_bar_consistent_start_rates():
    linkage = four_bar.linkage(load_case("four_bar"))
    crank, coupler, rocker = linkage.motions(np.zeros(1))
    assert 0.5 * (coupler.a_q - crank.a_q) == pytest.approx(-0.471950252322311, abs=1e-14)
    assert 0.5 * rocker.a_q == pytest.approx(0.3412625200261742, abs=1e-14)


# angles from the horizontal and their rates of two equal links, m = l = J = 1, g = 10, released at rest: the ODE of
# a unit test of Project Chrono, integrated independently to 18 digits
DOUBLE_PENDULUM = {
    0.5: (-0.769181566831688478, -0.213179908033865019, -2.89966987704458644, -1.06951203013420581),
    1.0: (-2.22720283996553233, -1.48968770110750401, -1.94959746087621001, -3.94804270979394147),
    2.0: (-1.87970008772534938, -4.91293511614811111, 1.84944188826103186, -2.33188004630741785),
    5.0: (-0.914598784383932876, -7.57771090698668658, 2.77925407646548067, 2.69242294100563044),
}


def test_double_pendulum_equations():
    pendulum = double_pendulum.DoublePendulum(1.0, 1.0, 1.0, 1.0, 0.5 + 0j, 0.5 + 0j, 1.0 + 0j, -10j)
    y = pendulum.solve(np.zeros(4), list(DOUBLE_PENDULUM))
    assert np.max(np.abs(y - list(DOUBLE_PENDULUM.values()))) < 1e-11


def test_both_amplitudes_have_values():
    assert [len(load_case(f"simple_pendulum-{v}").published) for v in ("small", "large")] == [6, 6]
