"""Contact problem: rows of contacts, stops and dry joints at one instant, their laws and their modes.

The rows are relative accelerations along normals, tangents and joint coordinates (velocities, in an impact), and the
mechanism answers forces (impulses) on them linearly, with the Delassus matrix G, symmetric and positive semidefinite:

    u = free + G f.

*Normal* rows (contacts, stops) obey ``0 <= u _|_ f >= 0``. All friction is a convex set that maximises dissipation
(Moreau 1988): with the force N of a normal row, or a constant,

    T in (N + offset) mu D,      T maximises -T . u_t,

where D is an interval (one row: dry friction of a joint, drilling friction, one side of a box), the unit disc (two
rows: the circular cone, rolling friction), or a regular polygon (two rows: a pyramid). A box cone is two intervals.

For modes that are known the problem is linear: ``f = constant + S x`` and ``E u = 0``, with one column and one row
per closed normal and per held direction; columns of normals contain the friction of what slides.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from consilience.errors import InvalidInput
from consilience.mechanism import Array

ROUNDING = 1e-14
"""Error of `free` over the size of the accelerations that it is what joints leave of."""

ON_BISECTOR = 1e-9
"""A heading nearer than this to the bisector of two vertices of a pyramid, rad, slides along their facet."""


@dataclass(frozen=True, eq=False)
class FrictionMode:
    """Mode of one friction set.

    Attributes
    ----------
    drag : ndarray, shape (d,)
        Force per unit of ``N + offset`` that the sliding fixes.
    held : ndarray, shape (r, d)
        Orthonormal directions along which nothing slides: all when sticking, none when sliding, one facet between.
    reach : float
        Largest force along a facet, per unit of ``N + offset``; 0 otherwise.
    """

    drag: Array
    held: Array
    reach: float = 0.0

    @property
    def name(self) -> str:
        """Mode in words: sticking, sliding or part-sticking."""
        count, d = self.held.shape
        return "sliding" if count == 0 else "sticking" if count == d else "part-sticking"


@dataclass(frozen=True, eq=False)
class FrictionSet:
    """Friction on one or two rows.

    Attributes
    ----------
    name : str
    rows : tuple of int, length d = 1 or 2
    kinetic, static : float
        Coefficients mu of sliding and of sticking, ``static >= kinetic`` (m for friction moments; 1 for a constant
        bound).
    load : int, optional
        Normal row whose force N bounds the friction; none for dry friction with a constant bound.
    offset : float, N (N m, N s, N m s)
        Constant part of ``N + offset``.
    facets : int
        Vertices of a pyramid; 0 for a disc. Of no meaning for one row.
    angle : float, rad
        Angle of the first vertex from the first row.
    associated : bool
        Whether what slides parts, along the normal of the cone.
    """

    name: str
    rows: tuple[int, ...]
    kinetic: float
    static: float
    load: int | None = None
    offset: float = 0.0
    facets: int = 0
    angle: float = 0.0
    associated: bool = False

    @property
    def is_disc(self) -> bool:
        """Whether the unit set is a disc, so that the direction of sliding friction follows the velocity."""
        return len(self.rows) == 2 and self.facets == 0

    @cached_property
    def vertices(self) -> Array | None:
        """Vertices of the unit set D in order, shape (k, d); None for a disc."""
        if len(self.rows) == 1:
            return np.array([[1.0], [-1.0]])
        if self.facets == 0:
            return None
        angles = self.angle + 2 * np.pi / self.facets * np.arange(self.facets)
        return np.stack([np.cos(angles), np.sin(angles)], axis=1)

    def among(self, place: Mapping[int, int], normals: Collection[int], offset: float) -> FrictionSet:
        """Return the set with rows renumbered, and its offset; a load that is none of the normals is in that."""
        load = place[self.load] if self.load is not None and self.load in normals else None
        return replace(self, rows=tuple(place[row] for row in self.rows), load=load, offset=offset)

    def sticking(self) -> FrictionMode:
        """Mode in which both rows are held."""
        d = len(self.rows)
        return FrictionMode(np.zeros(d), np.eye(d))

    def sliding(self, heading: Array, on_bisector: float = ON_BISECTOR) -> FrictionMode:
        """Mode of a heading, shape (d,), of any length but zero; on the bisector of two vertices, along their facet."""
        direction = -heading / np.linalg.norm(heading)
        d, vertices = len(self.rows), self.vertices
        if vertices is None:
            return FrictionMode(self.kinetic * direction, np.zeros((0, d)))
        along = vertices @ direction
        first, second = np.argsort(-along, kind="stable")[:2]
        if d == 1 or along[first] - along[second] > on_bisector * np.linalg.norm(vertices[first] - vertices[second]):
            return FrictionMode(self.kinetic * vertices[first], np.zeros((0, d)))
        side = 0.5 * (vertices[second] - vertices[first])
        half = float(np.linalg.norm(side))
        return FrictionMode(
            0.5 * self.kinetic * (vertices[first] + vertices[second]), side[None] / half, self.kinetic * half
        )

    def along_facet(self, slip: Array, least: float) -> Array:
        """Slip, shape (d,), without its part across the bisector of two vertices where that is at most `least`, m/s."""
        vertices = self.vertices
        if vertices is None or len(self.rows) == 1:
            return slip
        first, second = np.argsort(vertices @ slip, kind="stable")[:2]
        side = (vertices[second] - vertices[first]) / np.linalg.norm(vertices[second] - vertices[first])
        across = float(side @ slip)
        return slip - across * side if abs(across) <= least else slip


@dataclass(frozen=True, eq=False)
class Modes:
    """Modes of all rows of a contact problem.

    Attributes
    ----------
    closed : ndarray of bool, shape (n,)
        Which normal rows stay closed, in the order of `ContactProblem.normals`.
    friction : tuple of FrictionMode, length n_f
        That of a friction set with an open load is its mode if it had a load; nothing is held there.
    """

    closed: Array
    friction: tuple[FrictionMode, ...]

    def opened(self, normal: int) -> Modes:
        """These modes with one normal (index into `ContactProblem.normals`) open."""
        closed = self.closed.copy()
        closed[normal] = False
        return replace(self, closed=closed)

    def with_friction(self, index: int, mode: FrictionMode) -> Modes:
        """These modes with one friction set in another mode."""
        return replace(self, friction=(*self.friction[:index], mode, *self.friction[index + 1 :]))


@dataclass(frozen=True, eq=False)
class ContactProblem:
    """Contacts, stops and dry joints that are closed at one instant.

    Attributes
    ----------
    delassus : ndarray, shape (m, m)
        G, response of the rows to forces on them.
    free : ndarray, shape (m,)
        Relative accelerations (velocities) without these forces.
    names : tuple of str, length m
        Contact, stop or joint of each row, for messages.
    normals : tuple of int, length n
        Rows that cannot be penetrated.
    friction : tuple of FrictionSet, length n_f
    sliding : ndarray, shape (m,)
        Relative velocities along the rows of friction; exactly zero where nothing slides.
    scale : ndarray, shape (m,), optional
        Square roots of the diagonal that G has without joints: what is small beside them is rounding. Of G itself if
        left out.
    size : float
        Norm in the mass metric of the accelerations (velocities) of the bodies, of which `free` may be a small rest.
    """

    delassus: Array
    free: Array
    names: tuple[str, ...]
    normals: tuple[int, ...]
    friction: tuple[FrictionSet, ...] = ()
    sliding: Array | None = None
    scale: Array | None = None
    size: float = 0.0

    def __post_init__(self) -> None:
        """Check shapes and coefficients."""
        m = len(self.free)
        if self.delassus.shape != (m, m) or len(self.names) != m:
            raise InvalidInput("ContactProblem", f"delassus or names do not fit {m} rows", "Give one name per row.")
        for one in self.friction:
            if not 0.0 <= one.kinetic <= one.static:
                raise InvalidInput(
                    one.name, "its coefficients are negative, or the static one is smaller", "mu <= mu_s."
                )
            if one.load is not None and one.load not in self.normals:
                raise InvalidInput(one.name, f"its load {one.load} is not a normal row", f"One of {self.normals}.")

    def slip(self, index: int) -> Array:
        """Sliding velocity of one friction set, shape (d,)."""
        rows = list(self.friction[index].rows)
        return np.zeros(len(rows)) if self.sliding is None else self.sliding[rows]

    def row_scale(self) -> Array:
        """Scale of each row, never zero, shape (m,), kg^-1/2 (kg^-1/2/m)."""
        return self._row_scale

    @cached_property
    def _row_scale(self) -> Array:
        scale = np.sqrt(np.maximum(np.diag(self.delassus), 0.0)) if self.scale is None else self.scale
        return np.where(scale > 0.0, scale, np.max(scale, initial=0.0) or 1.0)

    @property
    def rounding(self) -> float:
        """What rounding leaves of accelerations, over the scales of their rows."""
        return ROUNDING * self.size

    def natural_modes(self) -> Modes:
        """All normals closed; what slides slides, the rest sticks."""
        return self._natural_modes

    @cached_property
    def _natural_modes(self) -> Modes:
        slips = [self.slip(j) for j in range(len(self.friction))]
        modes = [f.sliding(u) if np.any(u) else f.sticking() for f, u in zip(self.friction, slips, strict=True)]
        return Modes(np.ones(len(self.normals), dtype=bool), tuple(modes))

    def acceleration(self, force: Array) -> Array:
        """Return ``free + G f``, shape (m,)."""
        return self.free + self.delassus @ force


def in_words(names: Iterable[str]) -> str:
    """List names once each, the parts of one contact together: contact 'floor[0, 3]', stop 'end'."""
    parts: dict[str, dict[str, str]] = {}
    for name in names:
        owner, _, part = name.partition("[")
        number, _, after = part.partition("]")
        parts.setdefault(owner, {})[number] = after
    return ", ".join(
        f"{owner}[{', '.join(found)}]{next(iter(found.values()))}" if all(found) else owner
        for owner, found in parts.items()
    )
