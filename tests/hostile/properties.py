"""Properties of every input, however mutated: the input is refused with one sentence, or every command accepts it."""

import copy
import io
import json
import re
import shutil
import tomllib
import warnings
from contextlib import redirect_stderr, redirect_stdout

from hypothesis import strategies as st

from consilience.case import Case, case_files, load_case
from consilience.case.file.reader import load_file
from consilience.cli.commands.report import state_report
from consilience.cli.commands.validate import examine, text
from consilience.cli.options import OutputFormat
from consilience.engine import Question
from consilience.errors import ConsilienceError
from consilience.report import html
from consilience.report.markdown import render_markdown
from consilience.report.picture import picture
from consilience.report.record import _case, _plain, read_record, write_record
from consilience.report.summary import describe_case
from consilience.suite import QUICK, run_suite
from hostile.mutations import TABLE_KINDS, TEXT_KINDS, changed_bytes, changed_tables, jsonl_bytes, places, toml_bytes
from hostile.pages import check_html, check_markdown, check_svg, check_terminal
from hostile.watch import import_everything, watched

SMALL = 3_500
"""Size in bytes of the case files that are mutated: larger ones hold more of the same."""

PLACES = st.integers(0, 3_000)
CHOICES = st.integers(0, 1_000)


def steps(kinds, most=4):
    """Strategy of a few steps of mutation."""
    return st.lists(st.tuples(st.sampled_from(kinds), PLACES, CHOICES), min_size=1, max_size=most)


def case_seeds():
    """Shipped case files, as bytes and as tables."""
    found = [path.read_bytes() for path in case_files() if path.stat().st_size < SMALL]
    return [(raw, tomllib.loads(raw.decode())) for raw in found]


def report_seed(folder):
    """Record of one case, run on the reference and on one engine that needs no other program."""
    write_record(run_suite([load_case("double_pendulum")], ["mujoco"], thoroughness=QUICK), 1.0, folder)
    return read_seed(folder)


def read_seed(folder):
    """A record file as bytes, and line by line."""
    raw = (folder / "report.jsonl").read_bytes()
    return raw, [json.loads(line) for line in raw.splitlines()]


def mutants(seeds, write):
    """Strategy of inputs: mutated tables written out, a mutated file, or both mutations in turn."""
    whole = st.sampled_from(range(len(seeds)))
    return st.one_of(
        st.tuples(whole, steps(TABLE_KINDS)).map(lambda t: write(changed_tables(seeds[t[0]][1], t[1]))),
        # mutations of numbers alone pass most checks of form and reach the mechanics
        st.tuples(whole, steps(("number",), 2)).map(lambda t: write(changed_tables(seeds[t[0]][1], t[1]))),
        st.tuples(whole, steps(TEXT_KINDS)).map(lambda t: changed_bytes(seeds[t[0]][0], t[1])),
        st.tuples(whole, steps(TABLE_KINDS, 2), steps(TEXT_KINDS, 2)).map(
            lambda t: changed_bytes(write(changed_tables(seeds[t[0]][1], t[1])), t[2])
        ),
    )


def case_mutants():
    """Strategy of mutated case files."""
    return mutants(case_seeds(), toml_bytes)


def report_mutants(seed):
    """Strategy of mutated records."""
    return mutants([seed], jsonl_bytes)


def swallow_case(raw, folder):
    """Process a case file as the commands do before an engine runs; return whether it was accepted."""
    path = folder / "input.toml"
    path.write_bytes(raw)
    with watched(folder), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # extreme numbers overflow; only the outcome matters
        try:
            for case in load_file(path)[:1]:
                examined(QUICK.case(case))
        except ConsilienceError as error:
            check_terminal(str(error))
            return False
    return True


def examined(case: Case):
    """Describe a case as the commands do that run no engine."""
    found = examine(case)
    check_terminal(text(found) + describe_case(case))
    json.dumps(found, default=str)
    check_svg(picture(case.mechanism, case.initial_state, f"{case.name}: {case.title}"))
    json.dumps(_plain(_case(case, [Question.INSTANT])), allow_nan=False)


def warm(report=None, folder=None):
    """Import all modules and compile all templates, so that no later input causes file access."""
    import_everything()
    if report is None:
        for case in [c for path in case_files() if path.stat().st_size < SMALL for c in load_file(path)[:1]]:
            examined(case)
    else:
        read = read_record(folder)
        html.render_html(read)
        render_markdown(read)
        with redirect_stdout(io.StringIO()):
            state_report(folder, OutputFormat.TEXT)


SCRIPT = html.environment().get_template("script.js.j2").render()


def swallow_report(raw, folder, other=None):
    """Process a record as the commands do; return whether it was accepted."""
    own = folder / "report"
    own.mkdir(exist_ok=True)
    (own / "report.jsonl").write_bytes(raw)
    with watched(folder), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            record = read_record(own)
            page = html.render_html(record)
            markdown = render_markdown(record)
            printed = io.StringIO()
            with redirect_stdout(printed), redirect_stderr(printed):
                state_report(own, OutputFormat.TEXT)
        except ConsilienceError as error:
            check_terminal(str(error))
            return False
    check_html(page, SCRIPT)
    check_markdown(markdown)
    check_terminal(re.sub("\x1b\\[[0-9;]*m", "", printed.getvalue()))
    return True


def fresh(folder):
    """Make an empty folder of that name."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    return folder


WORDS = ("record", "written", "question", "route", "verdict", "profile", "status", "model", "motion", "failure")
"""Fields that hold words of the format; `questions` is a list of such."""

NAMES = ("case", "engine", "method", "name")
"""Fields by which lines refer to one another."""


def hostile_everywhere(records, payload):
    """The report with a payload in every text, every name and every freely chosen key."""
    lines = copy.deepcopy(records)
    names = {"reference": "reference"}

    def renamed(name):
        return names.setdefault(name, f"{payload} {len(names)}")

    for line in lines:
        for container, key in places(line):
            if isinstance(container[key], str) and key not in WORDS and container is not line.get("questions"):
                container[key] = renamed(container[key]) if key in NAMES else payload
        for container, key in [(line, k) for k in ("undetermined", "missing", "packages") if k in line]:
            container[key] = {payload: [1] * 6 if key == "undetermined" else payload}
        for method in [line["method"]] if isinstance(line.get("method"), dict) else []:
            method["settings"] = {payload: payload, f"{payload} 2": [payload]}
        for level in line.get("levels", []):
            level["counters"] = {payload: 1}
        if line["record"] == "run":
            line.update(log=payload, reason=payload, manifest={"exact": [payload], "approximated": [payload]})
    lines[0]["engines"] = {renamed(name): about for name, about in lines[0]["engines"].items()}
    return lines
