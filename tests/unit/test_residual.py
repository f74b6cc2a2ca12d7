"""The reference checks its own rows: drives that contradict each other, mechanisms that lock, states off the joints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from consilience.errors import InvalidInput, NumericalFailure
from consilience.mechanism import Drive, Function, Initial, Mechanism, State, initial_state
from consilience.reference import accelerations, simulate
from linkages import four_bar_of, in_other_units, platform
from mechanisms import ELEMENTS, LOOPS, states_of

TIMES = np.linspace(0.0, 0.4, 5)
FORMS = ("relative", "descriptor", "coordinate_partitioning", "descriptor_index_2")

PARALLELOGRAM = four_bar_of([(0.0, 0.0), (0.1, 0.3), (0.6, 0.3), (0.5, 0.0)])
"""Crank and rocker turn by the same angle."""


def doubly_driven(crank: Function, rocker: Function) -> Mechanism:
    drives = (Drive("first", "ground_crank", "angle", crank), Drive("second", "ground_rocker", "angle", rocker))
    return replace(PARALLELOGRAM, drives=drives)


@pytest.mark.parametrize("form", FORMS)
def test_drives_that_agree_to_second_order_fail_at_the_sample_at_which_they_part(form):
    """The angles differ by t^3: 1e-6 at 0.01 s, far above the tolerance; at t = 0 up to accelerations they agree."""
    mechanism = doubly_driven(Function([0.0, 1.0]), Function([0.0, 1.0, 0.0, 1.0]))
    with pytest.raises(NumericalFailure, match=r"at t = 0\.01 s"):
        simulate(mechanism, initial_state(mechanism), np.array([0.0, 0.01, 0.02]), 1e-9, form)


@pytest.mark.parametrize("length", [1.0, 1e-3, 1e3])
@pytest.mark.parametrize("form", FORMS)
def test_drives_with_contradictory_accelerations_are_named(form, length):
    mechanism = in_other_units(doubly_driven(Function([0.0, 1.0]), Function([0.0, 1.0, 0.5])), length)
    with pytest.raises(NumericalFailure, match="at t = 0 s no accelerations satisfy at once drive 'first', drive 'sec"):
        simulate(mechanism, initial_state(mechanism), TIMES, 1e-9, form)


@pytest.mark.parametrize("form", FORMS)
def test_equal_drives_of_a_parallelogram_go_on(form):
    mechanism = doubly_driven(Function([0.0, 1.0]), Function([0.0, 1.0]))
    found = simulate(mechanism, initial_state(mechanism), TIMES, 1e-9, form)
    np.testing.assert_allclose(found.w_WB_W[-1, 0], found.w_WB_W[0, 0], atol=1e-8)


@pytest.mark.parametrize("form", FORMS)
def test_a_mechanism_that_can_move_at_its_pose_alone_is_said_to_lock(form):
    mechanism = platform(0.8)
    start = initial_state(mechanism, Initial(rates={"ground_left": {"angle": 1.0}}))
    with pytest.raises(NumericalFailure, match="it can move at this pose alone and locks"):
        simulate(mechanism, start, TIMES, 1e-9, form)
    with pytest.raises(NumericalFailure, match="no accelerations satisfy"):
        accelerations(mechanism, [start], "null_space")


def pushed(state: State, poses: float, rates: float) -> State:
    p, w = state.p_WB.copy(), state.w_WB_W.copy()
    p[-1] += poses
    w[-1] += rates
    return State(p, state.quat_WB, state.v_WB_W, w)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(("poses", "rates", "what"), [(1e-6, 0.0, "is violated by"), (0.0, 1e-6, "has a wrong rate")])
def test_a_state_that_is_not_consistent_is_refused_or_assembled_if_asked(form, poses, rates, what):
    mechanism = LOOPS["four_bar"]
    state = states_of(mechanism)[0]
    given = pushed(state, poses, rates)
    with pytest.raises(InvalidInput, match=what):
        simulate(mechanism, given, TIMES, 1e-9, form)
    wanted = simulate(mechanism, state, TIMES, 1e-9, form)
    found = simulate(mechanism, given, TIMES, 1e-9, form, assemble=True)
    assert 0.0 < np.max(np.abs(found.p_WB - wanted.p_WB)) < 1e-4


@pytest.mark.parametrize(("name", "group"), [("coupled", "couplings"), ("driven", "drives")])
def test_a_state_that_only_couplings_or_drives_forbid_is_refused_for_one_of_them(name, group):
    """A state of the same joints without these elements; a turn more of an angle would be no violation."""
    mechanism = ELEMENTS[name]
    state = states_of(replace(mechanism, **{group: ()}))[1]
    with pytest.raises(InvalidInput, match=f"{group.removesuffix('s')} '.*' (is violated|has a wrong rate)"):
        simulate(mechanism, state, TIMES, 1e-9, "relative")


@pytest.mark.slow
@pytest.mark.parametrize("length", [1e-3, 1e3])
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", ["four_bar", "loop_rod", "loop_universal"])
def test_motions_of_scaled_twins_pass_and_are_scaled(name, form, length):
    mechanism, state = LOOPS[name], states_of(LOOPS[name])[1]
    twin = State(length * state.p_WB, state.quat_WB, length * state.v_WB_W, state.w_WB_W)
    found = simulate(in_other_units(mechanism, length), twin, TIMES, 1e-9, form)
    wanted = simulate(mechanism, state, TIMES, 1e-9, form)
    np.testing.assert_allclose(found.p_WB / length, wanted.p_WB, atol=1e-6)


@pytest.mark.parametrize("name", ELEMENTS)
def test_elements_pass_with_samples_between_which_angles_turn_many_times(name):
    mechanism = ELEMENTS[name]
    state = states_of(mechanism)[1]
    fast = State(state.p_WB, state.quat_WB, 5.0 * state.v_WB_W, 5.0 * state.w_WB_W) if not mechanism.drives else state
    assert simulate(mechanism, fast, np.array([0.0, 0.7, 2.1, 3.0]), 1e-9, "relative").counters["steps"] > 0
