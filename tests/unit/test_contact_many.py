"""Decisions of many contacts at once: guesses are exact whatever their number, and few modes are tried."""

import numpy as np

from consilience.case import load_cases
from consilience.reference.contact import candidates, contact_instant, headings, search
from consilience.reference.contact.complementarity import solve_lcp


def test_guesses_of_many_contacts_are_complementary_to_rounding(monkeypatch):
    # pivots add up rounding: `w = M z + q` vanishes where z does not
    solved = []

    def keep(matrix, constant, covering=None):
        z = solve_lcp(matrix, constant, covering)
        if z is not None:
            solved.append((matrix @ z + constant, z))
        return z

    monkeypatch.setattr(candidates, "solve_lcp", keep)
    (case,) = load_cases("box_stack:boxes=10,slope=1")
    contact_instant(case.mechanism, [case.initial_state])
    assert solved
    for w, z in solved:
        assert np.min(w) > -1e-9
        np.testing.assert_allclose(w[z > 0.0], 0.0, atol=1e-10)


def test_a_stack_of_boxes_is_decided_by_what_is_guessed(monkeypatch):
    # 20 boxes on four corners each: at rest by statics; each of the few guesses leads there at once
    tried = []

    class Counted(headings.Headings):
        def __init__(self, problem, modes):
            tried.append(modes)
            super().__init__(problem, modes)

    monkeypatch.setattr(search, "Headings", Counted)
    (case,) = load_cases("box_stack:boxes=20,slope=1")
    found = contact_instant(case.mechanism, [case.initial_state])
    np.testing.assert_allclose(found.a_WB_W, 0.0, atol=1e-9)
    weight = np.array([body.mass for body in case.mechanism.bodies])[:, None] * case.mechanism.gravity
    # each contact carries the weight of the boxes above it
    np.testing.assert_allclose(found.contact_force[0], -np.cumsum(weight[::-1], axis=0)[::-1], atol=1e-7)
    assert len(tried) <= 60  # that found, and what exchanges make of all open
