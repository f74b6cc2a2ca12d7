"""Exudyn: the implicit solvers integrate ObjectGenericODE1 with order one, for the first step starts with x' = 0.

x' = -x from x = 1: x(1) = 1/e. The rule for first-order coordinates is the trapezoidal one, of order two. It takes the
slope at the start of a step from the step before; for the first step nobody computes it, and it is zero. Second route:
the trapezoidal rule by hand with a first slope of zero gives Exudyn's numbers to rounding, and with a first slope of
-1, which Exudyn takes by SetODE1Coordinates_t, both have order two. ExplicitMidpoint has order two in any case.
"""

import os
import sys

os.environ["EXUDYN_NO_USER_SETTINGS"] = "1"

import exudyn as exu
import exudyn.itemInterface as ii  # noqa: N813 - Exudyn's own usual name
import numpy as np

exu.config.printToConsole = False
STEPS = (20, 40, 80)


def solve(solver, steps, slope=None):
    """Value after a second, with the first slope given or left to Exudyn."""
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    node = mbs.AddNode(
        ii.NodeGenericODE1(referenceCoordinates=[0.0], initialCoordinates=[1.0], numberOfODE1Coordinates=1)
    )
    mbs.AddObject(ii.ObjectGenericODE1(nodeNumbers=[node], systemMatrix=[[-1.0]]))
    mbs.Assemble()
    if slope is not None:
        mbs.systemData.SetODE1Coordinates_t([slope], exu.ConfigurationType.Initial)
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.timeIntegration.endTime = 1.0
    settings.timeIntegration.numberOfSteps = steps
    settings.timeIntegration.automaticStepSize = False
    settings.timeIntegration.newton.relativeTolerance = 1e-12
    settings.timeIntegration.newton.absoluteTolerance = 1e-14
    mbs.SolveDynamic(settings, solverType=getattr(exu.DynamicSolverType, solver))
    return float(mbs.systemData.GetODE1Coordinates()[0])


def by_hand(steps, slope):
    """The trapezoidal rule with a given slope at the start."""
    x, h = 1.0, 1.0 / steps
    for _ in range(steps):
        x = (x + 0.5 * h * slope) / (1.0 + 0.5 * h)
        slope = -x
    return x


print(f"exudyn {exu.__version__}: errors of x(1) at {STEPS} steps, order, distance from the rule by hand")
orders, distances = {}, []
for solver in ("GeneralizedAlpha", "TrapezoidalIndex2", "ExplicitMidpoint"):
    for slope in (None, -1.0):
        values = np.array([solve(solver, steps, slope) for steps in STEPS])
        errors = np.abs(values - np.exp(-1.0))
        orders[solver, slope] = np.log2(errors[1] / errors[2])
        text = f"{solver:17s} slope {slope!s:5s}  {' '.join(f'{e:.2e}' for e in errors)}  {orders[solver, slope]:.2f}"
        if solver != "ExplicitMidpoint":
            distances.append(np.max(np.abs(values - [by_hand(steps, slope or 0.0) for steps in STEPS])))
            text += f"  {distances[-1]:.0e}"
        print(text)
found = [orders[solver, None] for solver in ("GeneralizedAlpha", "TrapezoidalIndex2")]
rest = [order for key, order in orders.items() if key[1] or key[0] == "ExplicitMidpoint"]
shown = np.allclose(found, 1.0, atol=0.05) and np.allclose(rest, 2.0, atol=0.05) and max(distances) < 1e-11
print("the first step starts with a slope of zero" if shown else "the first step has its slope")
sys.exit(0 if shown else 1)
