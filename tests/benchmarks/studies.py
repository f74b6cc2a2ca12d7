"""The library for a mechanism that is known: one motion, one state, a thousand parameter sets.

    python tests/benchmarks studies

Least CPU times of many calls, since other processes share the machine, and their ratios to the time of one motion.
"""

from __future__ import annotations

import timeit
from collections.abc import Callable, Iterator, Sequence
from time import process_time

import numpy as np
from tables import Table

import consilience as cs
import consilience.mechanism as plain
from consilience.reference.steppers.driver import MotionRequest
from consilience.reference.steppers.driver import run as integrate
from consilience.reference.tree.solver import prepare
from consilience.reference.tree.state import pack_state

NUMBER, ROUNDS, MANY = 5, 9, 200


def double_pendulum() -> cs.Case:
    """Two bars of 1 m and 0.8 m that swing for 3 s."""
    draw = cs.Drawing("double_pendulum", gravity=(0, 0, -9.81))
    draw.body("upper", cs.bar((0, 0, 0), (0, 0, -1), radius=0.02), density=2700)
    draw.body("lower", cs.bar((0, 0, -1), (0, 0, -1.8), radius=0.02), density=2700)
    draw.joint("shoulder", "revolute", "ground", "upper", at=(0, 0, 0), axis=(0, 1, 0))
    draw.joint("elbow", "revolute", "upper", "lower", at=(0, 0, -1), axis=(0, 1, 0))
    return draw.case(start={"shoulder": 1.2, "elbow": 0.5}, duration=3.0, sample=0.05)


def least(call: Callable[[], object], number: int = NUMBER, rounds: int = ROUNDS) -> float:
    """Return the least CPU time of a call, s, after one that warms it up."""
    call()
    return min(timeit.repeat(call, timer=process_time, number=number, repeat=rounds)) / number


def single(case: cs.Case) -> Table:
    """Return the table of one mechanism."""
    mechanism, states = case.mechanism, case.states
    state, times = case.initial_state, case.times
    motion = least(lambda: cs.simulate(mechanism, state, times), rounds=MANY)
    about = f"{len(times)} samples over {case.duration:g} s. The ratio is that to one motion of `cs.simulate`."
    table = Table(f"One call of the library: {case.name}", about, ("what", "bar", "time", "ratio"))
    measured = {
        "`cs.simulate`, 1e-12": ("300 us", motion),
        "`cs.initial_state`": ("500 us", least(lambda: cs.initial_state(mechanism, case.initial), rounds=MANY)),
        "the same in NumPy": ("", least(lambda: plain.initial_state(mechanism, case.initial))),
        "`cs.accelerations`, a state of many": (
            "20 us",
            least(lambda: cs.accelerations(mechanism, states), rounds=MANY) / len(states),
        ),
        "`cs.accelerations`, one state": ("", least(lambda: cs.accelerations(mechanism, states[:1]), rounds=MANY)),
    }
    for what, (bar, seconds) in measured.items():
        table.rows.append([what, bar, f"{1e6 * seconds:.3g} us", f"{seconds / motion:.2g}"])
    return table


SPANS = (1.0, 2.0, 5.0)
"""Durations of the motions whose parts are timed, s."""

BAR_SPAN = 2.0
"""Duration of the motion that the bar is for, s: in the descriptor form the double pendulum takes 6.6 ms for it."""


def parts(cases: Sequence[cs.Case]) -> Table:
    """Return the table of what one motion is made of."""
    about = (
        "`cs.simulate` to 1e-12, samples every 0.05 s; the bar is 300 us for 2 s. The integrator alone is asked for "
        "the last sample; an evaluation is a coefficient of the series, with its share of the projection of the step. "
        "The rest is Python, checks and conversions, and what their memory costs the kernels."
    )
    columns = ("mechanism", "s", "steps", "evaluations", "ns an evaluation", "integrator", "samples", "rest", "in all")
    table = Table("Parts of one motion", about, columns)
    for case in cases:
        for span in SPANS:
            table.rows.append([case.name, f"{span:g}", *_parts(case.with_span(span, 0.05))])
    return table


def _parts(case: cs.Case) -> list[str]:
    mechanism, state, times = case.mechanism, case.initial_state, case.times
    prepared = prepare(mechanism)
    z, name = pack_state(prepared.links, prepared.packing, state), prepared.default_integrators[0]
    arrays = prepared.working(name)

    def kernels(samples: plain.Array) -> float:
        motion = np.empty((len(samples), *arrays.system.tree.y.shape))
        asked = MotionRequest(z, samples, 1e-12, prepared.longest)
        return least(lambda: integrate(arrays.integration, asked, motion, True), rounds=MANY)

    whole = least(lambda: cs.simulate(mechanism, state, times), rounds=MANY)
    alone, sampled = kernels(times[[0, -1]]), kernels(times)
    done = cs.simulate(case).counters
    each = [done["steps"], done["evaluations"], f"{1e9 * alone / done['evaluations']:.0f}"]
    return [*map(str, each), *(f"{1e6 * s:.0f} us" for s in (alone, sampled - alone, whole - sampled, whole))]


def many(case: cs.Case, sets: int) -> Table:
    """Return the table of studies."""
    rng = np.random.default_rng(1)
    values = {"upper.mass": rng.uniform(1.0, 4.0, sets), "elbow.place[2]": rng.uniform(-1.3, -0.7, sets)}
    motion = least(lambda: cs.simulate(case, tolerance=1e-9))
    study = least(lambda: cs.study(case, values, tolerance=1e-9, paired=True), 1)
    states = [case.initial_state] * sets
    starts = least(lambda: cs.simulate_many(case, states, tolerance=1e-9), 1)
    found = cs.study(case, values, tolerance=1e-9, paired=True)
    about = (
        f"{sets} sets of two parameters and {sets} states, {case.duration:g} s each, to 1e-9, CPU time of all threads."
    )
    table = Table("Studies", about, ("what", "bar", "time in all", "a set, in motions of `cs.simulate`"))
    for what, bar, seconds in (("`cs.study`", "1 s of 1000", study), ("`cs.simulate_many`", "", starts)):
        table.rows.append([what, bar, f"{seconds:.3g} s", f"{seconds / sets / motion:.2g}"])
    table.rows.append(["`study.plot()`", "", f"{least(found.plot, 1):.3g} s", ""])
    return table


def run(short: bool) -> Iterator[Table]:
    """Yield the tables of the page."""
    case = double_pendulum()
    four_bar = cs.load_case("four_bar")
    for one in (case, four_bar):
        yield single(one.with_span(BAR_SPAN, 0.05))
    yield parts((case, four_bar))
    yield many(case, 50 if short else 1000)
