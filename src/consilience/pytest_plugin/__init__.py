"""Plug-in for pytest: ``pytest --consilience-engine NAME cases/`` collects case files as tests (docs/pytest.md).

Every test run in an environment with Consilience loads the plug-in: it imports pytest alone, and does nothing without
the option.
"""

from __future__ import annotations

import pytest

MARKER = (
    "consilience(engine, question, case, group, tag): a case of Consilience on an engine; choose with "
    "-m \"consilience(question='instant') and consilience(tag='loop')\""
)


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
    """Read the settings and register the hooks of `EngineTests` if an engine is named."""
    config.addinivalue_line("markers", MARKER)
    if config.getoption("consilience_engine"):
        from consilience.pytest_plugin.items import EngineTests  # noqa: PLC0415 - no import without the option
        from consilience.pytest_plugin.setting import setting_of  # noqa: PLC0415

        setting = setting_of(config)
        config.pluginmanager.register(EngineTests(setting))
        config.add_cleanup(setting.interview.stop)
