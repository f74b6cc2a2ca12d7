"""How much of what can go wrong in an adapter the harness would notice: known errors, planted one at a time.

`consilience.mutate.table` says what is planted where, `consilience.mutate.campaign` judges every mutant by the
comparisons of the suite, `consilience.mutate.report` writes down what was caught, missed, and alarmed about for
nothing. The rule and the results stand in docs/detection.md.
"""
