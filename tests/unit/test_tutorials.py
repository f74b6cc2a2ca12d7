"""Tutorials run from top to bottom and print the numbers in their text; the API page lists all public names."""

import ast
import dataclasses
import inspect
import re
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from consilience.reference.integrators.adaptive import METHODS
from consilience.reference.tree.solver import INTEGRATORS

TUTORIALS = Path(__file__).parents[2] / "docs" / "tutorials"
NAMES = ("intro", "exu", "c4", "attia", "mass", "cube")

NUMBER = r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?"
EXACT = 1e-9
"""Tolerance for a float whose expected value is written without a decimal point."""


def text_of(name):
    return (TUTORIALS / f"{name}.md").read_text(encoding="utf-8")


def script(text):
    """Return the code blocks of a page as one script, on the same line numbers, so that errors point to the page."""
    lines, inside = [], False
    for line in text.splitlines():
        fence = line.startswith("```")
        lines.append(line if inside and not fence else "")
        inside = not inside and line == "```python" if fence else inside
    return "\n".join(lines) + "\n"


def uncertainty(number):
    """Return half a unit in the last written digit."""
    mantissa, _, power = number.partition("e")
    if "." not in mantissa:
        return EXACT
    return 0.5000001 * 10.0 ** (int(power or 0) - len(mantissa.partition(".")[2]))


def mismatch(values, written):
    """Return how results differ from those written in a page, or None; a bound is on the last value, or on all."""
    exact, bounded, bound = written.rpartition("< ")
    if not bounded:
        return inequality(values, written)
    worst = np.max([np.max(np.abs(np.asarray(value, dtype=float))) for value in (values[-1:] if exact else values)])
    if not worst < float(bound):
        return f"{worst} is not below {bound}"
    return inequality(values[:-1], exact.removesuffix(", ")) if exact else None


def inequality(values, written):
    """Return how results differ from the words or numbers written in a page, or None."""
    if any(isinstance(item, str | bool | np.bool_) for value in values for item in np.ravel(np.asarray(value))):
        shown = " ".join(str(value) for value in values)
        return None if shown == written else f"'{shown}' is written as '{written}'"
    numbers = re.findall(NUMBER, written)
    computed = np.concatenate([np.ravel(np.asarray(value, dtype=float)) for value in values])
    if re.sub(NUMBER, "", written).strip(" ,[]()"):
        return f"'{written}' holds more than numbers"
    if len(numbers) != len(computed):
        return f"{len(numbers)} numbers are written, {len(computed)} computed"
    for number, value in zip(numbers, computed, strict=True):
        if not abs(value - float(number)) <= uncertainty(number):
            return f"{value} is written as {number}"
    return None


def run(text, name):
    """Run a page statement by statement, compare what it prints, and return the number of results compared."""
    source = script(text)
    lines = source.splitlines()
    printed: list[tuple[object, ...]] = []
    namespace = {"__name__": name, "print": lambda *values: printed.append(values)}
    compared = 0
    for statement in ast.parse(source).body:
        printed.clear()
        exec(compile(ast.Module([statement], []), f"{name}.md", "exec"), namespace)
        _, arrow, written = lines[statement.end_lineno - 1].partition("# -> ")
        where = f"{name}.md, line {statement.end_lineno}"
        assert bool(arrow) == bool(printed), f"{where}: a result is printed or written, but not both"
        if arrow:
            assert len(printed) == 1, f"{where}: print once"
            problem = mismatch(printed[0], written.strip())
            assert problem is None, f"{where}: {problem}"
            compared += 1 + written.count(",")
    return compared


@pytest.mark.parametrize("name", NAMES)
def test_the_tutorial_prints_what_it_says(name):
    text = text_of(name)
    assert run(text, name) >= 8
    assert text.count("assert ") + text.count("< 1e-") >= 3
    assert len(text.splitlines()) <= 110
    assert "cs.Drawing(" in text
    assert "cs.Body(" not in text


def test_all_tutorials_are_run():
    assert {path.stem for path in TUTORIALS.glob("*.md")} == set(NAMES)


@pytest.mark.parametrize(
    "statement",
    [
        "print(1.2346)  # -> 1.2345",
        "print(2.0000001)  # -> 2",
        "print([1.0, 2.0])  # -> 1.0",
        "print(0.03)  # -> < 0.02",
        "print(1.5, 0.03)  # -> 1.5, < 0.02",
        "print(1.6, 0.01)  # -> 1.5, < 0.02",
        "print(1.5, 2.5, 0.01)  # -> 1.5, < 0.02",
        "print(0.01, float('nan'))  # -> < 0.02",
        "print(1.0)  # -> 1.0 m",
        "print('two')  # -> three",
        "print(True)  # -> False",
        "print(float('nan'))  # -> 0.0",
        "print(1.0)",
        "x = 1.0  # -> 1.0",
    ],
)
def test_a_wrong_number_is_found(statement):
    with pytest.raises(AssertionError):
        run(f"Text.\n\n```python\n{statement}\n```\n", "page")


@pytest.mark.parametrize(
    "statement",
    [
        "print(1.23456)  # -> 1.235",
        "print([1.0, -2.5e-7])  # -> 1, -2.5e-7",
        "print(1e-13)  # -> < 1e-12",
        "print(1.5, [1e-13, -1e-13])  # -> 1.5, < 1e-12",
        "print(-2)  # -> -2",
        "print('two', 'bodies')  # -> two bodies",
    ],
)
def test_a_right_number_passes(statement):
    results = 1 + statement.partition("# -> ")[2].count(",")
    assert run(f"Text.\n\n```python\n{statement}\n```\n\n```toml\nnot = 'python'\n```\n", "page") == results


API = Path(__file__).parents[2] / "docs" / "api.md"
DESCRIBED = ("consilience.reference", "consilience.reference.analyses", "consilience.reference.contact")
COMPLETE = ("consilience", *DESCRIBED)


def entries():
    """Yield (module, entry as written, lines below) of the API page: headings; first cells in sections without any."""
    for section in API.read_text(encoding="utf-8").split("\n## ")[1:]:
        title, _, body = section.partition("\n")
        parts = body.split("\n### ")
        for part in parts[1:]:
            heading, _, below = part.partition("\n")
            yield title.strip("`"), heading.strip("`"), below
        if len(parts) == 1:
            for written in re.findall(r"^\| `([^`]+)` \|", body, flags=re.MULTILINE):
                yield title.strip("`"), written, ""


ENTRIES = list(entries())


def first_cells(text):
    """Return the names in the first column of tables."""
    cells = re.findall(r"^\| ((?:`\w+`(?:, )?)+) \|", text, flags=re.MULTILINE)
    return [name for cell in cells for name in re.findall(r"`(\w+)`", cell)]


@pytest.mark.parametrize(("module", "written", "below"), ENTRIES, ids=[f"{m}.{w.split('(')[0]}" for m, w, _ in ENTRIES])
def test_the_api_page_is_true(module, written, below):
    name, called, arguments = written.partition("(")
    thing = getattr(import_module(module), name)
    if called:
        assert plain(inspect.signature(thing)) == arguments.removesuffix(")")
    elif dataclasses.is_dataclass(thing) and first_cells(below):
        fields = {field.name for field in dataclasses.fields(thing)}
        properties = {key for base in thing.__mro__ for key, value in vars(base).items() if isinstance(value, property)}
        assert set(first_cells(below)) == fields | properties
    elif name == "FORMULATIONS":
        assert set(first_cells(below)) == set(thing)


def plain(signature):
    """Return arguments with defaults and without types: strings in double quotes, default factories as dots."""
    parts = [
        p.name if p.default is p.empty else f"{p.name}={p.default!r}".replace("'", '"').replace("<factory>", "...")
        for p in signature.parameters.values()
    ]
    return ", ".join(parts)


@pytest.mark.parametrize("module", COMPLETE)
def test_every_public_name_is_on_the_api_page(module):
    written = {w.partition("(")[0] for m, w, _ in ENTRIES if m == module}
    assert written == set(import_module(module).__all__)


def test_every_class_of_the_analyses_and_impacts_has_its_fields_on_the_page():
    described = {w for _, w, below in ENTRIES if first_cells(below)}
    for module in DESCRIBED:
        for name in import_module(module).__all__:
            if dataclasses.is_dataclass(getattr(import_module(module), name)):
                assert name in described


def test_the_integrators_on_the_page_are_those_there_are():
    (below,) = [b for module, w, b in ENTRIES if w.startswith("simulate(") and module == "consilience.reference"]
    listed = re.search(r"Integrators: (.*?)\.\n", below, flags=re.DOTALL)
    assert set(re.findall(r"`(\w+)`", listed[1])) == {*METHODS, *INTEGRATORS}
