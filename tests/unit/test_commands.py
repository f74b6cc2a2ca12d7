"""Every command once in natural use and once with a typical mistake, in a terminal of 80 columns."""

import re
import webbrowser

import pytest

from commandline import GOOD, called
from consilience.cli.main import LAZY_COMMANDS

COLUMNS = 80

STYLES = re.compile("\x1b\\[[0-9;?]*[a-zA-Z]")

URDF = """<robot name="arm"><link name="base"/><link name="rod"><inertial><origin xyz="0 0 -0.4"/><mass value="2"/>
<inertia ixx="0.11" ixy="0" ixz="0" iyy="0.12" iyz="0" izz="0.02"/></inertial></link>
<joint name="pin" type="continuous"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/></joint></robot>"""

USES = {
    "run": ("pendulum.toml -e pinocchio --quick -o report", "agrees at model and instant"),
    "simulate": ("pendulum.toml --duration 0.1 -o motion.csv", "samples in motion.csv"),
    "coverage": ("moving_origin.toml -e pinocchio -o bands.md", "100.0 %"),
    "crosscheck": ("--mechanisms 1 --states 1 -j 1", "mechanisms"),
    "report": ("report", "report: report/report.html"),
    "schema": ("case", '"additionalProperties": false'),
    "list": ("gear", "gear_pair"),
    "doctor": ("-e pinocchio", "pinocchio"),
    "explain": ("regularisation", "rule:"),
    "show": ("pendulum.toml", "1 degree of freedom"),
    "play": ("report", "open: file://"),
    "new": ("arm", "arm.toml"),
    "validate": ("pendulum.toml -e pinocchio", "pendulum"),
    "check": ("pendulum.toml -e pinocchio --states 1", "residual"),
    "fuzz": ("-n 1 -e pinocchio -o fuzz", "outcome: fuzz/fuzz.md"),
    "values": ("double_pendulum", "double_pendulum"),
    "diff": ("report report", "0 worse, 0 better, 0 other changes"),
    "trend": (".", "1 report"),
    "site": ("report -o site", "site"),
    "export": ("report -f csv -o table.csv", "table.csv"),
    "plot": ("report pendulum --what energy -o energy.svg", "energy.svg"),
    "import": ("arm.urdf -o imported.toml", "imported.toml"),
    "translate": ("pendulum.toml -e pinocchio -o native", "native"),
}
"""Arguments of each command, and what its output has; `bisect` and `mutate` are in natural use in `harness`."""

MISTAKES = {
    "run": ("pendulum.toml -e pinochio", "Nearest: pinocchio"),
    "simulate": ("pendulum.toml --method RK5", "Methods: "),
    "coverage": ("pendulm.toml", "cannot be read"),
    "crosscheck": ("--mechanisms many", "unable to parse string as an integer"),
    "report": ("reprot", "consilience run"),
    "schema": ("cases", "case"),
    "list": ("--tag tuor", "Nearest: tour"),
    "doctor": ("-e pinochio", "Nearest: pinocchio"),
    "explain": ("horizn", "Nearest: horizon"),
    "show": ("four_bra", "Nearest: four_bar"),
    "play": ("report pendlum", "Nearest: pendulum"),
    "new": ("pendulum", "nothing is overwritten"),
    "validate": ("pendulum.tml", "pendulum.tml"),
    "check": ("pendulum.toml -e pinochio", "Nearest: pinocchio"),
    "fuzz": ("-n 1 -e pinochio", "Nearest: pinocchio"),
    "values": ("four_bra", "Nearest: four_bar"),
    "diff": ("report reprot", "reprot"),
    "trend": ("reprot", "reprot"),
    "bisect": ("pendulum.toml -e pinocchio@3.3", "ENGINE@3.3..4.0"),
    "site": ("reprot -o site", "reprot"),
    "export": ("report -f xml", "junit"),
    "plot": ("report pendulum --what energi", "energy"),
    "import": ("arm.urfd -o other.toml", "arm.urfd"),
    "translate": ("pendulum.toml -e pinochio -o other", "Nearest: pinocchio"),
    "mutate": ("999", "Mutants: "),
}
"""Arguments of each command with a mistake, and what its message has: what would be right, or what is wrong."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Make a folder with a case, a robot and a report."""
    path = tmp_path_factory.mktemp("commands")
    (path / "pendulum.toml").write_text(GOOD)
    longer = GOOD.replace("duration = 0.2", "duration = 2.0")  # errors above rounding
    (path / "moving_origin.toml").write_text(longer.replace("at = [0.0, 0.0, 0.0]\ncom", "at = [0.1, 0.0, 0.2]\ncom"))
    (path / "arm.urdf").write_text(URDF)
    done = called("run", *USES["run"][0].split(), cwd=path)
    assert done.returncode == 0, done.stdout + done.stderr
    return path


def told(done):
    """Return all that a command has said, without styles; no line that could be broken is wider than the terminal."""
    text = STYLES.sub("", done.stdout + done.stderr)
    assert not [line for line in text.splitlines() if len(line) > COLUMNS and " " in line.strip()]
    assert "Traceback" not in text
    return " ".join(text.replace("\N{BOX DRAWINGS LIGHT VERTICAL}", " ").split())


def test_every_command_is_used_and_mistaken():
    assert set(USES) == set(LAZY_COMMANDS) - {"bisect", "mutate"}
    assert set(MISTAKES) == set(LAZY_COMMANDS)


@pytest.mark.parametrize("name", USES)
def test_a_natural_use(folder, name, monkeypatch):
    monkeypatch.setattr(webbrowser, "open", lambda _: False)
    words, expected = USES[name]
    done = called(name, *words.split(), cwd=folder, columns=COLUMNS, to_terminal=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert expected in (done.stdout if name == "schema" else told(done))


@pytest.mark.parametrize("name", MISTAKES)
def test_a_typical_mistake(folder, name):
    words, expected = MISTAKES[name]
    done = called(name, *words.split(), cwd=folder, columns=COLUMNS, to_terminal=True)
    assert done.returncode == 2
    assert expected in told(done)


@pytest.mark.parametrize(("words", "expected"), [("", "doctor"), ("explain", "horizon"), ("plot --help", "reactions")])
def test_what_a_newcomer_types_to_look_around(folder, words, expected):
    done = called(*words.split(), cwd=folder, columns=COLUMNS, to_terminal=True)
    assert done.returncode == 0
    assert expected in told(done)
