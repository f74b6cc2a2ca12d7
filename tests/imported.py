"""Imported models against the engine's own loading of the same file: accelerations at random states.

Run on robot files that a package ships::

    python tests/imported.py FILE... > table.md

Features that the import reports as left out (limits, motors, contacts, rotor inertia, Coulomb friction) are off in the
engine; features that the import keeps (damping of hinges and slides, springs, mimicking joints, loops) are on.

Exit code 1 if a difference exceeds 1e-10, or if no file is imported.
"""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from consilience.case.file.reader import cases_from_tables
from consilience.case.importing import import_model, imported_text
from consilience.case.importing.build import IDLE, NO_COORDINATE
from consilience.engine import solve_constrained
from consilience.errors import ConsilienceError
from consilience.mechanism import State, constraint_residual, quaternion_from_rotation
from consilience.reference import accelerations

FORMULATION = "relative"

BAR = 1e-10
"""Largest relative difference of accelerations."""


def through_the_file(imported):
    """Write the imported case to a file and read the file again, as a user does; return its mechanism."""
    (case,) = cases_from_tables(imported.case.name, "written", tomllib.loads(imported_text(imported)))
    return case.mechanism


class Urdf:
    """A URDF file as Pinocchio loads it."""

    def __init__(self, path, imported, free_base):
        import pinocchio as pin

        self.pin = pin
        roots = [pin.JointModelFreeFlyer()] if free_base else []
        model = pin.buildModelFromUrdf(str(path), *roots)
        robot = ElementTree.parse(path).getroot()
        self.rows = [
            (e.get("name"), m.get("joint"), float(m.get("multiplier", "1")), float(m.get("offset", "0")))
            for e in robot.findall("joint")
            if (m := e.find("mimic")) is not None and e.get("type") != "fixed"
        ]
        onto = {e.find("child").get("link"): e.get("name") for e in robot.findall("joint")}
        idle = [onto[name] for name in imported.notes.left_out.get(IDLE, ())]
        if idle:
            model = pin.buildReducedModel(model, [model.getJointId(n) for n in idle], pin.neutral(model))
        self.rows = [row for row in self.rows if row[0] not in idle]
        for name in imported.notes.left_out.get(NO_COORDINATE, ()):
            model.damping[model.idx_vs[model.getJointId(name)]] = 0.0
        self.model, self.data = model, model.createData()
        self.frames = {
            body: model.getFrameId(piece, pin.FrameType.BODY) for body, piece in imported.built.pieces.items()
        }

    def sample(self, rng):
        """Random coordinates and velocities; mimicking joints follow the joints that they mimic."""
        model, pin = self.model, self.pin
        q = pin.integrate(model, pin.neutral(model), rng.uniform(-1.0, 1.0, model.nv))
        v = rng.normal(size=model.nv)
        G = np.eye(model.nv)
        for name, driver, ratio, offset in self._sorted():
            own, other = model.getJointId(name), model.getJointId(driver)
            qi, qd, i, d = model.idx_qs[own], model.idx_qs[other], model.idx_vs[own], model.idx_vs[other]
            pin_value = ratio * _angle(model, q, other, qd) + offset
            if model.nqs[own] == 2:
                q[qi : qi + 2] = np.cos(pin_value), np.sin(pin_value)
            else:
                q[qi] = pin_value
            G[i] = ratio * G[d]
        driven = [model.idx_vs[model.getJointId(row[0])] for row in self.rows]
        G = np.delete(G, driven, axis=1)
        return q, G @ np.delete(v, driven), G

    def _sorted(self):
        """Mimicking joints in an order in which every driver comes before its followers."""
        done, rest = [], list(self.rows)
        while rest:
            names = [row[0] for row in rest]
            ready = [row for row in rest if row[1] not in names]
            done += ready
            rest = [row for row in rest if row not in ready]
        return done

    def accelerations(self, q, v, G):
        model, data, pin = self.model, self.data, self.pin
        tau = -np.array(model.damping) * v
        if self.rows:
            M = pin.crba(model, data, q)
            M = np.triu(M) + np.triu(M, 1).T
            h = pin.nonLinearEffects(model, data, q, v)
            a = G @ np.linalg.solve(G.T @ M @ G, G.T @ (tau - h))
        else:
            a = pin.aba(model, data, q, v, tau)
        pin.forwardKinematics(model, data, q, v, a)
        pin.updateFramePlacements(model, data)
        return a

    def answer(self, rng):
        """Poses, velocities and accelerations of the bodies of the case at a random state, by name."""
        pin, model, data = self.pin, self.model, self.data
        self.accelerations(*self.sample(rng))
        axes = pin.LOCAL_WORLD_ALIGNED
        return {
            body: (
                np.array(data.oMf[f].translation),
                np.array(data.oMf[f].rotation),
                *(np.array(part) for part in _parts(pin.getFrameVelocity(model, data, f, axes))),
                np.concatenate(_parts(pin.getFrameClassicalAcceleration(model, data, f, axes))),
            )
            for body, f in self.frames.items()
        }


def _parts(motion):
    return motion.linear, motion.angular


def _angle(model, q, joint, at):
    return float(np.arctan2(q[at + 1], q[at])) if model.nqs[joint] == 2 else float(q[at])


class Mjcf:
    """An MJCF file as MuJoCo loads it."""

    def __init__(self, path, imported, free_base):
        import mujoco

        from consilience_mujoco.reading import name_of

        self.mj = mujoco
        model = mujoco.MjModel.from_xml_path(str(path))
        bits = mujoco.mjtDisableBit
        for bit in (bits.mjDSBL_CONTACT, bits.mjDSBL_LIMIT, bits.mjDSBL_FRICTIONLOSS, bits.mjDSBL_ACTUATION):
            model.opt.disableflags |= bit
        model.dof_armature[:] = 0.0
        model.body_gravcomp[:] = 0.0
        model.opt.density = model.opt.viscosity = 0.0
        for joint in range(model.njnt):
            one_axis = model.jnt_type[joint] >= int(mujoco.mjtJoint.mjJNT_SLIDE)
            if not one_axis or name_of(model, mujoco.mjtObj.mjOBJ_JOINT, joint) in imported.notes.left_out.get(
                NO_COORDINATE, ()
            ):
                dof, count = model.jnt_dofadr[joint], {0: 6, 1: 3}.get(int(model.jnt_type[joint]), 1)
                model.dof_damping[dof : dof + count] = 0.0
                model.jnt_stiffness[joint] = 0.0
        kept = {spring.name for spring in imported.case.mechanism.springs}
        for tendon in range(model.ntendon):
            if name_of(model, mujoco.mjtObj.mjOBJ_TENDON, tendon) not in kept:
                model.tendon_stiffness[tendon] = model.tendon_damping[tendon] = 0.0
        model.tendon_armature[:] = 0.0
        model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self.model, self.data = model, mujoco.MjData(model)
        self.reach = 0.1 if model.neq else 1.0  # far from the drawing loops cannot close
        names = {name_of(model, mujoco.mjtObj.mjOBJ_BODY, body): body for body in range(model.nbody)}
        self.bodies = {body: names[piece] for body, piece in imported.built.pieces.items()}

    def _rows(self):
        """Jacobian and violation of all equality constraints."""
        model, data = self.model, self.data
        self.mj.mj_forward(model, data)
        J = np.array(data.efc_J[: data.nefc * model.nv]).reshape(data.nefc, model.nv)
        return J, np.array(data.efc_pos[: data.nefc])

    def answer(self, rng):
        """Poses, velocities and accelerations of the bodies of the case at a random state, by name."""
        mj, model, data = self.mj, self.model, self.data
        data.qpos[:] = model.qpos0
        mj.mj_integratePos(model, data.qpos, rng.uniform(-1.0, 1.0, model.nv) * self.reach, 1.0)
        for _ in range(50 if model.neq else 0):
            J, residual = self._rows()
            if np.max(np.abs(residual), initial=0.0) < 1e-15:
                break
            mj.mj_integratePos(model, data.qpos, -np.linalg.lstsq(J, residual, rcond=1e-10)[0], 1.0)
        J, _ = self._rows()
        v = rng.normal(size=model.nv)
        data.qvel[:] = v - np.linalg.lstsq(J, J @ v, rcond=1e-10)[0]
        mj.mj_forward(model, data)
        M = np.zeros((model.nv, model.nv))
        mj.mj_fullM(model, data, M)
        # with equalities closed at position and velocity level, MuJoCo's reference acceleration of the rows is -J' v
        data.qacc[:], _ = solve_constrained(M, np.array(data.qfrc_smooth), J, np.array(data.efc_aref[: len(J)]))
        mj.mj_rnePostConstraint(model, data)
        found = {}
        for name, body in self.bodies.items():
            v, a = np.zeros(6), np.zeros(6)
            mj.mj_objectVelocity(model, data, mj.mjtObj.mjOBJ_XBODY, body, v, 0)
            mj.mj_objectAcceleration(model, data, mj.mjtObj.mjOBJ_XBODY, body, a, 0)
            a[3:] += 0.0 if model.opt.disableflags & int(mj.mjtDisableBit.mjDSBL_GRAVITY) else model.opt.gravity
            R = data.xmat[body].reshape(3, 3).copy()
            found[name] = (data.xpos[body].copy(), R, v[3:], v[:3], np.concatenate([a[3:], a[:3]]))
        return found


def difference(path, free_base=False, states=3, formulation=FORMULATION):
    """Largest relative difference of the accelerations of all bodies; also the largest joint violation, and the import.

    Accelerations are divided by the largest one, or by 1 if all are smaller. The violation is that of the joints of the
    case at the states of the engine.
    """
    imported = import_model(path, free_base)
    kind = Mjcf if ElementTree.parse(path).getroot().tag == "mujoco" else Urdf
    engine = kind(path, imported, free_base)
    mechanism = through_the_file(imported)
    rng = np.random.default_rng(1)
    worst = violated = 0.0
    for _ in range(states):
        told = engine.answer(rng)
        poses = [told[b.name] for b in mechanism.bodies]
        state = State(
            np.array([p[0] for p in poses]),
            quaternion_from_rotation(np.array([p[1] for p in poses])),
            np.array([p[2] for p in poses]),
            np.array([p[3] for p in poses]),
        )
        violated = max(violated, np.max(np.abs(constraint_residual(mechanism, state)), initial=0.0))
        answer = accelerations(mechanism, [state], formulation)
        ours = np.concatenate([answer.a_WB_W[0], answer.alpha_WB_W[0]], axis=1)
        theirs = np.array([p[4] for p in poses])
        worst = max(worst, np.max(np.abs(ours - theirs)) / max(np.max(np.abs(theirs)), 1.0))
    return worst, violated, imported


def row(path, free_base):
    """One row of the table, and the difference; None where the file is refused."""
    base = "free" if free_base else "as in the file"
    try:
        worst, _, imported = difference(path, free_base)
    except ConsilienceError as error:
        return f"| {path.name} | {base} | | | {error} |", None
    m = imported.case.mechanism
    beside = ", ".join(
        f"{len(elements)} {what}"
        for what, elements in (("springs", m.springs + m.joint_springs), ("couplings", m.couplings))
        if elements
    )
    noted = "; ".join(f"{reason} ({len(elements)})" for reason, elements in imported.notes.left_out.items())
    parts = f"{len(m.bodies)} bodies, {len(m.joints)} joints" + (f", {beside}" if beside else "")
    return f"| {path.name} | {base} | {parts} | {worst:.1e} | {noted} |", worst


def main(paths):
    """Print the table; return the exit code."""
    print("| file | base | case | relative difference | changed or left out |\n|---|---|---|---|---|")
    found = []
    for path in map(Path, paths):
        for free_base in (False, True) if path.suffix == ".urdf" else (False,):
            text, worst = row(path, free_base)
            found += [worst] if worst is not None else []
            print(text, flush=True)
    return int(not found or not all(worst <= BAR for worst in found))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
