"""Campaigns that check the harness can fail: each ends with an error once a fault is planted in what it checks.

Those of other files: `fuzz`, `check`, `crosscheck` and the hostile inputs, beside the tests of these campaigns.
"""

import importlib.util
import shlex
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

import exported
import imported
import newcomer
import pages
from consilience.audit import coverage as coverage_audit
from consilience.audit.mutate import campaign, judge, plan, summary
from consilience.audit.mutate.synthetic import NAME
from consilience.case import load_case
from consilience.case.file.writer import case_table, table_text
from consilience.cli.commands.coverage import coverage
from consilience.compare import Verdict
from consilience.report.html import render_html
from consilience.report.record import read_record
from harness import kills
from hostile import browser as hostile_browser
from hostile.properties import report_seed

pytestmark = pytest.mark.slow

HERE = Path(__file__).parent


# ---------------------------------------------------------------- suites that are killed


def killed(*more):
    """Last line and output of the short campaign."""
    command = [sys.executable, str(HERE / "kills.py"), "--short", *more]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    return done.returncode, done.stdout.splitlines()[-1], done.stdout + done.stderr


@pytest.mark.usefixtures("answers_kept")
def test_suites_that_are_killed_go_on_and_say_the_same():
    code, last, said = killed("--kills", "3")
    assert last.startswith("3 kills, "), said
    assert (code, last.endswith(" 0 wrong")) == (0, True), said


@pytest.mark.usefixtures("answers_kept")
@pytest.mark.parametrize(("fault", "seen"), [("forgets", "are gone"), ("asks_again", "another report")])
def test_a_store_that_forgets_or_finds_nothing_fails_the_kills(fault, seen):
    """Forgotten, the answers that were seen are other ones; asked again, they are refused by the database."""
    runner = shlex.join([sys.executable, str(HERE / "planted.py"), fault])
    code, last, said = killed("--kills", "1", "--runner", runner)
    assert code == 1, said
    assert seen in said
    assert not last.endswith(" 0 wrong")


def test_rounds_without_a_kill_fail_the_kills(monkeypatch, tmp_path):
    """A suite that ends before the signal loses nothing, and shows nothing."""
    monkeypatch.setattr(kills.Suite, "finish", lambda self, folder: "")
    monkeypatch.setattr(kills, "report", lambda folder: [])
    monkeypatch.setattr(kills, "kept", lambda folder: dict.fromkeys("abcde", ""))
    for alive, wrong in ((False, "only 0 kills in 6 rounds"), (True, "only 0 of 2 kills came between")):
        monkeypatch.setattr(kills, "disturb", lambda *_, alive=alive: kills.Disturbed(alive, {}, []))
        found = kills.campaign(kills.Suite(()), 2, 0, tmp_path / str(alive))
        assert any(words.startswith(wrong) for words in found.wrong), found.wrong


# ---------------------------------------------------------------- planted errors, bands


@pytest.mark.parametrize(("sees", "standing"), [(Verdict.AGREES, "missed"), (Verdict.MODEL, "not judged")])
def test_a_judge_that_is_blind_or_sees_errors_everywhere_fails_the_mutants(monkeypatch, sees, standing):
    def fixed(compare):
        return lambda *given: replace(compare(*given), verdict=sees)

    monkeypatch.setattr(judge, "_COMPARISONS", {q: fixed(compare) for q, compare in judge._COMPARISONS.items()})
    campaign._baseline.cache_clear()
    try:
        tasks, _ = plan.short(plan.mutants_named(["gravity too large"]), [NAME])
        found = campaign.MutationCampaign([campaign.perform(task) for task in tasks])
    finally:
        campaign._baseline.cache_clear()
    assert {str(row.standing) for row in summary.rows_of(found)} == {standing}
    assert summary.exit_code(found) != 0


def test_bands_that_are_too_narrow_fail_the_coverage(monkeypatch, tmp_path):
    app = typer.Typer()
    app.command()(coverage)
    monkeypatch.setattr(coverage_audit, "BUDGET", 0.0)  # the least factor of a finer run
    file = tmp_path / "pendulum.toml"
    file.write_text(table_text(case_table(load_case("simple_pendulum-small").with_span(2.5, None))), encoding="utf-8")
    asked = [str(file), "-e", "mujoco"]
    assert CliRunner().invoke(app, asked).exit_code == 0
    honest = coverage_audit.estimates

    def narrow(*given):
        return [replace(estimate, band=estimate.band / 100.0) for estimate in honest(*given)]

    monkeypatch.setattr(coverage_audit, "estimates", narrow)
    assert CliRunner().invoke(app, asked).exit_code == 1


# ---------------------------------------------------------------- pages, native models, imported models

PAGE = """# A page

```python
assert 1 + 1 == {sum}
```

```sh
test {sum} = 2
```
"""


def test_a_page_that_does_not_do_what_it_says_fails_the_newcomer(monkeypatch, tmp_path):
    monkeypatch.setattr(pages, "ROOT", tmp_path)
    monkeypatch.setattr(newcomer, "ROOT", tmp_path)
    monkeypatch.setattr(newcomer, "PATHS", (("read", "page.md", 60.0),))
    for result, code in ((2, 0), (3, 1)):
        pages.blocks.cache_clear()
        (tmp_path / "page.md").write_text(PAGE.format(sum=result))
        with pytest.raises(SystemExit) as ended:
            newcomer.main([])
        assert ended.value.code == code
    pages.blocks.cache_clear()
    (tmp_path / "page.md").write_text(PAGE.format(sum=2))
    monkeypatch.setattr(newcomer, "PATHS", (("read", "page.md", 0.0),))
    with pytest.raises(SystemExit) as ended:
        newcomer.main([])
    assert ended.value.code == 1


def test_a_native_model_that_errs_fails_the_exported_ones(monkeypatch, capsys):
    pytest.importorskip("pinocchio")
    assert exported.main(["pinocchio", "double_pendulum"]) == 0
    run = exported.results

    def bent(folder):
        told = run(folder)
        return {name: about | {"a": (1.0 + 1e-11) * np.array(about["a"])} for name, about in told.items()}

    monkeypatch.setattr(exported, "results", lambda folder: _lists(bent(folder)))
    assert exported.main(["pinocchio", "double_pendulum"]) == 1
    assert exported.main(["pinocchio", "bouncing_sphere"]) == 1, "nothing was compared"
    assert "nothing to compare" in capsys.readouterr().err


def _lists(told):
    return {name: about | {"a": list(about["a"])} for name, about in told.items()}


ROBOT = """<robot name="arm"><link name="base"/><link name="arm"><inertial><origin xyz="0.1 0 0.2" rpy="0.3 0.1 0"/>
<mass value="2"/><inertia ixx="0.03" iyy="0.04" izz="0.05" ixy="0.001" ixz="0" iyz="0.002"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0.48 0.6 0.64"/>
<limit effort="1" velocity="1" lower="-1" upper="1"/></joint></robot>"""


def test_an_import_that_errs_fails_the_imported_ones(monkeypatch, tmp_path):
    pytest.importorskip("pinocchio")
    (tmp_path / "arm.urdf").write_text(ROBOT)
    (tmp_path / "none.urdf").write_text("<robot name='r'/>")
    assert imported.main([tmp_path / "arm.urdf"]) == 0
    assert imported.main([tmp_path / "none.urdf"]) == 1
    read = imported.through_the_file

    def heavier(found):
        mechanism = read(found)
        bodies = [replace(body, inertia=(1.0 + 1e-8) * body.inertia) for body in mechanism.bodies]
        return replace(mechanism, bodies=tuple(bodies))

    monkeypatch.setattr(imported, "through_the_file", heavier)
    assert imported.main([tmp_path / "arm.urdf"]) == 1


# ---------------------------------------------------------------- reports in a browser

CHROMIUM = shutil.which("chromium")

needs_browser = pytest.mark.skipif(
    CHROMIUM is None or importlib.util.find_spec("playwright") is None, reason="needs Chromium and the extra `browser`"
)


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """Folder of a small report."""
    folder = tmp_path_factory.mktemp("report")
    report_seed(folder)
    (folder / "report.html").write_text(render_html(read_record(folder)), encoding="utf-8")
    return folder


@needs_browser
@pytest.mark.parametrize(
    ("check", "end", "fault"),
    [
        ("keyboard", "</script>", ";throw new Error('planted')"),
        # a class of another part of the page, which squeezes the key above the matrix
        ("first_screen", "</style>", ".key { display: inline-block; width: 1.4em; }"),
    ],
)
def test_a_page_with_a_fault_fails_the_browser(report, tmp_path, check, end, fault):
    command = [sys.executable, str(HERE.parent / "browser"), "--only", check]
    bad = tmp_path / "bad"
    shutil.copytree(report, bad)
    text = (bad / "report.html").read_text(encoding="utf-8")
    (bad / "report.html").write_text(text.replace(end, fault + end))
    for folder, code in ((report, 0), (bad, 1)):
        file = str(folder / "report.html")
        done = subprocess.run([*command, file], capture_output=True, text=True, timeout=300, check=False)
        assert done.returncode == code, done.stdout + done.stderr


@needs_browser
def test_a_text_that_is_not_escaped_fails_the_hostile_browser(monkeypatch, capsys):
    monkeypatch.setattr(hostile_browser, "PAYLOADS", hostile_browser.PAYLOADS[:1])
    assert not hostile_browser.main(["--browser", CHROMIUM])
    bare = "<!doctype html><html><body><img src='x' onerror='window.hit=1'></body></html>"
    monkeypatch.setattr(hostile_browser, "render_html", lambda record: bare)
    assert hostile_browser.main(["--browser", CHROMIUM])
    assert "RAN" in capsys.readouterr().out
