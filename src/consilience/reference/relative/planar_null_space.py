"""`null_space` in a plane, in three numbers."""

from __future__ import annotations

from consilience.reference.compiled import fused, kernel
from consilience.reference.relative import plane
from consilience.reference.relative.loops import CHOSEN, ROW, TOUCHED
from consilience.reference.relative.null_space import (
    add_motions,
    add_to_links,
    eliminate,
    homogeneous,
    particular,
    solve,
)
from consilience.reference.relative.planar import dot3, pair_at, put_three, three_at
from consilience.spatial import Array


@kernel
def move_planar(link: Array, free: Array, u: Array, moving: float, table: Array, at: int) -> None:
    """`move` in a plane."""
    for k in range(link.shape[0] - 1):
        a, d = three_at(table, int(link[k, plane.PARENT]), at), pair_at(link, k, plane.STEP)
        c = pair_at(link, k, plane.QUADRATIC)
        a = a[0] - a[2] * d[1] + moving * c[0], a[1] + a[2] * d[0] + moving * c[1], a[2]
        for n in range(int(link[k, plane.FIRST]), int(link[k, plane.LAST])):
            s = three_at(free, n, plane.S)
            a = a[0] + u[n] * s[0], a[1] + u[n] * s[1], a[2] + u[n] * s[2]
        put_three(table, k, at, a)


@fused
def _planar_rows_of_directions(
    group: Array,
    touched: Array,
    order: Array,
    state: Array,
    moves: Array,
    W: Array,
    target: Array,
    links: Array,
    free: Array,
    at: Array,
    J: Array,
) -> int:
    """`_rows_of_directions` in a plane."""
    rows, count, O = 0, free.shape[0], pair_at(links, 0, plane.POSITION)
    for k in range(links.shape[0] - 1):
        r = pair_at(links, k, plane.POSITION)
        for n in range(int(links[k, plane.FIRST]), int(links[k, plane.LAST])):
            s = three_at(free, n, plane.S)
            put_three(at, n, 0, (s[0] + s[2] * (r[1] - O[1]), s[1] - s[2] * (r[0] - O[0]), s[2]))
    for g in range(group.shape[0]):
        for number in range(group[g, ROW], group[g, ROW] + state[g, CHOSEN]):
            row = order[number]
            for n in range(count):
                J[rows, n] = 0.0
            J[rows, count] = target[row]
            for slot in range(TOUCHED):
                k = touched[row, slot]
                if k < 0:
                    continue
                r, x, y = pair_at(links, k, plane.POSITION), W[row, slot, 0], W[row, slot, 1]
                f = x, y, W[row, slot, 2] + (r[0] - O[0]) * y - (r[1] - O[1]) * x
                for n in range(count):
                    if moves[k, n]:
                        J[rows, n] += dot3(f, three_at(at, n, 0))
            rows += 1
    return rows


@fused
def _planar_masses(link: Array, freedoms: int, V: Array, G: Array, moving: float) -> None:
    """`_masses` in a plane."""
    for e in range(freedoms):
        for d in range(freedoms + 1):
            G[e, d] = 0.0
    for k in range(link.shape[0] - 1):
        m, I = link[k, plane.MASS], link[k, plane.INERTIA]
        a, p = three_at(link, k, plane.ACCELERATION), three_at(link, k, plane.BIAS)
        f = m * a[0] + moving * p[0], m * a[1] + moving * p[1], I * a[2] + moving * p[2]
        for e in range(freedoms):
            v = three_at(V[e], k, 0)
            x = m * v[0], m * v[1], I * v[2]
            G[e, freedoms] -= dot3(v, f)
            for d in range(e + 1):
                G[e, d] += dot3(three_at(V[d], k, 0), x)


@kernel
def solve_planar_rows(
    group: Array,
    touched: Array,
    order: Array,
    state: Array,
    moves: Array,
    W: Array,
    target: Array,
    links: Array,
    free: Array,
    at: Array,
    J: Array,
    given: Array,
    left: Array,
) -> tuple[int, int, float]:
    """Solve the rows chosen for directions in a plane; rows, directions left, least pivot."""
    rows = _planar_rows_of_directions(group, touched, order, state, moves, W, target, links, free, at, J)
    freedoms, least = eliminate(J, rows, given, left)
    return rows, freedoms, least


@kernel
def reduce_planar_links(
    J: Array,
    given: Array,
    left: Array,
    V: Array,
    G: Array,
    rows: int,
    freedoms: int,
    link: Array,
    free: Array,
    u: Array,
    moving: float,
) -> None:
    """Accelerations u, and those of the links, where the rows are solved (moving: 1).

    At rest and without forces (0), the displacements of least M-norm.
    """
    for e in range(freedoms):
        homogeneous(J, rows, given, left[e], u)
        move_planar(link, free, u, 0.0, V[e], 0)
    particular(J, rows, given, u)
    move_planar(link, free, u, moving, link, plane.ACCELERATION)
    _planar_masses(link, freedoms, V, G, moving)
    solve(G, freedoms)
    add_motions(J, rows, given, left, G, freedoms, u)
    add_to_links(link, plane.ACCELERATION, freedoms, V, G)
