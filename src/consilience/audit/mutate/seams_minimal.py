"""Errors inside the adapters of engines in minimal coordinates: MuJoCo, DART, Pinocchio."""

from __future__ import annotations

import importlib
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from consilience.audit.mutate.seams import Proxy, inside, module, on_result, replaced, with_settings, wrapped

# ---------------------------------------------------------------- MuJoCo


def _armature_mujoco(translation: Any, magnitude: float) -> None:
    model = translation.model
    model.dof_armature[:] += magnitude * model.dof_M0


def _damping_mujoco(translation: Any, magnitude: float) -> None:
    model = translation.model
    model.dof_damping[:] += magnitude * model.dof_M0


def _friction_mujoco(translation: Any, magnitude: float) -> None:
    translation.model.dof_frictionloss[:] = magnitude


def _gravity_compensation(original: Any, magnitude: float, spec: Any, *more: Any) -> None:
    original(spec, *more)
    spec.bodies[-1].gravcomp = magnitude


armature_mujoco = inside(("", "_prepare", on_result(_armature_mujoco)))
damping_mujoco = inside(("", "_prepare", on_result(_damping_mujoco)))
friction_mujoco = inside(("", "_prepare", on_result(_friction_mujoco)))
gravity_compensation = inside(("translate", "_add_body", wrapped(_gravity_compensation)))


def _identity_axes(original: Any, magnitude: float, inertia: Any) -> Any:
    moments, quat = original(inertia)
    turned = quat + magnitude * (np.array([1.0, 0.0, 0.0, 0.0]) * np.sign(quat[0] or 1.0) - quat)
    return moments, turned / np.linalg.norm(turned)


principal_axes_dropped = inside(("translate", "principal_inertia", wrapped(_identity_axes)))


def _geometry_mujoco(original: Any, magnitude: float, spec: Any, mechanism: Any, tree: Any, chain: Any) -> None:
    """A ball of the body's mass and density 1000 on each body, and the inertia from it."""
    del magnitude
    original(spec, mechanism, tree, chain)
    body = spec.bodies[-1]
    spec.compiler.inertiafromgeom = 1
    radius = (3.0 * max(float(body.mass), 1e-3) / (4.0 * np.pi * 1000.0)) ** (1.0 / 3.0)
    body.add_geom(size=[radius, 0.0, 0.0], density=1000.0, contype=0, conaffinity=0)


geometry_mujoco = inside(("translate", "_add_body", wrapped(_geometry_mujoco)))

_RADIUS = 0.05


def _touching(original: Any, magnitude: float, spec: Any, mechanism: Any, tree: Any, chain: Any) -> None:
    """A ball on each body, and one on the ground that it touches in the drawing, `magnitude` deep."""
    original(spec, mechanism, tree, chain)
    spec.bodies[-1].add_geom(size=[_RADIUS, 0.0, 0.0], pos=tree.links[chain[-1]].body_frame.p, mass=0.0)
    number = tree.links[chain[-1]].body
    if number >= 0:
        at = mechanism.bodies[number].drawing.p + np.array([0.0, 0.0, 2.0 * _RADIUS - magnitude])
        spec.worldbody.add_geom(size=[_RADIUS, 0.0, 0.0], pos=at, mass=0.0)


def _contacts(settings: dict[str, Any], magnitude: float) -> dict[str, Any]:
    del magnitude
    return {"opt.disableflags": [flag for flag in settings["opt.disableflags"] if flag != "CONTACT"]}


@contextmanager
def contacts_on(engine: Any, magnitude: float) -> Any:
    """Contacts as MuJoCo has them by default, and geometry that touches."""
    seam = inside(("translate", "_add_body", wrapped(_touching)))
    with seam(engine, magnitude) as inner, with_settings(_contacts)(inner, magnitude) as outer:
        yield outer


@contextmanager
def stale_samples(engine: Any, magnitude: float) -> Any:
    """Samples read from the derived fields as a step leaves them; all or nothing."""
    del magnitude
    states = module(engine, "states")
    real = states.mujoco

    def only_at_start(name: str) -> Any:
        """A function of MuJoCo's that does its work at time zero alone."""

        def evaluate(model: Any, data: Any) -> None:
            if data.time == 0.0:
                getattr(real, name)(model, data)

        return evaluate

    stale = {name: only_at_start(name) for name in ("mj_kinematics", "mj_comPos", "mj_comVel")}
    with replaced(states, "mujoco", lambda original: Proxy(original, **stale)):
        yield engine


def setting(name: str, of: Any) -> Any:
    """Plant another value of one setting of a method that has it."""
    return with_settings(lambda settings, e: {name: of(e)} if name in settings else {})


def without_flag(name: str) -> Any:
    """Take back one of the switches that the adapter sets."""

    def change(settings: dict[str, Any], magnitude: float) -> dict[str, Any]:
        del magnitude
        return {"opt.disableflags": [flag for flag in settings["opt.disableflags"] if flag != name]}

    return with_settings(change)


def _equality_off(translation: Any, magnitude: float) -> None:
    del magnitude
    translation.data.eq_active[:] = 0
    translation.model.eq_active0[:] = 0


welds_ignored = inside(("", "_prepare", on_result(_equality_off)))


def _free_in_world(original: Any, magnitude: float, link: Any, coordinate: Any, state: Any) -> Any:
    q, v = original(link, coordinate, state)
    w = state.w_WB_W[link.body]
    return q, np.concatenate([v[:3], v[3:] + magnitude * (w - v[3:])])


free_twist_mujoco = inside(("states[_WRITE]", "F", wrapped(_free_in_world)))

# ---------------------------------------------------------------- DART


def _time_step(model: Any, magnitude: float) -> None:
    model.skeleton.setTimeStep(magnitude)


implicit_damping = inside(("", "_translated", on_result(_time_step)))


def _default_inertia(original: Any, magnitude: float, node: Any, mass: float, com: Any, moment: Any) -> None:
    """Links without mass keep a part of DART's default: mass 1 and inertia 1."""
    if mass > 0.0:
        original(node, mass, com, moment)
    else:
        original(node, magnitude, np.zeros(3), magnitude * np.eye(3))


default_inertia = inside(("translation", "set_inertia", wrapped(_default_inertia)))


def _left_on(reduction: float, mixing: float) -> Any:
    """Error reduction and force mixing of the class as another run left them: what is asked for is not set."""

    def change(original: Any, magnitude: float, asked_reduction: float, asked_mixing: float) -> None:
        original(asked_reduction + reduction * magnitude, asked_mixing + mixing * magnitude)

    seams = [(where, "set_softness", wrapped(change)) for where in ("stepping", "methods")]
    return inside(*seams)


error_reduction_left = _left_on(1.0, 0.0)
force_mixing_left = _left_on(0.0, 1.0)


def _free_dart(original: Any, magnitude: float, model: Any, state: Any) -> Any:
    """Linear velocity of a free joint where its angular one belongs."""
    c = original(model, state)
    v = c.v.copy()
    for link, i in zip(model.tree.links, model.start, strict=True):
        if link.elementary == "F":
            w, u = v[i : i + 3].copy(), v[i + 3 : i + 6].copy()
            v[i : i + 3], v[i + 3 : i + 6] = w + magnitude * (u - w), u + magnitude * (w - u)
    return replace(c, v=v)


free_twist_dart = inside(("engine", "from_state", wrapped(_free_dart)))

# ---------------------------------------------------------------- Pinocchio


def _armature_pinocchio(built: Any, magnitude: float) -> None:
    model = built[0].model
    model.armature = np.zeros(model.nv)  # crba adds it
    data = model.createData()
    zero = np.concatenate([np.array(joint.nq * [0.0]) for joint in model.joints[1:]]) if model.nv else np.zeros(0)
    for joint in model.joints[1:]:
        if joint.nq != joint.nv:
            zero[joint.idx_q + joint.nq - 1] = 1.0
    pin = module_of_pinocchio(built)
    model.armature = magnitude * np.diag(pin.crba(model, data, zero))


def module_of_pinocchio(built: Any) -> Any:
    """The package that a translation's model is an object of."""
    return importlib.import_module(type(built[0].model).__module__.partition(".")[0])


def _armature_suited(original: Any, magnitude: float, mechanism: Any, state: Any) -> Any:
    built = original(mechanism, state)
    _armature_pinocchio(built, magnitude)
    return built


armature_pinocchio = inside(("", "_suited", wrapped(_armature_suited)))


def _baumgarte(original: Any, magnitude: float, mechanism: Any, state: Any) -> Any:
    built = original(mechanism, state)
    pin = module_of_pinocchio(built)
    for constraint in built[0].constraints:
        gains = pin.BaumgarteCorrectorParameters(magnitude, 2.0 * magnitude**0.5)
        constraint.setBaumgarteCorrectorParameters(gains)
    return built


baumgarte = inside(("", "_suited", wrapped(_baumgarte)))


def _spatial(pin: Any, magnitude: float) -> Any:
    def acceleration(*arguments: Any) -> Any:
        classical = pin.getFrameClassicalAcceleration(*arguments)
        spatial = pin.getFrameAcceleration(*arguments)
        return pin.Motion((1.0 - magnitude) * classical.vector + magnitude * spatial.vector)

    return Proxy(pin, getFrameClassicalAcceleration=acceleration)


spatial_body = inside(("observe", "pin", _spatial))
spatial_welds = inside(("dynamics", "pin", _spatial))


def _free_in_parent(original: Any, magnitude: float, coordinate: Any) -> Any:
    """Velocities of a free-flyer in axes of the parent where those of the body belong."""
    q, v = original(coordinate)
    return q, [*(np.array(v[:3]) + magnitude * (coordinate.v - np.array(v[:3]))), *v[3:]]


free_twist_pinocchio = inside(("translate[_COORDINATES]", "F", wrapped(_free_in_parent)))


def _scalar_first(original: Any, magnitude: float, coordinate: Any) -> Any:
    del magnitude
    q, v = original(coordinate)
    return [q[3], *q[:3]], v


scalar_first = inside(("translate[_COORDINATES]", "S", wrapped(_scalar_first)))


@contextmanager
def continuous_joints(engine: Any, magnitude: float) -> Any:
    """Hinges as continuous joints, whose cosine and sine have drifted off the circle by a fraction."""
    translate = module(engine, "translate")

    def of(coordinate: Any) -> Any:
        size = 1.0 + magnitude
        return [size * np.cos(coordinate.q), size * np.sin(coordinate.q)], [coordinate.rate]

    with (
        replaced(translate._JOINT_MODELS, "R", lambda _: translate.pin.JointModelRUBZ),
        replaced(translate._COORDINATES, "R", lambda _: of),
    ):
        yield engine


def _contact_sign(original: Any, magnitude: float, translation: Any) -> Any:
    return [((1.0 - 2.0 * magnitude) * a, (1.0 - 2.0 * magnitude) * b) for a, b in original(translation)]


contact_force_sign = inside(("dynamics", "_contact_wrenches", wrapped(_contact_sign)))


def _one_iteration(settings: dict[str, Any], magnitude: float) -> dict[str, Any]:
    return {"mu": magnitude, "max_iter": 1} if "mu" in settings else {}


proximal = with_settings(_one_iteration)
