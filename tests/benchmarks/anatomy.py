"""Parts of the CPU time of the reference: one evaluation, the projection after a step, and a motion of 5 s.

    python tests/benchmarks/anatomy.py [case ...]

The time of a part is the time of an evaluation up to the end of the part, less the time up to its beginning; both are
the least of several runs.
"""

import sys
import time

import numpy as np

from consilience.case import load_case
from consilience.reference import simulate
from consilience.reference.kernel.compiled import inlined, kernel
from consilience.reference.kernel.mechanism_record import fields_of, record_array, record_of
from consilience.reference.kernel.operation import address_of
from consilience.reference.steppers.motion import DERIVATIVE, END_STEP, Kernel, ask
from consilience.reference.tree.arrays import flatten_relative, tree_system
from consilience.reference.tree.articulated import gravity_biases, inward_sweep, rigid_inertias
from consilience.reference.tree.dynamics import _element_biases, factorise_rows
from consilience.reference.tree.either import (
    bias_accelerations,
    eliminate_rows,
    evaluate_rows,
    loop_acceleration_residual,
    place_state,
    sweep_accelerations,
)
from consilience.reference.tree.few_freedoms import add_link_accelerations, has_few_freedoms, solve_reduced
from consilience.reference.tree.loop_rows import mark_active_rows
from consilience.reference.tree.multifrontal import least_norm_forces
from consilience.reference.tree.planar import planar_inward_sweep
from consilience.reference.tree.planar_detection import planar_system
from consilience.reference.tree.planar_rows import add_force_biases
from consilience.reference.tree.state import pack_relative
from consilience.reference.tree.system import serve, system_record

CASES = ("four_bar", "slider_crank", "manipulator", "spatial_slider_crank", "rssr_four_bar", "furuta_pendulum")
PARTS = ("placing", "inertias, forces", "rows", "tree", "closing", "rates")
REPEATS, COUNT, DISPLACEMENT = 15, 2000, 1e-7
"""Repetitions, calls in each, and how far a step of a second leaves a state open: 1e-12 or so in a step of the
tolerance below, which one correction closes."""

DURATION, TOLERANCE = 5.0, 1e-10


@inlined
def push(closure, spatial, elements, planar, z):
    """Set inertias and force biases; in a plane, placing the links has set the inertias."""
    if spatial is not None:
        rigid_inertias(closure.link)
        if elements is not None and not elements.gravity_only:
            _element_biases(elements, closure.layout, spatial.y, spatial.A, 0.0, z, closure.link)
        else:
            gravity_biases(closure.link)
    if planar is not None and planar.force_table.shape[0]:
        add_force_biases(planar, closure.link, 0.0, z)


@inlined
def sweep(closure, spatial, planar):
    """Sweep inward and outward along the tree."""
    if spatial is not None:
        inward_sweep(closure.link, closure.free)
    if planar is not None:
        planar_inward_sweep(closure.link, closure.free, True)
    sweep_accelerations(closure, spatial, planar, 1.0)


@inlined
def along(closure, spatial, planar, small):
    """Compute the accelerations of the tree with its loops open."""
    if spatial is not None:  # noqa: SIM102 - Numba prunes only `is not None` branches
        if small:
            bias_accelerations(closure)
    if not small:
        sweep(closure, spatial, planar)


@inlined
def close(closure, spatial, planar, small):
    """Add the effect of the loop rows to the accelerations of the tree."""
    loop_acceleration_residual(closure, spatial, planar)
    if spatial is not None:  # noqa: SIM102 - as above
        if small:
            elimination, link = spatial.elimination, closure.link
            rows, freedoms, _ = eliminate_rows(closure, elimination)
            solve_reduced(elimination, rows, freedoms, link, closure.free, closure.u, 1.0)
            add_link_accelerations(link, freedoms, elimination.V, elimination.G)
    if not small:
        factorise_rows(closure, spatial, planar)
        least_norm_forces(closure)
        sweep_accelerations(closure, spatial, planar, 1.0)


@kernel
def up_to(depth, closure, spatial, elements, planar, z, n):
    """Run an evaluation up to part `depth`, n times."""
    group, qr, small = closure.loops.group, closure.qr, False
    if spatial is not None:
        small = closure.best[0].elimination_pivot > 0.0 and has_few_freedoms(
            group, qr.state, spatial.elimination.independent
        )
    for _ in range(n):
        place_state(closure, spatial, elements, planar, z)
        if depth > 0:
            push(closure, spatial, elements, planar, z)
        if depth > 1 and group.shape[0]:
            mark_active_rows(group, qr.order, qr.state, qr.active)
            evaluate_rows(closure, spatial, elements, planar, 0.0, z)
        if depth > 2:
            along(closure, spatial, planar, small)
        if depth > 3 and group.shape[0]:
            close(closure, spatial, planar, small)


@kernel
def whole(run, z, dz, n):
    """Run an evaluation n times."""
    for _ in range(n):
        ask(fields_of(run), DERIVATIVE, 0.0, z, dz)


@kernel
def step_end(run, z, apart, target, n):
    """Project a state slightly off the constraint manifold, n times, at the end of a step without a sample."""
    for _ in range(n):
        for k in range(z.shape[0]):
            target[k] = z[k] + apart[k]
        ask(fields_of(run), END_STEP, 0.0, target, target[:0])


def least(calls, count):
    """Return the least CPU time of each call in microseconds, divided by `count`; the calls take turns."""
    found = []
    for _ in range(REPEATS):
        found.append([])
        for call in calls:
            began = time.process_time()
            call()
            found[-1].append(time.process_time() - began)
    return 1e6 * np.min(found, axis=0) / count


def row(case):
    """Return the row of a case in the table."""
    links, spanning, model = flatten_relative(case.mechanism)
    given = case.mechanism, links, spanning, model
    system = planar_system(*given) or tree_system(*given)
    arrays, held = tuple(map(record_of, system)), record_of(system_record(system, False))
    run = record_array(Kernel(serve.address(held), address_of(held)))
    z = pack_relative(links, spanning, model, case.initial_state)
    dz, target = np.zeros_like(z), z.copy()
    step_end(run, z, dz, target, 1)
    whole(run, z, dz, 1)
    calls = [lambda depth=depth: up_to(depth, *arrays[1:], z, COUNT) for depth in range(len(PARTS) - 1)]
    calls.append(lambda: whole(run, z, dz, COUNT))
    calls.append(lambda: step_end(run, z, DISPLACEMENT * dz, target, COUNT))
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
