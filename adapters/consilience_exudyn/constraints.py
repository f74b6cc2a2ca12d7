"""Rows of `consilience_exudyn.rows` as Exudyn's rolling disc or as ObjectConnectorCoordinateVector.

The equations of an ObjectConnectorCoordinateVector are user functions. The coordinates of all bodies of a row are read
through one object without mass or forces, an ObjectGenericODE2 on the nodes of the bodies.
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
"""Coordinates as Exudyn passes them to these user functions: a list, unlike in their signatures."""


@dataclass(frozen=True, eq=False)
class Added:
    """Row object in an Exudyn system.

    Attributes
    ----------
    row : Row
    number : int
        Place of the row in `rows_of`.
    kept : tuple of int
        Equations of the row that are held.
    index : exudyn.ObjectIndex
    """

    row: Row
    number: int
    kept: tuple[int, ...]
    index: Any


def add_rows(
    system: Any, rows: Sequence[Row], held: Sequence[Sequence[int]], node: Callable[[str], Any], mark: Mark
) -> tuple[Added, ...]:
    """Add the rows of which equations are held.

    Parameters
    ----------
    system : exudyn.MainSystem
        Not yet assembled.
    rows : sequence of Row
    held : sequence of sequence of int
        For each row, which equations are held (1) or left out (0).
    node : callable
        Returns the node of a body.
    mark : callable
        Adds a rigid marker.
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
        """Jacobian, kept for the next call: Exudyn evaluates it several times at the same coordinates."""
        nonlocal known
        if known[0] != q:
            known = (q, _coordinate_jacobian(row, q)[list(kept)])
        return known[1]

    def residual(_system: Any, t: float, _item: int, q: Floats, q_t: Floats, velocity_level: bool) -> Array:
        """User function for the equations of a row.

        Parameters
        ----------
        _system, _item
            System and number of the object; not used.
        t : float, s
        q, q_t : list of float
            Coordinates of the bodies (positions, Euler parameters) and their rates.
        velocity_level : bool
            Return rates instead of values.
        """
        if velocity_level:
            return np.asarray(jacobian_at(q) @ q_t - np.array(row.rates(t))[list(kept)])
        return np.array(row.values(t, _poses(q)))[list(kept)]

    def jacobian(_system: Any, _t: float, _item: int, q: Floats, *_: Any) -> Array:
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
    return [Pose(np.array(q[n : n + 3]), rotation(q[n + 3 : n + _WIDTH])) for n in range(0, len(q), _WIDTH)]


def rotation(quaternion: Floats) -> Array:
    """Return the rotation matrix of Euler parameters that are not normalised, as in Exudyn."""
    w, x, y, z = quaternion
    return np.array(
        [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
    )


def rate_map(quaternion: Floats) -> Array:
    """Return ``2 E(e)`` of ``w_W = 2 E(e) e'``, ``E = (-e_v, e_0 1 + ~e_v)``, shape (3, 4)."""
    w, x, y, z = (2 * component for component in quaternion)
    return np.array([[-x, w, -z, y], [-y, z, w, -x], [-z, -y, x, w]])


def _coordinate_jacobian(row: Row, q: Floats) -> Array:
    """Jacobian of a row in positions and Euler parameters of its bodies."""
    J = row.coefficients(_poses(q))
    result = np.empty((len(J), len(q)))
    for n in range(len(row.bodies)):
        first = _WIDTH * n
        result[:, first : first + 3] = J[:, 6 * n : 6 * n + 3]
        result[:, first + 3 : first + _WIDTH] = J[:, 6 * n + 3 : 6 * n + 6] @ rate_map(q[first + 3 : first + _WIDTH])
    return result
