"""The rows of `consilience_exudyn.rows` in Exudyn: its rolling disc, else ObjectConnectorCoordinateVector.

The latter has user functions of its own equations. It reads the coordinates of all bodies of a row through one object
without mass or forces, an ObjectGenericODE2 on their nodes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from consilience.mechanism import GROUND, Array, Rolling
from consilience_exudyn.library import items
from consilience_exudyn.rows import DiscRow, Pose, Row

Mark = Callable[[str, Array, Array], Any]
"""Adds a rigid marker: name of the body, origin and axes of the marker in the body's frame; returns its index."""

_ONE = np.eye(3)
_WIDTH = 7

Floats = Sequence[float]
"""Coordinates as Exudyn hands them to these user functions: a list, whatever its signatures say."""


@dataclass(frozen=True, eq=False)
class Added:
    """A row, or rows, in an Exudyn system.

    Attributes
    ----------
    row : Row
    number : int
        Its place in `rows_of`.
    kept : tuple of int
        Which of its equations are held.
    index : exudyn.ObjectIndex
    """

    row: Row
    number: int
    kept: tuple[int, ...]
    index: Any


def add_rows(
    system: Any, rows: Sequence[Row], held: Sequence[Sequence[int]], node: Callable[[str], Any], mark: Mark
) -> tuple[Added, ...]:
    """Add rows to a system that is not yet assembled, but for those of which nothing is held.

    Parameters
    ----------
    held : sequence of sequence of int
        Which equations of each row are held (1) or left out (0).
    node : callable
        Node of a body.
    mark : callable
        Adds a marker.
    """
    added = []
    for number, (row, axes) in enumerate(zip(rows, held, strict=True)):
        kept = tuple(n for n, axis in enumerate(axes) if axis)
        if isinstance(row, DiscRow):
            index = _add_disc(system, row.rolling, axes, mark) if kept else None
        else:
            index = _add_row(system, row, kept, [node(name) for name in row.bodies]) if kept else None
        if kept:
            added.append(Added(row, number, kept, index))
    return tuple(added)


def _add_disc(system: Any, rolling: Rolling, axes: Sequence[int], mark: Mark) -> Any:
    return system.AddObject(
        items.ObjectJointRollingDisc(
            markerNumbers=[mark(GROUND, rolling.point, _ONE), mark(rolling.body, rolling.center, _ONE)],
            constrainedAxes=list(axes),
            discRadius=rolling.radius,
            discAxis=list(rolling.axis),
            planeNormal=list(rolling.normal),
        )
    )


def _add_row(system: Any, row: Row, kept: tuple[int, ...], nodes: Sequence[Any]) -> Any:
    size = _WIDTH * len(nodes)
    carrier = system.AddObject(items.ObjectGenericODE2(nodeNumbers=list(nodes), massMatrix=np.zeros((size, size))))
    nothing = system.AddMarker(items.MarkerNodeCoordinates(nodeNumber=system.AddNode(items.NodePointGround())))
    moved = system.AddMarker(items.MarkerObjectODE2Coordinates(objectNumber=carrier))

    known: tuple[Floats, Array] = ([], np.zeros(0))

    def jacobian_at(q: Floats) -> Array:
        """Jacobian, kept for the next call: Exudyn asks for it several times at the same coordinates."""
        nonlocal known
        if known[0] != q:
            known = (q, _coordinate_jacobian(row, q)[list(kept)])
        return known[1]

    def residual(_system: Any, t: float, _item: int, q: Floats, q_t: Floats, velocity_level: bool) -> Array:
        if velocity_level:
            return np.asarray(jacobian_at(q) @ q_t - np.array(row.rates(t))[list(kept)])
        return np.array(row.values(t, _poses(q)))[list(kept)]

    def jacobian(_system: Any, _t: float, _item: int, q: Floats, _q_t: Floats, _level: bool) -> Array:
        return jacobian_at(q)

    return system.AddObject(
        items.ObjectConnectorCoordinateVector(
            markerNumbers=[nothing, moved],
            scalingMarker0=np.zeros((len(kept), 1)),
            velocityLevel=not row.holonomic,
            constraintUserFunction=residual,
            jacobianUserFunction=jacobian,
        )
    )


def _poses(q: Floats) -> list[Pose]:
    return [_pose(q[n : n + _WIDTH]) for n in range(0, len(q), _WIDTH)]


def _pose(q: Floats) -> Pose:
    """Position, and rotation matrix of Euler parameters as they are, like Exudyn's."""
    w, x, y, z = q[3:]
    R = [
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    return Pose(np.array(q[:3]), np.array(R))


def _coordinate_jacobian(row: Row, q: Floats) -> Array:
    """Jacobian in positions and Euler parameters: ``w_W = 2 E(e) e'``, ``E = (-e_v, e_0 1 + ~e_v)``."""
    J = row.coefficients(_poses(q))
    result = np.empty((len(J), len(q)))
    for n in range(len(row.bodies)):
        first = _WIDTH * n
        w, x, y, z = q[first + 3 : first + _WIDTH]
        w, x, y, z = 2 * w, 2 * x, 2 * y, 2 * z
        E = np.array([[-x, w, -z, y], [-y, z, w, -x], [-z, -y, x, w]])
        result[:, first : first + 3] = J[:, 6 * n : 6 * n + 3]
        result[:, first + 3 : first + _WIDTH] = J[:, 6 * n + 3 : 6 * n + 6] @ E
    return result
