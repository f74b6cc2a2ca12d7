"""Mutation testing of the harness: known errors are planted in the adapters, one at a time, and judged as in a run.

`common_mutants` are planted in every adapter; an adapter brings more in a module ``mutants`` beside its engine, written
with the names of this package. `table` joins both, `campaign` judges every mutant by the comparisons of the suite,
`report` writes down what was caught, missed, and alarmed about for nothing. The results stand in docs/detection.md.
"""

# mypy: implicit-reexport

from consilience.audit.mutate import outputs, preconditions
from consilience.audit.mutate.mutants import FINE, FRACTION, MOTION, WHOLE, Mutant, decades
from consilience.audit.mutate.mutated import Planting, changed
from consilience.audit.mutate.seams import (
    Proxy,
    first_order_step,
    inside,
    on_result,
    replaced,
    with_settings,
    wrapped,
)
