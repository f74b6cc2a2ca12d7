"""Loads, actuators of springs, friction and control as actuators of MuJoCo.

The force of an actuator is ``gain * input + bias``; the input is a control, or the integral of a control. Controls are
signals: functions of time, and of length and velocity of the target of the actuator. MuJoCo evaluates them at every
stage of a step (`callback`), so that no control is held constant over a step.

===================  =================  ==========================  =================  ================================
element              target             control                     input              bias
===================  =================  ==========================  =================  ================================
load                 site               none, or the history        control            its factor 1, without a history
spring, actuator     tendon             f(t)                        control            none
joint spring, act.   joint              f(t)                        control            none
friction, Coulomb    joint              -F tanh(q' / v)             control            none (viscous: `dof_damping`)
control, P and D     joint              P target + D target'        control            -P q - D q', of MuJoCo
control, I           joint              target - q                  its integral       none
===================  =================  ==========================  =================  ================================
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from consilience.engine import axis_link
from consilience.mechanism import (
    Array,
    Control,
    Friction,
    Function,
    JointSpring,
    Load,
    Mechanism,
    Spring,
    Tree,
    friction_law,
)
from consilience_mujoco.functions import jet_of
from consilience_mujoco.places import add_point, link_name

Value = Callable[[float, float, float], float]
"""Control from time, length and velocity."""


@dataclass(frozen=True, eq=False)
class Signal:
    """Control of the actuator of a name, and the law of the control as data for `export`."""

    name: str
    value: Value
    law: dict[str, Any]


def in_time(name: str, function: Function) -> Signal:
    """Return the signal of an actuator that is a function of time."""
    jet = jet_of(function)
    return Signal(name, lambda t, _, __: jet(t)[0], {"kind": "time", "f": function})


def load_name(load: Load) -> str:
    """Return the name of actuator and site of a load."""
    return f"load {load.name}"


def load_wrench(load: Load) -> Array:
    """Return force, then torque, of a load for a factor of one, shape (6,), in the axes in which it is constant."""
    return np.concatenate([load.vector, np.zeros(3)] if load.kind == "force" else [np.zeros(3), load.vector])


def _add_load(spec: Any, mechanism: Mechanism, tree: Tree, load: Load) -> list[Signal]:
    """Add an actuator at a site, whose `gear` is the wrench in axes of the reference site."""
    name = load_name(load)
    add_point(spec, mechanism, tree, load.body, load.point, name)
    actuator = spec.add_actuator(
        name=name,
        target=name,
        trntype=mujoco.mjtTrn.mjTRN_SITE,
        gear=load_wrench(load),
        refsite="world axes" if load.frame == "world" else "",
    )
    if load.history is None:
        actuator.gainprm[0] = 0.0
        actuator.biastype, actuator.biasprm[0] = mujoco.mjtBias.mjBIAS_AFFINE, 1.0
        return []
    actuator.gainprm[0] = 1.0
    return [in_time(name, load.history)]


def _add_spring(spec: Any, mechanism: Mechanism, tree: Tree, spring: Spring) -> list[Signal]:
    """Add a tendon between two sites; a positive force of its actuator lengthens the tendon."""
    name = f"spring {spring.name}"
    tendon = spec.add_tendon(name=name, springlength=[spring.free_length] * 2)
    tendon.stiffness[0], tendon.damping[0] = spring.stiffness, spring.damping
    ends = ((spring.predecessor, spring.point_predecessor), (spring.successor, spring.point_successor))
    for side, (body, point) in enumerate(ends):
        add_point(spec, mechanism, tree, body, point, f"{name} {side}")
        tendon.wrap_site(f"{name} {side}")
    if spring.actuator is None:
        return []
    actuator = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_TENDON)
    actuator.gainprm[0] = 1.0
    return [in_time(name, spring.actuator)]


def _add_on_joint(spec: Any, mechanism: Mechanism, tree: Tree, element: Any, name: str, gain: float = 1.0) -> Any:
    """Add an actuator on the joint coordinate of an element, with the sign of the mechanism's coordinate.

    Parameters
    ----------
    spec : mujoco.MjSpec
    mechanism : Mechanism
    tree : Tree
    element : JointSpring, Friction or Control
    name : str
        Name of the actuator.
    gain : float
    """
    link, sign = axis_link(mechanism, tree, element.joint, element.coordinate)
    target = link_name(tree, link)
    actuator = spec.add_actuator(name=name, target=target, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.gear[0], actuator.gainprm[0] = sign, gain
    return actuator


def _add_joint_spring(spec: Any, mechanism: Mechanism, tree: Tree, spring: JointSpring) -> list[Signal]:
    if spring.actuator is None:
        return []
    _add_on_joint(spec, mechanism, tree, spring, f"joint spring {spring.name}")
    return [in_time(f"joint spring {spring.name}", spring.actuator)]


def _add_friction(spec: Any, mechanism: Mechanism, tree: Tree, friction: Friction) -> list[Signal]:
    if friction.coulomb == 0.0:
        return []
    name, force, speed = f"friction {friction.name}", friction.coulomb, friction.speed
    _add_on_joint(spec, mechanism, tree, friction, name)
    law = {"kind": "coulomb", "force": force, "speed": speed}
    return [Signal(name, lambda _, __, rate: friction_law(rate, 0.0, force, speed)[0], law)]


def _add_control(spec: Any, mechanism: Mechanism, tree: Tree, control: Control) -> list[Signal]:
    name, target = f"control {control.name}", jet_of(control.target)
    P, D = control.proportional, control.derivative
    servo = _add_on_joint(spec, mechanism, tree, control, name)
    servo.biastype, servo.biasprm[1:3] = mujoco.mjtBias.mjBIAS_AFFINE, [-P, -D]

    def wanted(t: float, _: float, __: float) -> float:
        value, rate, _bend = target(t)
        return P * value + D * rate

    signals = [Signal(name, wanted, {"kind": "servo", "f": control.target, "P": P, "D": D})]
    if control.integral != 0.0:
        integral = _add_on_joint(spec, mechanism, tree, control, f"integral of {name}", control.integral)
        integral.dyntype = mujoco.mjtDyn.mjDYN_INTEGRATOR
        law = {"kind": "error", "f": control.target}
        signals.append(Signal(f"integral of {name}", lambda t, q, _: target(t)[0] - q, law))
    return signals


_ADD: dict[str, Callable[[Any, Mechanism, Tree, Any], list[Signal]]] = {
    "springs": _add_spring,
    "loads": _add_load,
    "joint_springs": _add_joint_spring,
    "frictions": _add_friction,
    "controls": _add_control,
}


def add_forces(spec: Any, mechanism: Mechanism, tree: Tree) -> tuple[Signal, ...]:
    """Add the force elements of a mechanism that are actuators or tendons, and return their signals.

    Stiffness and damping of joint springs, and viscous friction, are properties of MuJoCo's joints (`translate`).
    """
    signals: list[Signal] = []
    for group, add in _ADD.items():
        for element in getattr(mechanism, group):
            signals += add(spec, mechanism, tree, element)
    return tuple(signals)
