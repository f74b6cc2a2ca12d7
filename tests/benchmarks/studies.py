"""The library for a mechanism that is known: one motion, one state, a thousand parameter sets.

    python tests/benchmarks studies

Least CPU times of many calls, since other processes share the machine, and their ratios to the time of one motion.
"""

from __future__ import annotations

import timeit
from collections.abc import Callable, Iterator
from time import process_time

import numpy as np
from tables import Table

import consilience as cs
import consilience.mechanism as plain

NUMBER, ROUNDS = 5, 9


def double_pendulum() -> cs.Case:
    """Two bars of 1 m and 0.8 m that swing for 3 s."""
    draw = cs.Drawing("double_pendulum", gravity=(0, 0, -9.81))
    draw.body("upper", cs.bar((0, 0, 0), (0, 0, -1), radius=0.02), density=2700)
    draw.body("lower", cs.bar((0, 0, -1), (0, 0, -1.8), radius=0.02), density=2700)
    draw.joint("shoulder", "revolute", "ground", "upper", at=(0, 0, 0), axis=(0, 1, 0))
    draw.joint("elbow", "revolute", "upper", "lower", at=(0, 0, -1), axis=(0, 1, 0))
    return draw.case(start={"shoulder": 1.2, "elbow": 0.5}, duration=3.0, sample=0.05)


def least(call: Callable[[], object], number: int = NUMBER) -> float:
    """Return the least CPU time of a call, s, after one that warms it up."""
    call()
    return min(timeit.repeat(call, timer=process_time, number=number, repeat=ROUNDS)) / number


def single(case: cs.Case) -> Table:
    """Return the table of one mechanism."""
    mechanism, states = case.mechanism, case.states
    state, times = case.initial_state, case.times
    motion = least(lambda: cs.simulate(mechanism, state, times))
    about = f"{len(times)} samples over {case.duration:g} s. The ratio is that to one motion of `cs.simulate`."
    table = Table(f"One call of the library: {case.name}", about, ("what", "bar", "time", "ratio"))
    measured = {
        "`cs.simulate`, 1e-12": ("300 us", motion),
        "`cs.initial_state`": ("500 us", least(lambda: cs.initial_state(mechanism, case.initial))),
        "the same in NumPy": ("", least(lambda: plain.initial_state(mechanism, case.initial))),
        "`cs.accelerations`, a state of many": (
            "20 us",
            least(lambda: cs.accelerations(mechanism, states)) / len(states),
        ),
        "`cs.accelerations`, one state": ("", least(lambda: cs.accelerations(mechanism, states[:1]))),
    }
    for what, (bar, seconds) in measured.items():
        table.rows.append([what, bar, f"{1e6 * seconds:.3g} us", f"{seconds / motion:.2g}"])
    return table


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
    for one in (case, cs.load_case("four_bar")):
        yield single(one)
    yield many(case, 50 if short else 1000)
