"""A motion as integrators see it: its state z, the run over its steps, and the kernels of the mechanism.

An error is measured as ``sqrt(mean((e_n / (tolerance size_n))^2))`` [Hairer, Norsett, Wanner, section II.4], with the
size of the kind of component n, DISTANCE to INTEGRAL.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.reference.kernel.compiled import inlined, inner
from consilience.reference.kernel.operation import call
from consilience.reference.kernel.record_type import INT, record_type

DISTANCE, ANGLE, SPEED, SPIN, INTEGRAL = range(5)
"""Kinds of the components of z; a relative tolerance refers to the size of a kind."""

RUN = record_type(
    ("t", float),  # start of the step, s
    ("step", float),  # its length, s
    ("h", float),  # proposed length of the next step, s; zero before the first
    ("before", float),  # length of the step before, s; infinite in the first
    ("span", float),  # time that is left, s
    ("tolerance", float),
    ("factor", float),  # change of the step size that the stepper asks for
    ("most", float),  # largest change that is allowed: 1 after a rejected step
    ("stop_if_stiff", INT),
    ("status", INT),  # key of `step_control.STATUS`, set by a stepper that cannot go on
    ("failure", INT),  # status if the steps become too short
    ("steps", INT),
    ("rejected", INT),
    ("evaluations", INT),
)
"""Scalars of a run."""

BEGIN, DERIVATIVE, END_STEP, SAMPLE = range(4)
"""Requests to the kernel of a mechanism, ``f(record, request, t, z, out)``:

- project z, the first state of a motion; record the sample `out`; return the longest step, s;
- compute ``out = dz/dt``;
- project z, the end of a step; record the sample `out`, if it is not empty; return the longest next step, s;
- project z, a state within a step, and record it as the sample `out`.
"""

PREPARE, ATTEMPT, INTERPOLATE, EVALUATE = range(4)
"""Requests to the kernel of a stepper, ``f(record, request, t, z, out)``:

- begin steps from a new state z; from the first, propose a step;
- attempt a step from z to `out`; return its error over the tolerance;
- prepare the dense output of an accepted step from z to `out`;
- evaluate the dense output at a time t after the start of the step.
"""


class Kernel(NamedTuple):
    """Addresses of a kernel of a mechanism or of a stepper, and of its record."""

    function: Any
    record: Any


@inlined
def ask(kernel: Kernel, request: int, t: float, z: Array, out: Array) -> float:
    """Call a kernel by its address.

    Parameters
    ----------
    kernel : Kernel
    request : int
        Number of what is asked.
    t : float, s
    z : ndarray, shape (n_z,)
        State at the time t.
    out : ndarray
        Overwritten by what the request names.
    """
    return call(kernel.function, kernel.record, request, t, z, out)


class MotionArrays(NamedTuple):
    """Arrays of a motion that the driver and a stepper share."""

    run: Array  # (1,) of RUN
    kind: Array  # (n_z,) DISTANCE to INTEGRAL
    length: float  # characteristic length of the mechanism, m
    z: Array  # (n_z,) state at the start of the step
    end: Array  # (n_z,) state at its end
    state: Array  # (n_z,) state of a stage or sample
    size: Array  # (5,) sizes of the kinds of components
    mechanism: Kernel


def new_motion(kind: Array, length: float, mechanism: Kernel) -> MotionArrays:
    """Return the arrays of a motion."""
    # far apart: next to each other, vector instructions could not copy one to another
    z, end, state = np.zeros((3, len(kind) + 32))[:, : len(kind)]
    return MotionArrays(np.zeros(1, RUN), kind, float(length), z, end, state, np.empty(5), mechanism)


@inlined
def derivative(motion: MotionArrays, t: float, z: Array, dz: Array) -> None:
    """Compute the state derivative at a state z."""
    motion.run[0].evaluations += 1
    ask(motion.mechanism, DERIVATIVE, t, z, dz)


@inner
def component_sizes(kind: Array, length: float, z: Array, size: Array) -> None:
    """Compute the size of each kind of component, shape (5,)."""
    size[:] = 0.0
    for n in range(z.shape[0]):
        size[kind[n]] = max(size[kind[n]], abs(z[n]))
    size[0] = max(size[0], length)
    size[1] = 1.0
    size[2] = max(size[2], size[3] * length, length)
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
    return tolerance ** (1.0 / 8.0) / max(np.sqrt(total / max(f.shape[0], 1)), 1.0 / span)
