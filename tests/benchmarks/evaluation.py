"""One evaluation of forward dynamics: against Pinocchio, with the number of bodies, and in batches.

    python tests/benchmarks/evaluation.py [pinocchio] [growth] [batch] [memory]

Spatial chains of revolute joints about skew axes, bodies with full inertia. Both programs are called from Python, warm,
in turns; ratios are medians over the turns, with quartiles in brackets.
"""

import multiprocessing
import os
import resource
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin

sys.path.insert(0, str(Path(__file__).parents[1]))

from consilience.case import load_case
from consilience.reference import ForwardDynamics, simulate
from mechanisms import chain

TURNS, SLICE = 41, 1e-3
"""Number of turns, and the seconds that one side is called for in each."""


def spread(values):
    low, middle, high = np.percentile(values, [25, 50, 75])
    return f"{middle:.3g} ({low:.3g} to {high:.3g})"


def timed(call, count):
    began = time.perf_counter()
    for _ in range(count):
        call()
    return (time.perf_counter() - began) / count


def in_turns(calls, turns=TURNS):
    """Return the time in s of each call in each turn, shape (turns, n)."""
    counts = [max(1, int(SLICE / max(timed(call, 1) for _ in range(3)))) for call in calls]
    return np.array([[timed(call, count) for call, count in zip(calls, counts, strict=True)] for _ in range(turns)])


def pinocchio_model(mechanism):
    """Return the chain as a Pinocchio model; each joint frame is at M."""
    model, end = pin.Model(), pin.SE3.Identity()
    model.gravity.linear = mechanism.gravity
    for n, (joint, body) in enumerate(zip(mechanism.joints, mechanism.bodies, strict=True)):
        model.addJoint(n, pin.JointModelRZ(), end * pin.SE3(joint.F.R, joint.F.p), joint.name)
        end = pin.SE3(joint.M.R, joint.M.p).inverse()
        model.appendBodyToJoint(n + 1, pin.Inertia(body.mass, body.com, body.inertia), end)
    return model


def spatial_chain(count):
    dynamics = ForwardDynamics(chain(*["revolute"] * count))
    return dynamics, *np.random.default_rng(count).normal(size=(2, count))


def against_pinocchio():
    """Compare with `aba`, which reuses its output arrays: the reference into a given array, and into a new one."""
    print("| bodies | ours, us | into a new array, us | aba, us | ratio | of the new array | difference |")
    print("|---|---|---|---|---|---|---|")
    for count in (2, 10, 50, 200):
        dynamics, q, v = spatial_chain(count)
        model, rest = pinocchio_model(dynamics.mechanism), np.zeros(count)
        data, out = model.createData(), np.empty(count)
        theirs = pin.aba(model, data, q, v, rest).copy()
        apart = np.max(np.abs(dynamics.accelerations(q, v) - theirs)) / np.max(np.abs(theirs))
        calls = (
            lambda d=dynamics, q=q, v=v, out=out: d.accelerations(q, v, 0.0, out),
            lambda d=dynamics, q=q, v=v: d.accelerations(q, v),
            lambda m=(model, data, q, v, rest): pin.aba(*m),
        )
        found = in_turns(list(calls))
        times = [spread(1e6 * column) for column in found.T]
        ratios = [spread(found[:, k] / found[:, 2]) for k in (0, 1)]
        print(f"| {count} | {' | '.join([*times, *ratios])} | {apart:.1e} |", flush=True)


def growth():
    counts = np.array([50, 100, 200, 500, 1000, 2000])
    chains = [spatial_chain(int(count)) for count in counts]
    found = in_turns([lambda c=c: c[0].accelerations(*c[1:]) for c in chains])
    exponents = np.diff(np.log(found), axis=1) / np.diff(np.log(counts))
    print("| bodies | us | exponent to the next |\n|---|---|---|")
    for n, count in enumerate(counts):
        print(f"| {count} | {spread(1e6 * found[:, n])} | {spread(exponents[:, n]) if n < len(counts) - 1 else ''} |")
    fits = [np.polyfit(np.log(counts), np.log(row), 1)[0] for row in found]
    least = np.polyfit(np.log(counts), np.log(found.min(axis=0)), 1)[0]
    print(f"exponent of all: {spread(fits)}; of the least times {least:.3g}", flush=True)


def batch():
    case = load_case("seven_axis_arm")
    # without joint springs: force elements use the slower, general kernel
    dynamics, states = ForwardDynamics(replace(case.mechanism, joint_springs=())), 100_000
    rng = np.random.default_rng(0)
    q, v = rng.normal(size=(states, dynamics.n_q)), rng.normal(size=(states, dynamics.n_v))
    calls = [lambda n=n: dynamics.accelerations_of(q, v, threads=n) for n in (1, 2)]
    found = in_turns(calls, 7)
    bodies = states * len(case.mechanism.bodies)
    print(f"{states} states of {case.mechanism.name}; processors {os.cpu_count()}, load {os.getloadavg()[0]:.1f}")
    for n in (0, 1):
        print(f"{n + 1} threads: {spread(1e-6 * bodies / found[:, n])} million bodies a second")
    print(f"two threads against one: {spread(found[:, 0] / found[:, 1])}", flush=True)
    print(f"the machine, two processes at once against one: {spread(_scaling(calls[0]))}", flush=True)


def _scaling(call):
    """Return the throughput of two independent single-threaded processes relative to one process, in each turn."""
    context = multiprocessing.get_context("fork")
    both = np.empty(7)
    for n in range(len(both)):
        alone = timed(call, 1)
        barrier, times = context.Barrier(2), context.Queue()

        def work(barrier=barrier, times=times):
            call()
            barrier.wait()
            times.put(timed(call, 1))

        started = [context.Process(target=work) for _ in range(2)]
        for process in started:
            process.start()
        together = max(times.get() for _ in started)
        for process in started:
            process.join()
        both[n] = 2.0 * alone / together
    return both


def memory():
    dynamics, q, v = spatial_chain(2000)
    simulate(dynamics.mechanism, dynamics.state(q, 0.01 * v), np.array([0.0, 1e-3]), 1e-6, "relative")
    print(f"run of a chain of 2000: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3:.0f} MB", flush=True)


PARTS = {"pinocchio": against_pinocchio, "growth": growth, "batch": batch, "memory": memory}

if __name__ == "__main__":
    for name in sys.argv[1:] or PARTS:
        PARTS[name]()
