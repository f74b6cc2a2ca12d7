"""Mutants of every adapter: errors at the public seam of an engine, in requests (`inputs`) and answers (`outputs`).

`table` adds the mutants of each adapter's own module ``mutants``.
"""

from __future__ import annotations

from consilience.audit.mutate import elements, inputs, outputs, preconditions
from consilience.audit.mutate.mutants import FINE, FRACTION, MOTION, WHOLE, Mutant, Precondition
from consilience.audit.mutate.mutated import Planting, changed
from consilience.audit.mutate.seams import lower_triangle
from consilience.engine import Question

M, I, T = Question.MODEL, Question.INSTANT, Question.TRAJECTORY


def of_elements(kind: str, *fields: str) -> tuple[Planting, Precondition]:
    """Return the error that loses a part of fields of a kind of elements, and what it acts on."""
    return changed(mechanism=elements.lost(kind, *fields)), elements.given(kind, *fields)


COMMON = (
    # the mechanism and its states
    Mutant(2, "hidden dampers", "a damper on every joint axis", FINE, "N m s", I,
           changed(mechanism=inputs.damping_hidden), preconditions.axis),
    Mutant(3, "inertia about the origin", "tensors about B where those about the centre of mass belong", FINE, FRACTION,
           M, changed(mechanism=inputs.inertia_about_origin)),
    Mutant(3, "inertia rotated", "tensors turned in their bodies", FINE, "rad", M,
           changed(mechanism=inputs.inertia_rotated)),
    Mutant(3, "products of inertia dropped", "products scaled by one minus the magnitude", FINE, FRACTION, M,
           changed(mechanism=inputs.products_dropped)),
    Mutant(3, "centre of mass lost", "centres of mass moved towards the origins", FINE, FRACTION, M,
           changed(mechanism=inputs.centre_of_mass_lost)),
    Mutant(4, "mass of a geometry", "a sphere of density 1000 about each origin, this part of the body's mass", FINE,
           "of the mass", M, changed(mechanism=inputs.geometry_masses)),
    Mutant(6, "conjugate quaternion", "R_BW where R_WB belongs", WHOLE, "", M,
           changed(states=inputs.quaternion_conjugate)),
    Mutant(6, "scalar last", "(e0, e1, e2, e3) read as (x, y, z, w)", WHOLE, "", M,
           changed(states=inputs.quaternion_scalar_last)),
    Mutant(6, "orientations turned", "orientations of all bodies off by a rotation", FINE, "rad", M,
           changed(states=inputs.orientations_turned)),
    Mutant(6, "joint frames turned", "frames M turned in their bodies", FINE, "rad", I,
           changed(mechanism=inputs.frames_turned)),
    Mutant(6, "joint frames transposed", "components taken from the body to the frame and not back", WHOLE, "", I,
           changed(mechanism=inputs.frames_transposed)),
    Mutant(6, "other sign", "-q in place of q: the same rotation", WHOLE, "", M,
           changed(states=inputs.quaternion_other_sign), harmless=True),
    Mutant(7, "angular velocity in body axes", "w_WB_B where w_WB_W belongs", FINE, FRACTION, I,
           changed(states=inputs.angular_velocity_in_body)),
    Mutant(7, "velocity in body axes", "v_WB_B where v_WB_W belongs", FINE, FRACTION, I,
           changed(states=inputs.velocity_in_body)),
    Mutant(7, "velocity of the centre of mass", "where that of the origin belongs", FINE, FRACTION, I,
           changed(states=inputs.velocity_of_centre)),
    Mutant(7, "order of the twist", "angular and linear velocity exchanged", FINE, FRACTION, I,
           changed(states=inputs.twist_order)),
    Mutant(14, "stale poses", "poses of a moment earlier with the velocities of now", FINE, "s", M,
           changed(states=inputs.poses_stale)),
    Mutant(23, "other branch", "the mechanism assembled the other way round", WHOLE, "", M,
           changed(states=inputs.branch_flipped), preconditions.branch),
    Mutant(11, "load in other axes", "loads of the world in body axes, and the other way round", FINE, FRACTION, I,
           changed(mechanism=inputs.loads_in_other_axes), preconditions.load),
    Mutant(11, "load at the origin", "forces moved towards the origins of the bodies", FINE, FRACTION, I,
           changed(mechanism=inputs.loads_at_the_origin), preconditions.force),
    Mutant(29, "higher coefficients lost", "of the square and the cube, of springs and dampers in joints", FINE,
           FRACTION, I, *of_elements("joint_springs", "higher_stiffness", "higher_damping")),
    Mutant(29, "rest of a spring lost", "the joint coordinate without a force", FINE, FRACTION, I,
           *of_elements("joint_springs", "rest")),
    Mutant(29, "free length lost", "of springs between points", FINE, FRACTION, I,
           *of_elements("springs", "free_length")),
    Mutant(29, "damping lost", "of springs between points", FINE, FRACTION, I, *of_elements("springs", "damping")),
    Mutant(29, "actuator lost", "of springs between points", FINE, FRACTION, I, *of_elements("springs", "actuator")),
    Mutant(29, "Coulomb friction lost", "in joints", FINE, FRACTION, I, *of_elements("frictions", "coulomb")),
    Mutant(29, "gain lost", "of the deviation, of controllers", FINE, FRACTION, I,
           *of_elements("controls", "proportional")),
    Mutant(29, "drive too slow", "the prescribed motion, by a fraction", FINE, FRACTION, I,
           *of_elements("drives", "motion")),
    Mutant(29, "ratio of a coupling", "too small by a fraction", FINE, FRACTION, I, *of_elements("couplings", "law")),
    Mutant(25, "gravity too large", "by a fraction; 9.80665 for 9.81 is 3.4e-4",
           (1e-2, 3.4e-4, 1e-8, 1e-10, 1e-11, 1e-12), "of gravity", I, changed(mechanism=inputs.gravity_scaled)),
    Mutant(25, "gravity turned", "from its direction", FINE, "rad", I, changed(mechanism=inputs.gravity_turned)),
    Mutant(25, "gravity by default", "9.81 m/s^2 along -z whatever the case says", WHOLE, "", I,
           changed(mechanism=inputs.gravity_default), preconditions.random),
    Mutant(10, "lower triangle", "mass matrix without its lower triangle, or with a smaller one", FINE, FRACTION, I,
           lower_triangle, solver=True),
    Mutant(18, "anchors of another pose", "closing joints hold what met where every body was moved a little", FINE,
           "m, rad", I, changed(mechanism=inputs.anchors_elsewhere), preconditions.loop),
    Mutant(20, "undetermined reactions", "other values where equilibrium leaves the reactions open", (1e3,), "N", I,
           changed(instant=outputs.undetermined_reactions), preconditions.redundant, harmless=True),
    Mutant(20, "freedom by count", "dependent rows counted twice", WHOLE, "", M, changed(model=outputs.freedom_off)),
    Mutant(22, "joint ignored", "the joint that closes the first loop holds nothing", WHOLE, "", M,
           changed(mechanism=inputs.joint_ignored), preconditions.springless_loop),
    Mutant(22, "constraints ignored", "this part of the accelerations without any joint", FINE, FRACTION, I,
           changed(instant=outputs.constraints_half_ignored), preconditions.held),
    # accelerations, reactions, form of the answer
    Mutant(8, "spatial acceleration", "a - w x v where the rate of v belongs", FINE, FRACTION, I,
           changed(instant=outputs.acceleration_spatial)),
    Mutant(8, "acceleration of the centre of mass", "where that of the origin belongs", FINE, FRACTION, I,
           changed(instant=outputs.acceleration_of_centre)),
    Mutant(12, "sign of one reaction", "that of the first joint is on its predecessor", FINE, FRACTION, I,
           changed(instant=outputs.reaction_sign), preconditions.held),
    Mutant(12, "reactions in world axes", "where axes of F belong", FINE, FRACTION, I,
           changed(instant=outputs.reactions_in_world), preconditions.held),
    Mutant(12, "reactions about the centre of mass", "of the successor, where M belongs", FINE, FRACTION, I,
           changed(instant=outputs.reactions_about_centre), preconditions.held),
    Mutant(13, "reactions cleared", "a part of them lost after the first state", FINE, FRACTION, I,
           changed(instant=outputs.reactions_cleared), preconditions.held),
    Mutant(13, "loads cleared", "a part of them lost after the first state", FINE, FRACTION, I,
           changed(instant=outputs.loads_cleared), preconditions.load),
    Mutant(15, "end of the step", "accelerations and reactions of the end of a step of this length", FINE, "s", I,
           changed(instant=outputs.answer_of_step_end)),
    Mutant(27, "name gone", "the adapter calls what the engine no longer has", WHOLE, "", I,
           changed(instant=outputs.name_gone)),
    Mutant(27, "array transposed", "accelerations come back the other way round", WHOLE, "", I,
           changed(instant=outputs.array_transposed)),
    # motions: integrators, steps, samples
    Mutant(2, "hidden dampers, motion", "a damper on every joint axis", MOTION, "N m s", T,
           changed(mechanism=inputs.damping_hidden), preconditions.axis),
    Mutant(6, "conjugate quaternion, motion", "R_BW where R_WB belongs", WHOLE, "", T,
           changed(motion=outputs.motion_conjugate)),
    Mutant(6, "other sign, motion", "-q in place of q: the same rotation", WHOLE, "", T,
           changed(motion=outputs.motion_other_sign), harmless=True),
    Mutant(7, "velocities in body axes, motion", "of every sample", MOTION, FRACTION, T,
           changed(motion=outputs.motion_velocities_in_body)),
    Mutant(14, "stale samples", "poses of a moment earlier with the velocities of now", MOTION, "s", T,
           changed(motion=outputs.motion_late)),
    Mutant(25, "gravity too large, motion", "by a fraction", (3.4e-4, 1e-7, 1e-9), "of gravity", T,
           changed(mechanism=inputs.gravity_scaled)),
)  # fmt: skip
