"""Export of an assembled Exudyn system as a script: the items as returned by Exudyn, and laws of user functions.

Constraints that are user functions of the adapter (screws, drives, couplings, skates, rounded rolling bodies) are user
functions of the script, which also contains their right-hand sides for accelerations at a state.
"""

from __future__ import annotations

from collections import Counter
from inspect import getsource
from typing import Any

import numpy as np

from consilience.engine import nonlinear_part
from consilience.engine.native import JET, LAWS, ROWS, SOLVE, function_data, refuse_contacts, row_data, script
from consilience.mechanism import GROUND, RANK_TOLERANCE, Joint, Mechanism, State, characteristic_length, linear
from consilience_exudyn.constraints import Added, rate_map, rotation
from consilience_exudyn.efforts import efforts_of
from consilience_exudyn.export_rows import CONNECTIONS
from consilience_exudyn.export_script import CODE
from consilience_exudyn.library import POINTWISE, exu, simulation_settings
from consilience_exudyn.maximal import Maximal, build, coordinates, velocities
from consilience_exudyn.rows import (
    TURN,
    ContactRow,
    CouplingRow,
    DiscRow,
    DriveRow,
    Row,
    ScrewRow,
    SkateRow,
    SlipRow,
    displacement_turns,
)
from consilience_exudyn.terms import convective_terms

_KINDS = ("Node", "Object", "Marker", "Load")


def _items(system: Any, kind: str) -> list[dict[str, Any]]:
    """Items of a kind of `_KINDS`, as returned by Exudyn."""
    return [getattr(system, f"Get{kind}")(k) for k in range(getattr(system.systemData, f"NumberOf{kind}s")())]


def _written(item: dict[str, Any]) -> dict[str, Any]:
    """Item without graphics, user functions and empty arrays."""
    found = {}
    for name, value in item.items():
        dense = value.Convert2DenseMatrix() if isinstance(value, exu.MatrixContainer) else value
        unwritten = name.startswith("V") or name.endswith("UserFunction")
        if not unwritten and not (isinstance(dense, np.ndarray) and dense.size == 0):
            found[name] = dense
    return found


def _with_user_function(system: Any, kind: str) -> list[tuple[str, int]]:
    """Type and number of the items of a kind with a user function, in their order."""
    return [
        (item[f"{kind.lower()}Type"], k)
        for k, item in enumerate(_items(system, kind))
        if any(isinstance(value, dict) for name, value in item.items() if name.endswith("UserFunction"))
    ]


def _laws(model: Maximal) -> dict[str, Any]:
    """Laws by the numbers of their loads and objects."""
    m, system = model.mechanism, model.system
    loads = [number for _, number in _with_user_function(system, "Load")]
    objects = _with_user_function(system, "Object")
    histories = [load for load in m.loads if load.history is not None]
    actuators = [number for kind, number in objects if kind == "ConnectorSpringDamper"]
    actuated = [spring for spring in m.springs if spring.actuator is not None]
    on_joints = ("ConnectorTorsionalSpringDamper", "ConnectorLinearSpringDamper")
    connectors = [number for kind, number in objects if kind in on_joints]
    efforts = dict(zip(efforts_of(m), connectors, strict=True))
    integrals = [
        {"connector": efforts[c.joint, c.coordinate], "turns": c.coordinate == "angle", "f": function_data(c.target)}
        for c in m.controls
        if c.integral
    ]
    return {
        "HISTORIES": {
            n: {"vector": x.vector, "f": function_data(x.history)}
            for n, x in zip(loads, histories, strict=True)
            if x.history
        },
        "ACTUATORS": {n: function_data(s.actuator) for n, s in zip(actuators, actuated, strict=True) if s.actuator},
        "EFFORTS": {number: _effort(m, *where) for where, number in efforts.items()},
        "INTEGRALS": integrals,
        "INTEGRATOR": [number for kind, number in objects if kind == "GenericODE2"],
    }


def _effort(m: Mechanism, joint: str, coordinate: str) -> dict[str, Any]:
    """Data of all efforts in one coordinate, as in `efforts.efforts_of`."""

    def here(x: Any) -> bool:
        return (x.joint, x.coordinate) == (joint, coordinate)

    with_memory = [c for c in m.controls if c.integral]
    return {
        "angle": coordinate == "angle",
        "actuators": [function_data(s.actuator) for s in m.joint_springs if here(s) and s.actuator is not None],
        "springs": [[s.rest, *nonlinear_part(s).laws] for s in m.joint_springs if here(s) and not s.is_linear],
        "frictions": [[f.viscous, f.coulomb, f.speed] for f in m.frictions if here(f)],
        "controls": [
            {
                "P": c.proportional,
                "D": c.derivative,
                "I": c.integral,
                "place": with_memory.index(c) if c.integral else -1,
                "f": function_data(c.target),
            }
            for c in m.controls
            if here(c)
        ],
    }


_CONNECTIONS: dict[type[Row], str] = {
    DriveRow: "drive",
    ScrewRow: "coupling",
    CouplingRow: "coupling",
    ContactRow: "contact",
    SlipRow: "slip",
    SkateRow: "skate",
}
"""Names in the script of the rows that are user functions; screws come before couplings."""


def _connections(added_rows: tuple[Added, ...]) -> dict[int, list[Any]]:
    """Kind, place within the kind, and bodies by object number, in the order of ``held`` of the script."""
    seen: Counter[str] = Counter()
    found: dict[int, list[Any]] = {}
    # ``held`` has drives before screws
    for added in sorted(added_rows, key=lambda added: not isinstance(added.row, DriveRow)):
        if not isinstance(added.row, DiscRow):
            kind = _CONNECTIONS[type(added.row)]
            found[int(added.index)] = [kind, seen[kind], added.row.bodies]
            seen[kind] += 1
    return found


def _frames(joint: Joint) -> list[Any]:
    return [[joint.predecessor, joint.F.p, joint.F.R], [joint.successor, joint.M.p, joint.M.R], joint.pitch]


def _rows(model: Maximal) -> dict[str, Any]:
    """Data of constraints that are user functions; a screw is a coupling of its distance to its angle."""
    m = model.mechanism
    data = row_data(m, lambda joint, coordinate: [joint, coordinate])
    screws = [
        [[joint.name, "distance"], [joint.name, "angle"], function_data(linear(joint.pitch / TURN))]
        for joint in m.joints
        if joint.kind == "screw"
    ]
    couplings = screws + data["COUPLINGS"]
    used = {place[0] for place, _ in data["DRIVES"]} | {place[0] for pair in couplings for place in pair[:2]}
    return data | {
        "GROUND": GROUND,
        "WELDS": [],
        "COUPLINGS": couplings,
        "ROLLINGS": [rolling for rolling in data["ROLLINGS"] if rolling["rounding"]],  # discs are Exudyn's
        "FRAMES": {joint.name: _frames(joint) for joint in m.joints if joint.name in used},
        "CONNECTIONS": _connections(model.rows),
    }


def _discs(model: Maximal) -> list[dict[str, Any]]:
    discs = [(int(added.index), added.row.rolling) for added in model.rows if isinstance(added.row, DiscRow)]
    index = model.mechanism.body_index
    return [vars(rolling) | {"object": number, "body": index[rolling.body]} for number, rolling in discs]


def export_model(title: str, mechanism: Mechanism, state: State) -> dict[str, str]:
    """Return the script ``run.py``, which adds the items of the system one by one and prints accelerations.

    Parameters
    ----------
    title : str
    mechanism : Mechanism
    state : State
        Initial state of the script.

    Raises
    ------
    InvalidInput
        See `consilience.engine.native.refuse_contacts`.
    """
    refuse_contacts(mechanism)
    model = build(mechanism, state)
    added = {int(row.index) for row in model.rows}
    native = [int(i) for objects in model.joints for i in objects if int(i) not in added]
    rods = {
        int(objects[0]): joint.length
        for joint, objects in zip(mechanism.joints, model.joints, strict=True)
        if joint.kind == "rod" and objects
    }
    constants = {
        **{f"{kind.upper()}S": [_written(item) for item in _items(model.system, kind)] for kind in _KINDS},
        **_laws(model),
        **_rows(model),
        "BODIES": {body.name: [body.name, np.zeros(3), np.eye(3)] for body in mechanism.bodies},
        "JOINTS": native,
        "LENGTH": characteristic_length(mechanism),
        "RODS": [[number, length] for number, length in rods.items()],
        "DISCS": _discs(model),
        "Q": np.append(coordinates(state), np.zeros(model.integrals)),
        "V": np.append(velocities(state), np.zeros(model.integrals)),
        "QUATERNIONS": state.quat_WB,
        "TURNS": [displacement_turns(mechanism, state, joint) for joint in model.turning],
        "SETTINGS": POINTWISE,
        "RANK_TOLERANCE": RANK_TOLERANCE,
    }
    about = f"{title}, for Exudyn {exu.__version__} alone, in redundant coordinates."
    imports = (
        "import json\nimport math\nimport os\nfrom functools import reduce\n\n"
        'os.environ["EXUDYN_NO_USER_SETTINGS"] = "1"  # read at import\n\nimport exudyn as exu\nimport numpy as np'
    )
    shared = ["\n" + getsource(function) for function in (rotation, rate_map, simulation_settings, convective_terms)]
    return {"run.py": script(about, imports, constants, JET, LAWS, SOLVE, *shared, CONNECTIONS, ROWS, CODE)}
