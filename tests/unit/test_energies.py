"""Energies along a motion against the energies of its single states."""

import functools
from itertools import islice

import numpy as np
import pytest

from consilience.audit.random_mechanisms import random_mechanism
from consilience.compare.energies import energies_over_time
from consilience.engine import TrajectoryAnswer
from consilience.mechanism import drawing_state, kinetic_energy, potential_energy, random_states
from consilience.mechanism.observables import load_potentials

SAMPLES = 12


@functools.cache
def sprung():
    """Return random mechanisms with springs, and their seeds."""
    drawn = ((seed, random_mechanism(seed)) for seed in range(60))
    return list(islice(((seed, m) for seed, m in drawn if m.springs or m.joint_springs), SAMPLES))


@pytest.mark.parametrize("drawn", range(SAMPLES))
def test_energies_are_those_of_the_states(drawn):
    """Random mechanisms with springs; quaternions are not of unit length."""
    seed, mechanism = sprung()[drawn]
    states = random_states(mechanism, drawing_state(mechanism), 4, seed)
    p, quat, v, w = (np.array([getattr(s, n) for s in states]) for n in ("p_WB", "quat_WB", "v_WB_W", "w_WB_W"))
    motion = TrajectoryAnswer(np.arange(4.0), p, 1.5 * quat, v, w)
    kinetic, potential = energies_over_time(mechanism, motion, [3, 0, 2])
    for n, sample in enumerate([3, 0, 2]):
        state = states[sample]
        assert kinetic[n] == pytest.approx(kinetic_energy(mechanism, state), rel=1e-13)
        expected = potential_energy(mechanism, state) + load_potentials(mechanism, state)
        assert potential[n] == pytest.approx(expected, rel=1e-12, abs=1e-11)


def test_the_samples_have_loads_and_springs_of_both_kinds():
    drawn = [mechanism for _, mechanism in sprung()]
    assert any(m.springs for m in drawn)
    assert any(m.joint_springs for m in drawn)
    assert any(x.kind == "force" and x.frame == "world" for m in drawn for x in m.loads)
