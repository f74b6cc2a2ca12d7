"""Integrators of the reference solver, compiled together with the equations they integrate."""
