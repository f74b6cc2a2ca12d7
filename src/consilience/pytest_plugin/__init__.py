"""Plug-in for pytest: ``pytest --consilience-engine NAME cases/`` collects case files as tests (docs/pytest.md).

Every test run in an environment with Consilience loads the plug-in: it imports pytest alone, and does nothing without
the option.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from consilience.pytest_plugin.setting import Setting  # named by the key of the stash

MARKER = (
    "consilience(engine, question, case, group, tag): a case of Consilience on an engine; choose with "
    "-m \"consilience(question='instant') and consilience(tag='loop')\""
)

_SETTING = pytest.StashKey["Setting"]()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options and the ini value."""
    group = parser.getgroup("consilience", "multibody engines against a reference")
    group.addoption(
        "--consilience-engine",
        action="append",
        default=[],
        metavar="NAME",
        help="collect case files as tests of this engine; repeat it",
    )
    group.addoption(
        "--consilience-effort",
        choices=("quick", "full"),
        default="full",
        help="quick: few states, short motions, the headline method; full: as `consilience run` (default)",
    )
    group.addoption(
        "--consilience-digits", type=int, metavar="N", help="correct digits asked of motions; default: the case's"
    )
    group.addoption(
        "--consilience-limit", type=float, default=180.0, metavar="S", help="time limit of one job in s (default: 180)"
    )
    group.addoption(
        "--consilience-known",
        action="append",
        default=[],
        metavar="FILE",
        help="file of known differences, which are strict expected failures; repeat it",
    )
    parser.addini("consilience_known", "files of known differences", type="paths", default=[])


def pytest_configure(config: pytest.Config) -> None:
    """Read the settings if an engine is named."""
    config.addinivalue_line("markers", MARKER)
    if config.getoption("consilience_engine"):
        from consilience.pytest_plugin.setting import setting_of  # noqa: PLC0415 - no import without the option

        config.stash[_SETTING] = setting_of(config)
        config.add_cleanup(config.stash[_SETTING].interview.stop)


def pytest_report_header(config: pytest.Config) -> str | None:
    """Return the line of the settings."""
    setting = config.stash.get(_SETTING, None)
    return setting.header if setting is not None else None


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """Collect a TOML file that looks like a case, or that is named on the command line."""
    setting = parent.config.stash.get(_SETTING, None)
    if setting is None or file_path.suffix != ".toml":
        return None
    from consilience.pytest_plugin.items import CaseFile, looks_like_a_case  # noqa: PLC0415

    if not parent.session.isinitpath(file_path) and not looks_like_a_case(file_path):
        return None
    node: Any = CaseFile.from_parent(parent, path=file_path, setting=setting)
    return node


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Note the known differences that match no test, before tests are deselected."""
    setting = config.stash.get(_SETTING, None)
    if setting is not None:
        setting.note_collected(items)


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """List the known differences that match no test: a case may have been renamed."""
    setting = config.stash.get(_SETTING, None)
    for known in setting.idle if setting is not None else ():
        terminalreporter.write_line(f"consilience: no test collected for the known difference: {known}")
