"""Mutation testing of the harness: known errors are planted in the adapters, one at a time, and judged as in a run.

`common_mutants` are planted in every adapter. An adapter may have a module ``mutants`` beside its engine, written with
the names of this package. `table` joins both, `campaign` judges every mutant by the comparisons of the suite, `report`
lists what was caught, what was missed, and false alarms. docs/detection.md has the results.
"""

from consilience.audit.mutate import outputs, preconditions
from consilience.audit.mutate.contact_mutants import contact_mutants
from consilience.audit.mutate.mutants import CONTACTS, FINE, FRACTION, MOTION, WHOLE, Mutant, decades
from consilience.audit.mutate.mutated import Planting, changed
from consilience.audit.mutate.seams import Proxy, first_order_step, inside, on_result, replaced, with_settings, wrapped

__all__ = [
    "CONTACTS",
    "FINE",
    "FRACTION",
    "MOTION",
    "WHOLE",
    "Mutant",
    "Planting",
    "Proxy",
    "changed",
    "contact_mutants",
    "decades",
    "first_order_step",
    "inside",
    "on_result",
    "outputs",
    "preconditions",
    "replaced",
    "with_settings",
    "wrapped",
]
