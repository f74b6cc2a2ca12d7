"""Oracles without a second engine: identities that the answers of every sound engine satisfy."""
