"""Loads, actuators of springs, friction and control, as actuators of MuJoCo.

A force of an actuator is ``gain * input + bias``; the input is a control, or the integral of one. Controls are signals:
functions of time, and of the length and velocity of what the actuator pulls at. MuJoCo asks for them at every stage
of a step (`callback`), so that none is held over it and none lags behind.

===================  =================  ==========================  =================  ================================
element              pulls at           control                     input              bias
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
from consilience_mujoco.places import add_point, axis_link, link_name

Value = Callable[[float, float, float], float]
"""Control from time, length and velocity."""


@dataclass(frozen=True, eq=False)
class Signal:
    """Control of the actuator of a name."""

    name: str
    value: Value


def in_time(function: Function) -> Value:
    """Control that is a function of time."""
    jet = jet_of(function)
    return lambda t, _, __: jet(t)[0]


def load_name(load: Load) -> str:
    """Name of the actuator, and of the site, that stand for a load."""
    return f"load {load.name}"


def load_wrench(load: Load) -> Array:
    """Force, then torque, of a load, shape (6,), in the axes in which it is constant, for a factor of one."""
    return np.concatenate([load.vector, np.zeros(3)] if load.kind == "force" else [np.zeros(3), load.vector])


def _add_load(spec: Any, mechanism: Mechanism, tree: Tree, load: Load) -> list[Signal]:
    """Add an actuator at a site: its `gear` is the wrench, in the axes of the reference site."""
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
    return [Signal(name, in_time(load.history))]


def _add_spring(spec: Any, mechanism: Mechanism, tree: Tree, spring: Spring) -> list[Signal]:
    """Add a tendon between two sites; a positive force of an actuator makes it longer."""
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
    return [Signal(name, in_time(spring.actuator))]


def _add_on_joint(spec: Any, mechanism: Mechanism, tree: Tree, element: Any, name: str, gain: float = 1.0) -> Any:
    """Add an actuator on the coordinate of an element, in the direction in which the mechanism counts it."""
    link, sign = axis_link(mechanism, tree, element.joint, element.coordinate)
    target = link_name(tree, link)
    actuator = spec.add_actuator(name=name, target=target, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.gear[0], actuator.gainprm[0] = sign, gain
    return actuator


def _add_joint_spring(spec: Any, mechanism: Mechanism, tree: Tree, spring: JointSpring) -> list[Signal]:
    if spring.actuator is None:
        return []
    _add_on_joint(spec, mechanism, tree, spring, f"joint spring {spring.name}")
    return [Signal(f"joint spring {spring.name}", in_time(spring.actuator))]


def _add_friction(spec: Any, mechanism: Mechanism, tree: Tree, friction: Friction) -> list[Signal]:
    if friction.coulomb == 0.0:
        return []
    name, force, speed = f"friction {friction.name}", friction.coulomb, friction.speed
    _add_on_joint(spec, mechanism, tree, friction, name)
    return [Signal(name, lambda _, __, rate: friction_law(rate, 0.0, force, speed)[0])]


def _add_control(spec: Any, mechanism: Mechanism, tree: Tree, control: Control) -> list[Signal]:
    name, target = f"control {control.name}", jet_of(control.target)
    P, D = control.proportional, control.derivative
    servo = _add_on_joint(spec, mechanism, tree, control, name)
    servo.biastype, servo.biasprm[1:3] = mujoco.mjtBias.mjBIAS_AFFINE, [-P, -D]

    def wanted(t: float, _: float, __: float) -> float:
        value, rate, _bend = target(t)
        return P * value + D * rate

    signals = [Signal(name, wanted)]
    if control.integral != 0.0:
        memory = _add_on_joint(spec, mechanism, tree, control, f"integral of {name}", control.integral)
        memory.dyntype = mujoco.mjtDyn.mjDYN_INTEGRATOR
        signals.append(Signal(f"integral of {name}", lambda t, q, _: target(t)[0] - q))
    return signals


_ADD: dict[str, Callable[[Any, Mechanism, Tree, Any], list[Signal]]] = {
    "springs": _add_spring,
    "loads": _add_load,
    "joint_springs": _add_joint_spring,
    "frictions": _add_friction,
    "controls": _add_control,
}


def add_forces(spec: Any, mechanism: Mechanism, tree: Tree) -> tuple[Signal, ...]:
    """Add every force element of a mechanism but what the joints of MuJoCo have of their own; what they must be told.

    Stiffness and damping of joint springs, and viscous friction, are those of the joints (`translate`).
    """
    signals: list[Signal] = []
    for group, add in _ADD.items():
        for element in getattr(mechanism, group):
            signals += add(spec, mechanism, tree, element)
    return tuple(signals)
