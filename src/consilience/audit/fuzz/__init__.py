"""Differential fuzzing: all engines on random mechanisms; each disagreement is shrunk and kept as a case file."""
