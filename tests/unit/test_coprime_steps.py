"""Limits of motions that scatter, by least squares over coprime steps."""

from itertools import combinations
from math import gcd

import numpy as np
import pytest
import scipy.stats

from consilience.compare.coprime_steps import COUNT, FALSE, RATIO, coprime_limit, coprime_substeps

SUBSTEPS = np.array(list(coprime_substeps(3200)))
STEPS = 0.05 / SUBSTEPS
LONG = STEPS / STEPS[-1]
"""Steps over the shortest, 32 to 1."""

NOISES = {
    "normal": lambda rng, size: rng.normal(size=size),
    "uniform": lambda rng, size: rng.uniform(-1.0, 1.0, size=size),
    "of two values": lambda rng, size: rng.choice([-1.0, 1.0], size=size),
    "with long tails": lambda rng, size: rng.standard_cauchy(size=size),
}


@pytest.mark.parametrize("finest", [320, 800, 3200])
def test_grids_of_coprime_steps_share_the_samples_alone(finest):
    substeps = list(coprime_substeps(finest))
    assert len(substeps) == COUNT
    assert all(gcd(*pair) == 1 for pair in combinations(substeps, 2))
    assert finest / RATIO <= substeps[0] < 1.2 * finest / RATIO
    assert finest <= substeps[-1] < 1.05 * finest


@pytest.mark.parametrize("power", [0.0, 0.3, 1.0])
def test_the_standard_error_is_the_larger_of_regression_and_jackknife(power):
    """`scipy.stats.linregress` has the former; the latter is the sum of squares of the changes by leaving one out."""
    y = 10.0 + 0.01 * LONG + np.random.default_rng(4).normal(size=COUNT) * LONG**power
    fits = []
    for x in (STEPS**0.5, STEPS):
        whole = scipy.stats.linregress(x, y)
        without = [scipy.stats.linregress(np.delete(x, n), np.delete(y, n)).intercept for n in range(COUNT)]
        jackknife = np.sqrt(np.sum((np.array(without) - whole.intercept) ** 2))
        fits.append((whole.intercept, max(whole.intercept_stderr, jackknife)))
    limit, error = min(fits, key=lambda fit: fit[0] / fit[1])
    found = coprime_limit([y[:, None]], list(STEPS), 0.0)
    assert found.limit == pytest.approx(limit, rel=1e-9)
    assert found.error == pytest.approx(error, rel=1e-9)
    assert found.least == pytest.approx(scipy.stats.t.isf(FALSE / 2.0, COUNT - 2) * error, rel=1e-9)


@pytest.mark.parametrize("noise", NOISES)
def test_scatter_about_the_reference_is_not_told_to_be_elsewhere(noise):
    """Of 500 with normal errors 0.05 are expected; scatter that changes with the step counts as well."""
    rng = np.random.default_rng(17)
    told = 0
    for n in range(500):
        trend = (0.0, 1.0, 30.0)[n % 3] * LONG ** (0.5, 1.0, 2.0)[n // 3 % 3]
        scatter = NOISES[noise](rng, (COUNT, 12)) * LONG[:, None] ** (0.0, 0.25, 0.5, 1.0)[n % 4]
        told += coprime_limit([trend[:, None] + scatter], list(STEPS), 0.0).elsewhere
    assert told == 0


def test_errors_at_any_phase_of_a_step_are_not_told_to_be_elsewhere():
    rng = np.random.default_rng(18)
    phases = (rng.uniform(size=(COUNT, 12)) * LONG[:, None] for _ in range(300))
    assert not any(coprime_limit([phase], list(STEPS), 0.0).elsewhere for phase in phases)


@pytest.mark.parametrize("order", [0.5, 0.6, 0.75, 1.0, 1.5, 2.0, 4.0])
@pytest.mark.parametrize("scatter", [0.0, 1e-6, 1e-3])
def test_no_power_of_the_step_is_taken_for_another_motion(order, scatter):
    """By order 1/2 the limit of a higher power has the other sign than the motions."""
    rng = np.random.default_rng(3)
    off = LONG[:, None] ** order * (1.0 + scatter * rng.normal(size=(COUNT, 6)))
    assert not coprime_limit([off], list(STEPS), 0.0).elsewhere


@pytest.mark.parametrize(("sizes", "least"), [(5.0, 0.9), (8.0, 0.95)])
def test_a_limit_far_beyond_the_scatter_is_told(sizes, least):
    rng = np.random.default_rng(19)
    trials = [sizes + 0.1 * LONG[:, None] ** 0.5 + rng.normal(size=(COUNT, 1)) for _ in range(200)]
    told = [coprime_limit([off], list(STEPS), 0.0) for off in trials]
    assert np.mean([one.elsewhere for one in told]) >= least
    assert np.mean([one.limit for one in told]) == pytest.approx(sizes, abs=0.2)


def test_a_limit_that_another_softness_moves_is_not_told():
    rng = np.random.default_rng(20)
    own, alike, harder = (limit + 0.01 * rng.normal(size=(COUNT, 6)) for limit in (1.0, 0.9, 0.7))
    assert coprime_limit([own], list(STEPS), 0.0).elsewhere
    assert coprime_limit([own, alike], list(STEPS), 0.0).elsewhere
    assert not coprime_limit([own, harder], list(STEPS), 0.0).elsewhere


def test_a_limit_within_what_is_allowed_is_not_told():
    rng = np.random.default_rng(21)
    off = 1.0 + 1e-3 * rng.normal(size=(COUNT, 6))
    assert coprime_limit([off], list(STEPS), 0.9).elsewhere
    assert not coprime_limit([off], list(STEPS), 1.1).elsewhere
