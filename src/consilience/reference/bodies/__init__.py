"""Descriptor form: arrays of all bodies, constraint rows, applied forces, canonical states and their projection."""
