"""Kernels without reference counting leak no array; inner kernels are not called from Python."""

import ast
import gc
from pathlib import Path

import numba
import numpy as np
import pytest
from numba.core.runtime import _nrt_python, rtsys

from consilience.mechanism import continuous_in_time
from consilience.reference import ForwardDynamics, accelerations, simulate
from consilience.reference.bodies.arrays import unpack
from consilience.reference.bodies.canonical import canonical_motion
from consilience.reference.formulations.body_velocities import KERNELS, TREE_KERNELS
from mechanisms import ELEMENTS, LOOPS, TREES, states_of

pytestmark = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")

ROOT = Path(__file__).resolve().parents[2]
MECHANISMS = {next(iter(group)): next(iter(group.values())) for group in (TREES, LOOPS, ELEMENTS)}
DECORATORS = {"kernel", "inner", "fused", "inlined", "threaded", "allocating", "Operation", "allocating_operation"}
TIMES = np.linspace(0.0, 0.05, 4)


def alive():
    """Return the number of arrays that kernels have allocated and not freed."""
    gc.collect()
    stats = rtsys.get_allocation_stats()
    return stats.alloc - stats.free


@pytest.fixture(autouse=True)
def _counting():
    before = _nrt_python.memsys_stats_enabled()
    _nrt_python.memsys_enable_stats()
    gc.collect()
    gc.freeze()  # keep existing objects out of every collection below
    yield
    if not before:
        _nrt_python.memsys_disable_stats()


def motions(mechanism, state):
    """Yield calls of every compiled integrator, and of the accelerations of every compiled formulation."""
    for formulation in ("relative", "descriptor", "null_space"):
        yield lambda name=formulation: simulate(mechanism, state, TIMES, 1e-8, name)
    yield lambda: simulate(mechanism, state, TIMES, 1e-8, "relative", "gauss")
    for formulation in (*KERNELS, *TREE_KERNELS):
        yield lambda name=formulation: accelerations(mechanism, [state], name)
    forward = ForwardDynamics(mechanism)
    q, v = forward.coordinates(state)
    yield lambda: forward.accelerations(q, v)
    yield lambda: forward.accelerations_of(np.array([q] * 4), np.array([v] * 4))


@pytest.mark.parametrize("name", MECHANISMS)
def test_no_array_leaks(name):
    (state,) = states_of(MECHANISMS[name], 1)
    for call in motions(MECHANISMS[name], state):
        call()  # compile, and allocate constants, before counting
        before = alive()
        for _ in range(3):
            call()
        assert alive() == before


def test_the_counter_sees_a_leaked_array():
    @numba.njit
    def make():
        return np.zeros(3)

    before = alive()
    kept = make()
    assert alive() > before
    del kept
    assert alive() == before


def test_a_compiled_motion_in_canonical_terms_is_the_plain_one():
    mechanism = LOOPS["four_bar"]
    y = np.random.default_rng(5).normal(size=(40, len(mechanism.bodies) + 1, 13))
    p, quat, v, w = unpack(mechanism, y)
    com = np.array([body.com for body in mechanism.bodies])
    for found, wanted in zip(canonical_motion(com, y), (p, continuous_in_time(quat), v, w), strict=True):
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-13)


def marks(node):
    """Return the names of the decorators of a function."""
    return {d.id for d in node.decorator_list if isinstance(d, ast.Name)}


def module_of(path):
    """Return the dotted module name of a file of the library."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[1:]) if parts[0] == "src" else ""


def kernels_in(tree, kinds):
    """Return the names of a module's kernels with one of the given decorators."""
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef) and marks(node) & kinds}


def named_by_python(tree, names, modules):
    """Return the names, and the attributes of modules, that uncompiled code refers to."""
    found, todo = set(), [tree]
    while todo:
        node = todo.pop()
        if isinstance(node, ast.FunctionDef) and marks(node) & DECORATORS:
            continue
        if isinstance(node, ast.Name) and node.id in names:
            found.add(node.id)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            found |= {node.attr} & modules.get(node.value.id, set())
        todo += ast.iter_child_nodes(node)
    return found


def wrongly_named(folders):
    """Yield inner kernels that uncompiled code refers to."""
    trees = {path: ast.parse(path.read_text()) for folder in folders for path in (ROOT / folder).rglob("*.py")}
    inner = {module_of(path): kernels_in(tree, {"inner", "fused"}) for path, tree in trees.items()}
    assert sum(map(len, inner.values())) > 100  # the search must find kernels at all
    for path, tree in trees.items():
        names, modules = set(inner[module_of(path)]) if module_of(path) else set(), {}
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom):
                names |= {a.asname or a.name for a in node.names if a.name in inner.get(node.module, ())}
                modules |= {a.asname or a.name: inner.get(f"{node.module}.{a.name}", set()) for a in node.names}
        if names or any(modules.values()):
            yield from (f"{path.relative_to(ROOT)}: {name}" for name in named_by_python(tree, names, modules))


def test_python_calls_no_kernel_that_only_kernels_may_call():
    assert list(wrongly_named(["src", "tests/unit", "tests/oracles", "tests/twins"])) == []
