"""Stops and dry friction by DART's joints: position limits, and Coulomb friction, held by `World.step`."""

from __future__ import annotations

from consilience_dart.translation import Model


def set_limits(model: Model) -> None:
    """Give DART's joints the limits of the stops and the bounds of dry friction.

    The sense of a coordinate is turned where the tree passes its joint backwards. Several on one coordinate join: the
    tightest limits, the sum of the bounds.
    """
    for stop in model.mechanism.stops:
        axis = model.axes[stop.joint, stop.coordinate]
        lower = -float("inf") if stop.lower is None else stop.lower
        upper = float("inf") if stop.upper is None else stop.upper
        if axis.sign < 0.0:
            lower, upper = -upper, -lower
        joint = axis.joint
        joint.setPositionLowerLimit(0, max(lower, joint.getPositionLowerLimit(0)))
        joint.setPositionUpperLimit(0, min(upper, joint.getPositionUpperLimit(0)))
        joint.setLimitEnforcement(True)
    for friction in model.mechanism.dry_frictions:
        joint = model.axes[friction.joint, friction.coordinate].joint
        joint.setCoulombFriction(0, joint.getCoulombFriction(0) + (friction.bound or 0.0))
