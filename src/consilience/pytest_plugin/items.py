"""Pytest collectors of case files, and tests of a case, an engine and a question."""

from __future__ import annotations

import os
import re
import shlex
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest

from consilience.case import Case
from consilience.case.file.reader import load_file
from consilience.compare import Verdict
from consilience.engine import Question
from consilience.errors import ConsilienceError
from consilience.pytest_plugin.interview import JudgedQuestion
from consilience.pytest_plugin.known import KnownDifference
from consilience.pytest_plugin.setting import Setting
from consilience.pytest_plugin.wording import evidence

_BODY = re.compile(r"^\s*\[\[body\]\]", re.MULTILINE)


class Disagreement(ConsilienceError):
    """An answer with a verdict that does not pass; a known difference expects this failure."""


class Outdated(ConsilienceError):
    """A known difference whose verdict has become another."""


def looks_like_a_case(path: Path) -> bool:
    """Whether a TOML file has bodies and joints; an invalid file counts if it has a table of a body."""
    text = path.read_text(encoding="utf-8", errors="replace")
    try:
        return {"body", "joint"} <= set(tomllib.loads(text))
    except tomllib.TOMLDecodeError:
        return _BODY.search(text) is not None


class CaseFile(pytest.File):
    """Collector of a case file: each case or variant with every engine and every question."""

    def __init__(self, *, setting: Setting, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.setting = setting

    def collect(self) -> Iterator[CaseTest]:
        """List tests case by case and engine by engine: neighbours share runs."""
        for case in load_file(self.path):
            asked = self.setting.case(replace(case, group=self.path.parent.name))
            for engine in self.setting.engines:
                for question in Question:
                    name = f"{case.name}[{engine}-{question}]"
                    yield CaseTest.from_parent(
                        self, name=name, case=asked, engine=engine, question=question, setting=self.setting
                    )

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """Show an invalid case file as one message."""
        if isinstance(excinfo.value, ConsilienceError):
            return str(excinfo.value)
        return super().repr_failure(excinfo)


class CaseTest(pytest.Item):
    """Test of one question about one case to one engine."""

    def __init__(self, *, case: Case, engine: str, question: Question, setting: Setting, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.case, self.engine, self.question, self.setting = case, engine, question, setting
        self.known = setting.known_of(case.name, engine, question)
        about = {"engine": engine, "question": str(question), "case": case.name, "group": case.group}
        self.add_marker(pytest.mark.consilience(**about))
        for tag in case.tags:
            self.add_marker(pytest.mark.consilience(tag=tag))
        self.extra_keyword_matches |= {case.group, *case.tags}
        if self.known is not None:
            self.add_marker(pytest.mark.xfail(reason=self.known.reason, raises=Disagreement, strict=True))

    def runtest(self) -> None:
        """Ask the engine, compare, and report verdict and evidence."""
        found = self.setting.interview.judged(self.case, self.engine, self.question)
        worst, text = found.worst, evidence(found, self.case, self._again())
        self.user_properties += [("verdict", str(worst.verdict)), ("version", found.info.version)]
        if worst.digits is not None:
            self.user_properties.append(("digits", round(worst.digits, 2)))
        self._judge(found, text)
        self.add_report_section("call", "consilience", text)  # a failure already has the text as its message

    def _judge(self, found: JudgedQuestion, text: str) -> None:
        verdict = found.worst.verdict
        if (
            self.known is not None
            and verdict is not self.known.verdict
            and (not found.fine or verdict is Verdict.UNSUPPORTED)
        ):
            what = f"known as '{self.known.verdict}' ({self.known.reason}), it is now '{verdict}'"
            raise Outdated(f"{what}: correct or remove the entry\n{text}")
        if verdict is Verdict.UNSUPPORTED:
            pytest.skip(f"{self.name}: unsupported: {found.worst.why}")
        if not found.fine:
            raise Disagreement(text)

    def _again(self) -> tuple[str, str]:
        """Return the commands that ask again: the report, and this test alone."""
        path = os.path.relpath(self.path, self.config.invocation_params.dir)
        quick = ("--quick",) if self.setting.effort == "quick" else ()
        options = self.setting.options
        return (
            shlex.join(("consilience", "run", path, "-e", self.engine, *quick)),
            shlex.join(("pytest", "--consilience-engine", self.engine, *options, f"{path}::{self.name}")),
        )

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """Show a failure of the engine or of the input without a traceback of the harness."""
        if isinstance(excinfo.value, ConsilienceError):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, int | None, str]:
        """Return file and name of the test."""
        return self.path, None, self.name


@dataclass(eq=False)
class EngineTests:
    """Hooks of a test run that names an engine."""

    setting: Setting
    _idle: list[KnownDifference] = field(default_factory=list)

    def pytest_report_header(self) -> str:
        """Return the line of the settings."""
        return self.setting.header

    def pytest_collect_file(self, file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
        """Collect a TOML file that looks like a case, or that is named on the command line."""
        if file_path.suffix != ".toml" or not (parent.session.isinitpath(file_path) or looks_like_a_case(file_path)):
            return None
        node: Any = CaseFile.from_parent(parent, path=file_path, setting=self.setting)
        return node

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """List the known differences of the engines that match no test, before tests are deselected."""
        named = {id(known) for item in items if (known := getattr(item, "known", None)) is not None}
        own = [known for known in self.setting.known if known.engine in self.setting.engines]
        self._idle = [known for known in own if id(known) not in named]

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        """Print the known differences that match no test: a case may have been renamed."""
        for known in self._idle:
            terminalreporter.write_line(f"consilience: no test collected for the known difference: {known}")
