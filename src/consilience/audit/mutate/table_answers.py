"""Mutants of the answer: accelerations, reactions, and the form of what comes back."""

from __future__ import annotations

from consilience.audit.mutate import needs, outputs, seams_minimal
from consilience.audit.mutate.mutated import changed
from consilience.audit.mutate.table_model import EVERY
from consilience.audit.mutate.traps import WHOLE, Mutant
from consilience.engine import Question

M, I = Question.MODEL, Question.INSTANT

_FRACTION = "of the whole error"
_FINE = (1.0, 1e-4, 1e-8, 1e-10, 1e-11, 1e-12)

ANSWERS = (
    Mutant(8, "spatial acceleration", "a - w x v where the rate of v belongs", EVERY, _FINE, _FRACTION,
           I, changed(instant=outputs.acceleration_spatial)),
    Mutant(8, "acceleration of the centre of mass", "where that of the origin belongs", EVERY, _FINE, _FRACTION,
           I, changed(instant=outputs.acceleration_of_centre)),
    Mutant(8, "getFrameAcceleration", "Pinocchio's spatial acceleration of the bodies", ("pinocchio",), _FINE,
           _FRACTION, I, seams_minimal.spatial_body),
    Mutant(8, "bias of welds", "Pinocchio's spatial acceleration in the rows of the harness's solve", ("pinocchio",),
           _FINE[:2], _FRACTION, I, seams_minimal.spatial_welds, needs.loop, methods="own weld rows", harmless=True,
           remark="the frames that a weld holds together move alike, w x v is the same for both: no error"),
    Mutant(12, "sign of one reaction", "that of the first joint is on its predecessor", EVERY, _FINE, _FRACTION,
           I, changed(instant=outputs.reaction_sign), needs.held),
    Mutant(12, "reactions in world axes", "where axes of F belong", EVERY, _FINE, _FRACTION,
           I, changed(instant=outputs.reactions_in_world), needs.held),
    Mutant(12, "reactions about the centre of mass", "of the successor, where M belongs", EVERY, _FINE, _FRACTION,
           I, changed(instant=outputs.reactions_about_centre), needs.held),
    Mutant(12, "sign of contact forces", "wrenches of constraintDynamics turned round", ("pinocchio",), _FINE,
           _FRACTION, I, seams_minimal.contact_force_sign, needs.loop, methods="constraintDynamics"),
    Mutant(13, "reactions cleared", "a part of them lost after the first state", EVERY, _FINE, _FRACTION,
           I, changed(instant=outputs.reactions_cleared), needs.held),
    Mutant(13, "loads cleared", "a part of them lost after the first state", EVERY, _FINE, _FRACTION,
           I, changed(instant=outputs.loads_cleared), needs.load),
    Mutant(15, "end of the step", "accelerations and reactions of the end of a step of this length", EVERY, _FINE, "s",
           I, changed(instant=outputs.answer_of_step_end)),
    Mutant(27, "name gone", "the adapter calls what the engine no longer has", EVERY, WHOLE, "",
           I, changed(instant=outputs.name_gone)),
    Mutant(27, "array transposed", "accelerations come back the other way round", EVERY, WHOLE, "",
           I, changed(instant=outputs.array_transposed)),
)  # fmt: skip
