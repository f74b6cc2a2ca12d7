"""Mechanisms: bodies, joints, elements and constraints, independent of any engine; NumPy alone.

A `Mechanism` is immutable data, a `State` the poses and velocities of its bodies. Read first: `model` (what a mechanism
is), `joints` and `joint_rows` (what a joint holds), `constraints` (the equations), `assembly` (consistent states),
`elementary_tree` (the form for engines in minimal coordinates). Conventions are in docs/conventions.md.
"""

# mypy: implicit-reexport

from consilience.mechanism.applied_forces import Wrenches, applied_wrenches, conservative_part
from consilience.mechanism.assembly import (
    Initial,
    assemble_positions,
    assemble_velocities,
    displaced_states,
    drawing_state,
    initial_state,
    move,
    random_states,
)
from consilience.mechanism.conditioning import mass_matrix_condition, reaction_condition, worst_condition
from consilience.mechanism.constraints import (
    RANK_TOLERANCE,
    RelativeMotion,
    constraint_gamma,
    constraint_jacobian,
    constraint_rates,
    constraint_residual,
    free_directions,
    joint_coordinates,
    joint_rates,
    null_space,
    reaction_in_F,
    relative_motion,
)
from consilience.mechanism.contacts import Contact, PointPlane, SpherePlane, SphereSphere
from consilience.mechanism.element_rows import (
    Angles,
    ElementRow,
    count_turns,
    holonomic_rows,
    non_holonomic_rows,
    plane_axes,
    rolling_contact,
    rolling_rows,
)
from consilience.mechanism.elementary_tree import Coordinate, Link, Tree, coordinates, to_elementary_tree
from consilience.mechanism.elements import (
    Control,
    Coupling,
    Drive,
    Friction,
    JointSpring,
    Load,
    Rolling,
    Skate,
    Spring,
    friction_law,
)
from consilience.mechanism.functions import Function, Jet, Table, constant, linear, sine, through
from consilience.mechanism.joint_rows import full_turns, joint_frames, row_gamma, row_jacobian, row_target, row_value
from consilience.mechanism.joints import AXIS_COORDINATES, BASIC_CONSTRAINTS, JOINT_KINDS, JointKind
from consilience.mechanism.model import GROUND, Body, Frame, Joint, Mechanism, State, check_inertia
from consilience.mechanism.observables import (
    body_point,
    centres_of_mass,
    characteristic_length,
    determinate_reactions,
    joint_spring_coordinates,
    joint_spring_motion,
    kinetic_energies,
    kinetic_energy,
    load_potentials,
    mass_matrix,
    mass_properties,
    potential_energies,
    potential_energy,
    reaction_map,
    world_inertias,
)
from consilience.mechanism.spanning_tree import spanning_tree
from consilience.mechanism.spatial import (
    Array,
    continuous_in_time,
    cross,
    elementary_rotation,
    euler_parameter_matrix,
    orthogonal_triad,
    quaternion_from_rotation,
    quaternion_from_rotation_vector,
    quaternion_product,
    rotation_angle_between,
    rotation_from_bryant_xyz,
    rotation_from_euler_zxz,
    rotation_from_quaternion,
    rotation_from_three_points,
    rotation_vector_from_quaternion,
    rotation_with_z_axis,
    skew,
)
