"""The tables of a case file for contacts, stops and dry friction, with the checks of single fields and tables."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, Strict, ValidationInfo, field_validator, model_validator

from consilience.case.file.values import Finite, InJoint, Name, Orientation, TableModel, Triple


class ConeTable(TableModel):
    """Cone of friction."""

    kind: Literal["circle", "pyramid", "box"]
    facets: Annotated[int, Strict(), Field(ge=3, le=1_000)] = Field(4, description="Of a pyramid.")
    offset: Finite = Field(0.0, description="Angle from the first tangent to a vertex of the pyramid, rad.")
    tangent: Triple | None = Field(
        None, description="First tangent in the drawing, projected; default: x of the partner, y where n is along x."
    )

    @model_validator(mode="after")
    def _of_its_kind(self) -> ConeTable:
        without = {"circle": ("facets", "offset", "tangent"), "box": ("facets", "offset"), "pyramid": ()}[self.kind]
        given = [name for name in without if name in self.model_fields_set]
        if given:
            raise ValueError(f"a {self.kind} has no {' and no '.join(given)}; remove it, or choose another kind")
        return self


class ComplianceTable(TableModel):
    """Spring and damper in the normal direction, in place of rigid shapes."""

    stiffness: Finite = Field(description="N/m.")
    damping: Finite = Field(0.0, description="N s/m.")


class ContactTable(TableModel):
    """A sphere, corner, box, capsule or rim of a body that may touch a plane of another, or two spheres."""

    name: Name
    body: Name
    partner: Name = Field("ground", description="Body that carries the plane or the other sphere.")
    at: Triple = Field(description="Centre of the sphere, box or circle; the corner; an end of the capsule; drawn, m.")
    radius: Finite = Field(0.0, description="Of the sphere, capsule or circle, m; zero for a corner.")
    to: Triple | None = Field(None, description="Capsule: centre of its other end in the drawing, m.")
    half_sizes: Triple | None = Field(None, description="Box: half of its edges, m.")
    orientation: Orientation | None = Field(None, description="Box: its axes in the drawing; default: the body's.")
    axis: Triple | None = Field(None, description="Disc: normal of its circle in the drawing.")
    point: Triple | None = Field(None, description="A point of the plane in the drawing, m.")
    normal: Triple | None = Field(None, description="Normal of the plane towards the body, in the drawing.")
    partner_at: Triple | None = Field(None, description="Centre of the other sphere in the drawing, m.")
    partner_radius: Finite | None = Field(None, description="Of the other sphere, m.")
    restitution: Finite = Field(0.0, description="Coefficient of restitution, 0 to 1.")
    rebound_threshold: Finite = Field(0.0, description="Rebounds up to this speed are none, m/s.")
    friction: Finite = Field(0.0, description="Coefficient of Coulomb's friction.")
    static_friction: Finite | None = Field(None, description="Coefficient of sticking; default: friction.")
    cone: ConeTable | None = Field(None, description="Default: Coulomb's circle.")
    associated: Annotated[bool, Strict()] = Field(
        False, description="Sliding lifts along the normal of the cone: the convex model."
    )
    impact_law: Literal["newton", "moreau", "poisson"] = "newton"
    torsional: Finite = Field(0.0, description="Bound of the moment about the normal over the normal force, m.")
    rolling: Finite = Field(0.0, description="Bound of the moment across the normal over the normal force, m.")
    compliance: ComplianceTable | None = Field(None, description="Default: rigid shapes.")

    @field_validator("cone", "compliance", mode="before")
    @classmethod
    def _table(cls, given: object, field: ValidationInfo) -> object:
        if given is None or isinstance(given, dict | TableModel):
            return given
        table = '{ kind = "circle" }' if field.field_name == "cone" else "{ stiffness = 1e4, damping = 10.0 }"
        raise ValueError(f"it is a table; give {table}, for instance")

    @model_validator(mode="after")
    def _one_pair(self) -> ContactTable:
        plane = [self.point is not None, self.normal is not None]
        sphere = [self.partner_at is not None, self.partner_radius is not None]
        if not (all(plane) and not any(sphere)) and not (all(sphere) and not any(plane)):
            raise ValueError("give point and normal of a plane, or partner_at and partner_radius of a sphere")
        own = [name for name in ("half_sizes", "to", "axis") if getattr(self, name) is not None]
        if len(own) > 1 or (own and all(sphere)):
            given = " and ".join(own if len(own) > 1 else [own[0], "partner_at"])
            raise ValueError(f"{given} make no pair; half_sizes is for a box, to for a capsule, axis for a disc")
        if (all(sphere) or "to" in own or "axis" in own) and self.radius == 0.0:
            raise ValueError("give a radius above zero: a corner hits a plane, every round shape has a radius")
        if "half_sizes" in own and self.radius != 0.0:
            raise ValueError("a box has no radius; remove it")
        if self.orientation is not None and "half_sizes" not in own:
            raise ValueError("the orientation is that of a box; give half_sizes, too")
        return self


class StopTable(InJoint):
    """Limits of a joint coordinate."""

    lower: Finite | None = Field(None, description="rad or m.")
    upper: Finite | None = Field(None, description="rad or m; at least one of the two.")
    restitution: Finite = Field(0.0, description="Coefficient of restitution, 0 to 1.")


class DryFrictionTable(InJoint):
    """Coulomb's friction in a joint, which sticks: a constant bound, or coefficient times reaction."""

    bound: Finite | None = Field(None, description="Largest effort, N m or N.")
    coefficient: Finite | None = Field(None, description="Effort over the reaction force across the axis (and radius).")
    radius: Finite | None = Field(None, description="With a coefficient about an axis: radius of the pin, m.")
