"""Joint kinds and elements that no adapter translates yet: every adapter refuses them by name."""

import json
import subprocess
import sys

import numpy as np
import pytest

from consilience.engine import Question, Unsupported, load_engine
from consilience.mechanism import (
    GROUND,
    Body,
    BoxPlane,
    CapsulePlane,
    Compliance,
    Cone,
    DiscPlane,
    DryFriction,
    Frame,
    Joint,
    Mechanism,
    SphereSphere,
    Stop,
)
from contact_problems import Lab
from pages import ROOT, blocks

ADAPTERS = ("dart", "exudyn", "mujoco", "pinocchio")

ASK = """
import importlib.util, json, sys
from dataclasses import replace
import numpy as np
from consilience.mechanism import joints, model

# before any adapter is imported: as if the kind stood in the table of joints
joints.JOINT_KINDS["cam"] = joints.JointKind(("X", "Y", "D13"), ("angle",))
known = model.Mechanism.features.func
model.Mechanism.features = property(lambda self: known(self) | {"magnet": "magnet 'm'"})

from consilience.engine import Question, load_engine

spec = importlib.util.spec_from_file_location("consilience_textbook", sys.argv[1])
textbook = importlib.util.module_from_spec(spec)
spec.loader.exec_module(textbook)
engines = {name: load_engine(name) for name in sys.argv[2:]} | {"textbook": textbook.TextbookEngine()}

still = model.Frame(np.zeros(3), np.eye(3))
body = model.Body("b", 1.0, np.zeros(3), np.eye(3), still)
mechanism = model.Mechanism(
    "m", np.zeros(3), (body,), (model.Joint("j", "cam", "ground", "b", still, still),)
)
found = {
    f"{name}, {question}": [[one.feature, one.reason] for one in engine.unsupported(mechanism, question)]
    for name, engine in engines.items()
    for question in Question
}
print(json.dumps(found))
"""


def test_an_unknown_joint_kind_and_an_unknown_element_are_refused_by_name(tmp_path):
    (block,) = [b for b in blocks(ROOT / "docs" / "add-an-engine.md") if b.file == "consilience_textbook.py"]
    path = tmp_path / block.file
    path.write_text(block.text)
    command = [sys.executable, "-c", ASK, str(path), *ADAPTERS]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300)
    answers = json.loads(done.stdout.splitlines()[-1])
    assert {name.partition(",")[0] for name in answers} == {*ADAPTERS, "textbook"}
    for name, refused in answers.items():
        reasons = dict(refused)
        assert "cam joint" in reasons.get("joint 'j'", ""), name
        assert "magnet" in reasons.get("magnet 'm'", ""), name


LAWS = (
    {"restitution": 0.5},
    {"restitution": 0.5, "rebound_threshold": 0.1},
    {"friction": 0.3, "static_friction": 0.4},
    *({"friction": 0.3, "cone": Cone(kind)} for kind in ("pyramid", "box")),
    {"friction": 0.3, "associated": True},
    *({"restitution": 0.5, "impact_law": law} for law in ("moreau", "poisson")),
    *({"friction": 0.3, moment: 0.01} for moment in ("torsional", "rolling")),
    {"compliance": Compliance(1e4)},
)
"""Every law of a contact that has a name of its own among the features."""


def touching_mechanisms():
    """Return mechanisms that have every feature of contacts, stops and dry friction between them."""
    lab, here, c = Lab(), Frame(np.zeros(3), np.eye(3)), np.zeros(3)
    up = lab.axes[:, 2]
    pairs = [lab.sphere(0.1, **law) for law in LAWS]
    pairs += [
        DiscPlane("rim", "body", c, lab.axes[:, 0], 0.1, GROUND, lab.origin, up),
        BoxPlane("box", "body", c, np.full(3, 0.1), GROUND, lab.origin, up),
        CapsulePlane("pill", "body", c, up, 0.1, GROUND, lab.origin, up),
        SphereSphere("balls", "body", c, 0.1, GROUND, lab.origin, 0.1),
        *lab.points([c]),
    ]
    body, pin = Body("b", 1.0, c, np.eye(3), here), Joint("pin", "revolute", GROUND, "b", here, here)
    held = [Stop("end", "pin", "angle", -1.0), Stop("end", "pin", "angle", -1.0, restitution=0.5)]
    rubbing = [DryFriction("rub", "pin", "angle", 1.0), DryFriction("rub", "pin", "angle", coefficient=0.1, radius=0.1)]
    yield from (lab.free_body(1.0, np.ones(3), c, [pair]) for pair in pairs)
    yield from (Mechanism("stopped", c, (body,), (pin,), stops=(one,)) for one in held)
    yield from (Mechanism("rubbed", c, (body,), (pin,), dry_frictions=(one,)) for one in rubbing)


@pytest.mark.parametrize("name", ADAPTERS)
def test_each_law_of_contact_that_an_engine_lacks_is_refused_with_a_reason(name):
    engine = load_engine(name)
    for mechanism in touching_mechanisms():
        for refused in engine.unsupported(mechanism, Question.TRAJECTORY):
            _, listed, told = refused.reason.partition("has no translation for: ")
            feature, _, why = told.partition(" (")
            assert not listed or (feature in mechanism.features and why), refused


def test_a_reason_with_a_semicolon_is_one_reason_in_a_record():
    refused = [Unsupported("rim", "there is none; a cylinder has two"), Unsupported("box", "it has axes of its own")]
    assert "; ".join(map(str, refused)).split("; ") == [
        "rim: there is none, a cylinder has two",
        "box: it has axes of its own",
    ]
