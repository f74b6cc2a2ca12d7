"""Settings of a test run from the options of pytest, checked before collection."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from consilience.case import Case
from consilience.engine import Question, require_installed
from consilience.errors import InvalidInput
from consilience.pytest_plugin.interview import Interview
from consilience.pytest_plugin.known import KnownDifference, read_known
from consilience.suite import FULL, QUICK

EFFORTS = {"quick": QUICK, "full": FULL}


@dataclass
class Setting:
    """The options of a test run.

    Attributes
    ----------
    options : tuple of str
        Options of the command that runs a test again.
    """

    engines: tuple[str, ...]
    effort: str
    digits: int | None
    known: list[KnownDifference]
    interview: Interview
    options: tuple[str, ...]

    @property
    def header(self) -> str:
        """Line of the settings in the header of the test run."""
        digits = "" if self.digits is None else f", {self.digits} digits"
        known = f", known differences: {len(self.known)}" if self.known else ""
        return f"consilience: {', '.join(self.engines)}, effort {self.effort}{digits}{known}"

    def case(self, case: Case) -> Case:
        """Adapt duration, states and digits of a case to the settings."""
        case = EFFORTS[self.effort].case(case)
        return case if self.digits is None else replace(case, digits=self.digits)

    def known_of(self, case: str, engine: str, question: Question) -> KnownDifference | None:
        """Find the known difference of a test."""
        return next((k for k in self.known if k.names(case, engine, question)), None)


def setting_of(config: pytest.Config) -> Setting:
    """Read the settings from the options.

    Raises
    ------
    pytest.UsageError
        If an engine is not installed, a file of known differences is wrong, or a number is out of range.
    """
    engines = tuple(dict.fromkeys(config.getoption("consilience_engine")))
    digits, limit, effort = (config.getoption(f"consilience_{name}") for name in ("digits", "limit", "effort"))
    if digits is not None and not 1 <= digits <= 15:
        raise pytest.UsageError(f"--consilience-digits: {digits} is not from 1 to 15")
    if not limit > 0.0:
        raise pytest.UsageError(f"--consilience-limit: {limit:g} s is no time limit")
    given = [config.invocation_params.dir / name for name in config.getoption("consilience_known")]
    try:
        for engine in engines:
            require_installed(engine)
        known = read_known([*given, *config.getini("consilience_known")])
    except InvalidInput as error:
        raise pytest.UsageError(f"consilience: {error}") from None
    options = _options(engines, effort, digits, given)
    return Setting(engines, effort, digits, known, Interview(EFFORTS[effort], limit), options)


def _options(engines: Sequence[str], effort: str, digits: int | None, given: Sequence[Path]) -> tuple[str, ...]:
    return (
        *(() if effort == "full" else ("--consilience-effort", effort)),
        *(() if digits is None else ("--consilience-digits", str(digits))),
        *(part for path in given for part in ("--consilience-known", str(path))),
    )
