"""Energies along a motion against the energies of its single states."""

import functools
from itertools import islice

import numpy as np
import pytest

from consilience import simulate
from consilience.audit.random_mechanisms import random_mechanism
from consilience.compare.energies import energies_over_time
from consilience.engine import TrajectoryAnswer
from consilience.mechanism import (
    GROUND,
    Body,
    Frame,
    Initial,
    Joint,
    JointSpring,
    Mechanism,
    Stop,
    drawing_state,
    initial_state,
    kinetic_energy,
    potential_energy,
    random_states,
)
from consilience.mechanism.observables import load_potentials
from consilience.report.curves import curve_sets

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


@pytest.mark.parametrize("stops", [(), (Stop("end", "pin", "angle", upper=5.0, restitution=1.0),)])
def test_a_spring_that_is_wound_beyond_half_a_turn_keeps_the_energy(stops):
    """A wheel of 0.5 kg m^2 at 8 rad/s winds a spring of 1 N m/rad by 8 sqrt(0.5) = 5.66 rad, or to a stop at 5 rad."""
    here = Frame(np.zeros(3), np.eye(3))
    wheel = Body("wheel", 1.0, np.zeros(3), 0.5 * np.eye(3), here)
    pin = Joint("pin", "revolute", GROUND, "wheel", here, here)
    spring = JointSpring("spring", "pin", "angle", 1.0, 0.0, 0.0)
    mechanism = Mechanism("wound", np.zeros(3), (wheel,), (pin,), joint_springs=(spring,), stops=stops)
    start = initial_state(mechanism, Initial(rates={"pin": {"angle": 8.0}}))
    motion = simulate(mechanism, start, np.linspace(0.0, 2.0, 21))
    assert np.max(motion.coordinates("pin")) > 1.5 * np.pi
    assert motion.energy()["total"] == pytest.approx(np.full(21, 16.0), rel=1e-10)
    assert sum(energies_over_time(mechanism, motion, range(21))) == pytest.approx(np.full(21, 16.0), rel=1e-10)
    (curves,) = curve_sets(mechanism, motion, ["energies"])
    assert curves.values[:, -1] == pytest.approx(np.full(len(curves.time), 16.0), rel=1e-10)
