"""Descriptor form: arrays of bodies, constraint rows, applied forces, canonical states and their projection."""
