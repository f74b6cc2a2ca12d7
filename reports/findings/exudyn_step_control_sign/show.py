"""Exudyn: automatic step size weighs errors by signed coordinates; where they are negative, the run may never end.

x'' = -100 (x - c), once with c = 0.5 from x = 1, once with c = -0.5 from x = -1. One motion is the mirror image of the
other, and rounding to the nearest is symmetric: DOPRI5 must take the same steps and make the opposite error. With
sc = atol + rtol max(|x0|, |x1|) [Hairer, Norsett and Wanner 1993, II.4] it does. Without the moduli sc vanishes at
x = -atol / rtol, which for equal tolerances is -1, a turning point of the second motion. Second route: with
rtol = 1e-30 sc is atol for both, and the two runs are equal.
"""

import os
import sys

os.environ["EXUDYN_NO_USER_SETTINGS"] = "1"

import exudyn as exu
import exudyn.itemInterface as ii  # noqa: N813 - Exudyn's own usual name
import numpy as np

exu.config.printToConsole = False
K, C, END, LIMIT = 100.0, 0.5, 2.0, 100_000


def run(sign, atol, rtol):
    """Evaluations of the force, and the error at the end (not a number after `LIMIT` evaluations)."""
    count = 0

    def force(_mbs, _t, _item, x, _v, _k, _d, _offset):
        nonlocal count
        count += 1
        if count > LIMIT:
            raise ValueError("no end in sight")
        return [K * (x[0] - sign * C), 0.0, 0.0]

    container = exu.SystemContainer()
    mbs = container.AddSystem()
    node = mbs.AddNode(ii.NodePoint(referenceCoordinates=[0, 0, 0], initialCoordinates=[sign * 2.0 * C, 0, 0]))
    ends = [mbs.AddObject(ii.ObjectGround()), mbs.AddObject(ii.ObjectMassPoint(mass=1.0, nodeNumber=node))]
    markers = [mbs.AddMarker(ii.MarkerBodyPosition(bodyNumber=body)) for body in ends]
    mbs.AddObject(ii.ObjectConnectorCartesianSpringDamper(markerNumbers=markers, springForceUserFunction=force))
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.timeIntegration.numberOfSteps = 1
    settings.timeIntegration.endTime = END
    settings.timeIntegration.absoluteTolerance = atol
    settings.timeIntegration.relativeTolerance = rtol
    try:
        mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.DOPRI5)
    except exu.ModelError:  # what becomes of the ValueError
        return count, np.nan
    x = mbs.GetNodeOutput(node, exu.OutputVariableType.Position)[0]
    return count, x - sign * C * (1.0 + np.cos(np.sqrt(K) * END))


print(f"exudyn {exu.__version__}, DOPRI5: evaluations, and error at the end; expected: equal, and opposite")
print(" atol    rtol     x from 1 to 0 and back    x from -1 to 0 and back")
found = {}
for atol, rtol in ((1e-8, 1e-8), (1e-10, 1e-10), (1e-12, 1e-12), (1e-8, 1e-30), (1e-12, 1e-30)):
    found[atol, rtol] = right, left = run(1.0, atol, rtol), run(-1.0, atol, rtol)
    print(f"{atol:.0e}   {rtol:.0e}    {right[0]:6d}  {right[1]:9.2e}       {left[0]:7d}  {left[1]:9.2e}")
differ = all(found[t, t][0][0] < found[t, t][1][0] for t in (1e-8, 1e-10))
endless = np.isfinite(found[1e-12, 1e-12][0][1]) and np.isnan(found[1e-12, 1e-12][1][1])
mirrored = all(found[t, 1e-30][0][0] == found[t, 1e-30][1][0] for t in (1e-8, 1e-12))
print("the sign of the coordinate decides, and one run never ends" if differ and endless else "the same for both signs")
sys.exit(0 if differ and endless and mirrored else 1)
