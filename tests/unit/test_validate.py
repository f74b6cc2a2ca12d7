"""`consilience validate`: contents of a case, and what engines will make of the case, before any run."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import typer

from consilience.case.families import family_cases
from consilience.case.file.reader import cases_from_tables, load_file
from consilience.cli.commands.new import starter_text
from consilience.cli.commands.validate import examine, load_all, text, validate, validate_cases
from consilience.cli.options import OutputFormat
from consilience.mechanism import initial_state
from consilience.report.anatomy import anatomy, expected_lines, fastest, listed, warnings

PLUGINS = Path(__file__).parents[1] / "harness" / "plugins"

PLAIN = {
    "title": "Plain",
    "sources": ["own"],
    "gravity": [0.0, 0.0, 0.0],
    "body": [{"name": "box", "mass": 2.0, "at": [0.0, 0.0, 0.0], "inertia": {"xx": 0.1, "yy": 0.1, "zz": 0.1}}],
    "joint": [
        {
            "name": "slide",
            "kind": "prismatic",
            "predecessor": "ground",
            "successor": "box",
            "at": [0, 0, 0],
            "axis": [1, 0, 0],
        }
    ],
    "joint_spring": [{"name": "stiff", "joint": "slide", "coordinate": "distance", "stiffness": 8e4}],
}
"""A symmetric box on a stiff spring: natural frequency 200 rad/s."""


@pytest.fixture
def files(tmp_path):
    good, syntax, apart = tmp_path / "good.toml", tmp_path / "syntax.toml", tmp_path / "apart.toml"
    good.write_text(starter_text("good"))
    syntax.write_text(starter_text("syntax").replace("mass = 2.0", "mass = -2.0"))
    held = "[initial.joints]\nelbow = { angle = 0.3 }\nstay = { angle = 1.0 }\n"
    apart.write_text(starter_text("apart").replace("[initial.joints]\n", held))
    return [str(path) for path in (good, syntax, apart)]


def plain(**changes):
    return cases_from_tables("plain", "plain.toml", PLAIN | changes)[0]


def test_a_four_bar_has_three_redundant_rows_out_of_its_plane():
    (case,) = family_cases("four_bar")
    facts = anatomy(case.mechanism, case.initial_state)
    assert (facts.freedom, facts.rows, facts.redundant) == (1, 20, 3)
    assert facts.dependent == dict.fromkeys(
        ("crank_pivot", "crank_pin", "rocker_pin", "rocker_pivot"), ("Z", "D13", "D23")
    )
    # loads out of the plane are statically indeterminate, in the plane determinate
    assert set(facts.undetermined.values()) == {("force z", "torque x", "torque y")}
    assert facts.residual < 1e-14
    assert facts.features == ("revolute joint",)


def test_a_single_dependency_is_found_where_a_ball_closes_the_loop():
    """Three revolutes and a spherical joint: 18 rows of rank 17; only the row Z of the spherical joint is dependent."""
    mechanism = family_cases("four_bar")[0].mechanism
    joints = (*mechanism.joints[:3], replace(mechanism.joints[3], kind="spherical"))
    mechanism = replace(mechanism, joints=joints)
    facts = anatomy(mechanism, initial_state(mechanism))
    assert (facts.freedom, facts.rows, facts.redundant) == (1, 18, 1)
    assert facts.dependent["rocker_pivot"] == ("Z",)
    assert facts.undetermined["rocker_pivot"] == ("force z",)
    assert len(facts.dependent) == 4


def test_rows_of_a_tree_are_independent():
    (case,) = family_cases("chain:bodies=4")
    facts = anatomy(case.mechanism, case.initial_state)
    assert (facts.redundant, facts.dependent, facts.undetermined) == (0, {}, {})


def test_names_with_the_same_are_listed_together():
    assert listed({"a": ("X", "Y"), "b": ("Z",), "c": ("X", "Y")}, " ") == "a, c: X Y; b: Z"


def test_fastest_motion_is_that_of_the_stiff_spring():
    case = plain()
    frequency, why = fastest(case.mechanism, case.initial_state)
    assert frequency == pytest.approx(200.0)
    assert why == "joint spring 'stiff'"


def test_a_spring_beside_the_centre_of_mass_turns_the_body_as_well():
    free = {"name": "free", "kind": "free", "predecessor": "ground", "successor": "box", "at": [0.0, 0.0, 0.0]}
    spring = {"name": "s", "predecessor": "ground", "successor": "box", "stiffness": 8e4, "free_length": 1.0}
    case = plain(joint=[free], joint_spring=[], spring=[spring | {"at": [-1.0, 0.3, 0.0], "to": [0.0, 0.3, 0.0]}])
    frequency, why = fastest(case.mechanism, case.initial_state)
    assert frequency == pytest.approx(np.sqrt(8e4 * (1 / 2.0 + 0.3**2 / 0.1)))
    assert why == "spring 's'"


FLOOR = {"name": "floor", "body": "box", "at": [0.0, 0.0, 0.0], "radius": 0.2}
FLOOR |= {"point": [0.2, 0.3, 0.0], "normal": [-1.0, 0.0, 0.0]}

DOUBTS = {
    "no expected value": {"published": []},
    "no body has a product of inertia": {},
    "every centre of mass is the origin": {},
    "along the axes of the world": {},
    "the sample of 0.05 s is long against the fastest motion, 200 rad/s": {},
    "choose 0.005 s or less": {},  # 1 rad at 200 rad/s
    "choose 0.04 s or less": {
        "joint_spring": [],
        "gravity": [0.0, 0.0, -98.6],
    },  # sqrt(98.6 / sqrt(0.1 / 2)) = 21 rad/s
    "the duration of 1e+06 s has 2e+08 rad of the fastest motion": {"trajectory": {"duration": 1e6, "sample": 1e5}},
    "has hardly begun": {"trajectory": {"duration": 1e-3, "sample": 1e-4}},
    "contact 'floor' is wedged: it is closed at the start": {
        "contact": [FLOOR | {"point": [0.0, -0.2, 0.0], "normal": [0.0, 1.0, 0.0]}]
    },
    "contacts left, right are closed at the start and hit at once": {
        "contact": [FLOOR | {"name": name, "restitution": 0.5} for name in ("left", "right")],
        "initial": {"rates": {"slide": {"distance": 1.0}}},
    },
    "contact 'resting' is closed at the start: if 'wall' hits meanwhile, both take part in one impact": {
        "contact": [
            FLOOR | {"name": "resting", "restitution": 0.5},
            FLOOR | {"name": "wall", "restitution": 0.5, "point": [0.9, 0.3, 0.0]},
        ]
    },
    "contact 'pair': the tangents of a box cone jump": {
        "contact": [
            {"name": "pair", "body": "box", "at": [0.0, 0.0, 0.0], "radius": 0.2, "friction": 0.3}
            | {"partner_at": [0.0, 1.0, 0.0], "partner_radius": 0.2, "cone": {"kind": "box"}}
        ]
    },
    "contact 'floor': the reference refuses its law, nothing is compared: an associated cone is a circle, without": {
        "contact": [FLOOR | {"friction": 0.3, "static_friction": 0.4, "associated": True}]
    },
    "friction 'rub': the speed 1e-09 is too small": {
        "friction": [{"name": "rub", "joint": "slide", "coordinate": "distance", "coulomb": 1.0, "speed": 1e-9}]
    },
}


@pytest.mark.parametrize("doubt", DOUBTS)
def test_a_weak_case_is_warned_about(doubt):
    assert any(doubt in warning for warning in warnings(plain(**DOUBTS[doubt])))


@pytest.mark.parametrize("name", ["parallel_rods", "top", "four_bar", "spring_chain", "mass_ratio"])
def test_a_good_case_has_no_warnings(name):
    assert warnings(family_cases(name)[0]) == []


def test_expected_values_have_uncertainty_origin_and_source():
    (case,) = family_cases("parallel_rods")
    lines = expected_lines(case)
    assert len(lines) == 2
    assert lines[0].startswith("p_WB (x, y, z) of platform at 1 s: ")
    assert "uncertain by 1e-11; closed form: all rods turn alike" in lines[0]


def test_what_is_invalid_is_told_beside_what_is_not(files):
    sound, invalid = load_all([*files, "no_such_case"])
    assert [case.name for case in sound] == ["good"]
    problems = [str(found["problems"]) for found in invalid]
    assert "syntax.toml:22: body 'arm': mass" in problems[0]
    assert "stay" in problems[1]
    assert "no_such_case" in problems[2]
    assert all(text(found).split("\n")[0].endswith(": invalid, 1 problem") for found in invalid)


def test_a_crash_of_an_engine_is_one_line_and_the_others_go_on(files, monkeypatch):
    monkeypatch.syspath_prepend(str(PLUGINS))
    first = Path(files[0]).rename(Path(files[0]).with_name("first.toml"))  # the test engines fail on this name
    (found,) = validate_cases([str(first)], ["honest", "broken_import", "cannot_plan"], limit=120.0)
    shown = text(found).splitlines()
    (line,) = [line for line in shown if line.startswith("  broken_import")]
    assert "no plan: does not start: " in line
    assert any(line.startswith("  cannot_plan") and ": no plan: " in line for line in shown)
    assert found["engines"]["honest"]["questions"]["instant"]["verdict"] == "exact"


def test_methods_come_with_route_and_order_and_refusals_with_their_reason():
    (chain,) = validate_cases(["chain:bodies=2"], ["pinocchio"], limit=120.0)
    (screw,) = validate_cases(["single_joint:kind=screw"], ["reference:lagrange"], limit=120.0)
    refused = screw["engines"]["reference:lagrange"]["questions"]["instant"]
    rows = text(chain)
    methods = chain["engines"]["pinocchio"]["questions"]["trajectory"]["methods"]
    assert methods
    assert {"name", "route", "order", "steps"} <= set(methods[0])
    assert f"order {methods[0]['order']}" in rows
    assert methods[0]["name"] in rows
    assert refused["verdict"] == "unsupported"
    assert refused["unsupported"][0]["reason"] in text(screw)
    assert refused["methods"] == []


def test_json_is_what_was_found_and_the_exit_code_tells_validity(files, capsys):
    with pytest.raises(typer.Exit) as ended:
        validate(files[:2], engine=["reference"], form=OutputFormat.JSON, limit=120.0)
    assert ended.value.exit_code == 2
    good, bad = json.loads(capsys.readouterr().out)["cases"]
    assert (good["valid"], bad["valid"]) == (True, False)
    assert good["freedom"] == 2
    assert good["engines"]["reference"]["questions"]["model"]["verdict"] == "exact"
    with pytest.raises(typer.Exit) as ended:
        validate(files[:1], engine=["reference"], form=OutputFormat.JSON, limit=120.0)
    assert ended.value.exit_code == 0


def test_health_is_about_the_case_alone(files):
    (case,) = load_file(Path(files[0]))
    found = examine(case)
    assert found["engines"] == {}
    assert found["expected"][0]["origin"] == "closed form"
    assert "2 degrees of freedom, 10 constraint rows, 0 of them dependent" in text(found)
