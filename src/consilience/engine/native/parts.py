"""What every format is read into: pieces that hang on one another by motions, all in the drawing.

A piece without a motion is fixed to the one that carries it. A piece without mass is a means to compose motions. What
cannot be kept goes to `Notes`; what would make another mechanism goes to `Notes.refuse`, and all of it is told at once.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from consilience.errors import InvalidInput
from consilience.mechanism import Array, Frame, Joint, Spring


@dataclass(frozen=True, eq=False)
class NativeJoint:
    """One joint of the file: what it lets a piece do relative to the one that carries it.

    Attributes
    ----------
    name : str
    kind : {"R", "P", "S", "F", "planar"}
        Hinge, slide, ball, free, or in the plane across `axis`.
    at, axis : ndarray, shape (3,), m
        Its place and its unit axis in the drawing, where its coordinate is zero.
    stiffness, damping, rest : float
        Of a spring on its coordinate, SI.
    """

    name: str
    kind: str
    at: Array
    axis: Array
    stiffness: float = 0.0
    damping: float = 0.0
    rest: float = 0.0


@dataclass(frozen=True, eq=False)
class Piece:
    """A link or body of the file.

    Attributes
    ----------
    name : str
    carrier : str
        The piece that carries it; empty for the ground.
    frame : Frame
        Its frame in the drawing.
    motions : tuple of Motion
        In the order from the carrier; none for a fixed piece.
    mass : float, kg
    com : ndarray, shape (3,), m
        Centre of mass, and
    inertia : ndarray, shape (3, 3), kg m^2
        the tensor about it, both in the axes of the frame, from its origin.
    """

    name: str
    carrier: str
    frame: Frame
    motions: tuple[NativeJoint, ...]
    mass: float
    com: Array
    inertia: Array


@dataclass(frozen=True)
class CoordinateLaw:
    """A coordinate of the file as a polynomial of another one: ``q = sum c_k q_driver^k``."""

    name: str
    motion: str
    driver: str
    coefficients: tuple[float, ...]


@dataclass
class Notes:
    """What was changed or left out, and what is in the way: reason, then the elements it holds for."""

    left_out: dict[str, list[str]] = field(default_factory=dict)
    refused: dict[str, list[str]] = field(default_factory=dict)

    def add(self, reason: str, *elements: str) -> None:
        """Note something that the case has differently, or not at all."""
        if elements:
            self.left_out.setdefault(reason, []).extend(elements)

    def refuse(self, reason: str, *elements: str) -> None:
        """Note something without which the case would be another mechanism."""
        self.refused.setdefault(reason, []).extend(elements)

    def check(self, where: str) -> None:
        """Raise all refusals as one.

        Raises
        ------
        InvalidInput
        """
        if self.refused:
            what = "; ".join(f"{', '.join(elements)}: {reason}" for reason, elements in self.refused.items())
            raise InvalidInput(where, what, "Mend it in the file: nothing is repaired on the way into a case.")

    def lines(self) -> list[str]:
        """One line for each reason, with its elements."""
        return [f"{reason}: {', '.join(elements)}" for reason, elements in self.left_out.items()]


@dataclass(frozen=True, eq=False)
class Parts:
    """A model of another format.

    Attributes
    ----------
    name : str
    gravity : ndarray, shape (3,), m/s^2
    pieces : tuple of Piece
        Carriers first.
    laws : tuple of Law
    loops : tuple of Joint
        Joints that close loops, between names of pieces (the ground has the empty name's ``ground``), with frames in
        the axes of the pieces.
    springs : tuple of Spring
        Between points of pieces, likewise.
    """

    name: str
    gravity: Array
    pieces: tuple[Piece, ...]
    laws: tuple[CoordinateLaw, ...] = ()
    loops: tuple[Joint, ...] = ()
    springs: tuple[Spring, ...] = ()


def inertia_of_several(shares: Iterable[tuple[float, Array, Array]]) -> tuple[float, Array, Array]:
    """Mass, centre of mass and the tensor about it of masses fixed to one another.

    ``I = sum I_i + m_i (d^2 1 - d d^T)``, d from the common centre of mass to that of the share.

    Parameters
    ----------
    shares : iterable of (float, ndarray, ndarray)
        Mass, centre of mass and tensor about it, in common axes.
    """
    known = list(shares)
    if len(known) == 1:
        return known[0]
    mass = sum(m for m, _, _ in known)
    if mass == 0.0:
        return 0.0, np.zeros(3), sum((tensor for _, _, tensor in known), np.zeros((3, 3)))
    com = sum((m * c for m, c, _ in known), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for m, c, tensor in known:
        d = c - com
        inertia += tensor + m * (d @ d * np.eye(3) - np.outer(d, d))
    return mass, com, inertia
