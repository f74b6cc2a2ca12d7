"""Columns of the two tables that the sweeps along the tree read and write in space.

A row holds all numbers of a link, or of a free direction: a kernel pays for each array argument, and the numbers of a
link lie side by side in memory. Matrices stand column by column, integers as floats.

Columns are NumPy integers, because Numba compiles a kernel anew for each Python integer literal in a call.
"""

from __future__ import annotations

import numpy as np

PARENT, REVOLUTE, SENSE, COORDINATE, N_TRANSLATIONS, N_ROTATIONS, FIRST, LAST = np.arange(8)
"""Columns of a link: parent (-1: the ground, the last row), whether its joint is revolute, +1 or -1 where the tree
passes the joint from successor to predecessor, first coordinate, number of displacements, number of rotations (3:
ball), first free direction and the one behind the last.
"""

INBOARD_FRAME, ARM_PARENT, ARM, MASS, INERTIA, AXES, CONSTANTS_END = np.array([8, 17, 20, 23, 24, 30, 39])
"""Constants of a link, whose axes are those of the joint frame on it: axes of the joint frame on the parent and the arm
to it from the parent's centre of mass, in axes of the parent; the arm from the centre of mass to the joint frame, mass,
inertia (xx, xy, xz, yy, yz, zz) and the axes of the body, in axes of the link.
"""

GRAVITY = INBOARD_FRAME
"""The row of the ground holds gravity at INBOARD_FRAME, and the number of coordinates at COORDINATE."""

X, POSITION, VELOCITY, SPIN = np.array([40, 49, 52, 55])
"""Placed link, in world axes: its axes, position of the centre of mass, velocity, angular velocity."""

VELOCITY_PRODUCT, OFFSET, ARTICULATED, BIAS, ACCELERATION, LINK_WIDTH = np.array([58, 64, 67, 88, 94, 104])
"""Accelerations c quadratic in velocities, offset d from the parent's centre of mass, articulated inertia I^A (upper
triangle of M, H row by row, upper triangle of J: `inertia`), articulated bias p^A, acceleration; number of columns.
"""

AXIS, PIVOT, S, U, JOINT_FORCE, INVERSE_ROOT, FREE_WIDTH = np.array([0, 1, 2, 8, 14, 15, 16])
"""Columns of a free direction: its axis (0 to 2 of F, 3 to 5 of M), D, s, U, remaining joint force r, ``1 / sqrt(D)``
(where loops are closed); number of columns. Symbols as in `articulated`.
"""
