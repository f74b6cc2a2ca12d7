"""The page of the site "Contact, engine by engine": methods, laws and refusals, as the adapters state them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from consilience.case import Case, shipped_cases
from consilience.compare import markdown_table
from consilience.engine import Engine, Profile, Question, Unsupported, installed, load_engine
from consilience.report.statement import escaped

ASKED = {
    "lasting contact with friction": "skew_slide_circle",
    "restitution": "bouncing_sphere",
    "a stop": "pendulum_rests_on_a_stop",
    "dry friction": "pendulum_dry_friction",
}
"""What each engine is asked: a case for each kind of contact."""

ABOUT = """\
# Contact, engine by engine

What each engine can be made to do with the cases of `cases/contact`, by which methods and under which law, what it
does as it comes out of the box, and what it cannot state. The tables are those of the adapters that are installed
where this page is built. [Contact](../contact.md) has the laws, the [tutorial of the sliding
cube](../tutorials/cube.md) shows what another law does to a motion, and `consilience run --tag contact` how many
digits come of it.

Only declared pairs collide, in every engine. A method at matched settings leads to the rigid law of the case as its
steps get smaller; one at the defaults keeps the law that the engine has, and the report names that law as the cause
where the reference with it moves alike.
"""


def contact_page() -> str:
    """Return the page as Markdown."""
    cases = {case.name: case for case in shipped_cases() if "contact" in case.tags}
    lines = [ABOUT]
    for name in installed():
        if name != "reference":
            lines += _engine(name, load_engine(name), cases)
    return "\n".join([*lines, ""])


def _engine(name: str, engine: Engine, cases: dict[str, Case]) -> Iterator[str]:
    yield from (f"## {name}", "")
    rows = [row for what, case in ASKED.items() for row in _methods(what, engine, cases[case])]
    yield from (*markdown_table(("asked", "question", "method", "route", "order", "law"), rows, escape=escaped), "")
    refused = markdown_table(("feature: reason", "cases"), _refusals(engine, cases.values()), escape=escaped)
    yield from ("### Cannot state", "", *refused, "")


def _methods(what: str, engine: Engine, case: Case) -> Iterator[tuple[object, ...]]:
    for question in (Question.INSTANT, Question.TRAJECTORY):
        refused = engine.unsupported(case.mechanism, question)
        if refused:
            yield what, question, "none", "", "", _why(refused[0])
            continue
        for method in engine.methods(case.mechanism, question):
            order = "" if method.order is None else method.order
            route = "as it comes" if method.profile is Profile.DEFAULT else method.route.value
            yield what, question, method.name, route, order, method.contact_law


def _refusals(engine: Engine, cases: Any) -> list[tuple[object, ...]]:
    found: dict[str, list[str]] = {}
    for case in cases:
        reasons = {_why(refused) for refused in engine.unsupported(case.mechanism, Question.TRAJECTORY)}
        for reason in reasons:
            found.setdefault(reason, []).append(case.name)
    return [(reason, ", ".join(names)) for reason, names in sorted(found.items())]


def _why(refused: Unsupported) -> str:
    return refused.reason.partition("has no translation for: ")[2] or refused.reason
