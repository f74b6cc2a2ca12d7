"""Modes of all rows of a layout: what is closed, pressed, held and slides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from consilience.mechanism import Array
from consilience.reference.contact.layout import RowLayout
from consilience.reference.contact.problem import FrictionMode


@dataclass(frozen=True, eq=False)
class RowModes:
    """Modes of all rows of a layout.

    Attributes
    ----------
    closed : ndarray of bool, shape (n_n,)
        Which normals are closed.
    pressed : ndarray of bool, shape (n_s,)
        Which compliant contacts carry a force.
    friction : tuple of FrictionMode or None, length n_f
        None where the load of the friction is open.
    heading : tuple of ndarray or None, length n_f
        Direction of sliding, shape (d,): that of the force while the speed is zero. Of a disc the direction follows
        the velocity.
    """

    closed: Array
    pressed: Array
    friction: tuple[FrictionMode | None, ...]
    heading: tuple[Array | None, ...]


def open_modes(layout: RowLayout) -> RowModes:
    """Return the modes in which nothing touches and no joint has friction."""
    none = (None,) * len(layout.friction)
    closed, pressed = (np.zeros(len(part), dtype=bool) for part in (layout.normals, layout.springs))
    return RowModes(closed, pressed, none, none)
