"""``consilience explain``: covers every word of reports and mutants, agrees with the code, suggests near words."""

import json
import os
import re
import subprocess
import sys
from typing import get_args

import numpy as np
import pytest
from typer.testing import CliRunner

from consilience.audit.mutate.mutants import TRAPS
from consilience.cli.explanations import Explanation, Topic, find_explanations, read_explanations
from consilience.cli.main import app
from consilience.compare import Verdict
from consilience.compare.rules import INSTANT_RULES, RULES
from consilience.engine import CONTACT_MODES, EVENT_KINDS, Profile, Question, Route
from consilience.errors import InvalidInput
from consilience.mechanism import Compliance, Cone, SpherePlane
from consilience.mechanism.contact_laws import ConeKind, ImpactLaw
from consilience.report.wording import AT_DEFAULTS, CAUSES, LOOKS
from pages import ROOT
from situations import SITUATIONS


def names(kind):
    return {entry.name for entry in read_explanations() if entry.kind is kind}


def test_everything_that_reports_name_is_explained():
    assert names(Topic.VERDICT) == {str(verdict) for verdict in Verdict}
    assert names(Topic.ROUTE) == {str(route) for route in Route}
    assert names(Topic.PROFILE) == {str(profile) for profile in Profile}
    assert names(Topic.QUESTION) == {str(question) for question in Question}
    assert {situation.rule for situation in SITUATIONS} | set(CAUSES) <= names(Topic.RULE)
    assert len(names(Topic.TERM)) >= 25


@pytest.mark.parametrize("look", [*LOOKS.values(), AT_DEFAULTS], ids=lambda look: look.name)
def test_the_words_of_a_report_for_a_verdict_lead_to_it(look):
    (entry,) = find_explanations(look.name)
    assert (entry.kind, entry.name) == (Topic.VERDICT, look.verdict)


@pytest.mark.parametrize("word", ["contact", "stop", "dry friction", "impact", "apart", "bounces end", *CONTACT_MODES])
def test_what_replays_and_phases_show_of_contacts_is_a_term(word):
    assert find_explanations(word)[0].kind is Topic.TERM


LAWS_OF_CONTACT = {
    "restitution": 0.4,
    "rebound_threshold": 0.1,
    "friction": 0.3,
    "static_friction": 0.5,
    "associated": True,
    "torsional": 0.01,
    "rolling": 0.02,
}
MESSAGES = ("jam", "wedged", "cone", "several accelerations", "hops", "open", "overlap", "chatter", "power", "cell")


def needs(**law):
    """What `validate` says that an engine needs for a contact, but for its shapes."""
    _, *found = SpherePlane("c", "a", np.zeros(3), 0.1, "b", np.zeros(3), np.eye(3)[2], **law).features
    return [feature for feature in found if feature != "moving plane contact"]


WORDS = {
    *(feature for kind in get_args(ConeKind) for feature in needs(**LAWS_OF_CONTACT, cone=Cone(kind))),
    *(feature for law in get_args(ImpactLaw) for feature in needs(impact_law=law)),
    *(*needs(compliance=Compliance(1e4)), *get_args(ConeKind), *get_args(ImpactLaw), *EVENT_KINDS, *MESSAGES),
}


@pytest.mark.parametrize("word", sorted(WORDS))
def test_laws_of_contact_events_and_words_of_messages_are_explained(word):
    assert {entry.kind for entry in find_explanations(word)} <= {Topic.TERM, Topic.RULE}


def test_rules_and_traps_are_those_of_the_code():
    assert {(e.name, e.rule) for e in read_explanations() if e.kind is Topic.RULE} == {
        (r.name, r.when) for r in RULES
    } | set(INSTANT_RULES.items())
    assert {e.number: e.name for e in read_explanations() if e.kind is Topic.TRAP} == TRAPS


@pytest.mark.parametrize("entry", read_explanations(), ids=lambda e: f"{e.kind}-{e.name}")
def test_an_entry_is_a_rule_three_lines_and_places(entry):
    assert entry.rule
    assert len(entry.theory.splitlines()) == 3
    assert max(map(len, (entry.rule, *entry.theory.splitlines(), *entry.met))) <= 120
    for place in entry.met:
        assert re.match(r"[\w./-]+( tracker \d+|[:#])", place), place
    assert entry.page.startswith("generated/") or (ROOT / "docs" / entry.page).exists()
    assert entry.kind is not Topic.TRAP or entry.met


@pytest.mark.parametrize(
    ("asked", "kinds"),
    [
        ("regularization", {Topic.VERDICT}),
        ("DIFFERS MODEL", {Topic.VERDICT}),
        ("horizon", {Topic.RULE, Topic.TERM}),
        ("trap 12", {Topic.TRAP}),
        ("20", {Topic.TRAP}),
        ("armature", {Topic.TRAP}),
        ("native, extrapolated", {Topic.ROUTE}),
        ("lyapunov", None),
        ("30", None),
        ("", None),
    ],
)
def test_names_numbers_and_other_words_are_found(asked, kinds):
    if kinds is None:
        with pytest.raises(InvalidInput):
            find_explanations(asked)
    else:
        assert {entry.kind for entry in find_explanations(asked)} == kinds


@pytest.mark.parametrize(
    ("wrong", "near"), [("armatur3", "armature"), ("horizn", "horizon"), ("constraint", "constraints silently ignored")]
)
def test_an_unknown_word_is_answered_with_the_nearest(wrong, near):
    with pytest.raises(InvalidInput, match=near):
        find_explanations(wrong)


def test_formats():
    text = CliRunner().invoke(app, ["explain", "softness"]).output
    assert "rule: " in text
    document = json.loads(CliRunner().invoke(app, ["explain", "17", "-f", "json"]).output)
    assert [entry["number"] for entry in document] == [17]
    assert CliRunner().invoke(app, ["explain", "17", "-f", "markdown"]).output.startswith("### ")
    assert all(entry.name in CliRunner().invoke(app, ["explain"]).output for entry in read_explanations())


def test_entries_of_one_kind_have_different_names():
    keys = [(entry.kind, entry.name) for entry in read_explanations()]
    assert len(set(keys)) == len(keys)
    assert Explanation(Topic.TERM, "n", "r", "t").page == "verdicts.md"


def shown_on_a_terminal(tmp_path, **environment):
    """Return what a terminal receives of an error message, which is red where colours are on."""
    terminal, end = os.openpty()
    kept = {name: value for name, value in os.environ.items() if name not in ("NO_COLOR", "FORCE_COLOR")}
    command = [sys.executable, "-c", "from consilience.cli.main import main; main()", "explain", "nothing_like_this"]
    variables = kept | {"TERM": "xterm-256color"} | environment
    done = subprocess.run(command, cwd=tmp_path, stderr=end, stdout=end, env=variables, check=False, timeout=120)
    os.close(end)
    shown = os.read(terminal, 65536).decode()
    os.close(terminal)
    assert done.returncode == 2
    assert "nothing_like_this" in shown
    return shown


def test_colours_are_for_terminals_that_want_them(tmp_path):
    red = "\x1b[31m"
    assert red in shown_on_a_terminal(tmp_path)
    assert red not in shown_on_a_terminal(tmp_path, NO_COLOR="1")
    command = [sys.executable, "-c", "from consilience.cli.main import main; main()", "explain", "agrees"]
    piped = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True, timeout=120)
    assert "agrees (verdict)" in piped.stdout
    assert "\x1b" not in piped.stdout + piped.stderr
