"""The table of all mutants."""

from __future__ import annotations

from consilience.audit.mutate.table_answers import ANSWERS
from consilience.audit.mutate.table_model import MODELS
from consilience.audit.mutate.table_motion import MOTIONS
from consilience.audit.mutate.traps import Mutant

MUTANTS: dict[str, Mutant] = {mutant.name: mutant for mutant in (*MODELS, *ANSWERS, *MOTIONS)}
"""By name, in the order of what they are wrong about: mechanism and state, answer, motion."""
