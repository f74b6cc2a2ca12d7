"""Component sizes and step lengths in the state z, common to the integrators of this package.

An error is measured as ``sqrt(mean((e_n / (tolerance size_n))^2))`` [Hairer, Norsett, Wanner, section II.4], with the
size of the kind of component n (`arrays.DISTANCE` and so on).
"""

from __future__ import annotations

import numpy as np

from consilience.mechanism import Array
from consilience.reference.kernel.compiled import inner


@inner
def component_sizes(kind: Array, model_length: float, z: Array, size: Array) -> None:
    """Compute the size of each kind of component, shape (5,)."""
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
    """Return the length of the next step, s; a remainder below two steps is halved, so that no tiny step is left."""
    return remaining if h >= remaining else min(h, 0.5 * remaining)


@inner
def first_step_length(kind: Array, f: Array, span: float, tolerance: float, size: Array) -> float:
    """Return the length, s, of the first step, in which z changes by about ``tolerance ** (1/8)`` of its size.

    Parameters
    ----------
    kind : ndarray of int, shape (n_z,)
        Kinds of the components.
    f : ndarray, shape (n_z,)
        Derivative of z.
    span : float, s
        Duration of the motion.
    tolerance : float
    size : ndarray, shape (5,)
        Sizes of the kinds.
    """
    total = 0.0
    for n in range(f.shape[0]):
        total += (f[n] / size[kind[n]]) ** 2
    return tolerance ** (1.0 / 8.0) / max(np.sqrt(total / f.shape[0]), 1.0 / span)


@inner
def next_sample(times: Array, sample: int, after: float) -> int:
    """Return the index of the first sample, from `sample` on, that is not before a time."""
    while sample < times.shape[0] and times[sample] < after:
        sample += 1
    return sample
