"""Columns of the two tables that the sweeps along the tree read and write.

All numbers of a link stand in one row, those of a direction in another: a compiled kernel pays for each array that it
is given, not for what is in it, and finds the numbers of a link side by side in memory. Matrices stand column by
column. Whole numbers are stored as floats.

The columns are numbers of NumPy: a kernel is compiled anew for each Python number that is written out where it is
called, by name or not.
"""

from __future__ import annotations

import numpy as np

PARENT, REVOLUTE, SENSE, COORDINATE, N_TRANSLATIONS, N_ROTATIONS, FIRST, LAST = np.arange(8)
"""Columns of a link: its parent (-1: the ground, whose row is the last one), whether it turns about a single axis and
does nothing else, +1 or -1 where the tree passes the joint from successor to predecessor, first coordinate, number of
displacements, of directions about (3: a ball), first free direction and the one behind the last."""

INBOARD_FRAME, ARM_PARENT, ARM, MASS, INERTIA, AXES, CONSTANTS_END = np.array([8, 17, 20, 23, 24, 30, 39])
"""Constants of a link, whose axes are those of the joint frame on it: axes of the joint frame on the parent and the arm
to it from the parent's centre of mass, in axes of the parent; the arm from the centre of mass to the joint frame, mass,
inertia (xx, xy, xz, yy, yz, zz) and the axes of the body, in its own."""

GRAVITY = INBOARD_FRAME
"""In the row of the ground gravity stands where the others have NEAR, and at COORDINATE their number."""

X, POSITION, VELOCITY, SPIN = np.array([40, 49, 52, 55])
"""Of a link that is placed, in the world: its axes, centre of mass, its velocity, angular velocity."""

VELOCITY_PRODUCT, OFFSET, ARTICULATED, BIAS, ACCELERATION, LINK_WIDTH = np.array([58, 64, 67, 88, 94, 104])
"""Accelerations that are quadratic in velocities, way from the parent's centre of mass, articulated inertia (upper
triangle of M, H row by row, upper triangle of J: `inertia`), articulated bias, acceleration; number of columns."""

AXIS, PIVOT, S, U, JOINT_FORCE, INVERSE_ROOT, FREE_WIDTH = np.array([0, 1, 2, 8, 14, 15, 16])
"""Columns of a direction: number of its axis (0 to 2 of F, 3 to 5 of M), D, S, U, remaining joint force, and
``1 / sqrt(D)`` where loops are closed."""
