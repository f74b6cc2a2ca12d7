"""Groups of rows that do not act on one another: each is decided by itself."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from consilience.reference.contact.problem import ContactProblem, Modes

_APART = 1e-13
"""Entries of G below this, relative to the scales of their rows, are rounding."""


@dataclass(frozen=True, eq=False)
class RowGroup:
    """Rows of a contact problem that act on one another, and their problem.

    Attributes
    ----------
    problem : ContactProblem
    rows, normals, sets : list of int
        Indices into the rows, `normals` and `friction` of the whole problem.
    """

    problem: ContactProblem
    rows: list[int]
    normals: list[int]
    sets: list[int]

    def modes(self, whole: Modes) -> Modes:
        """Return the part of modes of the whole problem."""
        return Modes(whole.closed[self.normals], tuple(whole.friction[j] for j in self.sets))


def groups(problem: ContactProblem) -> tuple[RowGroup, ...]:
    """Return the groups of a contact problem, in the order of their first rows."""
    whole = RowGroup(problem, *(list(range(len(part))) for part in (problem.free, problem.normals, problem.friction)))
    if len(problem.normals) + sum(f.load is None for f in problem.friction) < 2:
        return (whole,)
    m, weight = len(problem.free), problem.row_scale()
    linked = np.abs(problem.delassus) > _APART * np.outer(weight, weight)
    linked |= np.eye(m, dtype=bool)
    for f in problem.friction:
        own = [*f.rows, *(() if f.load is None else (f.load,))]
        linked[np.ix_(own, own)] = True
    label = np.arange(m)
    for _ in range(m):  # the least label travels along the links
        spread = np.min(np.where(linked, label, m), axis=1)
        if np.array_equal(spread, label):
            break
        label = spread
    if not np.any(label):
        return (whole,)
    return tuple(_group(problem, np.flatnonzero(label == one)) for one in dict.fromkeys(label.tolist()))


def _group(problem: ContactProblem, rows: np.ndarray) -> RowGroup:
    at = {int(row): k for k, row in enumerate(rows)}
    normals = [i for i, row in enumerate(problem.normals) if row in at]
    sets = [j for j, f in enumerate(problem.friction) if f.rows[0] in at]
    friction = tuple(
        replace(f, rows=tuple(at[row] for row in f.rows), load=None if f.load is None else at[f.load])
        for f in (problem.friction[j] for j in sets)
    )
    part = ContactProblem(
        problem.delassus[np.ix_(rows, rows)],
        problem.free[rows],
        tuple(problem.names[row] for row in rows),
        tuple(at[problem.normals[i]] for i in normals),
        friction,
        None if problem.sliding is None else problem.sliding[rows],
        problem.row_scale()[rows],
        problem.size,
    )
    return RowGroup(part, list(at), normals, sets)
