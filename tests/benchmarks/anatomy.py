"""Where the time of the reference goes: the parts of one evaluation, the projection after a step, and a motion of 5 s.

    python tests/benchmarks/anatomy.py [case ...]

Each part is what an evaluation takes up to its end less what it takes up to its beginning, the least of some runs.
"""

import sys
import time

import numpy as np

from consilience.case import load_case
from consilience.reference import simulate
from consilience.reference.kernel.compiled import inlined, kernel
from consilience.reference.kernel.held import hold
from consilience.reference.tree import records
from consilience.reference.tree.arrays import PIVOT, flatten_relative, system
from consilience.reference.tree.articulated import free_biases, inertias, sweep_in
from consilience.reference.tree.dynamics import _push, factorise_rows, rates
from consilience.reference.tree.either import accelerate, coast, cut_rows, eliminate, force_rows, open_links, place_at
from consilience.reference.tree.few_freedoms import add_to_links, is_small, reduce_links
from consilience.reference.tree.loop_rows import want
from consilience.reference.tree.planar import sweep_in_planar
from consilience.reference.tree.planar_detection import planar
from consilience.reference.tree.planar_rows import push_efforts
from consilience.reference.tree.projection import SEEN, arrive
from consilience.reference.tree.state import pack_relative

CASES = ("four_bar", "slider_crank", "manipulator", "spatial_slider_crank", "rssr_four_bar", "furuta_pendulum")
PARTS = ("placing", "inertias, forces", "rows", "tree", "closing", "rates")
REPEATS, COUNT, APART = 15, 2000, 1e-7
"""Repetitions, calls in each, and how far a step of a second leaves a state open: 1e-12 or so in a step of the
tolerance below, which one correction closes."""

DURATION, TOLERANCE = 5.0, 1e-10


@inlined
def push(rest, space, elements, plane, z):
    """Inertias (in a plane they are part of placing) and forces."""
    if space is not None:
        inertias(rest.link)
        if elements is not None and not elements.plain:
            _push(elements, rest.layout, space.y, space.A, 0.0, z, rest.link)
        else:
            free_biases(rest.link)
    if plane is not None and plane.effort.shape[0]:
        push_efforts(plane, rest.link, 0.0, z)


@inlined
def sweep(rest, space, plane):
    """Along the tree and back."""
    if space is not None:
        sweep_in(rest.link, rest.free)
    if plane is not None:
        sweep_in_planar(rest.link, rest.free, True)
    accelerate(space, plane, rest.link, rest.free, rest.u, 1.0)


@inlined
def along(rest, space, plane, small):
    """Accelerations of the tree."""
    if space is not None:  # noqa: SIM102 - Numba leaves out what is done where it is not None alone
        if small:
            coast(rest.link, rest.free, rest.u)
    if not small:
        sweep(rest, space, plane)


@inlined
def close(rest, space, plane, small):
    """What the rows do to the accelerations of the tree."""
    loops, fronts, link, free, u = rest.loops, rest.fronts, rest.link, rest.free, rest.u
    open_links(loops, fronts, space, plane, link, rest.gamma)
    if space is not None:  # noqa: SIM102 - as above
        if small:
            rows, freedoms, _ = eliminate(loops, fronts, space.reduced, link, free)
            reduce_links(space.reduced, rows, freedoms, link, free, u, 1.0)
            add_to_links(link, records.ACCELERATION, freedoms, space.reduced.V, space.reduced.G)
    if not small:
        factorise_rows(loops, rest.layout, link, free, fronts, space, plane, rest.size[0])
        force_rows(loops, fronts, free)
        accelerate(space, plane, link, free, u, 1.0)


@kernel
def up_to(depth, rest, space, elements, plane, z, n):
    """The first parts of an evaluation, n times."""
    group, fronts, small = rest.loops.group, rest.fronts, False
    if space is not None:
        small = rest.best[PIVOT] > 0.0 and is_small(group, fronts.state, space.reduced.left)
    for _ in range(n):
        place_at(rest, space, elements, plane, z)
        if depth > 0:
            push(rest, space, elements, plane, z)
        if depth > 1 and group.shape[0]:
            want(group, fronts.order, fronts.state, fronts.wanted)
            cut_rows(rest, space, elements, plane, 0.0, z)
        if depth > 2:
            along(rest, space, plane, small)
        if depth > 3 and group.shape[0]:
            close(rest, space, plane, small)


@kernel
def whole(tree, rest, space, elements, plane, z, dz, n):
    """An evaluation, n times."""
    for _ in range(n):
        rates(tree, rest, space, elements, plane, 0.0, z, dz)


@kernel
def arriving(tree, rest, space, elements, plane, z, apart, target, n):
    """The projection of a state that is a little apart from closed loops and no sample, n times."""
    for _ in range(n):
        for k in range(z.shape[0]):
            target[k] = z[k] + apart[k]
        arrive(tree, rest, space, elements, plane, 0.0, target, not SEEN)


def least(calls, count):
    """Least CPU time of each of some calls, taken in turns, in microseconds for one of `count`."""
    found = []
    for _ in range(REPEATS):
        found.append([])
        for call in calls:
            began = time.process_time()
            call()
            found[-1].append(time.process_time() - began)
    return 1e6 * np.min(found, axis=0) / count


def row(case):
    """What the table says of a case."""
    links, spanning, model = flatten_relative(case.mechanism)
    given = case.mechanism, links, spanning, model
    arrays = tuple(map(hold, planar(*given) or system(*given)))
    z = pack_relative(links, spanning, model, case.initial_state)
    dz, target = np.zeros_like(z), z.copy()
    arriving(*arrays, z, dz, target, 1)
    whole(*arrays, z, dz, 1)
    calls = [lambda depth=depth: up_to(depth, *arrays[1:], z, COUNT) for depth in range(len(PARTS) - 1)]
    calls.append(lambda: whole(*arrays, z, dz, COUNT))
    calls.append(lambda: arriving(*arrays, z, APART * dz, target, COUNT))
    *ends, projection = least(calls, COUNT)
    times = np.linspace(0.0, DURATION, 2)
    motion = simulate(case.mechanism, case.initial_state, times, TOLERANCE, "relative", "tp86")
    evaluations, steps = motion.counters["evaluations"], motion.counters["steps"]
    spans = times, times[:1]
    calls = [lambda s=s: simulate(case.mechanism, case.initial_state, s, TOLERANCE, "relative", "tp86") for s in spans]
    both = least(calls, evaluations)
    parts = [f"{part:.2f}" for part in np.diff([0.0, *ends])]
    return [
        case.name,
        *parts,
        f"{ends[-1]:.2f}",
        f"{projection:.2f}",
        f"{evaluations}, {steps}",
        f"{both[0] - both[1]:.2f}",
    ]


def main():
    """Print the table."""
    columns = ["case", *PARTS, "evaluation", "projection", "evaluations, steps", "all, by evaluation"]
    print("Microseconds; the last two columns: 5 s by tp86 at a tolerance of 1e-10, without translation.\n")
    print(f"| {' | '.join(columns)} |\n{'|---' * len(columns)}|")
    for name in sys.argv[1:] or CASES:
        print(f"| {' | '.join(row(load_case(name)))} |", flush=True)


if __name__ == "__main__":
    main()
