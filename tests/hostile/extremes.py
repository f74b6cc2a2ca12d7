"""Extreme but valid mechanisms: sizes near zero and huge, contradictions, singular drawings, tables that are too short.

Each is a shipped case and a few steps ``(kind, place, choice)``, as in `mutations`; every number stays finite and every
name known, so that the mechanics meet the input. It is refused with a message or answered, with finite numbers.
"""

import copy
import warnings
from contextlib import suppress

import numpy as np

from consilience.case import Case
from consilience.case.file.reader import load_file
from consilience.compare.instants import Instants
from consilience.engine import Question
from consilience.errors import ConsilienceError
from consilience.mechanism import fastest_rate
from consilience.reference.engine import ReferenceEngine
from consilience.suite import QUICK
from hostile.mutations import places, toml_bytes
from hostile.pages import check_terminal
from hostile.properties import case_seeds, examined
from hostile.watch import watched

FACTORS = (1e-12, 1e-9, 1e-6, 1e-3, 1e3, 1e6, 1e9, 1e12)

_LENGTHS = ("at", "to", "com", "pitch", "free_length", "radius", "point", "distance", "x", "y", "position")
_INERTIAS = ("xx", "yy", "zz", "xy", "xz", "yz")
_TIMES = ("duration", "sample")
_FORCES = ("stiffness", "damping", "coulomb", "viscous", "speed", "proportional", "vector", "gravity")


def _multiply(root, names, factor):
    for container, key in places(root):
        if key in names:
            container[key] = _times(container[key], factor)


def _times(value, factor):
    if isinstance(value, list):
        return [_times(one, factor) for one in value]
    return value * factor if isinstance(value, int | float) and not isinstance(value, bool) else value


def _tables(root, *kinds):
    return [table for kind in kinds for table in root.get(kind, []) if isinstance(table, dict)]


def _one(items, choice):
    return items[choice % len(items)] if items else None


def _scale_lengths(root, _place, choice):
    _multiply(root, _LENGTHS, FACTORS[choice % len(FACTORS)])


def _scale_consistently(root, place, choice):
    """Lengths, and moments of inertia with their squares."""
    factor = FACTORS[choice % len(FACTORS)]
    _multiply(root, _LENGTHS, factor)
    _multiply(root, _INERTIAS, factor**2)


def _scale_masses(root, place, choice):
    body = _one(_tables(root, "body"), place)
    if body:
        _multiply(body, ("mass", *_INERTIAS), FACTORS[choice % len(FACTORS)])


def _scale_times(root, _place, choice):
    _multiply(root, _TIMES, FACTORS[choice % len(FACTORS)])


def _scale_forces(root, place, choice):
    _multiply(root, (_FORCES[place % len(_FORCES)],), FACTORS[choice % len(FACTORS)])


def _no_length(root, place, choice):
    """Two ends in one point, or nearly."""
    table = _one(_tables(root, "spring", "joint"), place)
    if table and "at" in table:
        table["to"] = [x + (0.0, 1e-16, 1e-12, 1e-6)[choice % 4] for x in table["at"]]


def _spring(root, place, choice):
    body = _one(_tables(root, "body"), place)
    if body and "at" in body:
        free = (0.0, 1.0, 1e-9, -1.0)[choice % 4]
        ends = {"predecessor": "ground", "successor": body["name"], "at": body["at"], "to": body["at"]}
        root.setdefault("spring", []).append(
            {"name": f"extreme {place} {choice}", **ends, "stiffness": 1e3, "damping": 1.0, "free_length": free}
        )


def _coincide(root, place, choice):
    """Joints in one place, or with one axis."""
    joints = _tables(root, "joint")
    one, other = _one(joints, place), _one(joints, choice)
    for name in ("at", "axis") if choice % 2 else ("at",):
        if one and other and name in one and name in other:
            one[name] = list(other[name])


def _hold(root, place, choice):
    joint = _one(_tables(root, "joint"), place)
    kinds = {"revolute": "angle", "prismatic": "distance", "screw": "angle", "cylindrical": "distance"}
    if joint and joint.get("kind") in kinds:
        group = root.setdefault("initial", {}).setdefault("rates" if choice % 3 == 0 else "joints", {})
        group[joint["name"]] = {kinds[joint["kind"]]: (0.0, 1e-9, 1.0, np.pi, 100.0, 1e6)[choice % 6]}


def _drive(root, place, choice):
    """A drive, perhaps the second of a joint, by a table that may be too short."""
    joint = _one(_tables(root, "joint"), place)
    kinds = {"revolute": "angle", "prismatic": "distance", "screw": "angle", "cylindrical": "angle"}
    if joint and joint.get("kind") in kinds:
        span = (1e-6, 0.5, 1.0, 10.0)[choice % 4]
        x = [span * n / 6 for n in range(7)]
        motion = (
            {"table": {"x": x, "y": [0.1 * value for value in x]}} if choice % 8 < 4 else {"polynomial": [choice % 3]}
        )
        own = {"joint": joint["name"], "coordinate": kinds[joint["kind"]], "motion": motion}
        root.setdefault("drive", []).append({"name": f"extreme {place} {choice}", **own})


def _couple(root, place, choice):
    """A cam whose table is short."""
    joints = [j for j in _tables(root, "joint") if j.get("kind") in ("revolute", "prismatic")]
    one, other = _one(joints, place), _one(joints, choice)
    if one and other and one is not other:
        named = {"revolute": "angle", "prismatic": "distance"}
        width = (1e-9, 0.01, 0.3, 10.0)[choice % 4]
        x = [width * n / 3 for n in range(-3, 4)]
        law = {"table": {"x": x, "y": [value * value for value in x]}}
        drives = {"driver_joint": one["name"], "driver_coordinate": named[one["kind"]]}
        driven = {"joint": other["name"], "coordinate": named[other["kind"]], "law": law}
        root.setdefault("coupling", []).append({"name": f"extreme {place} {choice}", **drives, **driven})


EXTREME_STEPS = {
    "lengths": _scale_lengths,
    "size": _scale_consistently,
    "masses": _scale_masses,
    "times": _scale_times,
    "forces": _scale_forces,
    "no length": _no_length,
    "spring": _spring,
    "coincide": _coincide,
    "hold": _hold,
    "drive": _drive,
    "couple": _couple,
}
"""Steps on the tables of a case: of all tables, a place and a choice."""

EXTREME_KINDS = tuple(EXTREME_STEPS)


def extreme_mutants(steps):
    """Strategy of extreme cases, as bytes."""
    from hypothesis import strategies as st

    seeds = [tables for _, tables in case_seeds()]

    def written(drawn):
        root = copy.deepcopy(seeds[drawn[0]])
        for kind, place, choice in drawn[1]:
            EXTREME_STEPS[kind](root, place, choice)
        return toml_bytes(root)

    return st.tuples(st.sampled_from(range(len(seeds))), steps(EXTREME_KINDS, 3)).map(written)


def swallow_extreme(raw, folder):
    """Process a case as commands and the reference do at its states; return whether it was answered."""
    path = folder / "input.toml"
    path.write_bytes(raw)
    with watched(folder), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            for case in load_file(path)[:1]:
                _answer(QUICK.case(case))
        except ConsilienceError as error:
            check_terminal(str(error))
            return False
    return True


def _answer(case: Case):
    examined(case)
    rate = fastest_rate(case.mechanism, case.initial_state)
    assert not np.isnan(rate)
    engine = ReferenceEngine()
    Instants.of(case.mechanism, case.states)
    for method in engine.methods(case.mechanism, Question.INSTANT):
        answer = engine.instant(case.mechanism, case.states, method)
        assert np.isfinite(answer.a_WB_W).all()
        assert np.isfinite(answer.alpha_WB_W).all()


def warm_extreme(folder):
    """Load the kernels that answers at states need, and what they raise."""
    path = folder / "warm.toml"
    for _, tables in case_seeds():
        for choice in (None, 0):
            changed = copy.deepcopy(tables)
            if choice is not None:
                _scale_lengths(changed, 0, choice)
            path.write_bytes(toml_bytes(changed))
            with suppress(ConsilienceError), warnings.catch_warnings():
                warnings.simplefilter("ignore")
                _answer(QUICK.case(load_file(path)[0]))
