"""How much of what can go wrong in an adapter the harness would notice: known errors, planted one at a time.

`table` says what is planted where, `campaign` judges every mutant by the
comparisons of the suite, `report` writes down what was caught, missed, and alarmed about for
nothing. The rule and the results stand in docs/detection.md.
"""
