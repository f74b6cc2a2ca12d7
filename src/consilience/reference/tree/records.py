"""Records of links and free directions, in space and in a plane: one row of an array each.

Numba reads a field as ``link[k].parent``. Matrices stand column by column; a motion or wrench in space has two rows,
the linear and the angular part. The last link of an array is the ground.
"""

from __future__ import annotations

from consilience.mechanism import Array
from consilience.reference.kernel.record_type import INT, record_type

_MOTION, _MATRIX = (float, (2, 3)), (float, (3, 3))

LAYOUT = record_type(
    ("parent", INT),  # link; -1: the ground
    ("parent_body", INT),
    ("body", INT),
    ("forward", INT),  # whether the tree passes the joint from predecessor to successor
    ("coordinate", INT),  # first coordinate
    ("translations", INT),  # number of displacements
    ("rotations", INT),  # number of rotations; 3: ball
    ("free", INT),  # first free direction, and the one behind the last
    ("free_end", INT),
)
"""Place of a link in the tree."""

_TREE = (
    ("parent", INT),  # link; -1: the ground
    ("first", INT),  # first free direction of the joint to the parent, and the one behind its last
    ("last", INT),
    ("sense", float),  # +1, or -1 where the tree passes the joint from successor to predecessor
)

LINK = record_type(
    *_TREE,
    ("is_revolute", INT),
    ("coordinate", INT),  # first coordinate; of the ground, the number of coordinates
    ("translations", INT),  # number of displacements
    ("rotations", INT),  # number of rotations; 3: ball
    # constants, in axes of the link: those of the joint frame on the link
    ("inboard_axes", *_MATRIX),  # of the joint frame on the parent, in axes of the parent; of the ground, gravity first
    ("parent_arm", float, 3),  # from the centre of mass of the parent to that joint frame, in axes of the parent, m
    ("arm", float, 3),  # from the centre of mass to the joint frame, m
    ("mass", float),  # kg
    ("inertia", float, 6),  # xx, xy, xz, yy, yz, zz, kg m^2
    ("body_axes", *_MATRIX),
    # placed link, in world axes
    ("axes", *_MATRIX),
    ("position", float, 3),  # of the centre of mass
    ("velocity", float, 3),
    ("spin", float, 3),  # angular velocity
    ("velocity_product", *_MOTION),  # acceleration c quadratic in velocities
    ("offset", float, 3),  # d, from the parent's centre of mass
    # articulated inertia I^A = [M H; H^T J], bias p^A, acceleration
    ("M", float, 6),
    ("H", float, 9),
    ("J", float, 6),
    ("bias", *_MOTION),
    ("acceleration", *_MOTION),
)
"""Link of a tree in space. Symbols as in `articulated`."""

_FIRST_CONSTANT, _CONSTANTS = 8, 31
"""Number of 8-byte words before inboard_axes, each a scalar; number of floats from inboard_axes to body_axes."""


def constants_of(link: Array) -> Array:
    """Return a view of the fields of LINK that describe a mechanism in numbers, shape (..., n_b + 1, 31)."""
    return link.view(float).reshape(*link.shape, -1)[..., _FIRST_CONSTANT : _FIRST_CONSTANT + _CONSTANTS]


MOTION = record_type(("acceleration", *_MOTION))
"""Motion of a link, for a speed or an acceleration of a free direction."""

FREE = record_type(
    ("axis", INT),  # 0 to 2 of frame F, 3 to 5 of frame M
    ("pivot", float),  # D
    ("s", *_MOTION),
    ("U", *_MOTION),
    ("joint_force", float),  # remaining joint force r
    ("inverse_root", float),  # 1 / sqrt(D), where loops are closed
)
"""Free direction of a tree in space. Symbols as in `articulated`."""

CUT_JOINT = record_type(
    ("i", INT),  # links of predecessor and successor; -1: the ground
    ("j", INT),
    ("first_row", INT),  # first constraint row, and the one behind the last
    ("last_row", INT),
    ("pitch", float),  # m/rad
    ("arm_i", float, 3),  # from the centres of mass to the joint frames, in axes of the links, m
    ("arm_j", float, 3),
    ("axes_i", *_MATRIX),  # of the joint frames, in axes of the links
    ("axes_j", *_MATRIX),
)
"""Joint that closes loops, in space."""

PLANAR_LINK = record_type(
    *_TREE,
    ("rotation_sense", float),  # sense of the joint angle about the normal; 0: no rotation
    # constants
    ("parent_arm", float, 2),
    ("arm", float, 2),
    ("mass", float),
    ("inertia", float),
    ("weight", float, 2),
    # placed link
    ("turn", float, 2),  # cosine and sine of the angle
    ("position", float, 2),
    ("velocity", float, 2),
    ("spin", float),
    ("velocity_product", float, 2),
    ("offset", float, 2),
    ("articulated", float, 6),  # xx, xy, yy, x and y with the angle, moment
    ("bias", float, 3),
    ("acceleration", float, 3),
)
"""Link of a tree in a plane, in the axes e_1, e_2, n of `planar_detection`; fields as in LINK."""

PLANAR_FREE = record_type(
    ("direction", float, 2),  # axis of a displacement
    ("pivot", float),
    ("s", float, 3),
    ("U", float, 3),
    ("joint_force", float),
    ("inverse_root", float),
)
"""Free direction of a tree in a plane; fields as in FREE."""

AXIS_DISPLACEMENT, AXIS_PRODUCT, ROD_LENGTH, JOINT_ANGLE = range(4)
"""Kinds of rows: displacement along an axis of i; product of an axis of i and one of j; distance; joint angle."""

PLANAR_ROW = record_type(
    ("kind", INT),
    ("i", INT),  # links
    ("j", INT),
    ("arm_i", float, 2),  # from their centres of mass
    ("arm_j", float, 2),
    ("axis_i", float, 2),
    ("axis_j", float, 2),
    ("normal_distance", float),  # of the ends of a rod, along the normal
    ("target", float),  # value that the row holds
    ("angle_index", INT),  # index of a joint angle in z, and its sense about the normal
    ("angle_sense", float),
)
"""Constraint row, or joint coordinate that elements read, in a plane."""

SPRING, LOAD, JOINT_SPRING, FRICTION, CONTROL = range(5)
"""Kinds of force elements."""

PLANAR_FORCE = record_type(
    ("kind", INT),
    ("i", INT),  # link of a spring; row of a joint coordinate
    ("j", INT),  # link; index of an integral in z
    ("function", INT),  # function of time; -1: none
    ("law", float, 3),  # constants of the law; of a load: force and torque
    ("higher", float, 4),  # of a joint spring: coefficients of the squares and cubes
    ("arm_i", float, 2),  # from the centres of mass
    ("arm_j", float, 2),
    ("normal_distance", float),  # of the ends of a spring, along the normal
    ("body_fixed", INT),  # whether a load turns with its body
)
"""Force element in a plane."""

DRIVEN = record_type(
    ("row", INT),  # row of the coordinate
    ("driver", INT),  # row of the coordinate that drives it; -1: time
    ("law", INT),  # function
)
"""Drive or coupling in a plane."""

GROUP = record_type(
    ("row", INT),  # first constraint row, and the one behind the last
    ("row_end", INT),
    ("path", INT),  # its part of `Loops.path`
    ("path_end", INT),
    ("own", INT),  # its part of `Loops.own_directions`
    ("own_end", INT),
    ("last_reached", INT),  # last group with entries in the front
    ("front_rows", INT),  # largest number of rows of the front
    ("front_start", INT),  # first entry of the front in `MultifrontalQR.F`
    ("vector_start", INT),  # first of its rows in `MultifrontalQR.tau` and `MultifrontalQR.x`
)
"""Group of rows that close loops: see `loop_groups`."""

FRONT = record_type(
    ("active", INT),  # number of independent rows of the group, found by a projection
    ("used", INT),  # columns of the group in the present factors
    ("start", INT),  # the first of these columns
    ("rank", INT),  # their rank
    ("carried", INT),  # rows of the front that come from the front before
    ("compressed", INT),  # reflections that only reduce the number of rows passed on
)
"""State of the factorisation of a front: see `multifrontal`."""

LARGEST_ORDER = 32
"""Highest order of a Taylor series."""

COEFFICIENTS = LARGEST_ORDER + 3
"""Number of coefficients of a series, by order."""

LINK_SERIES = record_type(*((part, float, COEFFICIENTS) for part in ("c", "s", "w", "F_x", "F_y", "P_x", "P_y")))
"""Taylor coefficients of a link: real and imaginary parts of e, w, of F, and of P (`taylor_series`)."""

ROW_SERIES = record_type(*((part, float, COEFFICIENTS) for part in ("lam", "u_x", "u_y", "d_x", "d_y", "h_x", "h_y")))
"""Taylor coefficients of a row: multiplier; of a line also the axis u, the vector d, and the force (`taylor_rows`)."""
