"""Export of a compiled model as MJCF with all digits, and a script for features that MJCF lacks.

MuJoCo's own writer keeps six digits; here each number is that of the compiled model. The script contains the factors on
inverse inertias that make constraints hard, and the functions of the callback.
"""

from __future__ import annotations

from inspect import getsource
from typing import Any
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import mujoco
import numpy as np

from consilience.engine import Method, Question, suited_rods
from consilience.engine.native import JET, LAWS, ROLLING, function_data, refuse_contacts, script
from consilience.mechanism import Mechanism, State
from consilience_mujoco.callback import answering
from consilience_mujoco.engine import MujocoEngine
from consilience_mujoco.export_script import CODE
from consilience_mujoco.methods import WEIGHTS, configured
from consilience_mujoco.rows import hold_rolling, hold_skate, moving_dofs, velocity_term
from consilience_mujoco.states import set_state
from consilience_mujoco.translate import Translation, translate

_OBJ = mujoco.mjtObj
_EQUALITIES = {
    int(mujoco.mjtEq.mjEQ_WELD): ("weld", _OBJ.mjOBJ_SITE),
    int(mujoco.mjtEq.mjEQ_JOINT): ("joint", _OBJ.mjOBJ_JOINT),
    int(mujoco.mjtEq.mjEQ_TENDON): ("tendon", _OBJ.mjOBJ_TENDON),
}
_TARGETS = {
    int(mujoco.mjtTrn.mjTRN_JOINT): _OBJ.mjOBJ_JOINT,
    int(mujoco.mjtTrn.mjTRN_TENDON): _OBJ.mjOBJ_TENDON,
    int(mujoco.mjtTrn.mjTRN_SITE): _OBJ.mjOBJ_SITE,
}


def _text(values: Any) -> str:
    """Text of numbers with all digits."""
    return " ".join(repr(float(x)) for x in np.atleast_1d(values))


def _powers(first: float, higher: Any) -> str:
    """Text of a coefficient and, if there are any, of those of higher degree."""
    return _text([first, *higher] if np.any(higher) else first)


_FIELDS: dict[str, dict[str, str]] = {
    "body": {"pos": "body_pos", "quat": "body_quat"},
    "inertial": {"mass": "body_mass", "pos": "body_ipos", "quat": "body_iquat", "diaginertia": "body_inertia"},
    "site": {"pos": "site_pos", "quat": "site_quat"},
    "spatial": {"stiffness": "tendon_stiffness", "damping": "tendon_damping", "springlength": "tendon_lengthspring"},
    "equality": {"solref": "eq_solref", "solimp": "eq_solimp"},
}
"""Attributes of MJCF elements, and the arrays of the compiled model with their values."""


class _Writer:
    """Writer of an MJCF file from a compiled model."""

    def __init__(self, model: Any, title: str) -> None:
        self.model = model
        self.root = Element("mujoco", model="".join(c if c.isalnum() else "_" for c in title)[:60])

    def name(self, kind: Any, number: int) -> str:
        found: str = mujoco.mj_id2name(self.model, kind, number) or ""
        return found

    def fields(self, table: str, number: int) -> dict[str, str]:
        """Return the attributes of `_FIELDS` of one element."""
        return {name: _text(getattr(self.model, array)[number]) for name, array in _FIELDS[table].items()}

    def write(self, method: Method, data: Any) -> str:
        """Return the MJCF of the model, with the state of `data` as keyframe ``initial``."""
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
            name = {"name": self.name(_OBJ.mjOBJ_BODY, body)}
            element = SubElement(elements[model.body_parentid[body]], "body", name | self.fields("body", body))
            SubElement(element, "inertial", self.fields("inertial", body))
            first = model.body_jntadr[body]
            for joint in range(first, first + model.body_jntnum[body]):
                self._joint(element, joint)
            elements.append(element)
        for site in range(model.nsite):
            name = {"name": self.name(_OBJ.mjOBJ_SITE, site)}
            SubElement(elements[model.site_bodyid[site]], "site", name | self.fields("site", site))

    def _joint(self, element: Element, joint: int) -> None:
        model, kind = self.model, mujoco.mjtJoint(int(self.model.jnt_type[joint])).name.removeprefix("mjJNT_").lower()
        attributes = {"name": self.name(_OBJ.mjOBJ_JOINT, joint), "type": kind}
        if kind != "free":
            attributes["pos"] = _text(model.jnt_pos[joint])
        if kind in ("hinge", "slide"):
            dof = model.jnt_dofadr[joint]
            attributes |= {
                "axis": _text(model.jnt_axis[joint]),
                "stiffness": _powers(model.jnt_stiffness[joint], model.jnt_stiffnesspoly[joint]),
                "springref": _text(model.qpos_spring[model.jnt_qposadr[joint]]),
                "damping": _powers(model.dof_damping[dof], model.dof_dampingpoly[dof]),
            }
        SubElement(element, "joint", attributes)

    def _tendons(self) -> None:
        model = self.model
        tendons = SubElement(self.root, "tendon")
        for tendon in range(model.ntendon):
            name = {"name": self.name(_OBJ.mjOBJ_TENDON, tendon)}
            element = SubElement(tendons, "spatial", name | self.fields("spatial", tendon))
            first = model.tendon_adr[tendon]
            for site in model.wrap_objid[first : first + model.tendon_num[tendon]]:
                SubElement(element, "site", site=self.name(_OBJ.mjOBJ_SITE, site))

    def _equalities(self) -> None:
        model = self.model
        equalities = SubElement(self.root, "equality")
        for row in range(model.neq):
            tag, kind = _EQUALITIES[int(model.eq_type[row])]
            ids = (model.eq_obj1id[row], model.eq_obj2id[row])
            end = kind.name.removeprefix("mjOBJ_").lower()
            attributes = {f"{end}{n}": self.name(kind, i) for n, i in enumerate(ids, 1) if i >= 0}
            if name := self.name(_OBJ.mjOBJ_EQUALITY, row):
                attributes["name"] = name
            if tag == "joint":
                attributes["polycoef"] = _text(model.eq_data[row, :5])
            SubElement(equalities, tag, attributes | self.fields("equality", row))

    def _actuators(self) -> None:
        model = self.model
        actuators = SubElement(self.root, "actuator")
        for n in range(model.nu):
            kind = _TARGETS[int(model.actuator_trntype[n])]
            target, ids = kind.name.removeprefix("mjOBJ_").lower(), model.actuator_trnid[n]
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


def _signals(translation: Translation) -> list[dict[str, Any]]:
    """Controls of actuators, with the numbers of their functions."""
    functions = ({"f": function_data(s.law["f"])} if "f" in s.law else {} for s in translation.signals)
    pairs = zip(translation.signals, functions, strict=True)
    return [{"actuator": signal.name, **signal.law, **function} for signal, function in pairs]


def _rows(translation: Translation) -> list[dict[str, Any]]:
    """Drives and couplings: equality, joint and sign, those of the driver, function."""
    model = translation.model

    def joint(dof: int, sign: float) -> list[Any]:
        return [model.joint(int(model.dof_jntid[dof])).name, sign]

    return [
        {
            "equality": model.equality(row.equality).name,
            "held": joint(row.dof, row.sign),
            "driver": None if row.driver is None else joint(*row.driver[1:]),
            "f": function_data(row.law),
            "angle": row.angle,
            "written": row.written,
        }
        for row in translation.rows.joints
    ]


def _guides(translation: Translation) -> list[dict[str, Any]]:
    """Rolling bodies and skates, with the equalities of which they use the rows."""
    model = translation.model
    return [
        {
            "equalities": [model.equality(number).name for number in guide.equalities],
            "site": model.site(guide.site).name,
            "element": vars(guide.element),
        }
        for guide in translation.rows.guides
    ]


def export_model(title: str, mechanism: Mechanism, state: State) -> dict[str, str]:
    """Return ``model.xml``, and ``run.py``, which loads it, adds features that MJCF lacks, and prints accelerations.

    Parameters
    ----------
    title : str
    mechanism : Mechanism
    state : State
        State of the keyframe ``initial``.

    Raises
    ------
    InvalidInput
        See `consilience.engine.native.refuse_contacts`.
    """
    refuse_contacts(mechanism)
    method = MujocoEngine().methods(mechanism, Question.INSTANT)[0]
    translation = configured(translate(suited_rods(mechanism, state)), method)
    with answering(translation):
        set_state(translation, state)
        mujoco.mj_forward(translation.model, translation.data)
    sites = (translation.model.site(int(number)).name for number in translation.body_site)
    factors = {name: method.settings[f"{name}, factor"] for name in WEIGHTS if f"{name}, factor" in method.settings}
    constants = {
        "BODIES": dict(zip((body.name for body in mechanism.bodies), sites, strict=True)),
        "FACTORS": factors,
        "SIGNALS": _signals(translation),
        "ROWS": _rows(translation),
        "GUIDES": _guides(translation),
    }
    about = f"{title}, for MuJoCo {mujoco.__version__} alone: `model.xml`, and what MJCF does not have."
    imports = (
        "import json\nimport math\nfrom pathlib import Path\nfrom types import SimpleNamespace\n\n"
        "import mujoco\nimport numpy as np"
    )
    shared = ["\n" + getsource(function) for function in (moving_dofs, velocity_term, hold_rolling, hold_skate)]
    return {
        "model.xml": _Writer(translation.model, title).write(method, translation.data),
        "run.py": script(about, imports, constants, JET, LAWS, ROLLING, *shared, CODE),
    }
