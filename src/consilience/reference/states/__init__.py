"""Single states of a known mechanism, compiled: assembly, and the answers at an instant."""
