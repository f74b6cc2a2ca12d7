"""Export of a translated mechanism as a script for Pinocchio alone, and as URDF where URDF has all of its joints.

Elements that Pinocchio lacks (springs, loads, efforts, drives, couplings, guided bodies) are code of the script. The
script finds joints by name, because a model from URDF has another order of joints.
"""

from __future__ import annotations

import math
from typing import Any
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np
import pinocchio as pin

from consilience.engine.native import ELEMENTS, JET, Places, element_data, script
from consilience.mechanism import Array, Link, Mechanism, State
from consilience_pinocchio.charts import suited
from consilience_pinocchio.efforts import Axis, axis
from consilience_pinocchio.export_script import BUILD, CODE, LOAD, RUN
from consilience_pinocchio.translate import Seat, Translation, configuration, translate

_UNBOUNDED = "1e9"
"""Limits of joints, which URDF requires; the script does not use them."""

_URDF_KINDS = {"R": "revolute", "P": "prismatic", "F": "floating", "W": "fixed"}
_ROOT = "ground"


class _Data:
    """Data of a translation for the script, as numbers and names."""

    def __init__(self, translation: Translation, state: State) -> None:
        self.t, self.mechanism = translation, translation.mechanism
        q, v = configuration(translation, state)
        model = translation.model
        self.start = {
            model.names[j]: [q[i : i + nq], v[k : k + nv]]
            for j, i, nq, k, nv in zip(
                range(1, model.njoints), model.idx_qs[1:], model.nqs[1:], model.idx_vs[1:], model.nvs[1:], strict=True
            )
        }

    def seat(self, seat: Seat) -> list[Any]:
        """Return the name of the joint, then origin and axes of a frame in the moving frame of the joint."""
        return [self.t.model.names[seat.joint], np.array(seat.placement.translation), np.array(seat.placement.rotation)]

    def frame(self, body: str) -> list[Any]:
        """Return the name of the joint that carries a body, then origin and axes of the body in its moving frame."""
        return self.seat(self.t.body_seat(self.mechanism.body_index[body]))

    def axis(self, joint: str, coordinate: str) -> list[Any]:
        """Return the name of the joint and the sign of a coordinate."""
        place: Axis = axis(self.t, joint, coordinate)
        return [self.t.model.names[place.joint], place.sign]

    def joints(self) -> list[list[Any]]:
        """Return name, carrier, kind, pitch in m/rad, origin and axes in the carrier's moving frame of each joint."""
        model, found = self.t.model, []
        for link in self.t.tree.links:
            if link.elementary != "W":
                j = model.getJointId(link.name)
                pitch = self.mechanism.joints[link.joint].pitch / (2.0 * math.pi)
                kind, at = model.joints[j].shortname(), model.jointPlacements[j]
                found.append([link.name, model.names[model.parents[j]], kind, pitch, at.translation, at.rotation])
        return found

    def placements(self) -> dict[str, list[Any]]:
        """Return origin and axes of each joint in the moving frame of its carrier."""
        model = self.t.model
        found = zip(model.names[1:], model.jointPlacements[1:], strict=True)
        return {name: [np.array(place.translation), np.array(place.rotation)] for name, place in found}

    def constants(self, urdf: bool) -> dict[str, Any]:
        """Return the constants of the script; with `urdf`, without those that the URDF file contains."""
        t, m = self.t, self.mechanism
        masses = [
            [*self.seat(seat), link.mass, link.com, link.inertia]
            for link, seat in zip(t.tree.links, t.seats, strict=True)
        ]
        return {
            "GRAVITY": m.gravity,
            **({"PLACEMENTS": self.placements()} if urdf else {"JOINTS": self.joints(), "MASSES": masses}),
            "START": self.start,
            "WELDS": [[self.seat(original), self.seat(copy)] for original, copy in t.welds],
            **element_data(m, Places(self.frame, self.axis)),
        }


# ---------------------------------------------------------------- URDF


def has_urdf(translation: Translation) -> bool:
    """Whether URDF has every joint of a model: no ball, no screw, no closed loop."""
    tree, screws = translation.tree, any(joint.pitch for joint in translation.mechanism.joints)
    return not tree.welds and not screws and all(link.elementary in _URDF_KINDS for link in tree.links)


def _text(values: Any) -> str:
    return " ".join(repr(float(x)) for x in values)


def roll_pitch_yaw(R: Array) -> Array:
    """Return the angles of ``R = Rz(yaw) Ry(pitch) Rx(roll)``, shape (3,), to all digits for every R.

    Where x of the frame lies along z of the parent, the yaw is lost in rounding; the roll is computed in the frame
    after the yaw and compensates it.
    """
    yaw = math.atan2(R[1, 0], R[0, 0])
    s, c = math.sin(yaw), math.cos(yaw)
    pitch = math.atan2(-R[2, 0], c * R[0, 0] + s * R[1, 0])
    roll = math.atan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
    return np.array([roll, pitch, yaw])


def _inertial(element: Element, link: Link) -> None:
    if link.mass == 0.0:
        return
    inertial = SubElement(element, "inertial")
    SubElement(inertial, "origin", xyz=_text(link.com), rpy="0 0 0")
    SubElement(inertial, "mass", value=repr(float(link.mass)))
    entries = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    SubElement(inertial, "inertia", {name: repr(float(link.inertia[place])) for name, place in entries.items()})


def urdf_text(translation: Translation, title: str) -> str:
    """Return the URDF of a model for which `has_urdf` is true."""
    robot = Element("robot", name="".join(c if c.isalnum() else "_" for c in title)[:60])
    SubElement(robot, "link", name=_ROOT)
    links = translation.tree.links
    for link in links:
        _inertial(SubElement(robot, "link", name=link.name), link)
    for link in links:
        joint = SubElement(robot, "joint", name=link.name, type=_URDF_KINDS[link.elementary])
        SubElement(joint, "origin", xyz=_text(link.placement.p), rpy=_text(roll_pitch_yaw(link.placement.R)))
        SubElement(joint, "parent", link=_ROOT if link.parent < 0 else links[link.parent].name)
        SubElement(joint, "child", link=link.name)
        if link.elementary in ("R", "P"):
            SubElement(joint, "axis", xyz="0 0 1")
            wide = dict.fromkeys(("effort", "velocity", "upper"), _UNBOUNDED)
            SubElement(joint, "limit", wide | {"lower": f"-{_UNBOUNDED}"})
    indent(robot)
    return tostring(robot, encoding="unicode") + "\n"


def export_model(title: str, mechanism: Mechanism, state: State) -> dict[str, str]:
    """Return the script ``run.py``, and ``model.urdf`` if URDF has all joints.

    With a URDF the script takes joints and masses from the file; it sets the placements of joints itself, because the
    angles of a URDF lose digits.

    Parameters
    ----------
    title : str
    mechanism : Mechanism
    state : State
        Initial state of the script.
    """
    translation = suited(translate(mechanism), state)
    urdf = has_urdf(translation)
    about = f"{title}, for Pinocchio {pin.__version__} alone."
    imports = "import json\nimport math\nfrom pathlib import Path\n\nimport numpy as np\nimport pinocchio as pin"
    text = script(
        about, imports, _Data(translation, state).constants(urdf), JET, LOAD if urdf else BUILD, CODE, ELEMENTS, RUN
    )
    return {"run.py": text} | ({"model.urdf": urdf_text(translation, title)} if urdf else {})
