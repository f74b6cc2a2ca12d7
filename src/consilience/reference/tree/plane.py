"""Columns of the tables in a plane (see `records` for space), and the arrays that planar kernels read beside them.

Vectors are in the axes e_1, e_2, n of `planar_detection`; n is the normal.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.reference.kernel.functions import Functions
from consilience.reference.tree import records

PARENT, SENSE, ROTATION_SENSE, FIRST, LAST, ARM_PARENT, ARM, MASS, INERTIA = np.array([0, 1, 2, 3, 4, 5, 7, 9, 10])
"""Constants of a link: parent (-1: the ground, the last row), +1 or -1 where the tree passes the joint from successor
to predecessor, sense of the joint angle about n (0: no rotation), first free direction and the one behind the last,
arms to the joint frame M from the parent's centre of mass and from its own, mass, moment of inertia.
"""

COS, SIN, POSITION, VELOCITY, SPIN, VELOCITY_PRODUCT, OFFSET = np.array([11, 12, 13, 15, 17, 18, 20])
"""Placed link: cosine and sine of its angle, position of the centre of mass, velocity, angular velocity, accelerations
quadratic in velocities, offset from the parent's centre of mass.
"""

ARTICULATED, BIAS, ACCELERATION, WEIGHT, PLANAR_WIDTH = np.array([22, 28, 31, 34, 36])
"""Articulated inertia (xx, xy, yy, x and y with the angle, moment), bias, acceleration, weight (constant); number of
columns.
"""

PIVOT, S, U, DIRECTION = records.PIVOT, records.S, records.U, records.S + 3
"""Columns of a free direction as in `records`, s and U with three components, and the axis of a displacement."""
JOINT_FORCE, INVERSE_ROOT, FREE_WIDTH = records.JOINT_FORCE, records.INVERSE_ROOT, records.FREE_WIDTH

AXIS_DISPLACEMENT, AXIS_PRODUCT, ROD_LENGTH, JOINT_ANGLE = range(4)
"""Kinds of rows: displacement along an axis of i; product of an axis of i and one of j; distance; joint angle."""

KIND, LINK_I, LINK_J, ARM_I, ARM_J, AXIS_I, AXIS_J, TARGET, ANGLE_INDEX, ANGLE_SENSE, ROW_WIDTH = np.array(
    [0, 1, 2, 3, 5, 7, 9, 11, 12, 13, 14]
)
"""Columns of a row: kind, links, arms from their centres of mass, axes (of a rod the first entry of AXIS_J is the
distance along n), target value, index of an angle in z, its sense about n.
"""

SPRING, LOAD, JOINT_SPRING, FRICTION, CONTROL = range(5)
"""Kinds of force elements."""

FORCE_KIND, FORCE_I, FORCE_J, FUNCTION, LAW, FORCE_ARM_I, FORCE_ARM_J, NORMAL_DISTANCE, BODY_FIXED, FORCE_WIDTH = (
    np.array([0, 1, 2, 3, 4, 7, 9, 11, 12, 13])
)
"""Columns of a force element: kind; links of a spring (of a load only the second), or row of the joint coordinate and
index of an integral in z; function of time (-1: none); constants of its law (of a load: force and torque); arms;
distance of the ends of a spring along n; whether a load turns with its body.
"""


class PlanarArrays(NamedTuple):
    """Arrays that planar kernels read beside the tables of links and free directions."""

    body: Array  # (n_b, 20) body, height along n, axes of the body at zero in e_1, e_2, n; e_1, e_2, n in the world
    row_table: Array  # (n_f, ROW_WIDTH) rows of joints, then joint coordinates that elements read
    driven: Array  # (m, 3) drives and couplings: row, row of the driver (-1: time), function
    force_table: Array  # (m, FORCE_WIDTH)
    functions: Functions
