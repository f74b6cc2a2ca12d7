"""Neutral parts of a model of another format: pieces in a tree of joints, couplings, loops and springs.

Positions and axes are those of the drawing, where all joint coordinates are zero, in axes of the world; SI units. A
piece without joints is fixed to the piece that carries it. A piece without mass composes the joints on both its sides.
`Notes` collects what a case cannot keep, and what is refused because the case would be another mechanism.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from consilience.errors import InvalidInput
from consilience.mechanism import Array, Frame, Joint, Spring


@dataclass(frozen=True, eq=False)
class NativeJoint:
    """One joint of a file, between a piece and the piece that carries it.

    Attributes
    ----------
    name : str
    kind : {"R", "P", "S", "F", "planar"}
        Hinge, slide, ball, free, or planar across `axis`.
    at, axis : ndarray, shape (3,), m
        Place and unit axis in the drawing.
    stiffness, damping, rest : float
        Of a spring in the joint coordinate, SI.
    higher_stiffness, higher_damping : tuple of float
        As of `JointSpring`.
    """

    name: str
    kind: str
    at: Array
    axis: Array
    stiffness: float = 0.0
    damping: float = 0.0
    rest: float = 0.0
    higher_stiffness: tuple[float, ...] = ()
    higher_damping: tuple[float, ...] = ()

    @property
    def sprung(self) -> bool:
        """Whether the joint has a spring."""
        return any((self.stiffness, *self.higher_stiffness))

    @property
    def damped(self) -> bool:
        """Whether the joint has a damper."""
        return any((self.damping, *self.higher_damping))


@dataclass(frozen=True, eq=False)
class Piece:
    """A link or body of a file.

    Attributes
    ----------
    name : str
    carrier : str
        Name of the piece that carries this piece; empty for the ground.
    frame : Frame
        Frame of the piece in the drawing.
    motions : tuple of NativeJoint
        Joints in the order from the carrier; none for a fixed piece.
    mass : float, kg
    com : ndarray, shape (3,), m
        Centre of mass from the origin of the frame, in its axes.
    inertia : ndarray, shape (3, 3), kg m^2
        About the centre of mass, in axes of the frame.
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
    """A joint coordinate as a polynomial of a driver's, ``q = sum c_k q_driver^k``, or a constant without a driver."""

    name: str
    motion: str
    driver: str
    coefficients: tuple[float, ...]


@dataclass
class Notes:
    """Names of elements that were changed, left out or refused, by reason."""

    left_out: dict[str, list[str]] = field(default_factory=dict)
    refused: dict[str, list[str]] = field(default_factory=dict)

    def add(self, reason: str, *elements: str) -> None:
        """Note elements that the case has differently, or not at all."""
        if elements:
            self.left_out.setdefault(reason, []).extend(elements)

    def refuse(self, reason: str, *elements: str) -> None:
        """Note elements without which the case would be another mechanism."""
        self.refused.setdefault(reason, []).extend(elements)

    def check(self, where: str) -> None:
        """Raise all refusals in one error.

        Raises
        ------
        InvalidInput
            An element was refused.
        """
        if self.refused:
            what = "; ".join(f"{', '.join(elements)}: {reason}" for reason, elements in self.refused.items())
            raise InvalidInput(where, what, "Mend it in the file: nothing is repaired on the way into a case.")

    def lines(self) -> list[str]:
        """Return one line for each reason, with the elements."""
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
    laws : tuple of CoordinateLaw
    loops : tuple of Joint
        Joints that close loops: predecessor and successor are names of pieces (empty: the ground), frames are in axes
        of the pieces.
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
    """Return mass, centre of mass, and inertia about that centre of masses fixed to one another.

    ``I = sum I_i + m_i (d^2 1 - d d^T)``, d from the common centre of mass to that of the share.

    Parameters
    ----------
    shares : iterable of (float, ndarray, ndarray)
        Mass, centre of mass, and inertia about the centre of mass, in common axes.
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
