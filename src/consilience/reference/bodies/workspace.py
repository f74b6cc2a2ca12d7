"""Arrays that the kernels write into, allocated once per call from Python."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.reference.bodies.arrays import Model, all_rows
from consilience.reference.kernel.mechanism_record import record_of


class Workspace(NamedTuple):
    """Scratch arrays for n_b bodies and q constraint rows; `external` alone is input."""

    A: Array  # (n_b, 3, 3) rotation matrices
    f: Array  # (6 n_b,) generalised forces
    external: Array  # (6 n_b,) forces from outside the model, added to f
    value: Array  # (q,) violation; scratch after that
    rate: Array  # (q,) nu of Q v = nu
    Q: Array  # (q, 6 n_b)
    gamma: Array  # (q,)
    B: Array  # (6 n_b, q) L^-1 Q^T and its factors
    tau: Array  # (min(6 n_b, q),)
    pivot: Array  # (q,)
    limit: Array  # (1,) most rows to take as independent: the rank where a projection has found it, else q
    best: Array  # (2,) largest rank that a projection has found, and the largest least pivot of that rank
    norms: Array  # (q,)
    z: Array  # (6 n_b,)


def workspace(model: Model) -> Workspace:
    """Scratch arrays of the size a model needs."""
    n, q = 6 * len(model.mass), all_rows(model)
    return record_of(
        Workspace(
            A=np.zeros((len(model.mass), 3, 3)),
            f=np.zeros(n),
            external=np.zeros(n),
            value=np.zeros(q),
            rate=np.zeros(q),
            Q=np.zeros((q, n)),
            gamma=np.zeros(q),
            B=np.zeros((n, q)),
            tau=np.zeros(min(n, q)),
            pivot=np.zeros(q, dtype=np.int64),
            limit=np.array([q], dtype=np.int64),
            best=np.zeros(2),
            norms=np.zeros(q),
            z=np.zeros(n),
        )
    )
