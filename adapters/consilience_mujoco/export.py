"""A compiled model as MJCF with all its digits, and a script for what MJCF does not have.

MuJoCo's own writer keeps six digits; here each number is the compiled model's. The factors on the inverse inertias that
make constraints hard, and the functions that MuJoCo asks for in a callback, go to the script.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import mujoco
import numpy as np

from consilience.engine import Method, Question
from consilience.engine.native import FRICTION, JET, ROLLING, function_data, script
from consilience.mechanism import Mechanism, Rolling, Skate, State, to_elementary_tree
from consilience_mujoco.actuators import load_name
from consilience_mujoco.callback import answering
from consilience_mujoco.engine import MujocoEngine
from consilience_mujoco.export_script import CODE
from consilience_mujoco.methods import configured
from consilience_mujoco.places import axis_link, link_name
from consilience_mujoco.rows import is_own, without_screws
from consilience_mujoco.states import set_state
from consilience_mujoco.translate import Translation, translate

_OBJ = mujoco.mjtObj
_JOINTS = {
    int(mujoco.mjtJoint.mjJNT_HINGE): "hinge",
    int(mujoco.mjtJoint.mjJNT_SLIDE): "slide",
    int(mujoco.mjtJoint.mjJNT_BALL): "ball",
    int(mujoco.mjtJoint.mjJNT_FREE): "free",
}
_EQUALITIES = {
    int(mujoco.mjtEq.mjEQ_WELD): ("weld", ("site1", "site2"), _OBJ.mjOBJ_SITE),
    int(mujoco.mjtEq.mjEQ_JOINT): ("joint", ("joint1", "joint2"), _OBJ.mjOBJ_JOINT),
    int(mujoco.mjtEq.mjEQ_TENDON): ("tendon", ("tendon1", "tendon2"), _OBJ.mjOBJ_TENDON),
}
_TARGETS = {
    int(mujoco.mjtTrn.mjTRN_JOINT): ("joint", _OBJ.mjOBJ_JOINT),
    int(mujoco.mjtTrn.mjTRN_TENDON): ("tendon", _OBJ.mjOBJ_TENDON),
    int(mujoco.mjtTrn.mjTRN_SITE): ("site", _OBJ.mjOBJ_SITE),
}
_WEIGHTS = ("body_invweight0", "dof_invweight0", "tendon_invweight0")


def _text(values: Any) -> str:
    """Numbers with every digit."""
    return " ".join(repr(float(x)) for x in np.atleast_1d(values))


class _Writer:
    """The elements of an MJCF file, from a compiled model."""

    def __init__(self, model: Any, title: str) -> None:
        self.model = model
        self.root = Element("mujoco", model="".join(c if c.isalnum() else "_" for c in title)[:60])

    def name(self, kind: Any, number: int) -> str:
        found: str = mujoco.mj_id2name(self.model, kind, number) or ""
        return found

    def write(self, method: Method, data: Any) -> str:
        """MJCF of the model, its keyframe ``initial`` being the state that `data` holds."""
        SubElement(self.root, "compiler", angle="radian", autolimits="false")
        self._option(method)
        self._bodies()
        for write in (self._tendons, self._equalities, self._actuators):
            write()
        key = {"name": "initial", "qpos": _text(data.qpos), "qvel": _text(data.qvel)}
        key |= {"ctrl": _text(data.ctrl)} if self.model.nu else {}
        SubElement(SubElement(self.root, "keyframe"), "key", key)
        indent(self.root)
        return tostring(self.root, encoding="unicode") + "\n"

    def _option(self, method: Method) -> None:
        settings = method.settings
        names = {"opt.jacobian": "jacobian", "opt.solver": "solver"}
        found = {
            xml: settings[name] if xml == "solver" else settings[name].lower()
            for name, xml in names.items()
            if name in settings
        }
        for name in ("tolerance", "iterations"):
            if f"opt.{name}" in settings:
                found[name] = repr(settings[f"opt.{name}"])
        found |= {"gravity": _text(self.model.opt.gravity), "integrator": "RK4"}
        option = SubElement(self.root, "option", found)
        flags = {name.lower(): "disable" for name in settings["opt.disableflags"]}
        SubElement(option, "flag", flags)

    def _bodies(self) -> None:
        model = self.model
        elements = [SubElement(self.root, "worldbody")]
        for body in range(1, model.nbody):
            element = SubElement(
                elements[model.body_parentid[body]],
                "body",
                name=self.name(_OBJ.mjOBJ_BODY, body),
                pos=_text(model.body_pos[body]),
                quat=_text(model.body_quat[body]),
            )
            SubElement(
                element,
                "inertial",
                mass=_text(model.body_mass[body]),
                pos=_text(model.body_ipos[body]),
                quat=_text(model.body_iquat[body]),
                diaginertia=_text(model.body_inertia[body]),
            )
            first = model.body_jntadr[body]
            for joint in range(first, first + model.body_jntnum[body]):
                self._joint(element, joint)
            elements.append(element)
        for site in range(model.nsite):
            SubElement(
                elements[model.site_bodyid[site]],
                "site",
                name=self.name(_OBJ.mjOBJ_SITE, site),
                pos=_text(model.site_pos[site]),
                quat=_text(model.site_quat[site]),
            )

    def _joint(self, element: Element, joint: int) -> None:
        model, kind = self.model, _JOINTS[int(self.model.jnt_type[joint])]
        attributes = {"name": self.name(_OBJ.mjOBJ_JOINT, joint), "type": kind}
        if kind != "free":
            attributes["pos"] = _text(model.jnt_pos[joint])
        if kind in ("hinge", "slide"):
            attributes |= {
                "axis": _text(model.jnt_axis[joint]),
                "stiffness": _text(model.jnt_stiffness[joint]),
                "springref": _text(model.qpos_spring[model.jnt_qposadr[joint]]),
                "damping": _text(model.dof_damping[model.jnt_dofadr[joint]]),
            }
        SubElement(element, "joint", attributes)

    def _tendons(self) -> None:
        model = self.model
        tendons = SubElement(self.root, "tendon")
        for tendon in range(model.ntendon):
            element = SubElement(
                tendons,
                "spatial",
                name=self.name(_OBJ.mjOBJ_TENDON, tendon),
                stiffness=_text(model.tendon_stiffness[tendon]),
                damping=_text(model.tendon_damping[tendon]),
                springlength=_text(model.tendon_lengthspring[tendon]),
            )
            first = model.tendon_adr[tendon]
            for site in model.wrap_objid[first : first + model.tendon_num[tendon]]:
                SubElement(element, "site", site=self.name(_OBJ.mjOBJ_SITE, site))

    def _equalities(self) -> None:
        model = self.model
        equalities = SubElement(self.root, "equality")
        for row in range(model.neq):
            tag, ends, kind = _EQUALITIES[int(model.eq_type[row])]
            ids = (model.eq_obj1id[row], model.eq_obj2id[row])
            attributes = {end: self.name(kind, i) for end, i in zip(ends, ids, strict=True) if i >= 0}
            if name := self.name(_OBJ.mjOBJ_EQUALITY, row):
                attributes["name"] = name
            if tag == "joint":
                attributes["polycoef"] = _text(model.eq_data[row, :5])
            attributes |= {"solref": _text(model.eq_solref[row]), "solimp": _text(model.eq_solimp[row])}
            SubElement(equalities, tag, attributes)

    def _actuators(self) -> None:
        model = self.model
        actuators = SubElement(self.root, "actuator")
        for n in range(model.nu):
            target, kind = _TARGETS[int(model.actuator_trntype[n])]
            ids = model.actuator_trnid[n]
            attributes = {
                "name": self.name(_OBJ.mjOBJ_ACTUATOR, n),
                target: self.name(kind, ids[0]),
                "gear": _text(model.actuator_gear[n]),
                "gainprm": _text(model.actuator_gainprm[n, :3]),
                "biastype": ("none", "affine")[int(model.actuator_biastype[n])],
                "biasprm": _text(model.actuator_biasprm[n, :3]),
            }
            if target == "site" and ids[1] >= 0:
                attributes["refsite"] = self.name(kind, ids[1])
            if int(model.actuator_dyntype[n]) == int(mujoco.mjtDyn.mjDYN_INTEGRATOR):
                attributes["dyntype"] = "integrator"
            SubElement(actuators, "general", attributes)


def _signals(mechanism: Mechanism) -> list[dict[str, Any]]:
    """Controls of actuators, as `actuators` has them."""
    found: list[dict[str, Any]] = []

    def in_time(name: str, function: Any) -> None:
        if function is not None:
            found.append({"actuator": name, "kind": "time", "f": function_data(function)})

    for load in mechanism.loads:
        in_time(load_name(load), load.history)
    for spring in mechanism.springs:
        in_time(f"spring {spring.name}", spring.actuator)
    for turning in mechanism.joint_springs:
        in_time(f"joint spring {turning.name}", turning.actuator)
    for f in mechanism.frictions:
        if f.coulomb:
            name = f"friction {f.name}"
            found.append({"actuator": name, "kind": "coulomb", "force": f.coulomb, "speed": f.speed})
    for c in mechanism.controls:
        name, target = f"control {c.name}", function_data(c.target)
        found.append({"actuator": name, "kind": "servo", "f": target, "P": c.proportional, "D": c.derivative})
        if c.integral:
            found.append({"actuator": f"integral of {name}", "kind": "error", "f": target})
    return found


def _rows(mechanism: Mechanism) -> list[dict[str, Any]]:
    """Drives and couplings: equality, joint and sign, those of the driver, function."""
    tree = to_elementary_tree(without_screws(mechanism))

    def axis(joint: str, coordinate: str) -> tuple[str, float]:
        link, sign = axis_link(mechanism, tree, joint, coordinate)
        return link_name(tree, link), sign

    def row(name: str, x: Any, driver: Any, law: Any, written: bool) -> dict[str, Any]:
        """One row as data: `x` names the joint that is held, `driver` the one that leads, if any."""
        return {
            "equality": name,
            "held": axis(x.joint, x.coordinate),
            "driver": driver,
            "f": function_data(law),
            "angle": x.coordinate == "angle",
            "written": written,
        }

    rows = [row(f"drive {d.name}", d, None, d.motion, False) for d in mechanism.drives]
    for c in mechanism.couplings:
        driver = axis(c.driver_joint, c.driver_coordinate)
        rows.append(row(f"coupling {c.name}", c, driver, c.law, not is_own(c.law)))
    return rows


def _guides(mechanism: Mechanism, sites: dict[str, str]) -> list[dict[str, Any]]:
    """Rolling bodies and skates, with the equalities whose rows they have."""
    found: list[dict[str, Any]] = []
    guides: tuple[Rolling | Skate, ...] = (*mechanism.rollings, *mechanism.skates)
    for guide in guides:
        count = 3 if isinstance(guide, Rolling) else 1
        names = ("center", "axis", "radius", "point", "normal", "rounding") if count == 3 else ("point", "lateral")
        found.append(
            {
                "equalities": [f"row {k} of {guide.name}" for k in range(count)],
                "site": sites[guide.body],
                **{name: getattr(guide, name) for name in names},
            }
        )
    return found


def _sites(translation: Translation) -> dict[str, str]:
    names: Iterable[str] = (
        mujoco.mj_id2name(translation.model, _OBJ.mjOBJ_SITE, int(i)) for i in translation.body_site
    )
    return dict(zip((b.name for b in translation.mechanism.bodies), names, strict=True))


def export_model(title: str, mechanism: Mechanism, state: State) -> dict[str, str]:
    """``model.xml``, and ``run.py`` which loads it, gives MuJoCo what MJCF cannot, and prints accelerations.

    Parameters
    ----------
    state : State
        Where the keyframe ``initial`` starts.
    """
    method = MujocoEngine().methods(mechanism, Question.INSTANT)[0]
    translation = configured(translate(mechanism), method)
    with answering(translation):
        set_state(translation, state)
        mujoco.mj_forward(translation.model, translation.data)
    sites = _sites(translation)
    factors = {name: method.settings[f"{name}, factor"] for name in _WEIGHTS if f"{name}, factor" in method.settings}
    constants = {
        "BODIES": sites,
        "FACTORS": factors,
        "SIGNALS": _signals(mechanism),
        "ROWS": _rows(mechanism),
        "GUIDES": _guides(mechanism, sites),
    }
    about = f"{title}, for MuJoCo {mujoco.__version__} alone: `model.xml`, and what MJCF does not have."
    imports = "import json\nimport math\nfrom pathlib import Path\n\nimport mujoco\nimport numpy as np"
    return {
        "model.xml": _Writer(translation.model, title).write(method, translation.data),
        "run.py": script(about, imports, constants, JET, FRICTION, ROLLING, CODE),
    }
