"""Full descriptor form with Euler parameters, index 1 [MASS (36)-(39), C4 (4.84)-(4.97)].

Newton-Euler for every body with all constraint rows of all joints,

    [ M  Q^T ] [   a   ]   [   f   ]
    [ Q   0  ] [ -lam  ] = [ gamma ],        M = diag(m 1, I'),

in the velocities (v, w'), w' in body axes: M is constant, with Cholesky factor L. MASS (38) has this in p'',

    4 G^T I' G p'' + Q_p^T lam = 2 G^T (l' - ~w' I' w'),    p.p'' = -p'.p',    Q_p = 2 Q_w' G,

which is the same system: with ``w' = 2 G p'`` and ``G G^T = 1`` its first line multiplied by G/2 is the rotational
line above, and ``p'' = 1/2 G^T dw'/dt - 1/4 (w'.w') p`` gives the second. With w' as velocities of the Euler parameters
p no multiplier for the norm of p is needed.

The constrained acceleration is the unconstrained one plus the correction of least M-norm:

    z = L^T a,   B = L^-1 Q^T,   z = L^-1 f + argmin |zeta| : B^T zeta = gamma - Q a_free,

by a rank-revealing QR of B, which leaves out dependent rows; accelerations are unique, multipliers of least norm.
"""

from __future__ import annotations

import numpy as np

from consilience.mechanism import RANK_TOLERANCE, Array
from consilience.reference.bodies import constraints, forces
from consilience.reference.bodies.arrays import Model, Workspace
from consilience.reference.bodies.mass_metric import factorise_as_projected, solve_factor, solve_factor_transposed
from consilience.reference.bodies.motion import rotations
from consilience.reference.kernel.compiled import kernel
from consilience.reference.kernel.factorisation import least_norm
from consilience.reference.kernel.vectors import assign


@kernel
def accelerations(model: Model, t: float, y: Array, turns: Array, ws: Workspace, a: Array) -> int:
    """Compute the accelerations (dv/dt, dw'/dt) of all bodies at a state.

    Parameters
    ----------
    model : Model
    t : float, s
    y : ndarray, shape (n_b + n_e, 13)
    turns : ndarray, shape (n_c,)
        Joint coordinates that elements read, at an earlier time (m, rad): full turns are counted from them.
    ws : Workspace
        Holds f, Q, gamma and the factors afterwards.
    a : ndarray, shape (6 n_b,)
        Overwritten.

    Returns
    -------
    int
        Rank of the constraints.
    """
    rotations(y, ws.A)
    forces.evaluate(model, t, y, turns, ws)
    assign(a, ws.f)
    solve_factor(model, a)
    if ws.Q.shape[0] == 0:
        solve_factor_transposed(model, a)
        return 0
    constraints.evaluate(model, t, y, turns, ws)
    rank = factorise_as_projected(model, ws)
    assign(ws.z, a)
    solve_factor_transposed(model, ws.z)
    for row in range(ws.Q.shape[0]):
        s = ws.gamma[row]
        for c in range(a.shape[0]):
            s -= ws.Q[row, c] * ws.z[c]
        ws.value[row] = s
    least_norm(ws.B, ws.tau, ws.pivot, rank, ws.value, ws.z)
    for n in range(a.shape[0]):
        a[n] += ws.z[n]
    solve_factor_transposed(model, a)
    return rank


@kernel
def _whitened(model: Model, ws: Workspace, a: Array, B: Array) -> None:
    """Write ``L^-1 Q^T`` into B and ``L^-1 (M a - f)`` into ``ws.z``."""
    for row in range(ws.Q.shape[0]):
        assign(ws.z, ws.Q[row])
        solve_factor(model, ws.z)
        assign(B[:, row], ws.z)
    for b in range(model.mass.shape[0]):
        o = 6 * b
        for k in range(3):
            ws.z[o + k] = model.mass[b] * a[o + k] - ws.f[o + k]
            ws.z[o + 3 + k] = -ws.f[o + 3 + k]
            for j in range(3):
                ws.z[o + 3 + k] += model.inertia[b, k, j] * a[o + 3 + j]
    solve_factor(model, ws.z)


def multipliers(model: Model, t: float, y: Array, turns: Array, ws: Workspace, a: Array) -> Array:
    """Compute the multipliers of least norm of ``Q^T lam = M a - f``, in the metric of B, shape (q,), and a.

    Parameters as in `accelerations`.
    """
    accelerations(model, t, y, turns, ws, a)
    if len(ws.Q) == 0:
        return np.zeros(0)
    B = np.empty(ws.B.shape)
    _whitened(model, ws, a, B)
    U, s, Vt = np.linalg.svd(B, full_matrices=False)
    independent = s > RANK_TOLERANCE * s[0]
    along = np.divide(U.T @ ws.z, s, out=np.zeros_like(s), where=independent)
    return np.asarray(Vt.T @ along)
