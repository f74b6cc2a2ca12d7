"""Mechanism from the parts of a model: fixed pieces merged, pieces without mass composed, joints recognised."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import chain, count
from typing import Any

import numpy as np

from consilience.case.importing.between import Share, between
from consilience.case.importing.compound import recognise
from consilience.engine.native import CoordinateLaw, NativeJoint, Notes, Parts, Piece
from consilience.engine.native.parts import inertia_of_several
from consilience.errors import InvalidInput
from consilience.mechanism import (
    GROUND,
    Array,
    Body,
    Coupling,
    Drive,
    Frame,
    Function,
    Joint,
    JointSpring,
    Mechanism,
    Spring,
    check_inertia,
    rotation_with_z_axis,
)

_ONE = np.eye(3)

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}")

MERGED = "fixed, merged into the body that carries it"
GROUNDED = "fixed to the ground, its mass left out"
IDLE = "without mass, and nothing with mass on it: left out"
FILLED = "between two joints in a row: it takes over mass on their axes from its neighbours, the motion is the same"
COMPOSED = "without mass: its joint and the next are one joint of the case"
LOCKS = "hinges through one point became a ball, which does not lock where their axes lie in a plane"
NO_COORDINATE = "spring or damping left out: the joint it became has no such coordinate"


@dataclass(frozen=True, eq=False)
class Built:
    """A mechanism, and the piece of the file for each of its bodies.

    Attributes
    ----------
    mechanism : Mechanism
    pieces : dict
        Name of the piece whose frame is that of the body, by the name of the body; without bodies that are no piece.
    """

    mechanism: Mechanism
    pieces: dict[str, str]


def usable_names(names: Mapping[str, str], what: str, notes: Notes, taken: set[str]) -> dict[str, str]:
    """Return a unique name that a case can have for each name, by key; changes are noted.

    Parameters
    ----------
    names : dict
    what : str
        Prefix of a name that begins with no letter.
    notes : Notes
    taken : set of str
        Names that others of the kind have; the new ones are added.
    """
    found: dict[str, str] = {}
    for key, name in names.items():
        plain = re.sub(r"[^A-Za-z0-9_]", "_", name)[:60]
        plain = plain if _NAME.fullmatch(plain) else f"{what}_{plain}"[:60]
        candidates = chain([plain], (f"{plain}_{k}" for k in count(2)))
        usable = next(candidate for candidate in candidates if candidate not in taken)
        taken.add(usable)
        found[key] = usable
        if usable != name:
            notes.add(f"{what} with a new name", f"{name} is {usable}")
    return found


class _Builder:
    """Construction of a mechanism from parts.

    Attributes
    ----------
    merged_into : dict
        Moving piece, or empty for the ground, that each fixed piece belongs to.
    homes : dict
        Body, or ground, of each piece.
    made : set of str
        Pieces that the file does not have.
    taken : dict
        Names in the case of bodies, of joints and of elements.
    """

    def __init__(self, parts: Parts, notes: Notes) -> None:
        self.parts, self.notes = parts, notes
        self.pieces = {piece.name: piece for piece in parts.pieces}
        self.merged_into: dict[str, str] = {}
        self.homes: dict[str, str] = {"": GROUND}
        self.made: set[str] = set()
        self.taken: dict[str, set[str]] = {"body": {GROUND}, "joint": set(), "element": set()}

    def build(self) -> Built:
        """Return the mechanism.

        Raises
        ------
        InvalidInput
            Nothing with mass moves, or a part has no place in a case.
        """
        shares = self._merge()
        self._fill_between(shares)
        idle = self._idle(shares)
        self.kept = {name: share for name, share in shares.items() if name not in idle and share[0] > 0.0}
        if not self.kept:
            raise InvalidInput(
                self.parts.name, "nothing with mass moves", "If the root of a URDF file floats, say --free-base."
            )
        self.names = usable_names({n: n for n in self.kept}, "body", self.notes, self.taken["body"])
        self.homes |= self.names
        for name, home in self.merged_into.items():
            if home in self.homes:
                self.homes[name] = self.homes[home]
        joints, coordinates = self._joints(idle, shares)
        fields: dict[str, tuple[Any, ...]] = {
            "bodies": tuple(self._bodies()),
            "joints": (*joints, *self._loops()),
            "springs": tuple(self._springs()),
            "joint_springs": tuple(self._joint_springs(coordinates)),
            **self._laws(coordinates, idle),
        }
        self.notes.check(self.parts.name)
        mechanism = Mechanism(self.parts.name, self.parts.gravity, **fields)
        return Built(mechanism, {body: piece for piece, body in self.names.items() if piece not in self.made})

    def _merge(self) -> dict[str, Share]:
        """Mass, centre of mass and inertia of each moving piece with all pieces fixed to the piece, in its frame."""
        lumps: dict[str, list[Share]] = {}
        for piece in self.parts.pieces:
            if piece.motions:
                lumps[piece.name] = [(piece.mass, piece.com, piece.inertia)]
                continue
            base = self.merged_into.get(piece.carrier, piece.carrier)
            self.merged_into[piece.name] = base
            if not base:
                self.notes.add(GROUNDED if piece.mass else MERGED, piece.name)
                continue
            self.notes.add(MERGED, piece.name)
            if piece.mass or np.any(piece.inertia):
                end, start = piece.frame, self.pieces[base].frame
                R, p = start.R.T @ end.R, start.R.T @ (end.p - start.p)
                lumps[base].append((piece.mass, p + R @ piece.com, R @ piece.inertia @ R.T))
        self.homes |= {name: GROUND for name, base in self.merged_into.items() if not base}
        return {name: inertia_of_several(_with_something(lump)) for name, lump in lumps.items()}

    def _base(self, piece: Piece) -> str:
        """Name of the moving piece that carries a piece; empty for the ground."""
        return self.merged_into.get(piece.carrier, piece.carrier)

    def _fill_between(self, shares: dict[str, Share]) -> None:
        """Give mass to what lies between two joints in a row if a law, a spring or a damper needs their coordinates.

        A row that is no joint of a case is divided, too.
        """
        needed = {m for law in self.parts.laws for m in (law.motion, law.driver)}
        needed |= {m.name for p in self.parts.pieces for m in p.motions if m.sprung or m.damped}
        for piece in self.parts.pieces:
            if not piece.motions or shares[piece.name][0] == 0.0:
                continue
            base, row = self._row(piece, shares)
            found = recognise(row)
            if len(row) != 2 or (found and needed.isdisjoint({m.name for m in row} - found.coordinates.keys())):
                continue
            before = self._drawn(base, shares[base]) if base else None
            divided = between(*row, before, self._drawn(piece.name, shares[piece.name]))
            if divided is None:
                continue
            middle = self._base(piece) if len(piece.motions) == 1 else self._middle(piece)
            for name, share in zip((base, middle, piece.name), divided, strict=True):
                if name:
                    shares[name] = self._in_piece(name, share)
            self.notes.add(FILLED, middle)

    def _middle(self, piece: Piece) -> str:
        """Insert a piece between the two joints of a piece; return its name."""
        name = next(n for k in count(1) if (n := f"{piece.name}_{k}") not in self.pieces)
        first, second = piece.motions
        new = replace(piece, name=name, motions=(first,), mass=0.0, inertia=np.zeros((3, 3)))
        last = replace(piece, carrier=name, motions=(second,))
        pieces = (p for old in self.parts.pieces for p in ((new, last) if old.name == piece.name else (old,)))
        self.parts = replace(self.parts, pieces=tuple(pieces))
        self.made.add(name)
        self.pieces |= {name: new, piece.name: last}
        return name

    def _drawn(self, name: str, share: Share) -> Share:
        """Share of a piece in axes of the drawing."""
        frame, (mass, com, inertia) = self.pieces[name].frame, share
        return mass, frame.p + frame.R @ com, frame.R @ inertia @ frame.R.T

    def _in_piece(self, name: str, share: Share) -> Share:
        """Share in axes of the drawing as one in the frame of a piece."""
        frame, (mass, com, inertia) = self.pieces[name].frame, share
        return mass, frame.R.T @ (com - frame.p), frame.R.T @ inertia @ frame.R

    def _idle(self, shares: dict[str, Share]) -> set[str]:
        """Moving pieces without mass that carry no mass."""
        loaded: set[str] = set()
        for piece in reversed(self.parts.pieces):
            if piece.motions and (piece.name in loaded or shares[piece.name][0] > 0.0):
                loaded |= {piece.name, self._base(piece)}
        idle = [name for name in shares if name not in loaded]
        for name in idle:
            if np.any(shares[name][2]):
                self.notes.refuse("it has moments of inertia and no mass", name)
        self.notes.add(IDLE, *idle)
        return set(idle)

    def _row(self, piece: Piece, shares: dict[str, Share]) -> tuple[str, tuple[NativeJoint, ...]]:
        """Return the next piece with mass towards the root, and the joints on the way, past pieces without mass."""
        motions, base = piece.motions, self._base(piece)
        while base and shares[base][0] == 0.0:
            motions, base = (*self.pieces[base].motions, *motions), self._base(self.pieces[base])
        return base, motions

    def _joints(
        self, idle: set[str], shares: dict[str, Share]
    ) -> tuple[list[Joint], dict[str, tuple[str, str, float]]]:
        """Joints of the tree; joint, coordinate and sign of each joint of the file that is a coordinate of the case."""
        light = [n for n, share in shares.items() if share[0] == 0.0 and n not in idle]
        for name in light:
            carried = [p.name for p in self.parts.pieces if p.motions and p.name not in idle and self._base(p) == name]
            if len(carried) > 1:
                self.notes.refuse(f"without mass, but it carries {' and '.join(carried)}", name)
            if np.any(shares[name][2]):
                self.notes.refuse("it has moments of inertia and no mass", name)
        self.notes.add(COMPOSED, *light)
        rows = {name: self._row(self.pieces[name], shares) for name in self.kept}
        wanted = {name: "_".join(m.name for m in row) for name, (_, row) in rows.items()}
        titles = usable_names(wanted, "joint", self.notes, self.taken["joint"])
        joints: list[Joint] = []
        coordinates: dict[str, tuple[str, str, float]] = {}
        for name, (base, row) in rows.items():
            title, found = titles[name], recognise(row)
            if found is None:
                kinds = " ".join(m.kind for m in row)
                self.notes.refuse(
                    f"{len(row)} joints in a row ({kinds}) without mass between them are no joint of a case", name
                )
                continue
            if found.kind == "spherical" and len(row) == 3:
                self.notes.add(LOCKS, title)
            axes = rotation_with_z_axis(found.axis, found.second)
            F, M = self._local(base, found.at, axes), self._local(name, found.at, axes)
            joints.append(Joint(title, found.kind, self.homes[base], self.names[name], F, M))
            if found.also is not None:
                across = rotation_with_z_axis(found.also)
                F, M = self._local(base, found.at, across), self._local(name, found.at, across)
                (more,) = usable_names({"": f"{title}_parallel"}, "joint", Notes(), self.taken["joint"]).values()
                joints.append(Joint(more, "parallel_axes", self.homes[base], self.names[name], F, M))
            coordinates |= {motion: (title, c, sign) for motion, (c, sign) in found.coordinates.items()}
        return joints, coordinates

    def _local(self, name: str, at: Array, axes: Array) -> Frame:
        """Frame in the drawing as a frame of a piece, or of the ground (empty name)."""
        if not name:
            return Frame(at, axes)
        frame = self.pieces[name].frame
        return Frame(frame.R.T @ (at - frame.p), frame.R.T @ axes)

    def _bodies(self) -> Iterable[Body]:
        """Yield the bodies with mass; refuse inertia tensors that no rigid body can have."""
        for name, (mass, com, inertia) in self.kept.items():
            tensor = 0.5 * (inertia + inertia.T)  # turned tensors are symmetric up to rounding
            try:
                check_inertia(tensor, name)
            except InvalidInput as error:
                self.notes.refuse(error.what, name)
                continue
            yield Body(self.names[name], mass, com, tensor, self.pieces[name].frame)

    # ---------------------------------------------------------------- elements

    def _in_body(self, name: str, p: Array, R: Array = _ONE) -> Frame:
        """Frame of a piece, or of the ground, in axes of the body that the piece belongs to."""
        if name:
            frame = self.pieces[name].frame
            p, R = frame.p + frame.R @ p, frame.R @ R
        return self._local(self.merged_into.get(name, name), p, R)

    def _loops(self) -> Iterable[Joint]:
        """Yield the joints that close loops, with frames in axes of the bodies."""
        titles = usable_names({x.name: x.name for x in self.parts.loops}, "loop", self.notes, self.taken["joint"])
        for loop in self.parts.loops:
            ends = loop.predecessor, loop.successor
            if self._absent("loop", loop.name, ends):
                continue
            predecessor, successor = (self.homes[end] for end in ends)
            F, M = (self._in_body(n, f.p, f.R) for n, f in zip(ends, (loop.F, loop.M), strict=True))
            yield replace(loop, name=titles[loop.name], predecessor=predecessor, successor=successor, F=F, M=M)

    def _springs(self) -> Iterable[Spring]:
        """Yield the springs between points, with points in axes of the bodies."""
        wanted = {spring.name: spring.name for spring in self.parts.springs}
        titles = usable_names(wanted, "spring", self.notes, self.taken["element"])
        for spring in self.parts.springs:
            ends = spring.predecessor, spring.successor
            if not self._absent("spring", spring.name, ends):
                yield replace(
                    spring,
                    name=titles[spring.name],
                    predecessor=self.homes[ends[0]],
                    successor=self.homes[ends[1]],
                    point_predecessor=self._in_body(ends[0], spring.point_predecessor).p,
                    point_successor=self._in_body(ends[1], spring.point_successor).p,
                )

    def _absent(self, what: str, name: str, ends: tuple[str, ...]) -> bool:
        """Whether an end was left out, or both ends are on one body."""
        if any(end not in self.homes for end in ends):
            self.notes.refuse(f"the {what} ends on a piece that cannot be a body", name)
            return True
        if self.homes[ends[0]] == self.homes[ends[1]]:
            self.notes.add(f"{what} within one body, left out", name)
            return True
        return False

    def _joint_springs(self, coordinates: dict[str, tuple[str, str, float]]) -> Iterable[JointSpring]:
        """Yield springs and dampers of joints; note those whose joint has no such coordinate in the case."""
        present = [m for p in self.parts.pieces for m in p.motions if m.sprung or m.damped]
        wanted = {m.name: f"{m.name}_{'spring' if m.sprung else 'damper'}" for m in present}
        titles = usable_names(wanted, "spring", Notes(), self.taken["element"])
        for motion in present:
            if motion.name in coordinates:
                joint, coordinate, sign = coordinates[motion.name]
                name = titles[motion.name]
                law = motion.stiffness, motion.damping, sign * motion.rest
                # k1 belongs to an effort even in the coordinate; what belongs to k2, c1 and c2 is odd
                stiffness = tuple(k * sign**n for n, k in enumerate(motion.higher_stiffness, start=1))
                yield JointSpring(name, joint, coordinate, *law, None, stiffness, motion.higher_damping)
            else:
                self.notes.add(NO_COORDINATE, motion.name)

    def _laws(self, coordinates: dict[str, tuple[str, str, float]], idle: set[str]) -> dict[str, tuple[Any, ...]]:
        """Couplings and constant drives; note or refuse laws without their coordinates in the case."""
        gone = {m.name for name in idle for m in self.pieces[name].motions}
        titles = usable_names({x.name: x.name for x in self.parts.laws}, "law", Notes(), self.taken["element"])
        couplings, drives = list[Coupling](), list[Drive]()
        for law in self.parts.laws:
            ends = (law.motion, law.driver) if law.driver else (law.motion,)
            if law.motion in gone:
                self.notes.add("coupling of a joint that was left out", law.name)
            elif missing := [m for m in ends if m not in coordinates]:
                self.notes.refuse(f"it couples {' and '.join(missing)}, no coordinate of a joint of the case", law.name)
            elif law.driver:
                couplings.append(_coupling(titles[law.name], law, coordinates))
            else:
                joint, coordinate, sign = coordinates[law.motion]
                motion = Function(np.array([sign * law.coefficients[0]]))
                drives.append(Drive(titles[law.name], joint, coordinate, motion))
        return {"couplings": tuple(couplings), "drives": tuple(drives)}


def _with_something(lump: list[Share]) -> list[Share]:
    """Shares with mass or inertia, or all: a frame without mass must not change digits of the others."""
    return [share for share in lump if share[0] or np.any(share[2])] or lump


def _coupling(name: str, law: CoordinateLaw, coordinates: dict[str, tuple[str, str, float]]) -> Coupling:
    joint, coordinate, sign = coordinates[law.motion]
    driver_joint, driver_coordinate, turn = coordinates[law.driver]
    powers = [sign * c * turn**k for k, c in enumerate(law.coefficients)]
    return Coupling(name, driver_joint, driver_coordinate, joint, coordinate, Function(np.array(powers)))


def build(parts: Parts, notes: Notes) -> Built:
    """Return the mechanism of the parts of a model.

    Raises
    ------
    InvalidInput
        Parts that no case can express, all in one message.
    """
    return _Builder(parts, notes).build()
