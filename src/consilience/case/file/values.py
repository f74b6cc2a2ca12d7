"""Values that many tables of a case file share: numbers, names, orientations and functions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    Strict,
    WithJsonSchema,
    model_validator,
)

from consilience.errors import visible
from consilience.mechanism import (
    Array,
    Function,
    Table,
    rotation_from_bryant_xyz,
    rotation_from_euler_zxz,
    rotation_from_quaternion,
    rotation_from_three_points,
)

TomlTable = dict[str, Any]
"""A table of a case file: numbers, texts, lists and tables by name."""

LARGEST = 1e30
"""Largest magnitude of a number: its fourth power, the highest in mechanics, is still finite."""


def _printable(text: str) -> str:
    if visible(text) != text:
        raise ValueError("it holds control characters; give plain text")
    return text


_FINITE = {"type": "number", "minimum": -LARGEST, "maximum": LARGEST}
"""JSON Schema of `Finite`."""

Finite = Annotated[float, Strict(), Field(ge=-LARGEST, le=LARGEST, allow_inf_nan=False)]
Positive = Annotated[float, Strict(), Field(gt=0, le=LARGEST, allow_inf_nan=False)]
Triple = Annotated[list[Finite], Field(min_length=3, max_length=3)]
Powers = Annotated[
    list[Finite],
    Field(min_length=1, max_length=3),
    BeforeValidator(lambda given: given if isinstance(given, list) else [given]),
    WithJsonSchema({"anyOf": [_FINITE, {"type": "array", "items": _FINITE, "minItems": 1, "maxItems": 3}]}),
]
"""A number, or a list of it and the coefficients of the square and of the cube."""
Quaternion = Annotated[list[Finite], Field(min_length=4, max_length=4)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", max_length=64)]
Text = Annotated[str, Field(max_length=20_000), AfterValidator(_printable)]


class TableModel(BaseModel):
    """A table without unknown fields."""

    model_config = ConfigDict(extra="forbid", strict=False, frozen=True, defer_build=True)


AxisCoordinate = Literal["angle", "distance"]


class InJoint(TableModel):
    """An element in a joint coordinate."""

    name: Name
    joint: Name
    coordinate: AxisCoordinate


class Orientation(TableModel):
    """Orientation, in exactly one of five ways."""

    quaternion: Quaternion | None = Field(
        None, description="Unit quaternion, scalar first; unit to 1e-9, the rounding of its digits is removed."
    )
    euler_zxz: Triple | None = Field(
        None, description="Euler angles (phi, theta, psi) in rad: Rz(phi) Rx(theta) Rz(psi)."
    )
    bryant_xyz: Triple | None = Field(None, description="Bryant angles (alpha, beta, gamma) in rad: Rx Ry Rz.")
    three_points: Annotated[list[Triple], Field(min_length=3, max_length=3)] | None = Field(
        None, description="Points O, P, Q in the world: origin, a point on x, a point in the xy plane."
    )
    rows: Annotated[list[Triple], Field(min_length=3, max_length=3)] | None = Field(
        None, description="Rows of the rotation matrix, orthogonal to 1e-9: all digits of a frame from elsewhere."
    )

    @model_validator(mode="before")
    @classmethod
    def _no_list(cls, given: object) -> object:
        if isinstance(given, list):
            raise ValueError(
                "a list is no orientation; give a table, { quaternion = [1.0, 0.0, 0.0, 0.0] }, "
                "or under rates an angular_velocity"
            )
        return given

    @model_validator(mode="after")
    def _exactly_one(self) -> Orientation:
        given = self._given()
        if len(given) != 1:
            raise ValueError(f"{len(given)} ways given; give exactly one of {', '.join(_ROTATIONS)}")
        norm = 1.0 if self.quaternion is None else float(np.linalg.norm(self.quaternion))
        if abs(norm - 1.0) > 1e-9:
            raise ValueError(f"the quaternion has norm {norm:.9g}; give a unit quaternion, scalar first")
        R = np.eye(3) if self.rows is None else np.array(self.rows)
        if np.max(np.abs(R @ R.T - np.eye(3))) > 1e-9 or np.linalg.det(R) < 0.0:
            raise ValueError("the rows are no rotation; give an orthogonal matrix of determinant +1")
        return self

    def _given(self) -> list[str]:
        return [way for way in _ROTATIONS if getattr(self, way) is not None]

    def matrix(self) -> Array:
        """Return the rotation matrix; raises ValueError for three points on one line."""
        (way,) = self._given()
        return _ROTATIONS[way](getattr(self, way))


_ROTATIONS: dict[str, Callable[[list[Any]], Array]] = {
    "quaternion": lambda given: rotation_from_quaternion(np.array(given) / np.linalg.norm(given)),
    "euler_zxz": rotation_from_euler_zxz,
    "bryant_xyz": rotation_from_bryant_xyz,
    "three_points": lambda given: rotation_from_three_points(*given),
    "rows": np.array,
}
"""Rotation matrix by each of the ways to give an orientation."""


class CurveTable(TableModel):
    """A smooth curve through points, a spline of degree five; it ends with them or is periodic."""

    x: Annotated[list[Finite], Field(min_length=6, max_length=10_000)] = Field(description="Increasing.")
    y: Annotated[list[Finite], Field(min_length=6, max_length=10_000)] = Field(description="As many as x.")
    periodic: Annotated[bool, Strict()] = Field(
        False, description="It repeats with the period x[-1] - x[0]; then y[-1] = y[0]."
    )

    @model_validator(mode="after")
    def _pairs(self) -> CurveTable:
        if len(self.x) != len(self.y):
            raise ValueError(f"there are {len(self.x)} values of x and {len(self.y)} of y; give as many")
        return self


class FunctionTable(TableModel):
    """Sum of ``c_k x^k``, ``a sin(w x + phi)`` and a curve; x is the time in s, or a joint coordinate."""

    polynomial: Annotated[list[Finite], Field(min_length=1, max_length=32)] | None = Field(
        None, description="Coefficients of 1, x, x^2, ..."
    )
    harmonics: Annotated[list[Triple], Field(min_length=1, max_length=1_000)] | None = Field(
        None, description="Amplitude, angular frequency and phase (rad) of each sine."
    )
    table: CurveTable | None = None

    @model_validator(mode="after")
    def _something(self) -> FunctionTable:
        if self.polynomial is None and self.harmonics is None and self.table is None:
            raise ValueError("the function is empty; give polynomial, harmonics, table, or several of them")
        return self

    def function(self) -> Function:
        """Return the function of `mechanism`; raises InvalidInput for points that no curve passes through."""
        t = self.table
        return Function(
            np.array(self.polynomial or []),
            np.array(self.harmonics or []),
            None if t is None else Table(np.array(t.x), np.array(t.y), t.periodic),
        )
