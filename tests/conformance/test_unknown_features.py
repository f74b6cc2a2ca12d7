"""Joint kinds and elements that no adapter translates yet: every adapter refuses them by name."""

import json
import subprocess
import sys

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
