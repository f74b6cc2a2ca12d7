"""Interview of engines about one case after the other, each in a worker that lives as long as the test run."""

from __future__ import annotations

from dataclasses import dataclass, field

from consilience.case import Case
from consilience.compare import CODES, Comparison
from consilience.compare.judge import REFERENCE, judge_case, reference_motion
from consilience.engine import EngineInfo, Profile, Question, Run
from consilience.engine.worker.client import Request, Worker
from consilience.errors import ConsilienceError
from consilience.report.wording import severity
from consilience.suite import Thoroughness, ask_case


class EngineMissing(ConsilienceError):
    """An engine that does not start."""


@dataclass(frozen=True)
class JudgedQuestion:
    """Comparisons and runs of one engine on one question of one case.

    Attributes
    ----------
    info : EngineInfo
    comparisons : tuple of Comparison
        Comparisons of methods with matched settings, which alone decide.
    runs : tuple of Run
    """

    info: EngineInfo
    comparisons: tuple[Comparison, ...]
    runs: tuple[Run, ...]

    @property
    def worst(self) -> Comparison:
        """The comparison that decides."""
        return max(self.comparisons, key=lambda c: severity(c.verdict, c.digits))

    @property
    def fine(self) -> bool:
        """Whether the verdict passes, as for the exit code of `consilience run`."""
        return CODES[self.worst.verdict] == 0


@dataclass
class Interview:
    """Workers by engine, and the runs of the current case."""

    thoroughness: Thoroughness
    limit: float
    _workers: dict[str, Worker] = field(default_factory=dict)
    _infos: dict[str, EngineInfo] = field(default_factory=dict)
    _case: Case | None = None
    _runs: dict[tuple[str, Question], list[Run]] = field(default_factory=dict)

    def judged(self, case: Case, engine: str, question: Question) -> JudgedQuestion:
        """Ask an engine and judge its answers; a motion is judged with the answers to `model` and `instant`.

        Raises
        ------
        EngineMissing
            If the engine does not start.
        """
        if case is not self._case:
            self._case, self._runs = case, {}  # tests come case by case: the runs of one case are kept
        info = self._info(engine)
        questions = [q for q in Question if q is question or (question.over_time and not q.over_time)]
        names = dict.fromkeys((REFERENCE, engine))
        runs = [run for name in names for q in questions for run in self._asked(case, name, q)]
        found = [c for c in judge_case(case, runs) if (c.engine, c.question) == (engine, question)]
        matched = tuple(c for c in found if c.profile is Profile.MATCHED)
        return JudgedQuestion(info, matched, tuple(self._runs[engine, question]))

    def _asked(self, case: Case, engine: str, question: Question) -> list[Run]:
        if (engine, question) not in self._runs:
            worker = self._worker(engine)
            motion = reference_motion(case, self._runs.get((REFERENCE, question), []))
            runs = ask_case(worker, case, [question], self.thoroughness, reference_motion=motion)
            self._runs[engine, question] = list(runs)
        return self._runs[engine, question]

    def _info(self, engine: str) -> EngineInfo:
        if engine not in self._infos:
            reply = self._worker(engine).ask(Request())
            if not isinstance(reply.value, EngineInfo):
                raise EngineMissing(f"engine '{engine}' does not start: {reply.reason}\n{reply.log}".strip())
            self._infos[engine] = reply.value
        return self._infos[engine]

    def _worker(self, engine: str) -> Worker:
        if engine not in self._workers:
            self._workers[engine] = Worker(engine, self.limit)
        return self._workers[engine]

    def stop(self) -> None:
        """End all workers."""
        for worker in self._workers.values():
            worker.stop()
