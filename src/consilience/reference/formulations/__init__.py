"""Formulations of the equations of motion; each gives accelerations of a state, by equations of its own."""
