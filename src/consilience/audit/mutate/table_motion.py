"""Mutants of the motion: integrators, steps, and samples; the question is `trajectory`."""

from __future__ import annotations

from consilience.audit.mutate import inputs, needs, outputs, seams_maximal, seams_minimal
from consilience.audit.mutate.mutated import changed
from consilience.audit.mutate.seams import first_order_step, inside
from consilience.audit.mutate.table_model import EVERY
from consilience.audit.mutate.traps import WHOLE, Mutant, decades
from consilience.engine import Question

T = Question.TRAJECTORY

_FRACTION = "of the whole error"
_SOME = (1.0, 1e-4, 1e-7, 1e-9)

MOTIONS = (
    Mutant(2, "hidden dampers, motion", "a damper on every joint axis", EVERY, _SOME, "N m s",
           T, changed(mechanism=inputs.damping_hidden), needs.axis),
    Mutant(3, "KinematicTree about the origin", "inertia of links about their origin", ("exudyn",), _SOME, _FRACTION,
           T, seams_maximal.tree_inertia_about_origin, needs.tree, methods="KinematicTree"),
    Mutant(6, "conjugate quaternion, motion", "R_BW where R_WB belongs", EVERY, WHOLE, "",
           T, changed(motion=outputs.motion_conjugate)),
    Mutant(6, "other sign, motion", "-q in place of q: the same rotation", EVERY, WHOLE, "",
           T, changed(motion=outputs.motion_other_sign), harmless=True),
    Mutant(7, "velocities in body axes, motion", "of every sample", EVERY, _SOME, _FRACTION,
           T, changed(motion=outputs.motion_velocities_in_body)),
    Mutant(14, "stale samples", "poses of a moment earlier with the velocities of now", EVERY, _SOME, "s",
           T, changed(motion=outputs.motion_late)),
    Mutant(14, "fields as a step leaves them", "MuJoCo's poses without mj_kinematics", ("mujoco",), WHOLE, "",
           T, seams_minimal.stale_samples, needs.tree, unseen=True,
           remark="the poses are those of the last stage of the step: off by less as steps get shorter, with the "
           "declared order; `differs: discretisation` is what there is to say"),
    Mutant(16, "error reduction left on, motion", "DART's class keeps more of it from another run", ("dart",),
           (0.5, 0.1), "a step", T, seams_minimal.error_reduction_left, needs.loop, methods="World.step",
           harmless=True,
           remark="0.1 to 1 give one and the same motion: the error reduction is gone with the step"),
    Mutant(16, "force mixing left on, motion", "DART's class keeps a force mixing from another run", ("dart",),
           decades(0, -8, 4), "1/(kg s)", T, seams_minimal.force_mixing_left, needs.loop, methods="World.step",
           harmless=True, remark="the impulses of a step are in proportion to it, and what they lack, too"),
    Mutant(17, "soft welds, motion", "regularisation at the clamped impedance: this factor on body_invweight0",
           ("mujoco",), decades(0, -8, 2), "of the default", T,
           seams_minimal.setting("body_invweight0, factor", float), needs.loop, methods="RK4"),
    Mutant(19, "Baumgarte, motion", "corrector gains Kp, and Kd = 2 sqrt(Kp)", ("pinocchio",), (1e2, 1.0), "1/s^2",
           T, seams_minimal.baumgarte, needs.loop, harmless=True,
           remark="holds the constraints of a motion that keeps them anyhow"),
    Mutant(20, "redundant rows", "every row of every joint given to Exudyn's integrators", ("exudyn",), WHOLE, "",
           T, seams_maximal.redundant_rows, needs.redundant, methods="TrapezoidalIndex2"),
    Mutant(21, "loose Newton iteration", "its tolerances", ("exudyn",), decades(0, -10, 2), "",
           T, seams_maximal.newton_loose, methods="GeneralizedAlpha"),
    Mutant(21, "steps by default", "hundred for the whole run, whatever step was asked", ("exudyn",), WHOLE, "",
           T, seams_maximal.steps_of_default, methods="GeneralizedAlpha"),
    Mutant(21, "adaptive step", "on, as it is by default: steps are halved where Newton's iteration fails, here never",
           ("exudyn",), WHOLE, "", T, seams_maximal.adaptive_step, methods="GeneralizedAlpha", harmless=True),
    Mutant(21, "spectral radius", "one minus this; 0.9 is the default, every one is of order two", ("exudyn",),
           (0.5, 0.2), "", T, seams_maximal.spectral_radius, methods="GeneralizedAlpha", harmless=True),
    Mutant(21, "initial accelerations", "not computed: the integration starts from zero", ("exudyn",), WHOLE, "",
           T, seams_maximal.initial_accelerations, methods="GeneralizedAlpha"),
    Mutant(24, "RK4 is Euler", "opt.integrator: Euler, declared as order four", ("mujoco",), WHOLE, "",
           T, seams_minimal.setting("opt.integrator", lambda e: "EULER"), methods="RK4"),
    Mutant(24, "order two declared", "World.step is of order one", ("dart",), WHOLE, "",
           T, changed(method=outputs.order_declared(2)), methods="World.step"),
    Mutant(24, "part of Euler in RK4, Pinocchio", "this part of the step is by Euler's method", ("pinocchio",), _SOME,
           _FRACTION, T, inside(("motion", "runge_kutta_4", first_order_step))),
    Mutant(24, "part of Euler in RK4, DART", "this part of the step is by Euler's method", ("dart",), _SOME,
           _FRACTION, T, inside(("integration", "runge_kutta_4", first_order_step)), methods="RK4"),
    Mutant(25, "gravity too large, motion", "by a fraction", EVERY, (3.4e-4, 1e-7, 1e-9), "of gravity",
           T, changed(mechanism=inputs.gravity_scaled)),
)  # fmt: skip
