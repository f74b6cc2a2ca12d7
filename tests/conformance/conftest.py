"""Conformance: every installed engine answers correctly, or states what it cannot represent.

Tests that take `engine` or `engine_name` are run for each installed engine, or for those of ``--engine``. A difference
that the adapter's ``known_differences.toml`` lists is a strict xfail with the reason that stands there.
"""

import tomllib
from importlib.util import find_spec
from pathlib import Path

import pytest

from consilience.engine import installed, load_engine


def pytest_generate_tests(metafunc):
    if "engine_name" in metafunc.fixturenames:
        chosen = metafunc.config.getoption("--engine") or list(installed())
        metafunc.parametrize("engine_name", chosen, scope="session")


@pytest.fixture(scope="session")
def engine(engine_name):
    return load_engine(engine_name)


def known_differences(engine_name):
    package = installed()[engine_name].module.split(".")[0]
    path = Path(find_spec(package).origin).parent / "known_differences.toml"
    return tomllib.loads(path.read_text())["difference"] if path.exists() else []


def pytest_collection_modifyitems(config, items):
    tables = {name: known_differences(name) for name in installed()}
    matched = set()
    for item in items:
        if "engine_name" not in getattr(item, "fixturenames", ()):
            continue
        name = item.callspec.params["engine_name"]
        for entry in tables[name]:
            if entry["test"] in item.nodeid:
                matched.add((name, entry["test"]))
                item.add_marker(pytest.mark.xfail(reason=entry["reason"], strict=True))
    whole = not config.getoption("--engine") and not config.getoption("keyword") and len(config.args) == 1
    if whole and str(config.args[0]).endswith("conformance"):
        unmatched = {(n, e["test"]) for n, table in tables.items() for e in table} - matched
        assert not unmatched, f"known differences that name no test: {unmatched}"
