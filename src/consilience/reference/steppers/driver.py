"""The driver of all compiled integrators: steps from sample to sample, or over samples with a dense output.

    attempt a step of length h from z; if its error is above the tolerance, repeat it with a shorter h;
    project its end; project the samples within it; go on from its end.

Samples do not shorten steps, except those of a stepper that has no dense output.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.reference.kernel.compiled import inner, threaded
from consilience.reference.kernel.mechanism_record import fields_of, record_array, record_of
from consilience.reference.kernel.operation import Operation, address_of
from consilience.reference.kernel.vectors import assign
from consilience.reference.steppers.motion import (
    ATTEMPT,
    BEGIN,
    END_STEP,
    EVALUATE,
    INTERPOLATE,
    PREPARE,
    SAMPLE,
    Kernel,
    MotionArrays,
    ask,
    new_motion,
    step_length,
)


class CompiledStepper(NamedTuple):
    """A compiled integrator: a row in a table of integrators."""

    arrays: Callable[..., Any]  # (motion, ...) to the record of the kernel, a named tuple
    kernel: Operation  # requests PREPARE to EVALUATE of `motion`
    lands: bool = False  # whether steps end at samples: the stepper has no dense output


class _Drive(NamedTuple):
    """Arguments of the driver."""

    motion: MotionArrays
    stepper: Kernel
    lands: bool


class Integration(NamedTuple):
    """Arrays of one motion by one stepper; not to be used by two threads at once."""

    motion: MotionArrays
    held: tuple[Any, ...]  # records that kernels read by their addresses
    drive: Any  # record array of the arguments of the driver


def new_integration(
    stepper: CompiledStepper, kind: Array, length: float, mechanism: tuple[Operation, Any], *given: Any
) -> Integration:
    """Return the arrays of a motion.

    Parameters
    ----------
    stepper : CompiledStepper
    kind : ndarray of int, shape (n_z,)
        DISTANCE to INTEGRAL.
    length : float, m
        Characteristic length of the mechanism.
    mechanism : tuple
        Kernel of the mechanism, with requests BEGIN to SAMPLE, and its record, a named tuple.
    *given
        Other arguments of ``stepper.arrays``.
    """
    operation, record = mechanism[0], record_of(mechanism[1])
    motion = new_motion(kind, length, Kernel(operation.address(record), address_of(record)))
    own = record_of(stepper.arrays(motion, *given))
    drive = _Drive(motion, Kernel(stepper.kernel.address(own), address_of(own)), stepper.lands)
    return Integration(motion, (record, own), record_array(drive))


class MotionRequest(NamedTuple):
    """What is asked of an integration."""

    z: Array  # initial state
    times: Array  # (n_t,) samples, s; the first is the time of z
    tolerance: float
    longest: float  # bound on the steps, s


def run(integration: Integration, request: MotionRequest, samples: Array, stop_if_stiff: bool) -> int:
    """Integrate from the first to the last of the sample times.

    Parameters
    ----------
    integration : Integration
    request : MotionRequest
    samples : ndarray, shape (n_t, ...)
        Overwritten: one row for each time, as the kernels of the mechanism record a sample.
    stop_if_stiff : bool
        Whether to return `step_control.UNSUITABLE` once an explicit stepper finds the motion stiff.

    Returns
    -------
    int
        Key of `step_control.STATUS`.
    """
    integration.motion.z[:] = request.z
    rows = samples.reshape(len(samples), -1)
    return int(integrate(integration.drive, *request[1:], stop_if_stiff, rows))


def counts_of(run: Array) -> dict[str, int | float]:
    """Return the numbers of accepted steps, rejected steps and evaluations of a run, shape (1,)."""
    *_, steps, rejected, evaluations = run.item()
    return {"steps": steps, "rejected": rejected, "evaluations": evaluations}


@inner
def _next_sample(times: Array, sample: int, after: float) -> int:
    """Return the index of the first sample, from `sample` on, that is not before a time."""
    while sample < times.shape[0] and times[sample] < after:
        sample += 1
    return sample


@inner
def _record_samples(drive: _Drive, times: Array, first: int, last: int, samples: Array) -> None:
    """Record the samples `first` to `last` - 1, within a step, from the dense output."""
    motion = drive.motion
    t = motion.run[0].t
    ask(drive.stepper, INTERPOLATE, t, motion.z, motion.end)
    for n in range(first, last):
        ask(drive.stepper, EVALUATE, times[n] - t, motion.z, motion.state)
        ask(motion.mechanism, SAMPLE, times[n], motion.state, samples[n])


@inner
def _integrate(drive: _Drive, times: Array, tolerance: float, longest: float, stop: bool, samples: Array) -> int:
    """Integrate as `integrate`."""
    motion = drive.motion
    run, mechanism, z, end = motion.run[0], motion.mechanism, motion.z, motion.end
    run.steps, run.rejected, run.evaluations, run.status, run.failure = 0, 0, 0, 0, 1
    run.h, run.before, run.most, run.tolerance, run.stop_if_stiff = 0.0, np.inf, np.inf, tolerance, stop
    t, last, sample, accepted = times[0], times[-1], 1, True
    bound = min(longest, ask(mechanism, BEGIN, t, z, samples[0]))
    while sample < times.shape[0]:
        run.t, run.span = t, last - t
        if accepted:
            ask(drive.stepper, PREPARE, t, z, end)
            if run.status:
                return run.status
        goal = times[sample] if drive.lands else last
        step = step_length(min(run.h, bound), goal - t)
        if not step >= 1e-14 * max(1.0, abs(t)):
            return run.failure
        run.step = step
        accepted = ask(drive.stepper, ATTEMPT, t, z, end) <= 1.0
        if not accepted:
            run.rejected += 1
            run.h, run.most = step * run.factor, 1.0
            continue
        run.steps += 1
        after = goal if step == goal - t else t + step
        left = _next_sample(times, sample, after)
        ended = min(left + 1, times.shape[0]) if left < times.shape[0] and times[left] == after else left
        row = samples[left] if ended > left else motion.state[:0]
        bound = min(longest, ask(mechanism, END_STEP, after, end, row))
        if sample < left:
            _record_samples(drive, times, sample, left, samples)
        assign(z, end)
        run.h, run.most = step * run.factor if step == run.h else max(run.h, step * run.factor), np.inf
        t, sample, run.before = after, ended, step
    return 0


@threaded
def integrate(
    drive: _Drive, times: Array, tolerance: float, longest: float, stop_if_stiff: bool, samples: Array
) -> int:
    """Integrate from ``times[0]`` and record all samples; return a key of `step_control.STATUS`.

    Parameters
    ----------
    drive : _Drive
        As a record array; ``motion.z`` holds the initial state, and afterwards the last.
    times : ndarray, shape (n_t,), s
    tolerance : float
        Bound on the scaled local error.
    longest : float, s
        Bound on the steps.
    stop_if_stiff : bool
    samples : ndarray, shape (n_t, n)
        Overwritten.
    """
    return _integrate(fields_of(drive), times, tolerance, longest, stop_if_stiff, samples)
