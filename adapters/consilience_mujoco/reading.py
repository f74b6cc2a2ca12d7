"""Import of MJCF files as parts of a case, by MuJoCo's own compiler.

The compiler resolves defaults, includes, and inertia from shapes. The compiled model is read at its `qpos0`, where the
joint coordinates of MuJoCo and of the case are zero.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, tostring

import mujoco
import numpy as np

from consilience.engine.native import CoordinateLaw, NativeJoint, Notes, Parts, Piece
from consilience.errors import InvalidInput
from consilience.mechanism import Array, Frame, Joint, Spring, rotation_from_quaternion
from consilience_mujoco.translate import JOINT_TYPES

_OBJ, _OFF = mujoco.mjtObj, mujoco.mjtDisableBit
_JOINT, _CONNECT, _WELD = (
    int(kind) for kind in (mujoco.mjtEq.mjEQ_JOINT, mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD)
)
_TORQUE_SCALE = 10
"""Place of the factor on the rotation that a weld holds, in `eq_data`."""

_SITE = int(mujoco.mjtWrap.mjWRAP_SITE)
_LETTERS = {int(kind): letter for letter, kind in JOINT_TYPES.items()}
_WIDTH = {kind: {"S": 3, "F": 6}.get(letter, 1) for kind, letter in _LETTERS.items()}

_LISTS = {
    "motors and muscles, which a case does not have": (_OBJ.mjOBJ_ACTUATOR, "nu"),
    "sensors, which a case does not have": (_OBJ.mjOBJ_SENSOR, "nsensor"),
    "keyframes: the case starts at rest as drawn": (_OBJ.mjOBJ_KEY, "nkey"),
    "plugins, not read": (_OBJ.mjOBJ_PLUGIN, "nplugin"),
}


def name_of(model: Any, kind: Any, number: int) -> str:
    """Return the name of an object; if it has none, its kind and number, as no other object of the kind is named."""
    if name := mujoco.mj_id2name(model, kind, number):
        return str(name)
    made = f"{kind.name.removeprefix('mjOBJ_').lower()}_{number}"
    while mujoco.mj_name2id(model, kind, made) >= 0:
        made += "_"
    return made


def _specification(root: Element, path: Path, notes: Notes) -> Any:
    """Return the specification of a file, without text between its elements if MuJoCo refuses the file as it is."""
    try:
        return mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        for element in root.iter():
            if (element.text or "").strip() or (element.tail or "").strip():
                notes.add("text between elements, not read", element.tag)
            element.text = element.tail = None
        try:
            spec = mujoco.MjSpec.from_string(tostring(root, "unicode"))
        except ValueError:
            raise error from None
        spec.modelfiledir = str(path.parent)
        return spec


def _without_absent_meshes(spec: Any, path: Path, notes: Notes) -> None:
    """Remove meshes whose files are not there, with their shapes, from bodies that say their inertia."""
    folder = path.parent / spec.meshdir
    absent = {m.name: m for m in spec.meshes if m.file and not (folder / m.file).exists()}
    for geom in list(spec.geoms):
        if geom.meshname in absent:
            body = geom.parent
            if not body.explicitinertial and body.name != "world":
                notes.refuse(f"its inertia is that of the mesh '{geom.meshname}', which is not there", body.name)
            spec.delete(geom)
    for mesh in absent.values():
        spec.delete(mesh)
    notes.add("meshes that are not there: shapes are not read", *absent)
    notes.check(path.name)


def _higher(coefficients: Any) -> tuple[float, ...]:
    """Return the coefficients of higher degree of a spring or damper, none if all are zero."""
    return tuple(float(x) for x in coefficients) if np.any(coefficients) else ()


class _Model:
    """Compiled model at `qpos0`."""

    def __init__(self, root: Element, path: Path, notes: Notes) -> None:
        try:
            spec = _specification(root, path, notes)
            _without_absent_meshes(spec, path, notes)
            self.model: Any = spec.compile()
        except ValueError as error:
            raise InvalidInput(str(path), f"MuJoCo refuses it: {error}", "Give a file that MuJoCo loads.") from None
        self.data: Any = mujoco.MjData(self.model)
        mujoco.mj_kinematics(self.model, self.data)
        self.notes = notes

    def off(self, flag: Any) -> bool:
        return bool(self.model.opt.disableflags & int(flag))

    def body_name(self, body: int) -> str:
        return "" if body == 0 else name_of(self.model, _OBJ.mjOBJ_BODY, body)

    def joint_name(self, joint: int) -> str:
        return name_of(self.model, _OBJ.mjOBJ_JOINT, joint)

    def frame(self, body: int) -> Frame:
        return Frame(self.data.xpos[body], self.data.xmat[body].reshape(3, 3))

    def pieces(self) -> Iterator[Piece]:
        """Return the bodies, with the joints to their parents."""
        model = self.model
        for body in range(1, model.nbody):
            R = rotation_from_quaternion(model.body_iquat[body])
            first = model.body_jntadr[body]
            yield Piece(
                self.body_name(body),
                self.body_name(model.body_parentid[body]),
                self.frame(body),
                tuple(self.motion(joint) for joint in range(first, first + model.body_jntnum[body])),
                float(model.body_mass[body]),
                np.array(model.body_ipos[body]),
                (R * model.body_inertia[body]) @ R.T,
            )

    def motion(self, joint: int) -> NativeJoint:
        """Return a joint with its spring and damper, in the drawing."""
        model, dof, at = self.model, self.model.jnt_dofadr[joint], self.model.jnt_qposadr[joint]
        letter, width = _LETTERS[int(model.jnt_type[joint])], _WIDTH[int(model.jnt_type[joint])]
        damping = 0.0 if self.off(_OFF.mjDSBL_DAMPER) else float(np.max(model.dof_damping[dof : dof + width]))
        rest = float(model.qpos_spring[at] - model.qpos0[at]) if width == 1 else 0.0
        return NativeJoint(
            self.joint_name(joint),
            letter,
            np.array(self.data.xanchor[joint]),
            np.array(self.data.xaxis[joint]),
            0.0 if self.off(_OFF.mjDSBL_SPRING) else float(model.jnt_stiffness[joint]),
            damping,
            rest,
            () if self.off(_OFF.mjDSBL_SPRING) else _higher(model.jnt_stiffnesspoly[joint]),
            () if self.off(_OFF.mjDSBL_DAMPER) else _higher(model.dof_dampingpoly[dof]),
        )

    # ---------------------------------------------------------------- equalities

    def _active(self, *types: int) -> Iterator[tuple[str, int]]:
        model = self.model
        for row in range(model.neq):
            if model.eq_type[row] in types and model.eq_active0[row] and not self.off(_OFF.mjDSBL_EQUALITY):
                yield name_of(model, _OBJ.mjOBJ_EQUALITY, row), row

    def laws(self) -> Iterator[CoordinateLaw]:
        """Return equalities of joints as polynomials of the driver's coordinate, or as constants without a driver."""
        for name, row in self._active(_JOINT):
            driver = int(self.model.eq_obj2id[row])
            powers = tuple(float(c) for c in self.model.eq_data[row, : 5 if driver >= 0 else 1])
            held = self.joint_name(self.model.eq_obj1id[row])
            yield CoordinateLaw(name, held, self.joint_name(driver) if driver >= 0 else "", powers)

    def loops(self) -> Iterator[Joint]:
        """Return equalities of two bodies as joints that close loops: rigid, or spherical if no rotation is held."""
        for name, row in self._active(_CONNECT, _WELD):
            weld = self.model.eq_type[row] == _WELD
            bodies, F, M = self._ends(row, weld)
            first, second = (self.body_name(body) for body in bodies)
            turning = not weld or self.model.eq_data[row, _TORQUE_SCALE] == 0.0
            yield Joint(name, "spherical" if turning else "rigid", first, second, F, M)

    def _ends(self, row: int, weld: bool) -> tuple[list[int], Frame, Frame]:
        """Bodies and frames that an equality holds together; for a ball, with the axes of the drawing."""
        model, data = self.model, self.model.eq_data[row]
        ids = [int(model.eq_obj1id[row]), int(model.eq_obj2id[row])]
        if model.eq_objtype[row] == int(_OBJ.mjOBJ_SITE):
            bodies = [int(model.site_bodyid[i]) for i in ids]
            points = [np.array(model.site_pos[i]) for i in ids]
            turns = [rotation_from_quaternion(model.site_quat[i]) for i in ids]
        else:
            bodies = ids
            points = [data[3:6], data[0:3]] if weld else [data[0:3], data[3:6]]
            turns = [
                rotation_from_quaternion(data[6:10] / np.linalg.norm(data[6:10])) if weld else np.eye(3),
                np.eye(3),
            ]
        if not weld:
            turns = [self.frame(body).R.T for body in bodies]
        return bodies, Frame(points[0], turns[0]), Frame(points[1], turns[1])

    def springs(self) -> Iterator[Spring]:
        """Return tendons between two sites with a spring or damper as springs."""
        model = self.model
        for tendon in range(model.ntendon):
            name, first = name_of(model, _OBJ.mjOBJ_TENDON, tendon), model.tendon_adr[tendon]
            stiffness, damping = float(model.tendon_stiffness[tendon]), float(model.tendon_damping[tendon])
            length, longest = (float(x) for x in model.tendon_lengthspring[tendon])
            types = list(model.wrap_type[first : first + model.tendon_num[tendon]])
            if not (stiffness or damping):
                self.notes.add("tendons, which a case does not have", name)
            elif types != [_SITE] * 2 or (stiffness and length != longest):
                self.notes.add(
                    "spring or damper of a tendon that is no straight line between two points, or slack", name
                )
            else:
                sites = [int(i) for i in model.wrap_objid[first : first + 2]]
                start, end = (self.body_name(model.site_bodyid[i]) for i in sites)
                at, to = (np.array(model.site_pos[i]) for i in sites)
                yield Spring(name, start, end, at, to, stiffness, damping, length)

    # ---------------------------------------------------------------- elements that a case lacks

    def note_rest(self) -> None:
        """Note the elements that a case lacks, and refuse those that constrain the model."""
        model, add = self.model, self.notes.add
        for reason, (kind, count) in _LISTS.items():
            add(reason, *(name_of(model, kind, i) for i in range(getattr(model, count))))
        joints = range(model.njnt)
        dofs = [slice(model.jnt_dofadr[j], model.jnt_dofadr[j] + _WIDTH[int(model.jnt_type[j])]) for j in joints]
        for reason, marked in {
            "limits, not read: a `stop` states them": model.jnt_limited,
            "limits of motors, which a case does not have": model.jnt_actfrclimited,
            "armature: a case has no rotor inertia": [np.any(model.dof_armature[d]) for d in dofs],
            "Coulomb friction, not read: `dry_friction` states it": [np.any(model.dof_frictionloss[d]) for d in dofs],
            "spring that yields, kept as if it did not": model.jnt_springyield,
        }.items():
            add(reason, *(self.joint_name(j) for j in joints if marked[j]))
        for reason, marked in {
            "limits, which a case has in joints alone": model.tendon_limited,
            "limits of motors, which a case does not have": model.tendon_actfrclimited,
            "armature: a case has no rotor inertia": model.tendon_armature,
            "Coulomb friction, which a case has in joints alone": model.tendon_frictionloss,
            "spring or damper with a polynomial, its linear part kept": [
                np.any(model.tendon_stiffnesspoly[t]) or np.any(model.tendon_dampingpoly[t])
                for t in range(model.ntendon)
            ],
            "spring that yields, kept as if it did not": model.tendon_springyield,
        }.items():
            add(reason, *(name_of(model, _OBJ.mjOBJ_TENDON, t) for t in range(model.ntendon) if np.any(marked[t])))
        add("compensation of gravity", *(self.body_name(b) for b in range(model.nbody) if model.body_gravcomp[b]))
        add(
            "bodies moved by the user (mocap), fixed",
            *(self.body_name(b) for b in range(model.nbody) if model.body_mocapid[b] >= 0),
        )
        if model.ngeom:
            add("shapes and their contacts, not read: a `contact` states which pairs touch", "mechanism")
        if model.opt.density or model.opt.viscosity:
            add("the medium: drag and lift", "mechanism")
        known = (_JOINT, _CONNECT, _WELD)
        for row in range(model.neq):
            name = name_of(model, _OBJ.mjOBJ_EQUALITY, row)
            if not model.eq_active0[row] or self.off(_OFF.mjDSBL_EQUALITY):
                add("equality that is not active", name)
            elif model.eq_type[row] not in known:
                self.notes.refuse("an equality of tendons or flexible bodies is no joint of a case", name)
        if model.nflex:
            self.notes.refuse(
                "a case has rigid bodies only", *(name_of(model, _OBJ.mjOBJ_FLEX, i) for i in range(model.nflex))
            )


def read_mjcf(root: Element, path: Path, free_base: bool, notes: Notes) -> Parts:
    """Return the parts of an MJCF file.

    Parameters
    ----------
    root : Element
        Root of the XML; read only where MuJoCo, which knows includes, refuses the file.
    path : Path
    free_base : bool
        Refused: an MJCF file has free joints of its own.
    notes : Notes
        Takes notes of elements that are left out or refused.

    Raises
    ------
    InvalidInput
        MuJoCo refuses the file, or `free_base` is true.
    """
    if free_base:
        raise InvalidInput(str(path), "an MJCF file says itself what floats", "Leave the option for URDF.")
    read = _Model(root, path, notes)
    gravity: Array = np.zeros(3) if read.off(_OFF.mjDSBL_GRAVITY) else np.array(read.model.opt.gravity)
    read.note_rest()
    return Parts(
        path.stem, gravity, tuple(read.pieces()), tuple(read.laws()), tuple(read.loops()), tuple(read.springs())
    )


READERS = {"mujoco": read_mjcf}
"""Readers by the root element of the XML, for `consilience.case.importing`."""
