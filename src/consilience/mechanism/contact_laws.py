"""Laws of contact: friction cones, compliance, restitution. Immutable data; docs/contact.md has the equations."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

from consilience.errors import InvalidInput, in_range, require
from consilience.mechanism.spatial import Array, cross, fixed_array

ConeKind = Literal["circle", "pyramid", "box"]
ImpactLaw = Literal["newton", "moreau", "poisson"]

LAWS_OF_IMPACT = ("restitution", "rebound_threshold", "impact_law")
"""Laws of rigid shapes alone: a spring and a damper have no impacts."""
ASSOCIATED_ALONE = "an associated cone is a circle, without rebound, static friction, friction moments or compliance"


def _one_of(where: str, value: object, kinds: object) -> None:
    if value not in get_args(kinds):
        raise InvalidInput(where, f"'{value}' is none", f"Use one of {', '.join(get_args(kinds))}.")


@dataclass(frozen=True)
class Cone:
    """The set of friction forces for a unit normal force and coefficient.

    Attributes
    ----------
    kind : str
        ``circle``; ``pyramid``, the polygon inscribed in the circle; ``box``, a bound for each tangent alone.
    facets : int
        Of the pyramid, at least 3.
    offset : float, rad
        Angle from the first tangent to the first vertex of the pyramid; the others follow at equal angles.
    tangent : tuple of 3 floats, or None
        Direction in axes of `partner` whose projection onto the tangent plane is the first tangent; None: its x axis,
        or its y axis where the normal is along x.
    """

    kind: ConeKind = "circle"
    facets: int = 4
    offset: float = 0.0
    tangent: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        _one_of("cone: kind", self.kind, ConeKind)
        if self.kind != "pyramid" and (self.facets != 4 or self.offset != 0.0):
            raise InvalidInput(f"cone: {self.kind}", "it has no facets and no offset", "Give these to a pyramid alone.")
        if isinstance(self.facets, bool) or not isinstance(self.facets, int) or self.facets < 3:
            raise InvalidInput("cone: facets", f"{self.facets} make no pyramid", "Give an integer of at least 3.")
        in_range("cone: offset", self.offset, -np.inf, np.inf, "Give an angle in rad.")
        if self.tangent is not None:
            direction = fixed_array(self.tangent, (3,), "cone: tangent")
            if not np.any(direction):
                raise InvalidInput("cone: tangent", "it is the zero vector", "Give a direction across the normal.")
            object.__setattr__(self, "tangent", tuple(float(x) for x in direction))

    def tangents(self, normal: Array) -> tuple[Array, Array]:
        """Return the tangents t1 and ``t2 = n x t1`` of a unit normal, each (3,), all in axes of `partner`.

        Raises
        ------
        InvalidInput
            If `tangent` is along the normal.
        """
        if self.tangent is not None:
            wanted = np.array(self.tangent)
        else:
            wanted = np.eye(3)[1 if abs(normal[0]) > 1.0 - 1e-9 else 0]
        t1 = wanted - (normal @ wanted) * normal
        length = float(np.linalg.norm(t1))
        if length <= 1e-9 * float(np.linalg.norm(wanted)):
            raise InvalidInput("cone: tangent", "it is along the normal", "Give a direction across the normal.")
        t1 = t1 / length
        return t1, cross(normal, t1)

    @property
    def vertices(self) -> Array:
        """Vertices of the polygon for ``mu N = 1`` in components along t1 and t2, shape (n, 2); none of a circle."""
        if self.kind == "box":
            return np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
        if self.kind == "circle":
            return np.zeros((0, 2))
        angles = self.offset + 2.0 * np.pi * np.arange(self.facets) / self.facets
        return np.stack([np.cos(angles), np.sin(angles)], axis=1)


@dataclass(frozen=True)
class Compliance:
    """A spring and a damper in the normal direction of a contact, in place of rigid shapes.

    Attributes
    ----------
    stiffness : float, N/m
    damping : float, N s/m
    """

    stiffness: float
    damping: float = 0.0

    def __post_init__(self) -> None:
        in_range("compliance: stiffness", self.stiffness, 0.0, np.inf, "Give a stiffness above zero, N/m.", True)
        in_range("compliance: damping", self.damping, 0.0, np.inf, "Give a damping of at least zero, N s/m.")


@dataclass(frozen=True, eq=False, kw_only=True)
class SurfaceLaw:
    """Laws of normal force, friction and impact of a contact.

    Attributes
    ----------
    restitution : float
        Coefficient e of the impact law, 0 to 1.
    rebound_threshold : float, m/s
        Rebounds ``e |u_n-|`` up to this speed are none.
    friction : float
        Coulomb's coefficient mu of sliding.
    static_friction : float or None
        Coefficient of sticking, at least `friction`; None: equal to it.
    cone : Cone
    associated : bool
        Whether the relative velocity is along the normal of the friction cone, so that sliding lifts: the convex model.
    impact_law : str
        ``newton``: ``u_n+ = -e u_n-``, with friction that never gains energy; ``moreau``: the same, with friction that
        opposes the velocity after, as a time stepper has it; ``poisson``: e is the ratio of the impulses of expansion
        and compression.
    torsional, rolling : float, m
        Bounds of the friction moments about the normal and across it, over the normal force.
    compliance : Compliance or None
        None: the shapes are rigid.
    """

    restitution: float = 0.0
    rebound_threshold: float = 0.0
    friction: float = 0.0
    static_friction: float | None = None
    cone: Cone = field(default_factory=Cone)
    associated: bool = False
    impact_law: ImpactLaw = "newton"
    torsional: float = 0.0
    rolling: float = 0.0
    compliance: Compliance | None = None

    def check_law(self, where: str) -> None:
        """Refuse numbers out of range, and parts that have no meaning together."""
        in_range(f"{where}: restitution", self.restitution, 0.0, 1.0, "Choose 0 to 1.")
        speed = "Give a speed of at least 0, in m/s."
        in_range(f"{where}: rebound_threshold", self.rebound_threshold, 0.0, np.inf, speed)
        for name in ("friction", "torsional", "rolling"):
            remedy = "Give a coefficient of at least 0." if name == "friction" else "Give a length of at least 0, in m."
            in_range(f"{where}: {name}", getattr(self, name), 0.0, np.inf, remedy)
        require(self.cone, Cone, f"{where}: cone", "Give a Cone; Cone() is Coulomb's circle.")
        _one_of(f"{where}: impact_law", self.impact_law, ImpactLaw)
        if self.static_friction is not None:
            remedy = f"Give at least the friction of sliding, {self.friction:g}, or leave it out."
            in_range(f"{where}: static_friction", self.static_friction, self.friction, np.inf, remedy)
        if self.friction == 0.0 and (self.cone.kind != "circle" or self.associated):
            what = "associated" if self.associated else f"a {self.cone.kind} cone"
            raise InvalidInput(f"{where}: friction", f"it is missing beside {what}", "Give the coefficient, above 0.")
        if self.compliance is not None:
            require(self.compliance, Compliance, f"{where}: compliance", "Give Compliance(stiffness, damping).")
            for name in LAWS_OF_IMPACT:
                if getattr(self, name) != getattr(SurfaceLaw, name):
                    what = "a spring and a damper decide how the bodies part"
                    raise InvalidInput(f"{where}: {name}", what, f"Leave out {name}, or compliance.")

    @property
    def mixes_associated(self) -> bool:
        """Whether an associated cone stands beside another law, so that the two have no equations together."""
        return self.associated and (
            self.cone.kind != "circle"
            or self.impact_law == "poisson"
            or self.compliance is not None
            or self.static_friction not in (None, self.friction)
            or max(self.restitution, self.torsional, self.rolling) > 0.0
        )


@dataclass(frozen=True, kw_only=True)
class Regularisation:
    """A spring and a damper of the acceleration of a contact: ``u' + R f = a_ref`` of a row that overlaps and pushes.

    With the overlap r and the rate u, ``a_ref = pull d(r) r - decay u`` and ``R = (1 - d(r))/d(r) inverse_mass``.

    Attributes
    ----------
    pull : float, 1/s^2
    decay : float, 1/s
    least, most : float
        Impedance d of no overlap, and of `width` and more; it rises as ``x^p / m^(p-1)`` up to the midpoint m, of the
        share x of the width, and turned by half a turn behind it. Both between zero and one.
    width : float, m
    midpoint, power : float
        m, between zero and one, and p, one at least.
    inverse_mass : float, 1/kg
    """

    pull: float
    decay: float
    least: float
    most: float
    width: float
    midpoint: float
    power: float
    inverse_mass: float

    def __post_init__(self) -> None:
        for name in ("pull", "decay", "width", "inverse_mass"):
            in_range(f"regularisation: {name}", getattr(self, name), 0.0, np.inf, "Give a number above zero.", True)
        for name in ("least", "most", "midpoint"):
            value = getattr(self, name)
            in_range(f"regularisation: {name}", value, 0.0, 1.0, "Give a number between zero and one.", True)
            if value >= 1.0:
                raise InvalidInput(f"regularisation: {name}", f"it is {value:g}", "Give a number below one.")
        in_range("regularisation: power", self.power, 1.0, np.inf, "Give a power of at least 1.")

    def impedance(self, overlap: float) -> float:
        """Return d of an overlap, m."""
        x, m, p = min(overlap / self.width, 1.0), self.midpoint, self.power
        rise = x**p / m ** (p - 1.0) if x <= m else 1.0 - (1.0 - x) ** p / (1.0 - m) ** (p - 1.0)
        return self.least + rise * (self.most - self.least)


@dataclass(frozen=True, kw_only=True)
class ContactLaw:
    """The law of contact that a method solves where it is not the law of the case; None: that of the case.

    Attributes
    ----------
    cone : Cone or None
    associated : bool or None
    compliance : Compliance or None
    rebound_threshold : float or None, m/s
    impact_law : str or None
    regularisation : tuple of Regularisation or None
        One for each elementary contact, in the order of `contact_parts`.
    """

    cone: Cone | None = None
    associated: bool | None = None
    compliance: Compliance | None = None
    rebound_threshold: float | None = None
    impact_law: ImpactLaw | None = None
    regularisation: tuple[Regularisation, ...] | None = None
