"""Lengths of steps in the state z: what every integrator of the relative form asks."""

from __future__ import annotations

import numpy as np

from consilience.mechanism import Array
from consilience.reference.kernel.compiled import inner


@inner
def component_sizes(kind: Array, model_length: float, z: Array, size: Array) -> None:
    """Size of each kind of component, shape (5,)."""
    size[:] = 0.0
    for n in range(z.shape[0]):
        size[kind[n]] = max(size[kind[n]], abs(z[n]))
    size[0] = max(size[0], model_length)
    size[1] = 1.0
    size[2] = max(size[2], size[3] * model_length, model_length)
    size[3] = max(size[3], 1.0)
    size[4] = max(size[4], 1.0)


@inner
def step_length(h: float, remaining: float) -> float:
    """Length of the next step: a remainder a little longer than a step is halved, so that no sliver of one is left."""
    return remaining if h >= remaining else min(h, 0.5 * remaining)


@inner
def first_step_length(kind: Array, f: Array, span: float, tolerance: float, size: Array) -> float:
    """Length of the first step, in which z changes by ``tolerance ** (1/8)``, from its derivative f."""
    total = 0.0
    for n in range(f.shape[0]):
        total += (f[n] / size[kind[n]]) ** 2
    return tolerance ** (1.0 / 8.0) / max(np.sqrt(total / f.shape[0]), 1.0 / span)


@inner
def next_sample(times: Array, sample: int, after: float) -> int:
    """Number of the first of the samples left that is not before a time."""
    while sample < times.shape[0] and times[sample] < after:
        sample += 1
    return sample
