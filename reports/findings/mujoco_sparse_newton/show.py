"""MuJoCo 4.0.0: Newton with sparse Jacobians gives wrong accelerations on a small branched tree with two loops.

Six bodies on hinges, two `connect` equalities, default options but for `jacobian="sparse"` (the default is "auto",
which is sparse from 60 degrees of freedom). Expected: the regularised problem that MuJoCo states, M a = f + J^T lam,
J a + R lam = a_ref, solved by NumPy from MuJoCo's own M, f, J, R and a_ref. Second route: MuJoCo's dense Newton and its
sparse CG. The sparse Newton runs through all its 100 iterations and warns of nothing.
"""

import sys

import mujoco
import numpy as np

PARENT = (-1, -1, 0, -1, 1, 1)
LOOPS = ((3, 2), (4, 2))
rng = np.random.default_rng(5)
AXES, PLACES = rng.normal(size=(6, 3)), rng.uniform(-0.5, 0.5, (6, 3))


def body(i):
    """MJCF of a body and all that hangs on it."""
    axis, place = (" ".join(map(str, numbers[i])) for numbers in (AXES, PLACES))
    children = "".join(body(k) for k in range(6) if PARENT[k] == i)
    inertial = f'<inertial pos="{place}" mass="1" diaginertia="0.1 0.12 0.15"/>'
    return f'<body pos="{place}"><joint axis="{axis}"/>{inertial}<site name="{i}" pos="{place}"/>{children}</body>'


def solve(jacobian, solver):
    """Data after mj_forward."""
    bodies = "".join(body(i) for i in range(6) if PARENT[i] < 0)
    connects = "".join(f'<connect site1="{a}" site2="{b}"/>' for a, b in LOOPS)
    option = f'<option jacobian="{jacobian}" solver="{solver}"/>'
    text = f"<mujoco>{option}<worldbody>{bodies}</worldbody><equality>{connects}</equality></mujoco>"
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[:] = 0.3 * np.arange(6)
    mujoco.mj_forward(model, data)
    return model, data


model, data = solve("dense", "Newton")
M = np.zeros((6, 6))
mujoco.mj_fullM(model, data, M)
J = data.efc_J[: 6 * data.nefc].reshape(-1, 6)
KKT = np.block([[M, -J.T], [J, np.diag(data.efc_R[: data.nefc])]])
expected = np.linalg.solve(KKT, np.concatenate([data.qfrc_smooth, data.efc_aref[: data.nefc]]))[:6]
print(f"mujoco {mujoco.__version__}: accelerations, expected  {np.round(expected, 3)}")
errors = {}
for jacobian, solver in (("dense", "Newton"), ("sparse", "CG"), ("sparse", "Newton")):
    _, data = solve(jacobian, solver)
    errors[jacobian, solver] = np.max(np.abs(data.qacc - expected)) / np.max(np.abs(expected))
    print(
        f"{jacobian:6s} {solver:7s} {np.round(data.qacc, 3)}  relative error {errors[jacobian, solver]:.1e}, ", end=""
    )
    print(f"iterations {data.solver_niter[0]}, warnings {np.sum(data.warning.number)}")
shown = errors["sparse", "Newton"] > 1e-3 and max(errors["dense", "Newton"], errors["sparse", "CG"]) < 1e-6
print("wrong where it is sparse" if shown else "right")
sys.exit(0 if shown else 1)
