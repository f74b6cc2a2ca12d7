"""Kernels that do not count references keep no array for ever."""

import gc

import numba
import numpy as np
import pytest
from numba.core.runtime import _nrt_python, rtsys

from consilience.reference import ForwardDynamics, accelerations, simulate
from consilience.reference.canonical import canonical_motion
from consilience.reference.formulations.kernels import KERNELS, TREE_KERNELS
from consilience.reference.model import unpack
from consilience.spatial import continuous_in_time
from mechanisms import ELEMENTS, LOOPS, TREES, states_of

pytestmark = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")

MECHANISMS = {next(iter(group)): next(iter(group.values())) for group in (TREES, LOOPS, ELEMENTS)}
TIMES = np.linspace(0.0, 0.05, 4)


def alive():
    """Arrays that kernels made and nobody freed."""
    gc.collect()
    stats = rtsys.get_allocation_stats()
    return stats.alloc - stats.free


@pytest.fixture(autouse=True)
def _counting():
    before = _nrt_python.memsys_stats_enabled()
    _nrt_python.memsys_enable_stats()
    yield
    if not before:
        _nrt_python.memsys_disable_stats()


def motions(mechanism, state):
    """Calls of every compiled integrator, and of the accelerations of every formulation over kernels."""
    for formulation in ("relative", "descriptor", "null_space"):
        yield lambda name=formulation: simulate(mechanism, state, TIMES, 1e-8, name)
    yield lambda: simulate(mechanism, state, TIMES, 1e-8, "relative", "gauss")
    for formulation in (*KERNELS, *TREE_KERNELS):
        yield lambda name=formulation: accelerations(mechanism, [state], name)
    forward = ForwardDynamics(mechanism)
    q, v = forward.coordinates(state)
    yield lambda: forward.accelerations(q, v)
    yield lambda: forward.accelerations_of(np.array([q] * 4), np.array([v] * 4))


@pytest.mark.parametrize("name", MECHANISMS)
def test_no_array_stays(name):
    (state,) = states_of(MECHANISMS[name], 1)
    for call in motions(MECHANISMS[name], state):
        call()  # compiled, constants made
        before = alive()
        for _ in range(3):
            call()
        assert alive() == before


def test_the_counter_sees_an_array_that_stays():
    @numba.njit
    def make():
        return np.zeros(3)

    before = alive()
    kept = make()
    assert alive() > before
    del kept
    assert alive() == before


def test_a_compiled_motion_in_canonical_terms_is_the_plain_one():
    mechanism = LOOPS["four_bar"]
    y = np.random.default_rng(5).normal(size=(40, len(mechanism.bodies) + 1, 13))
    p, quat, v, w = unpack(mechanism, y)
    for found, wanted in zip(canonical_motion(mechanism, y), (p, continuous_in_time(quat), v, w), strict=True):
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-13)
