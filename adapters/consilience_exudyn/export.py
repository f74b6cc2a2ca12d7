"""An assembled Exudyn system as a script: its items as Exudyn itself tells them, and the laws of its user functions.

Constraints that are user functions of the adapter (screws, drives, couplings, skates, rounded rolling bodies) are user
functions of the script. Their second derivatives, which Exudyn does not ask for, are written beside them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

from consilience.engine.native import FRICTION, JET, ROWS, SOLVE, function_data, row_data, script
from consilience.mechanism import GROUND, RANK_TOLERANCE, Joint, Mechanism, State, linear
from consilience_exudyn.constraints import Added
from consilience_exudyn.efforts import efforts_of
from consilience_exudyn.export_rows import CONNECTIONS
from consilience_exudyn.export_script import CODE
from consilience_exudyn.library import POINTWISE, exu
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

_KINDS = ("Node", "Object", "Marker", "Load")


def _item(told: dict[str, Any]) -> dict[str, Any]:
    """An item without what draws it, without user functions, and without what is empty."""
    found = {}
    for name, value in told.items():
        dense = value.Convert2DenseMatrix() if isinstance(value, exu.MatrixContainer) else value
        unwritten = name.startswith("V") or name.endswith("UserFunction")
        if not unwritten and not (isinstance(dense, np.ndarray) and dense.size == 0):
            found[name] = dense
    return found


def _items(system: Any) -> dict[str, list[dict[str, Any]]]:
    data = system.systemData
    return {
        f"{kind.upper()}S": [
            _item(getattr(system, f"Get{kind}")(k)) for k in range(getattr(data, f"NumberOf{kind}s")())
        ]
        for kind in _KINDS
    }


def _with_user_function(system: Any, kind: str, wanted: Callable[[str], bool]) -> list[int]:
    """Numbers of items of a type that have a user function, in their order."""
    count = getattr(system.systemData, f"NumberOf{kind}s")()
    told = [getattr(system, f"Get{kind}")(k) for k in range(count)]
    return [
        k
        for k, item in enumerate(told)
        if wanted(item[f"{kind.lower()}Type"])
        and any(isinstance(v, dict) for n, v in item.items() if n.endswith("UserFunction"))
    ]


def _laws(model: Maximal) -> dict[str, Any]:
    """Laws by the number of the load or object that has them."""
    m, system = model.mechanism, model.system
    loads = _with_user_function(system, "Load", lambda _: True)
    histories = [load for load in m.loads if load.history is not None]
    actuators = _with_user_function(system, "Object", lambda kind: kind == "ConnectorSpringDamper")
    actuated = [spring for spring in m.springs if spring.actuator is not None]
    connectors = _with_user_function(
        system, "Object", lambda kind: kind in ("ConnectorTorsionalSpringDamper", "ConnectorLinearSpringDamper")
    )
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
        "INTEGRATOR": _with_user_function(system, "Object", lambda kind: kind == "GenericODE2"),
    }


def _effort(m: Mechanism, joint: str, coordinate: str) -> dict[str, Any]:
    """Everything that acts in one coordinate, as `efforts.Effort` has it."""

    def here(x: Any) -> bool:
        return (x.joint, x.coordinate) == (joint, coordinate)

    with_memory = [c for c in m.controls if c.integral]
    return {
        "angle": coordinate == "angle",
        "actuators": [function_data(s.actuator) for s in m.joint_springs if here(s) and s.actuator is not None],
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
"""What the script calls the rows that are user functions, those of screws before those of couplings."""


def _connections(added_rows: tuple[Added, ...]) -> dict[int, list[Any]]:
    """Kind, place among its kind, and bodies by the object's number; in the order of the script's ``held``."""
    seen: Counter[str] = Counter()
    found: dict[int, list[Any]] = {}
    # drives come before screws there
    for added in sorted(added_rows, key=lambda added: not isinstance(added.row, DriveRow)):
        if not isinstance(added.row, DiscRow):
            kind = _CONNECTIONS[type(added.row)]
            found[int(added.index)] = [kind, seen[kind], added.row.bodies]
            seen[kind] += 1
    return found


def _frames(joint: Joint) -> list[Any]:
    return [[joint.predecessor, joint.F.p, joint.F.R], [joint.successor, joint.M.p, joint.M.R], joint.pitch]


def _rows(model: Maximal) -> dict[str, Any]:
    """Data of constraints that are user functions: a screw is a coupling of its distance to its angle."""
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
        "ROLLINGS": [rolling for rolling in data["ROLLINGS"] if rolling["rounding"]],  # Exudyn has discs
        "FRAMES": {joint.name: _frames(joint) for joint in m.joints if joint.name in used},
        "CONNECTIONS": _connections(model.rows),
    }


def _discs(model: Maximal) -> list[dict[str, Any]]:
    names = ("center", "axis", "radius", "normal")
    return [
        {
            "object": int(added.index),
            "body": model.mechanism.body_index[added.row.rolling.body],
            **{name: getattr(added.row.rolling, name) for name in names},
        }
        for added in model.rows
        if isinstance(added.row, DiscRow)
    ]


def export_model(title: str, mechanism: Mechanism, state: State) -> dict[str, str]:
    """``run.py``, which adds the items of the system one by one.

    Parameters
    ----------
    state : State
        Where the script starts.
    """
    model = build(mechanism, state)
    added = {int(row.index) for row in model.rows}
    native = [int(i) for objects in model.joints for i in objects if int(i) not in added]
    rods = {
        int(objects[0]): joint.length
        for joint, objects in zip(mechanism.joints, model.joints, strict=True)
        if joint.kind == "rod" and objects
    }
    constants = {
        **_items(model.system),
        **_laws(model),
        **_rows(model),
        "BODIES": {body.name: [body.name, np.zeros(3), np.eye(3)] for body in mechanism.bodies},
        "JOINTS": native,
        "RODS": [[number, length] for number, length in rods.items()],
        "DISCS": _discs(model),
        "Q": np.append(coordinates(state), np.zeros(model.integrals)),
        "V": np.append(velocities(state), np.zeros(model.integrals)),
        "QUATERNIONS": state.quat_WB,
        "TURNS": [displacement_turns(mechanism, state, joint) for joint in model.turning],
        "SETTINGS": POINTWISE,
        "TOLERANCE": RANK_TOLERANCE,
    }
    about = f"{title}, for Exudyn {exu.__version__} alone, in redundant coordinates."
    imports = (
        "import json\nimport math\nimport os\nfrom functools import reduce\n\n"
        'os.environ["EXUDYN_NO_USER_SETTINGS"] = "1"  # read at import\n\nimport exudyn as exu\nimport numpy as np'
    )
    return {"run.py": script(about, imports, constants, JET, FRICTION, SOLVE, CONNECTIONS, ROWS, CODE)}
