"""Mutants of the mechanism and of its states: what goes into an engine, and how an adapter translates it."""

from __future__ import annotations

from consilience.audit.mutate import inputs, needs, outputs, seams_maximal, seams_minimal
from consilience.audit.mutate.mutated import changed
from consilience.audit.mutate.seams import inside, lower_triangle
from consilience.audit.mutate.traps import WHOLE, Mutant, decades
from consilience.engine import Question

M, I = Question.MODEL, Question.INSTANT

EVERY = ("synthetic", "exudyn", "pinocchio", "mujoco", "dart")
ADAPTERS = EVERY[1:]

_FRACTION = "of the whole error"
_FINE = (1.0, 1e-4, 1e-8, 1e-10, 1e-11, 1e-12)
_RAD = "rad"

_BODIES = (
    Mutant(1, "armature, MuJoCo", "dof_armature: this part of the diagonal of the mass matrix", ("mujoco",),
           decades(-1, -13), "of the inertia", I, seams_minimal.armature_mujoco),
    Mutant(1, "armature, Pinocchio", "Model.armature: this part of the diagonal of the mass matrix", ("pinocchio",),
           decades(-1, -13), "of the inertia", I, seams_minimal.armature_pinocchio),
    Mutant(2, "hidden dampers", "a damper on every joint axis", EVERY, _FINE, "N m s",
           I, changed(mechanism=inputs.damping_hidden), needs.axis),
    Mutant(2, "dof_damping", "dof_damping: this part of the diagonal of the mass matrix", ("mujoco",),
           decades(0, -14, 2), "1/s", I, seams_minimal.damping_mujoco),
    Mutant(2, "dof_frictionloss", "dry friction in every velocity", ("mujoco",), decades(0, -12, 2), "N m",
           I, seams_minimal.friction_mujoco,
           remark="at any magnitude the rows of friction are counted as constraints"),
    Mutant(2, "implicit damping", "the skeleton keeps a time step, over which springs and dampers are implicit",
           ("dart",), (1e-1, 1e-2, 1e-3, *decades(-4, -14, 2)), "s", I, seams_minimal.implicit_damping, needs.damper),
    Mutant(3, "inertia about the origin", "tensors about B where those about the centre of mass belong", EVERY, _FINE,
           _FRACTION, M, changed(mechanism=inputs.inertia_about_origin)),
    Mutant(3, "inertia rotated", "tensors turned in their bodies", EVERY, _FINE, _RAD,
           M, changed(mechanism=inputs.inertia_rotated)),
    Mutant(3, "products of inertia dropped", "products scaled by one minus the magnitude", EVERY, _FINE, _FRACTION,
           M, changed(mechanism=inputs.products_dropped)),
    Mutant(3, "centre of mass lost", "centres of mass moved towards the origins", EVERY, _FINE, _FRACTION,
           M, changed(mechanism=inputs.centre_of_mass_lost)),
    Mutant(3, "principal axes dropped", "orientation of the principal axes lost, as MuJoCo does without a position",
           ("mujoco",), _FINE, _FRACTION, M, seams_minimal.principal_axes_dropped),
    Mutant(3, "inertia about the centre", "ObjectRigidBody takes the tensor about its origin", ("exudyn",), _FINE,
           _FRACTION, M, seams_maximal.inertia_about_centre),
    Mutant(3, "order of the products", "xy and yz exchanged in the vector of six", ("exudyn",), _FINE, _FRACTION,
           M, seams_maximal.products_order),
    Mutant(4, "mass of a geometry", "a sphere of density 1000 about each origin, this part of the body's mass", EVERY,
           _FINE, "of the mass", M, changed(mechanism=inputs.geometry_masses)),
    Mutant(4, "inertiafromgeom", "inertia from a sphere of density 1000 and the body's mass", ("mujoco",), WHOLE, "",
           M, seams_minimal.geometry_mujoco),
    Mutant(4, "default mass of massless links", "they keep this part of DART's mass 1 and inertia 1", ("dart",),
           _FINE, "kg, kg m^2", M, seams_minimal.default_inertia, needs.massless_link),
    Mutant(5, "contacts on", "a sphere on each body touches one on the ground in the drawing", ("mujoco",),
           decades(-1, -9, 2), "m deep", I, seams_minimal.contacts_on,
           remark="only mechanisms asked about in their drawing touch: the shipped cases' first states"),
)  # fmt: skip

_STATES = (
    Mutant(6, "conjugate quaternion", "R_BW where R_WB belongs", EVERY, WHOLE, "",
           M, changed(states=inputs.quaternion_conjugate)),
    Mutant(6, "scalar last", "(e0, e1, e2, e3) read as (x, y, z, w)", EVERY, WHOLE, "",
           M, changed(states=inputs.quaternion_scalar_last)),
    Mutant(6, "scalar first", "quaternions of balls in the wrong order", ("pinocchio",), WHOLE, "",
           M, seams_minimal.scalar_first, needs.kind("spherical", "rod", "point_on_line", "point_in_plane")),
    Mutant(6, "orientations turned", "orientations of all bodies off by a rotation", EVERY, _FINE, _RAD,
           M, changed(states=inputs.orientations_turned)),
    Mutant(6, "joint frames turned", "frames M turned in their bodies", EVERY, _FINE, _RAD,
           I, changed(mechanism=inputs.frames_turned)),
    Mutant(6, "joint frames transposed", "components taken from the body to the frame and not back", EVERY, WHOLE, "",
           I, changed(mechanism=inputs.frames_transposed)),
    Mutant(6, "other sign", "-q in place of q: the same rotation", EVERY, WHOLE, "",
           M, changed(states=inputs.quaternion_other_sign), harmless=True),
    Mutant(7, "angular velocity in body axes", "w_WB_B where w_WB_W belongs", EVERY, _FINE, _FRACTION,
           I, changed(states=inputs.angular_velocity_in_body)),
    Mutant(7, "velocity in body axes", "v_WB_B where v_WB_W belongs", EVERY, _FINE, _FRACTION,
           I, changed(states=inputs.velocity_in_body)),
    Mutant(7, "velocity of the centre of mass", "where that of the origin belongs", EVERY, _FINE, _FRACTION,
           I, changed(states=inputs.velocity_of_centre)),
    Mutant(7, "order of the twist", "angular and linear velocity exchanged", EVERY, _FINE, _FRACTION,
           I, changed(states=inputs.twist_order)),
    Mutant(7, "free joint, MuJoCo", "qvel of a free joint: angular part in world axes", ("mujoco",), _FINE, _FRACTION,
           I, seams_minimal.free_twist_mujoco, needs.kind("free")),
    Mutant(7, "free joint, DART", "linear part where the angular one belongs", ("dart",), _FINE, _FRACTION,
           I, seams_minimal.free_twist_dart, needs.kind("free")),
    Mutant(7, "free joint, Pinocchio", "linear velocity in axes of the parent", ("pinocchio",), _FINE, _FRACTION,
           I, seams_minimal.free_twist_pinocchio, needs.kind("free")),
    Mutant(9, "continuous joints", "hinges by cosine and sine, which have drifted off the circle", ("pinocchio",),
           decades(-1, -15, 2), "of the radius", I, seams_minimal.continuous_joints, needs.hinges_without_springs),
    Mutant(14, "stale poses", "poses of a moment earlier with the velocities of now", EVERY, _FINE, "s",
           M, changed(states=inputs.poses_stale)),
    Mutant(23, "other branch", "the mechanism assembled the other way round", EVERY, WHOLE, "",
           M, changed(states=inputs.branch_flipped), needs.branch),
)  # fmt: skip

_FORCES = (
    Mutant(11, "load in other axes", "loads of the world in body axes, and the other way round", EVERY, _FINE,
           _FRACTION, I, changed(mechanism=inputs.loads_in_other_axes), needs.load),
    Mutant(11, "load at the origin", "forces moved towards the origins of the bodies", EVERY, _FINE, _FRACTION,
           I, changed(mechanism=inputs.loads_at_the_origin), needs.force),
    Mutant(25, "gravity too large", "by a fraction; 9.80665 for 9.81 is 3.4e-4", EVERY,
           (1e-2, 3.4e-4, 1e-8, 1e-10, 1e-11, 1e-12), "of gravity",
           I, changed(mechanism=inputs.gravity_scaled)),
    Mutant(25, "gravity turned", "from its direction", EVERY, _FINE, _RAD,
           I, changed(mechanism=inputs.gravity_turned)),
    Mutant(25, "gravity by default", "9.81 m/s^2 along -z whatever the case says", EVERY, WHOLE, "",
           I, changed(mechanism=inputs.gravity_default), needs.random),
    Mutant(25, "gravity compensated", "body_gravcomp: this part of the weight", ("mujoco",), _FINE, "of the weight",
           I, seams_minimal.gravity_compensation),
)  # fmt: skip

_CONSTRAINTS = (
    Mutant(10, "lower triangle", "mass matrix without its lower triangle, or with a smaller one", ADAPTERS,
           _FINE, _FRACTION, I, inside(("@solve", "solve_constrained", lower_triangle))),
    Mutant(18, "anchors of another pose", "closing joints hold what met where every body was moved a little", EVERY,
           _FINE, "m, rad", I, changed(mechanism=inputs.anchors_elsewhere), needs.loop),
    Mutant(16, "error reduction left on", "DART's class keeps an error reduction from another run", ("dart",),
           (1.0, 1e-1, 1e-2, *decades(-3, -13, 2)), "a step", I, seams_minimal.error_reduction_left, needs.loop,
           methods="World.step"),
    Mutant(16, "force mixing left on", "DART's class keeps a force mixing from another run", ("dart",),
           decades(-1, -13, 2), "1/(kg s)", I, seams_minimal.force_mixing_left, needs.loop, methods="World.step"),
    Mutant(17, "soft welds", "regularisation at the clamped impedance: this factor on body_invweight0", ("mujoco",),
           decades(0, -12, 2), "of the default", I, seams_minimal.setting("body_invweight0, factor", float),
           needs.loop, methods="mj_forward"),
    Mutant(17, "impedance", "solimp: this much below one", ("mujoco",), (0.1, 1e-2, 1e-3, 2e-4), "",
           I, seams_minimal.setting("eq_solimp", lambda e: [1.0 - e, 1.0 - e, 0.001, 0.5, 2.0]), needs.loop,
           methods="mj_forward", remark="softness is this over one, times body_invweight0, which the adapter scales"),
    Mutant(19, "Baumgarte, Pinocchio", "corrector gains Kp, and Kd = 2 sqrt(Kp)", ("pinocchio",),
           decades(10, 0, 2), "1/s^2", I, seams_minimal.baumgarte, needs.loop, methods="constraintDynamics",
           remark="the states are assembled to 1e-13: the terms act on nothing, and change nothing that can be seen"),
    Mutant(19, "Baumgarte, MuJoCo", "solref: stiffness, and the damping that goes with it", ("mujoco",),
           decades(10, 0, 2), "1/s^2", I,
           seams_minimal.setting("eq_solref", lambda e: [-e, -2.0 * e**0.5]), needs.loop, methods="mj_forward",
           remark="as above"),
    Mutant(20, "one proximal iteration", "constraintDynamics regularised by this and stopped after one iteration",
           ("pinocchio",), (*decades(-2, -14, 2), 0.0), "mu", I, seams_minimal.proximal, needs.loop,
           methods="constraintDynamics", remark="at 0, the default, dependent rows give values that are not numbers"),
    Mutant(20, "undetermined reactions", "other values where equilibrium leaves the reactions open", EVERY, (1e3,), "N",
           I, changed(instant=outputs.undetermined_reactions), needs.redundant, harmless=True),
    Mutant(20, "freedom by count", "dependent rows counted twice", EVERY, WHOLE, "",
           M, changed(model=outputs.freedom_off)),
    Mutant(22, "joint ignored", "the joint that closes the first loop holds nothing", EVERY, WHOLE, "",
           M, changed(mechanism=inputs.joint_ignored), needs.springless_loop),
    Mutant(22, "constraints ignored", "this part of the accelerations without any joint", EVERY, _FINE, _FRACTION,
           I, changed(instant=outputs.constraints_half_ignored), needs.held),
    Mutant(22, "welds off", "equality constraints switched off", ("mujoco",), WHOLE, "",
           M, seams_minimal.welds_ignored, needs.loop),
    Mutant(26, "solver stopped early", "opt.iterations: one over the magnitude", ("mujoco",),
           (1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01), "", I,
           seams_minimal.setting("opt.iterations", lambda e: round(1.0 / e)), needs.loop, methods="mj_forward"),
    Mutant(26, "solver tolerance", "opt.tolerance; 1e-8 is the default", ("mujoco",), decades(0, -24, 4), "",
           I, seams_minimal.setting("opt.tolerance", float), needs.loop, methods="mj_forward"),
    Mutant(26, "sparse Jacobian", "opt.jacobian: sparse", ("mujoco",), WHOLE, "",
           I, seams_minimal.setting("opt.jacobian", lambda e: "SPARSE"), needs.only_joints, methods="mj_forward",
           harmless=True),
    Mutant(26, "warm start", "on, as it is by default: an instant depends on the one before", ("mujoco",), WHOLE, "",
           I, seams_minimal.without_flag("WARMSTART"), needs.loop, methods="mj_forward"),
    Mutant(26, "islands", "on, as they are by default", ("mujoco",), WHOLE, "",
           I, seams_minimal.without_flag("ISLAND"), methods="mj_forward", harmless=True),
)  # fmt: skip

MODELS = (*_BODIES, *_STATES, *_FORCES, *_CONSTRAINTS)
