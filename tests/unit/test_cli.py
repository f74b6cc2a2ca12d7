"""The command line: exit codes, clear messages, no file overwritten; runs and signals in real processes."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace as Namespace

import numpy as np
import psutil
import pytest

from commandline import GOOD, called
from consilience.case import case_names
from consilience.cli.main import LAZY_COMMANDS, command_of
from consilience.compare import markdown_table
from consilience.errors import InvalidInput
from consilience.report.columns import tables_as_columns


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Make a folder with a valid case, and its report of the reference and one engine, by a process of its own."""
    path = tmp_path_factory.mktemp("cli")
    (path / "pendulum.toml").write_text(GOOD)
    (path / "taken.csv").mkdir()
    (path / "full.md").symlink_to("/dev/full")
    words = ("run", "pendulum.toml", "-e", "pinocchio", "-o", "report")
    command = [sys.executable, "-c", "from consilience.cli.main import main; main()", *words]
    done = subprocess.run(command, cwd=path, capture_output=True, text=True, check=False, timeout=600)
    assert done.returncode == 0, done.stdout + done.stderr
    return path


def test_run_writes_the_three_files_and_names_the_report(folder):
    for name in ("report.jsonl", "report.html", "report.md"):
        assert (folder / "report" / name).stat().st_size > 1000
    records = [json.loads(line) for line in (folder / "report" / "report.jsonl").read_text().splitlines()]
    assert records[0]["record"] == "header"
    assert set(records[0]["engines"]) == {"reference", "pinocchio"}
    assert records[-1]["record"] == "footer"
    assert {r["question"] for r in records if r["record"] == "comparison"} == {"model", "instant", "trajectory"}


def test_report_renders_the_same_pages_again_from_the_record(folder):
    before = (folder / "report" / "report.md").read_text()
    (folder / "report" / "report.md").unlink()
    done = called("report", "report", cwd=folder)
    assert done.returncode == 0
    assert (folder / "report" / "report.md").read_text() == before


def test_a_run_ends_with_its_headline_and_says_what_it_replaces(folder):
    told = called("report", "report", cwd=folder).stdout.splitlines()
    assert told[-3:] == [
        "1 of 1 cell agrees at model and instant.",
        "1 of 1 motion reaches the digits asked, by the engine's own integrator or else the harness's.",
        "report: report/report.html",
    ]
    (folder / "other").mkdir()
    (folder / "other" / "report.jsonl").write_text((folder / "report" / "report.jsonl").read_text())
    call = ("run", "pendulum.toml", "-e", "reference", "-q", "model", "-o", "other")
    done = called(*call, "-f", "json", cwd=folder)
    assert "other holds the report of another run (1 case, pinocchio, reference), which this one" in done.stderr
    assert json.loads(done.stdout)["exit_code"] == done.returncode == 0
    assert "another run" not in called(*call, cwd=folder).stderr


BAD = {
    "unknown case": (["run", "no_such_case"], "no_such_case", "double_pendulum"),
    "unknown engine": (["run", "pendulum.toml", "-e", "mujocco"], "mujocco", "Nearest: mujoco"),
    "unknown question": (["run", "pendulum.toml", "-q", "instance"], "instance", "Nearest: instant."),
    "unknown tag": (["list", "--tag", "tuor"], "tuor", "Nearest: tour"),
    "unknown family": (["show", "window:count=3"], "window", "Nearest: windows."),
    "unknown parameter": (["show", "windows:cuont=3"], "cuont", "Nearest: count."),
    "unknown mutant": (["mutate", "999"], "999", "Mutants: "),
    "unknown case of a report": (["plot", "report", "pendlum"], "pendlum", "Nearest: pendulum."),
    "words that no case has": (["list", "gear_par"], "gear_par", "Nearest: gear_pair"),
    "missing file": (["run", "no.toml"], "no.toml", "cannot be read"),
    "unknown profile": (["simulate", "pendulum.toml", "--profile", "defualt"], "defualt", "Nearest: default."),
    "bad file ending": (["simulate", "pendulum.toml", "-o", "x.xls"], "x.xls", ".npz"),
    "folder for a file": (["simulate", "pendulum.toml", "-o", "taken.csv"], "taken.csv: it is a folder"),
    "report below a file": (["run", "pendulum.toml", "-o", "pendulum.toml/r"], "pendulum.toml/r: it cannot be written"),
    "table below a file": (["crosscheck", "-o", "pendulum.toml/t.md"], "t.md: it cannot be written"),
    "table in no folder": (["coverage", "-o", "nowhere/t.md"], "nowhere/t.md: its folder does not exist"),
    "report where nothing can be": (["run", "pendulum.toml", "-o", "/proc/r"], "/proc/r: it cannot be written"),
    "disk that is full": (["values", "double_pendulum", "-o", "full.md"], "full.md: it cannot be written (No space"),
    "values as a folder": (["values", "-o", "taken.csv"], "taken.csv: it is a folder"),
    "sample that does not divide": (
        ["simulate", "pendulum.toml", "-o", "x.csv", "--duration", "1", "--sample", "0.3"],
        "0.3 s",
        "divides",
    ),
    "no report": (["report", "pendulum"], "report.jsonl", "consilience run"),
    "unknown schema": (["schema", "universe"], "universe", "case"),
    "no such option": (["run", "--nonsense"], "nonsense", "No such option"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_message_exit_code_2_and_no_traceback(folder, name):
    arguments, *expected = BAD[name]
    done = called(*arguments, cwd=folder)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    for text in expected:
        assert text in done.stderr


def test_a_locale_without_unicode_ends_no_command(folder):
    """The text drawing consists of braille signs, which ASCII lacks."""
    command = [sys.executable, "-c", "from consilience.cli.main import main; main()", "show", "pendulum.toml"]
    environment = os.environ | {"PYTHONIOENCODING": "ascii"}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, check=False, timeout=600)
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"????" in done.stdout
    assert b"gravity (0, 0, -9.81) m/s^2" in done.stdout


def test_cases_that_cannot_be_read_cost_no_other_its_answer(folder):
    (folder / "spoilt.toml").write_text(GOOD.replace("mass = 2.0", "mass = -2.0"))
    ball = "name = 'floor'\nbody = 'bob'\nat = [0, 0, -1]\nradius = 0.1\npoint = [0, 0, 0]\nnormal = [0, 0, 1]\n"
    (folder / "sunk.toml").write_text(f"{GOOD}[[contact]]\n{ball}")
    names = ("spoilt.toml", "pendulum.toml", "sunk.toml", "no.toml")
    done = called("run", *names, "-e", "reference", "-q", "model", "-o", "some", cwd=folder)
    assert done.returncode == 2
    assert "spoilt.toml" in done.stderr
    assert "no.toml: it cannot be read" in done.stderr
    line = GOOD.count("\n") + 1
    assert f"sunk.toml:{line}: contact 'floor': bob and ground overlap by " in done.stderr
    records = [json.loads(line) for line in (folder / "some" / "report.jsonl").read_text().splitlines()]
    assert [(r["case"], r["status"]) for r in records if r["record"] == "run"] == [("pendulum", "answered")]


SPOILT = {
    "mass": ("mass = 2.0", "mass = -2.0", ("pendulum.toml", "bob", "mass")),
    "field": ("mass = 2.0", "mass = 2.0\nweight = 1", ("pendulum.toml", "body 'bob'.weight", "unknown field")),
    "syntax": ("mass = 2.0", "mass = ", ("pendulum.toml", "TOML")),
    "inertia": ("xx = 0.11", "xx = 9.0", ("pendulum.toml", "bob", "inertia", "triangle")),
    "body": ('successor = "bob"', 'successor = "bib"', ("pendulum.toml", "pin", "bib")),
    "held": ("angle = 0.5", "distance = 0.5", ("pendulum.toml:23: initial.joints.pin.distance", "It has: angle")),
    "held joint": (
        "[initial.joints.pin]",
        "[initial.rates.pn]",
        ("pendulum.toml:22: initial.rates.pn", "no joint 'pn'"),
    ),
}


@pytest.mark.parametrize("name", SPOILT)
def test_a_spoilt_case_file_is_refused_and_the_earlier_report_stays(folder, tmp_path, name):
    good, bad, expected = SPOILT[name]
    assert good in GOOD
    (tmp_path / "pendulum.toml").write_text(GOOD.replace(good, bad))
    before = (folder / "report" / "report.jsonl").read_bytes()
    done = called("run", str(tmp_path / "pendulum.toml"), "-o", "report", cwd=folder)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    for text in expected:
        assert text in done.stderr
    assert (folder / "report" / "report.jsonl").read_bytes() == before


def test_a_report_without_its_footer_is_not_taken_for_complete(folder, tmp_path):
    lines = (folder / "report" / "report.jsonl").read_text().splitlines(keepends=True)
    (tmp_path / "report.jsonl").write_text("".join(lines[:-1]))
    done = called("report", str(tmp_path), cwd=folder)
    assert done.returncode == 2
    assert "cut off" in done.stderr
    assert not (tmp_path / "report.html").exists()


def test_simulate_writes_the_same_motion_in_all_formats(folder):
    for ending in ("json", "npz", "csv"):
        done = called("simulate", "pendulum.toml", "--duration", "0.1", "-o", f"motion.{ending}", cwd=folder)
        assert done.returncode == 0, done.stderr
    document = json.loads((folder / "motion.json").read_text())
    with np.load(folder / "motion.npz") as stored:
        arrays = dict(stored)
    with (folder / "motion.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    assert np.array_equal(np.array(document["quat_WB"]), arrays["quat_WB"])
    assert [float(r["bob.quat_WB.e2"]) for r in rows] == list(arrays["quat_WB"][:, 0, 2])
    # energy of the pendulum about its pin, at the last sample
    angle = 2 * np.arctan2(arrays["quat_WB"][-1, 0, 2], arrays["quat_WB"][-1, 0, 0])
    speed = arrays["w_WB_W"][-1, 0, 1]
    mgl, inertia = 2.0 * 9.81 * 0.4, 0.12 + 2.0 * 0.4**2
    assert 0.5 * inertia * speed**2 == pytest.approx(mgl * (np.cos(angle) - np.cos(0.5)), rel=1e-9)


def test_motions_are_plotted_from_a_report_and_by_simulate(folder):
    done = called("plot", "report", "pendulum", "--what", "reactions", "-o", "peak.svg", cwd=folder)
    assert done.returncode == 0, done.stderr
    arguments = ("--duration", "0.1", "--method", "null_space", "-o", "motion.json", "--plot", "drawn.svg")
    done = called("simulate", "pendulum.toml", *arguments, "-f", "json", cwd=folder)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["how"].startswith("null_space")
    assert {"drawn-coordinates.svg", "drawn-energies.svg", "drawn-reactions.svg"} <= set(told["plots"])
    for name in ("peak.svg", *told["plots"]):
        assert ET.parse(folder / name).getroot().tag.endswith("svg")


def test_schema_accepts_the_shipped_names(folder):
    done = called("schema", "case", cwd=folder)
    schema = json.loads(done.stdout)
    assert schema["additionalProperties"] is False
    assert set(schema["required"]) == {"title", "gravity", "body", "joint"}


def test_list_gives_each_case_one_line_of_80_columns_and_takes_words_and_tags(tmp_path):
    lines = called("list", cwd=tmp_path, columns=80).stdout.splitlines()
    assert max(map(len, lines)) <= 80
    for name in case_names():
        assert len([line for line in lines if line.split()[:1] == [name]]) == 1
    found = json.loads(called("list", "GEAR", "lumpy", "-f", "json", cwd=tmp_path).stdout)
    assert [case["name"] for case in found["cases"]] == ["bevel_gears"]
    assert "gear_pair" in called("list", "gear", cwd=tmp_path).stdout
    tour = json.loads(called("list", "--tag", "tour", "-f", "json", cwd=tmp_path).stdout)
    assert all("tour" in case["tags"] for case in tour["cases"])
    assert "engines" not in tour


def test_every_command_but_one_that_prints_json_anyway_has_a_format():
    options = {name: [o for p in command_of(name).params for o in p.opts] for name in LAZY_COMMANDS}
    assert {name for name, own in options.items() if "--format" not in own} == {"schema"}


def test_tables_of_markdown_are_columns_in_a_terminal():
    markdown = "\n".join(["before", *markdown_table(("case", "off"), [("four_bar", "1e-13")]), "after"])
    lines = [line.split() for line in tables_as_columns(markdown, 80).splitlines()]
    assert lines == [["before"], ["case", "off"], ["─" * 8, "─" * 5], ["four_bar", "1e-13"], ["after"]]


def test_the_version_is_that_of_the_package(tmp_path):
    assert called("--version", cwd=tmp_path).stdout == f"consilience {version('consilience')}\n"


def test_show_works_from_any_folder(tmp_path):
    shown = called("show", "four_bar", cwd=Path(tmp_path)).stdout
    assert "1 degree of freedom, 20 constraint rows, 3 of them dependent" in shown


def test_interrupt_stops_at_once_and_leaves_no_worker_behind(tmp_path):
    # background jobs of a shell ignore Ctrl-C, and so do their children: restore the default handler
    listening = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    program = f"{listening}; from consilience.cli.main import main; main()"
    command = [sys.executable, "-c", program, "run", "double_pendulum", "four_bar", "slider_crank", "-o", "report"]
    with subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True) as process:
        try:
            workers = children(process.pid, least=2, within=180.0)
            process.send_signal(signal.SIGINT)
            _, told = process.communicate(timeout=20)
        finally:
            process.kill()
    assert process.returncode == 130
    assert "the same command goes on from there" in told
    assert psutil.wait_procs(workers, timeout=10)[1] == []
    assert not (tmp_path / "report" / "report.jsonl").exists()


def children(process, least, within):
    """Return the descendants of a process, as soon as there are at least `least`."""
    until = time.monotonic() + within
    while len(found := psutil.Process(process).children(recursive=True)) < least:
        assert time.monotonic() < until, f"only {len(found)} workers"
        time.sleep(0.1)
    return found


def test_cases_are_chosen_by_tag_or_group_and_unknown_tags_are_refused():
    from consilience.cli.options import tagged_cases

    cases = [Namespace(name="a", group="joints", tags=("lumpy",)), Namespace(name="b", group="hard", tags=("tour",))]
    assert [case.name for case in tagged_cases(cases, None)] == ["a", "b"]
    assert [case.name for case in tagged_cases(cases, ["joints"])] == ["a"]
    assert [case.name for case in tagged_cases(cases, ["tour", "lumpy"])] == ["a", "b"]
    with pytest.raises(InvalidInput, match=r"tag 'soft': no chosen case has it\. Tags and groups: hard, joints"):
        tagged_cases(cases, ["soft"])


@pytest.mark.parametrize(
    ("words", "found"),
    [
        ("consilience ru", "run"),
        ("consilience run double_w", "double_wishbone"),
        ("consilience run -e ref", "reference"),
        ("consilience run -q ins", "instant"),
        ("consilience show --pic", "--picture"),
        ("consilience translate four_bar -e ref", "reference"),
        ("consilience export report --format jun", "junit"),
        ("consilience explain hori", "horizon"),
    ],
)
def test_a_shell_completes_commands_options_and_names(words, found, tmp_path, monkeypatch):
    asked = {"_CONSILIENCE_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
    for name, value in asked.items():
        monkeypatch.setenv(name, value)
    assert called(cwd=tmp_path).stdout.split() == [found]
