"""Recursive minimal form on a spanning tree, against dense NumPy, the descriptor form, and between its two routes."""

import functools
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import truth
from consilience.mechanism import GROUND, JOINT_KINDS, Mechanism, spanning_tree
from consilience.mechanism.conditioning import mass_matrix_condition
from consilience.reference import accelerations
from consilience.reference.bodies import constraints
from consilience.reference.bodies.arrays import flatten, pack, workspace
from consilience.reference.bodies.motion import rotations
from consilience.reference.bodies.spanning_tree import flatten_tree, free_axes, tree_rows
from consilience.reference.formulations import descriptor, recursive
from consilience.reference.formulations.body_velocities import TREE_KERNELS, KernelFormulation
from mechanisms import ELEMENTS, GRAVITY, LOOPS, TREES, chain, drawn_joint, four_bar, rotation, states_of

ALL = TREES | LOOPS | ELEMENTS
EPS = np.finfo(float).eps


@functools.cache
def states(name):
    return states_of(ALL[name])


def worst_ratio(mechanism, state, found, wanted):
    """Return the largest difference relative to the largest acceleration, in units of the tolerance."""
    found, wanted = np.hstack(found), np.hstack(wanted)
    bar = 1e-11 + 4 * EPS * mass_matrix_condition(mechanism, state)
    return np.max(np.abs(found - wanted)) / np.max(np.abs(wanted)) / bar


@pytest.mark.parametrize("route", TREE_KERNELS)
@pytest.mark.parametrize("name", ALL)
def test_accelerations_are_those_of_dense_numpy(name, route):
    mechanism = ALL[name]
    ratios = [
        worst_ratio(mechanism, s, KernelFormulation(mechanism, route).accelerations(s), truth.solve(mechanism, s)[:2])
        for s in states(name)
    ]
    assert np.max(ratios) < 1.0


@pytest.mark.parametrize("route", TREE_KERNELS)
@pytest.mark.parametrize("name", ALL)
def test_accelerations_are_those_of_the_descriptor_form(name, route):
    mechanism = ALL[name]
    answer = accelerations(mechanism, states(name), "descriptor")
    ratios = [
        worst_ratio(mechanism, s, KernelFormulation(mechanism, route).accelerations(s), (a, alpha))
        for s, a, alpha in zip(states(name), answer.a_WB_W, answer.alpha_WB_W, strict=True)
    ]
    assert np.max(ratios) < 1.0


@pytest.mark.parametrize("route", TREE_KERNELS)
@pytest.mark.parametrize("name", ALL)
def test_rank_is_that_of_all_rows(name, route):
    mechanism = ALL[name]
    model, tree = flatten(mechanism), flatten_tree(mechanism)
    ws, a, turns = workspace(model), np.empty(6 * len(mechanism.bodies)), np.zeros(len(model.coordinate))
    y = pack(mechanism, states(name)[0])
    wanted = descriptor.accelerations(model, 0.0, y, turns, ws, a)
    assert TREE_KERNELS[route](tree, model, 0.0, y, turns, ws, a) == wanted


def test_cut_joint_of_the_planar_four_bar_has_three_dependent_rows():
    """Five rows on a tree of three freedoms leave one freedom, so three rows depend on the others."""
    mechanism = four_bar()
    tree = flatten_tree(mechanism)
    assert (len(tree.direction), len(tree.cut.row_kind)) == (3, 5)
    model = flatten(mechanism)
    rank = recursive.accelerations(
        tree, model, 0.0, pack(mechanism, states_of(mechanism)[0]), np.zeros(0), workspace(model), np.empty(18)
    )
    assert rank == 15 + 2


# ---------------------------------------------------------------- parts


@pytest.mark.parametrize("kind", JOINT_KINDS)
def test_every_joint_kind_has_as_many_directions_as_its_tree_rows_leave(kind):
    assert len(set(free_axes(kind))) == len(free_axes(kind)) == 6 - len(tree_rows(kind))
    assert set(JOINT_KINDS[kind].rows) - set(tree_rows(kind)) == {"rod": {"L"}, "screw": {"H"}}.get(kind, set())


def links_at(mechanism, state):
    """Return the links, the Jacobian rows of the tree joints, and their gamma."""
    model, tree, y = flatten(mechanism), flatten_tree(mechanism), pack(mechanism, state)
    ws = workspace(model)
    rotations(y, ws.A)
    constraints.evaluate(model, 0.0, y, np.zeros(len(model.coordinate)), ws)
    chosen = [
        model.first_row[k] + n
        for k, _ in spanning_tree(mechanism)[0]
        for n, row in enumerate(mechanism.joints[k].rows)
        if row in tree_rows(mechanism.joints[k].kind)
    ]
    return tree, recursive.kinematics(tree, model, y, ws.A), ws.A, ws.Q[chosen], ws.gamma[chosen]


def as_solver(tree, A, acc):
    """Return the motion of the links in the columns of Q: angular parts in body axes, original order of bodies."""
    a = np.empty((len(acc), 6))
    for k, b in enumerate(tree.body):
        a[b] = np.concatenate([acc[k, :3], A[b].T @ acc[k, 3:]])
    return a.ravel()


@pytest.mark.parametrize("name", ALL)
def test_the_recursion_meets_the_rows_of_the_tree_joints(name):
    """``Q (J u + abar) = gamma`` for any u, though neither S nor c is derived from the rows."""
    mechanism = ALL[name]
    rng = np.random.default_rng(1)
    for state in states(name):
        tree, links, A, Q, gamma = links_at(mechanism, state)
        motion = recursive.joint_motion(tree, links, rng.normal(size=len(links.S)))
        a = as_solver(tree, A, motion)
        size = max(1.0, np.max(np.abs(a)))
        np.testing.assert_allclose(Q @ a, gamma, rtol=0, atol=1e-12 * size)


@pytest.mark.parametrize("name", ALL)
def test_composite_bodies_give_the_projected_mass_matrix(name):
    """``H = J^T M J`` with J from columns of unit rates."""
    mechanism = ALL[name]
    tree, links, _, _, _ = links_at(mechanism, states(name)[0])
    N = len(links.S)
    rest = links._replace(c=np.zeros(links.c.shape))
    J = np.array([recursive.joint_motion(tree, rest, u).ravel() for u in np.eye(N)]).reshape(N, -1).T
    M = np.zeros((J.shape[0], J.shape[0]))
    for k, block in enumerate(links.inertia):
        M[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] = block
    wanted = J.T @ M @ J
    H = recursive.composite_mass_matrix(tree, links)
    np.testing.assert_allclose(np.tril(H), np.tril(wanted), rtol=0, atol=1e-13 * np.max(np.abs(wanted)))


@pytest.mark.parametrize("route", TREE_KERNELS)
def test_bodies_that_cannot_move_do_not_accelerate(route):
    mechanism = chain("rigid", "rigid", seed=73)
    for found in KernelFormulation(mechanism, route).accelerations(states_of(mechanism, 1)[0]):
        np.testing.assert_array_equal(found, np.zeros((2, 3)))


@pytest.mark.parametrize(("name", "row"), [("single_rod", 3), ("backward_rod", 3), ("single_screw", 13)])
def test_a_row_that_the_tree_cannot_pass_is_closed_like_a_loop(name, row):
    tree = flatten_tree(ALL[name])
    assert list(tree.cut.row_kind) == [row]
    assert tree.cut_rows == 1


def test_a_rod_that_closes_a_loop_is_a_cut_joint():
    mechanism = ALL["loop_rod"]
    tree = flatten_tree(mechanism)
    assert len(tree.cut.row_kind) == 1
    assert tree.cut.row_target[0] == next(j.length for j in mechanism.joints if j.kind == "rod")


# ---------------------------------------------------------------- long chains and cost


@pytest.mark.parametrize("route", TREE_KERNELS)
def test_fifty_links_agree_with_the_descriptor_form(route):
    mechanism = chain(*(("revolute", "universal", "prismatic", "spherical", "cylindrical") * 10), seed=70)
    state = states_of(mechanism, 1)[0]
    answer = accelerations(mechanism, [state], "descriptor")
    found = KernelFormulation(mechanism, route).accelerations(state)
    assert worst_ratio(mechanism, state, found, (answer.a_WB_W[0], answer.alpha_WB_W[0])) < 1.0


def closed_chain(count):
    """Return a chain of universal joints whose last link is fastened to the ground by a ball joint."""
    open_chain = chain(*["universal"] * count, seed=71)
    bodies = {b.name: b for b in open_chain.bodies}
    rng = np.random.default_rng(72)
    last = drawn_joint("last", "spherical", bodies, f"b{count - 1}", GROUND, rng.normal(size=3), rotation(rng))
    return Mechanism("closed", GRAVITY, open_chain.bodies, (*open_chain.joints, last))


def lines_of(route, mechanism):
    """Return the number of lines of Python that a route executes uncompiled.

    A line is work of fixed size, or one pass over the bodies. The QR of the loop system (N rows, as many columns as cut
    rows, linear in N) is left out: the number of its column exchanges depends on the numbers.
    """
    state = states_of(mechanism, 1)[0]
    model, tree, y = flatten(mechanism), flatten_tree(mechanism), pack(mechanism, state)
    ws, a = workspace(model), np.empty(6 * len(mechanism.bodies))
    count = 0

    def trace(frame, event, _):
        nonlocal count
        file = Path(frame.f_code.co_filename)
        if "consilience" not in file.parts or file.name == "factorisation.py":
            return None
        count += event == "line"
        return trace

    sys.settrace(trace)
    TREE_KERNELS[route](tree, model, 0.0, y, np.zeros(0), ws, a)
    sys.settrace(None)
    return count


@functools.cache
def line_counts(closed):
    """Return the lines of both routes for 4, 8, 12 and 16 links, counted in a process without the compiler."""
    program = (
        f"import test_recursive as t; make = t.closed_chain if {closed} else lambda n: t.chain(*['universal'] * n)\n"
        "for n in (4, 8, 12, 16): print(*(t.lines_of(route, make(n)) for route in t.TREE_KERNELS))"
    )
    here = Path(__file__).parent
    path = os.pathsep.join([str(here), str(here.parent), os.environ.get("PYTHONPATH", "")])
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": path}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    return np.array([[int(x) for x in line.split()] for line in done.stdout.split("\n") if line]).T


@pytest.mark.parametrize("closed", [False, True], ids=["open", "closed"])
def test_articulated_bodies_cost_as_much_for_every_link(closed):
    """Second differences over the number of links are zero for articulated bodies, positive for composite bodies."""
    articulated, composite = line_counts(closed)
    assert np.all(np.diff(articulated) > 1000)
    assert np.all(np.diff(articulated, 2) == 0)
    assert np.all(np.diff(composite, 2) > 1000)
