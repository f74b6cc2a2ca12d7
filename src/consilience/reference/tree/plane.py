"""Columns of the tables that kernels of a plane read and write, as `columns` are those of space, and what they read."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.reference.kernel.functions import Functions
from consilience.reference.tree import records

PARENT, SENSE, ROTATION_SENSE, FIRST, LAST, ARM_PARENT, ARM, MASS, INERTIA = np.array([0, 1, 2, 3, 4, 5, 7, 9, 10])
"""Constants of a link: its parent (-1: the ground, whose row is the last one), +1 or -1 where the tree passes the joint
from successor to predecessor, sense of its angle about n (0: it does not turn), first free direction and the one behind
the last, arms to the joint frame M from the parent's centre of mass and its own, mass, moment of inertia."""

COS, SIN, POSITION, VELOCITY, SPIN, VELOCITY_PRODUCT, OFFSET = np.array([11, 12, 13, 15, 17, 18, 20])
"""Of a link that is placed: how it is turned, its centre of mass, its velocity, angular velocity, accelerations that
are quadratic in velocities, way from the parent's centre of mass."""

ARTICULATED, BIAS, ACCELERATION, WEIGHT, PLANAR_WIDTH = np.array([22, 28, 31, 34, 36])
"""Articulated inertia (xx, xy, yy, x and y with the angle, moment), bias, acceleration; the weight, which is constant;
number of columns."""

PIVOT, S, U, DIRECTION = records.PIVOT, records.S, records.U, records.S + 3
JOINT_FORCE, INVERSE_ROOT, FREE_WIDTH = records.JOINT_FORCE, records.INVERSE_ROOT, records.FREE_WIDTH
"""Columns of a direction, as in `columns`: D, S and U of three numbers, and the axis of a displacement."""

AXIS_DISPLACEMENT, AXIS_PRODUCT, ROD_LENGTH, JOINT_ANGLE = range(4)
"""Kinds of forms: displacement along an axis of i; product of an axis of i and one of j; distance; angle of a joint."""

KIND, LINK_I, LINK_J, ARM_I, ARM_J, AXIS_I, AXIS_J, TARGET, ANGLE_INDEX, ANGLE_SENSE, ROW_WIDTH = np.array(
    [0, 1, 2, 3, 5, 7, 9, 11, 12, 13, 14]
)
"""Of a form: kind, links, arms from their centres of mass, axes (for a rod the first of AXIS_J is the distance along
n), what is taken off its value, number of an angle in z, and its sense about n."""

SPRING, LOAD, JOINT_SPRING, FRICTION, CONTROL = range(5)
"""Kinds of efforts."""

FORCE_KIND, FORCE_I, FORCE_J, FUNCTION, LAW, FORCE_ARM_I, FORCE_ARM_J, NORMAL_DISTANCE, BODY_FIXED, FORCE_WIDTH = (
    np.array([0, 1, 2, 3, 4, 7, 9, 11, 12, 13])
)
"""Of an effort: kind; links of a spring (of a load the second one), or form of a coordinate and number of an integral
in z; function of time (-1: none); constants of its law (of a load force and torque); arms; distance along n of the ends
of a spring; whether a load turns with its body."""


class PlanarArrays(NamedTuple):
    """What planar kernels read beside the tables of links and directions; n_f forms, q of them and more are rows."""

    body: Array  # (n_b, 20) body, distance from the plane, axes of the body in e_1, e_2, n at zero; e_1, e_2, n
    row_table: Array  # (n_f, FORM_WIDTH) rows of joints, then joint coordinates that elements read
    driven: Array  # (m, 3) rows of drives and couplings: form, form of the driver (-1: time), function
    force_table: Array  # (n_e, EFFORT_WIDTH)
    functions: Functions
