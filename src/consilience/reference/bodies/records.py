"""Records of joint coordinates, force elements and constraints other than joints: one row of an array each.

Numba reads a field as ``spring[n].stiffness``. Vectors are in axes of their body and start at its centre of mass; the
ground, body -1, has the world's axes and origin. A function is an index into `kernel.functions.Functions`.
"""

from __future__ import annotations

from consilience.reference.kernel.record_type import INT, record_type

LARGEST = record_type(
    ("first", INT),  # rank at the first state; zero before it
    ("rank", INT),
    ("pivot", float),  # the least pivot of a factorisation with that rank
    ("elimination_pivot", float),  # the same of an elimination
)
"""Largest rank of the constraint rows so far, and the largest value of its least pivot."""

COORDINATE = record_type(
    ("joint", INT),
    ("kind", INT),  # ANGLE or DISTANCE
)
"""Joint coordinate that elements read."""

SPRING = record_type(
    ("i", INT),  # bodies
    ("j", INT),
    ("arm_i", float, 3),
    ("arm_j", float, 3),
    ("stiffness", float),
    ("damping", float),
    ("rest", float),  # free length
    ("actuator", INT),  # function of time; -1: none
)
"""Spring and damper between two points."""

JOINT_SPRING = record_type(
    ("coordinate", INT),
    ("actuator", INT),
    ("stiffness", float),
    ("damping", float),
    ("rest", float),
    ("higher", float, 4),  # k1, k2, c1 and c2: coefficients of the squares and cubes
)
"""Spring and damper in a joint coordinate."""

FRICTION = record_type(("coordinate", INT), ("viscous", float), ("coulomb", float), ("speed", float))
"""Friction in a joint coordinate."""

CONTROL = record_type(
    ("coordinate", INT),
    ("target", INT),  # function of time
    ("proportional", float),
    ("integral", float),
    ("derivative", float),
)
"""PID controller of a joint coordinate."""

LOAD = record_type(
    ("body", INT),
    ("is_torque", INT),
    ("on_body", INT),  # whether the vector turns with the body
    ("vector", float, 3),
    ("arm", float, 3),
    ("history", INT),  # function of time; -1: constant
)
"""Force or torque."""

DRIVE = record_type(
    ("coordinate", INT),
    ("motion", INT),  # function of time
)
"""Prescribed joint coordinate."""

COUPLING = record_type(
    ("coordinate", INT),
    ("driver", INT),  # coordinate
    ("law", INT),  # function of the driver
)
"""Joint coordinate as a function of another one."""

ROLLING = record_type(
    ("body", INT),
    ("arm", float, 3),  # centre
    ("axis", float, 3),
    ("plane", float, (3, 3)),  # normal and two directions in the plane, as rows; world axes
    ("point", float, 3),  # of the plane, world
    ("radius", float),  # of the circle about the axis
    ("rounding", float),
)
"""Body that rolls on a plane."""

SKATE = record_type(
    ("body", INT),
    ("arm", float, 3),
    ("lateral", float, 3),  # direction in which the point does not move
)
"""Point of a body that does not slip sideways."""
