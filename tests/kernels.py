"""Compile the kernels that the tests use, once, in two processes: ``python tests/kernels.py``.

Numba compiles a kernel for the types of its arguments at the first call and caches the machine code on disk for all
processes. Test processes that run side by side would each compile the same kernels. Here each set of argument types is
compiled by one process only. With ``--copy PACKAGE``, the kernels of another installation of the same sources, given
by the folder of its package, are copied and none is compiled.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import os
import shutil
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

CHAINS = (
    # joint coordinates: in space with loops, with elements, as a plain tree; in a plane with loops and without
    ("loop_universal", "forced_chain", "long_chain", "four_bar", "single_revolute"),
    ("states", "body coordinates", "recursive", "contact"),
)
"""Sets of kernels by the process that compiles them, in order: sets with many kernels in common follow one another."""

BODY = "single_revolute"
"""Mechanism for formulations in body coordinates: the types are the same for all mechanisms."""

TOUCHING = ("bouncing_sphere", "ball_in_corner-stays", "ball_rolls")
"""Cases with contact: a motion through impacts, and forces that are chosen among many."""


def _motions(mechanism):
    """Run every integrator to one sample, accelerations and reactions, in joint coordinates."""
    from consilience.errors import InvalidInput
    from consilience.reference import formulation, simulate
    from consilience.reference.tree.solver import INTEGRATORS
    from mechanisms import states_of

    (state,) = states_of(mechanism, 1)
    equations = formulation("relative", mechanism)
    equations.accelerations(state)
    equations.reactions(state)
    equations.settle(0.0, equations.coordinates(state))
    for integrator in INTEGRATORS:
        with contextlib.suppress(InvalidInput):  # Taylor series do not support every mechanism
            simulate(mechanism, state, [0.0, 1e-3], 1e-9, "relative", integrator)


def _body_coordinates(mechanism, names):
    """Run accelerations, reactions and a motion in body coordinates with each kernel."""
    from consilience.reference import formulation, simulate
    from mechanisms import states_of

    (state,) = states_of(mechanism, 1)
    for name in names:
        equations = formulation(name, mechanism)
        equations.accelerations(state)
        equations.reactions(state)
        equations.settle(0.0, equations.coordinates(state))
        simulate(mechanism, state, [0.0, 1e-3], 1e-9, name)


def _contact(names):
    """Run motions with contact, and choose forces at their start."""
    from consilience.case import load_case
    from consilience.engine import Question, load_engine

    reference = load_engine("reference")
    for name in names:
        case = load_case(name)
        mechanism, state = case.mechanism, case.initial_state
        reference.instant(mechanism, [state], reference.methods(mechanism, Question.INSTANT)[0])
        method = reference.methods(mechanism, Question.TRAJECTORY)[0]
        reference.trajectory(mechanism, state, case.times[:3], method, 1e-9)


def _states(names):
    """Assemble states, and compute accelerations, reactions and energies there."""
    import consilience as cs
    from mechanisms import LOOPS, TREES

    for name in names:
        mechanism = (TREES | LOOPS)[name]
        state = cs.initial_state(mechanism)
        cs.accelerations(mechanism, state)


def compile_set(name):
    """Compile one set of kernels."""
    from consilience.reference.formulations.body_velocities import KERNELS, TREE_KERNELS
    from flat import PLANAR
    from mechanisms import LOOPS, TREES

    if name == "contact":
        _contact(TOUCHING)
    elif name == "states":
        _states(("loop_universal", "single_revolute"))
    elif name == "body coordinates":
        _body_coordinates(TREES[BODY], KERNELS)
    elif name == "recursive":
        _body_coordinates(TREES[BODY], TREE_KERNELS)
    else:
        _motions((PLANAR | TREES | LOOPS)[name])


def compile_all() -> None:
    """Compile every set; ignore errors, because the tests that use the kernel report them in more detail."""
    with contextlib.ExitStack() as stack:
        pools = [stack.enter_context(ProcessPoolExecutor(1, get_context("spawn"))) for _ in CHAINS]
        sets = {
            name: pool.submit(compile_set, name) for pool, chain in zip(pools, CHAINS, strict=True) for name in chain
        }
        for name, found in sets.items():
            if found.exception() is not None:
                print(f"kernels of {name} are not compiled: {found.exception()!r}", file=sys.stderr)


def compile_apart() -> None:
    """Run `compile_all` in a new process: the calling process cannot always be spawned again by multiprocessing."""
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    subprocess.run([sys.executable, str(Path(__file__))], env=environment, check=False)


def numba_folder(room: Path) -> str:
    """Name that Numba gives to the cache of a folder of sources: the folder's own, and a digest of its path."""
    return f"{room.name}_{hashlib.sha1(str(room).encode()).hexdigest()}"


def copy_kernels(other: Path, package: Path) -> int:
    """Copy the compiled kernels of another package folder with the same sources; return the number of files."""
    from consilience.reference.kernel.cache import digest

    kernels = Path("reference") / "kernel" / "__pycache__" / f"kernels-{digest(package)}"
    files = list((other / kernels).glob("*/*.nb[ic]"))
    for file in files:
        room = package / "reference" / file.parent.name.rpartition("_")[0]
        here = package / kernels / numba_folder(room)
        here.mkdir(parents=True, exist_ok=True)
        shutil.copy(file, here)
    return len(files)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--copy", type=Path, metavar="PACKAGE", help="copy the kernels of another installation")
    other = parser.parse_args().copy
    if other is None:
        compile_all()
    else:
        import consilience

        print(f"{copy_kernels(other, Path(consilience.__file__).parent)} files of kernels copied")
