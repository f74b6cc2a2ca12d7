"""Differential fuzzing: random mechanisms on all engines; what shows a disagreement is shrunk and kept as a case."""
