"""Export of a skeleton as a script for DART alone; elements that DART lacks are code of the script."""

from __future__ import annotations

from typing import Any

import dartpy
import numpy as np

from consilience.engine import suited_rods
from consilience.engine.native import ELEMENTS, JET, SOLVE, Places, element_data, script
from consilience.mechanism import GROUND, RANK_TOLERANCE, Link, Mechanism, State
from consilience_dart.export_script import CODE, RUN
from consilience_dart.state import from_state, send
from consilience_dart.translation import CREATORS, SCREW, Model, build, remainder, sprung


def _links(model: Model) -> list[list[Any]]:
    """Name, parent, creator of the joint, axis, pitch, placement, mass, centre of mass and inertia of each link."""
    tree, mechanism, found = model.tree, model.mechanism, []
    for link in tree.links:
        pitch = mechanism.joints[link.joint].pitch
        parent = tree.links[link.parent].name if link.parent >= 0 else ""
        free = link.elementary == "F"  # a free joint keeps the identity
        place = [np.zeros(3), np.eye(3)] if free else [link.placement.p, link.placement.R]
        creator = SCREW if pitch else CREATORS[link.elementary]
        axis = link.elementary in ("R", "P")
        found.append([link.name, parent, creator, axis, pitch, *place, link.mass, link.com, link.inertia])
    return found


def _joint_springs(model: Model) -> list[list[Any]]:
    """Link, stiffness, damping and rest position of each joint with a spring."""
    found = []
    for i in sprung(model.mechanism, model.tree):
        joint, name = model.joints[i], model.tree.links[i].name
        found.append([name, joint.getSpringStiffness(0), joint.getDampingCoefficient(0), joint.getRestPosition(0)])
    return found


def _frame(link: Link) -> list[Any]:
    """Name of a link, and frame B of its body in the link."""
    return [link.name, link.body_frame.p, link.body_frame.R]


def _places(model: Model) -> Places:
    index, links = model.mechanism.body_index, model.tree.links

    def frame(body: str) -> list[Any]:
        return ["", np.zeros(3), np.eye(3)] if body == GROUND else _frame(links[model.carriers[index[body]]])

    def axis(joint: str, coordinate: str) -> list[Any]:
        place = model.axes[joint, coordinate]
        owner = next(link.name for link, own in zip(links, model.joints, strict=True) if own is place.joint)
        return [owner, place.sign]

    return Places(frame, axis, exerted=remainder)


def export_model(title: str, mechanism: Mechanism, state: State) -> dict[str, str]:
    """Return the script ``run.py``, which builds the skeleton and prints accelerations.

    Parameters
    ----------
    title : str
    mechanism : Mechanism
    state : State
        Initial state of the script.
    """
    model = build(suited_rods(mechanism, state))
    send(model, from_state(model, state))
    links = model.tree.links
    constants = {
        "GRAVITY": mechanism.gravity,
        "LINKS": _links(model),
        "JOINT_SPRINGS": _joint_springs(model),
        "WELDS": [[_frame(links[weld.original]), _frame(links[weld.copy])] for weld in model.tree.welds],
        "POSITIONS": model.skeleton.getPositions(),
        "VELOCITIES": model.skeleton.getVelocities(),
        "RANK_TOLERANCE": RANK_TOLERANCE,
        **element_data(mechanism, _places(model)),
    }
    about = f"{title}, for DART {dartpy.__version__} alone."
    imports = "import json\nimport math\n\nimport dartpy\nimport numpy as np"
    return {"run.py": script(about, imports, constants, JET, CODE, ELEMENTS, SOLVE, RUN)}
