"""New case files from the starter: load, run, explain their fields, and overwrite no file."""

import re

import numpy as np
import pytest

from consilience.case import load_cases, read_motion
from consilience.case.file.reader import load_file
from consilience.case.file.schema import case_schema
from consilience.cli.commands.new import copied_text, starter_text, write_new
from consilience.errors import InvalidInput
from consilience.mechanism import centres_of_mass, kinetic_energy, potential_energy
from consilience.reference import simulate

EXPLAINED = (
    "CaseTable",
    "BodyTable",
    "InertiaTable",
    "JointTable",
    "Orientation",
    "SpringTable",
    "JointSpringTable",
    "ForceTable",
    "TorqueTable",
    "FrictionTable",
    "ControlTable",
    "InitialTable",
    "BodyGuess",
    "TrajectoryTable",
    "InstantTable",
    "PublishedTable",
)
"""Tables of the schema; the starter names each of their fields."""

LEFT_TO_THE_SCHEMA = {
    "drive",
    "coupling",
    "rolling",
    "skate",
    "contact",
    "stop",
    "dry_friction",
    "variants",
    "pitch",
    "joint",
}
"""Fields of these tables that the starter leaves to the schema."""


def all_examples(name):
    """Return the starter text with all commented examples uncommented."""
    return starter_text(name).replace("#| ", "")


def test_the_starter_loads_runs_and_meets_the_value_it_states(tmp_path):
    path = write_new("mine", None, tmp_path / "mine.toml")
    (case,) = load_file(path)
    assert case.title == "mine"
    assert "NAME" not in path.read_text()
    answer = simulate(case.mechanism, case.initial_state, case.times, 1e-11)
    for known in case.published:
        assert known.off(read_motion(case.mechanism, known, answer)) <= known.uncertainty
    energies = [
        kinetic_energy(case.mechanism, answer.state(n)) + potential_energy(case.mechanism, answer.state(n))
        for n in (0, len(case.times) - 1)
    ]
    assert energies[1] == pytest.approx(energies[0], rel=1e-9)


def test_every_example_of_the_starter_can_be_taken_in(tmp_path):
    path = tmp_path / "all.toml"
    path.write_text(all_examples("all"))
    (case,) = load_file(path)
    assert len(case.states) == 20
    m = case.mechanism
    assert [len(group) for group in (m.joints, m.springs, m.joint_springs, m.loads, m.frictions, m.controls)] == [
        3, 1, 1, 2, 1, 1,
    ]  # fmt: skip
    answer = simulate(m, case.initial_state, case.times[:5], 1e-9)
    assert np.all(np.isfinite(answer.p_WB))


def test_the_starter_names_every_field_of_the_usual_tables():
    schema = case_schema()
    text = starter_text("mine")
    for table in EXPLAINED:
        properties = schema["properties"] if table == "CaseTable" else schema["$defs"][table]["properties"]
        for field in set(properties) - LEFT_TO_THE_SCHEMA:
            assert re.search(rf"\b{field}\b", text), f"{table}.{field}"


def test_a_family_and_a_shipped_case_can_be_started_from(tmp_path):
    (case,) = load_file(write_new("rods", "parallel_rods:rods=3", tmp_path / "rods.toml"))
    assert (case.name, len(case.mechanism.bodies)) == ("rods", 4)
    assert case.published
    (copy,) = load_file(write_new("copy", "slider_crank", tmp_path / "copy.toml"))
    (shipped,) = load_cases("slider_crank")
    assert np.array_equal(
        centres_of_mass(copy.mechanism, copy.initial_state), centres_of_mass(shipped.mechanism, shipped.initial_state)
    )
    assert copied_text("slider_crank").count("#") > 5, "the comments of the file stay"
    (again,) = load_file(write_new("again", str(tmp_path / "copy.toml"), tmp_path / "again.toml"))
    assert again.title == copy.title


def test_a_variant_stands_for_its_file():
    assert copied_text("simple_pendulum-large").splitlines()[1:] == copied_text("simple_pendulum").splitlines()[1:]


SPOILT = {
    "name": (("2fast", None, "x.toml"), "name '2fast'"),
    "ending": (("good", None, "x.txt"), "end with .toml"),
    "unknown case": (("good", "no_such_case", "x.toml"), "no_such_case"),
    "unknown family": (("good", "wheels:n=3", "x.toml"), "Families: windows"),
    "bad parameter": (("good", "windows:count=0", "x.toml"), "out of range"),
    "no folder": (("good", None, "nowhere/x.toml"), "cannot be written"),
}


@pytest.mark.parametrize("what", SPOILT)
def test_what_cannot_be_started_is_refused_and_leaves_no_file(tmp_path, what):
    (name, source, file), message = SPOILT[what]
    with pytest.raises(InvalidInput, match=re.escape(message)):
        write_new(name, source, tmp_path / file)
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_overwritten(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text("keep me")
    with pytest.raises(InvalidInput, match="nothing is overwritten"):
        write_new("mine", None, path)
    assert path.read_text() == "keep me"
