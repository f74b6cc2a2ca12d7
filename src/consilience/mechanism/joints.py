"""The joint table: which basic constraints each kind of joint holds, and which coordinates stay free.

Frame F is fixed to the predecessor, frame M to the successor. Basic constraints are functions of the pose of M relative
to F (`joint_rows`): components X, Y, Z of the vector from F to M in axes of F, its length L, and the direction cosines
D_kl of axis k of F and axis l of M.
"""

from __future__ import annotations

from dataclasses import dataclass

BASIC_CONSTRAINTS = ("X", "Y", "Z", "L", "D11", "D12", "D13", "D21", "D22", "D23", "D31", "D32", "D33")
"""Names of the thirteen basic constraints between two joint coordinate systems [MASS (9)-(12)]."""


@dataclass(frozen=True)
class JointKind:
    """One row of the joint table.

    Attributes
    ----------
    rows : tuple of str
        Basic constraints, held at their values where F and M coincide (L of the rod: at the rod's length).
    coordinates : tuple of str
        Scalar joint coordinates of M relative to F, in the order in which the motion is composed from F to M.
    """

    rows: tuple[str, ...]
    coordinates: tuple[str, ...]

    @property
    def freedom(self) -> int:
        """Number of degrees of freedom the joint leaves."""
        return 6 - len(self.rows)


JOINT_KINDS: dict[str, JointKind] = {
    "revolute": JointKind(("X", "Y", "Z", "D13", "D23"), ("angle",)),
    "prismatic": JointKind(("X", "Y", "D13", "D23", "D12"), ("distance",)),
    "cylindrical": JointKind(("X", "Y", "D13", "D23"), ("distance", "angle")),
    "universal": JointKind(("X", "Y", "Z", "D31"), ("angle1", "angle2")),
    "spherical": JointKind(("X", "Y", "Z"), ("orientation",)),
    "planar": JointKind(("Z", "D13", "D23"), ("x", "y", "angle")),
    "rigid": JointKind(("X", "Y", "Z", "D12", "D13", "D23"), ()),
    "rod": JointKind(("L",), ()),
    "free": JointKind((), ("position", "orientation")),
    "screw": JointKind(("X", "Y", "D13", "D23", "H"), ("angle",)),
    "point_on_line": JointKind(("X", "Y"), ("distance", "orientation")),
    "point_in_plane": JointKind(("Z",), ("x", "y", "orientation")),
    "parallel_axes": JointKind(("D13", "D23"), ("position", "angle")),
}
"""The joint table of docs/formulations.md. Axis of a joint, line, normal of a plane: z of F; universal: z of F, then x
of M. The origin of M is the point on the line or in the plane. Row H of the screw: ``Z - pitch angle / 2 pi``, the
angle counted over full turns."""

AXIS_COORDINATES: dict[str, tuple[str, ...]] = {
    "revolute": ("angle",),
    "prismatic": ("distance",),
    "cylindrical": ("distance", "angle"),
    "screw": ("angle",),
}
"""Coordinates about or along the one axis of a joint: what springs, drives and couplings may refer to."""
