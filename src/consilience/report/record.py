"""The record of a suite as JSON Lines: header, cases, runs, comparisons, cells, footer.

Each line is a JSON object with a key ``record``. The footer comes last and counts the other lines: a record without
its footer was cut off, and is refused. The record holds answers in full, but for the arrays of motions, which are NPZ
files in the folder ``runs``.
"""

from __future__ import annotations

import json
import os
import platform
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, is_dataclass
from datetime import UTC, datetime
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from pydantic_core import from_json

from consilience.case import Case
from consilience.case.bounded_reading import bounded_text
from consilience.compare import exit_code as exit_code_of
from consilience.engine import Profile, Question, Run
from consilience.errors import InvalidInput
from consilience.mechanism import determinate_forces
from consilience.report.annotations import Lines, annotated, cell_lines, failure_of
from consilience.report.recordschema import FORMAT, READABLE, checked, contradictions
from consilience.report.replay import replays
from consilience.report.replayschema import NAME
from consilience.report.selection import grouped, is_matched
from consilience.suite import QUICK, Results

LARGEST_FILE = 500_000_000
"""Size limit of a record, bytes."""


@dataclass(frozen=True)
class Record:
    """A record read from its file, as dictionaries."""

    header: dict[str, Any]
    cases: list[dict[str, Any]]
    runs: list[dict[str, Any]]
    comparisons: list[dict[str, Any]]
    cells: list[dict[str, Any]]
    footer: dict[str, Any]

    @classmethod
    def annotated(cls, header: dict[str, Any], cases: Lines, runs: Lines, comparisons: Lines, footer: Any) -> Record:
        """Annotate lines without annotations, and judge the cells.

        Parameters
        ----------
        header, footer : dict
        cases, runs, comparisons : list of dict
            Lines of the record by kind, as `recordschema` describes them.
        """
        failures = [{**run, "failure": failure_of(run)} for run in runs]
        compared = list(annotated(comparisons, cases))
        return cls(header, list(cases), failures, compared, list(cell_lines(compared)), footer)

    @cached_property
    def _by_method(self) -> dict[tuple[str, ...], list[dict[str, Any]]]:
        return grouped(
            ((r["case"], r["engine"], r["question"], r["method"]["name"] if r["method"] else ""), r) for r in self.runs
        )

    def runs_of(self, comparison: dict[str, Any]) -> list[dict[str, Any]]:
        """Return the runs of the method of a comparison: levels, and probes of other softness."""
        c = comparison
        return self._by_method.get((c["case"], c["engine"], c["question"], c["method"]), [])

    @cached_property
    def _by_case(self) -> list[dict[str, list[dict[str, Any]]]]:
        return [grouped((one["case"], one) for one in lines) for lines in (self.runs, self.comparisons)]

    def of_case(self, name: str) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
        """Return the runs and the comparisons of a case."""
        runs, comparisons = self._by_case
        return runs.get(name, []), comparisons.get(name, [])

    def motions(self, case: str) -> list[dict[str, Any]]:
        """List the comparisons of motions of a case, matched methods first."""
        return sorted((c for c in self.of_case(case)[1] if c["levels"]), key=lambda c: not is_matched(c))

    def growing_motion(self, case: str) -> dict[str, Any] | None:
        """Return a comparison with the growth of perturbations, which is the same for all motions of a case."""
        return next((c for c in self.motions(case) if c["growth"]), None)

    def again(self, case: dict[str, Any] | None = None, engine: str = "", question: str = "") -> str:
        """Return the command that repeats the run, for one case or all, one engine or all, one question or all."""
        words = ["consilience", "run"]
        words += [] if case is None else [case.get("call") or case["name"]]
        words += ["-e", engine] if engine else []
        words += ["-q", question] if question else []
        words += ["--quick"] if self.header.get("quick") else []
        return shlex.join(words)


def _plain(value: Any) -> Any:
    """Convert to JSON types: arrays to lists, numbers that are not finite to None."""
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if is_dataclass(value) and not isinstance(value, type):
        return _plain({k: v for k, v in vars(value).items() if not k.startswith("_")})
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


def header(results: Results, elapsed: float) -> dict[str, Any]:
    """Make the header: versions, platform and engines."""
    packages = {p: version(p) for p in ("consilience", "numpy", "scipy", "numba")}
    return {
        "record": "header",
        "format": FORMAT,
        "written": datetime.now(UTC).isoformat(timespec="seconds"),
        "elapsed": round(elapsed, 1),
        "platform": f"{platform.system()} {platform.machine()}, {os.cpu_count()} processors",
        "processor": _processor(),
        "python": platform.python_version(),
        "packages": packages,
        "engines": {name: asdict(info) for name, info in results.engines.items()},
        "missing": results.missing,
        "questions": [str(q) for q in results.questions],
        "quick": results.thoroughness == QUICK,
    }


def _processor() -> str:
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        for line in cpuinfo.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or "unknown"


def _case(case: Case, questions: Sequence[Question]) -> dict[str, Any]:
    mechanism = case.mechanism
    return {
        "record": "case",
        "name": case.name,
        "call": case.call or case.name,
        "digest": case.digest,
        "title": case.title,
        "bodies": [b.name for b in mechanism.bodies],
        "joints": [[j.name, j.kind, j.predecessor, j.successor] for j in mechanism.joints],
        "rows": mechanism.constraint_count(),
        "duration": case.duration,
        "sample": case.sample,
        "digits": case.digits,
        "instants": case.instants,
        "undetermined": _undetermined(case) if Question.INSTANT in questions else {},
        "sources": case.sources,
        "remarks": case.remarks,
        "tags": case.tags,
    }


def _undetermined(case: Case) -> dict[str, list[int]]:
    """Count, for each joint and component of its reaction, the states in which equilibrium does not determine it."""
    try:
        states = case.states
    except InvalidInput:  # the comparisons of the case say why
        return {}
    determined = [determinate_forces(case.mechanism, state).reactions for state in states]
    counts = np.sum(~np.array(determined), axis=0)
    return {j.name: [int(n) for n in c] for j, c in zip(case.mechanism.joints, counts, strict=True) if np.any(c)}


def _run(run: Run) -> dict[str, Any]:
    answer = shown = run.answer
    if run.question.over_time and answer is not None:
        shown = {"counters": answer.counters, "samples": len(answer.time)}
    line = {name: value for name, value in vars(run).items() if name != "perturbation"}
    line |= {"record": "run", "answer": shown}
    return line | {"failure": failure_of(line)}


def lines(results: Results, elapsed: float) -> Iterator[dict[str, Any]]:
    """List the lines of a record in order."""
    yield header(results, elapsed)
    cases = [_plain(_case(case, results.questions)) for case in results.cases]
    yield from cases
    for run in results.runs:
        yield _run(run)
    comparisons = (_plain({"record": "comparison", **vars(comparison)}) for comparison in results.comparisons)
    compared = list(annotated(list(comparisons), cases))
    yield from compared
    yield from cell_lines(compared)
    yield {
        "record": "footer",
        "cases": len(results.cases),
        "runs": len(results.runs),
        "comparisons": len(results.comparisons),
        "exit_code": exit_code(results),
    }


def exit_code(results: Results) -> int:
    """Return 0 if all engines agree with matched settings, 1 if a model differs, 3 if the results are incomplete."""
    verdicts = {c.verdict for c in results.comparisons if c.profile is Profile.MATCHED}
    return exit_code_of(verdicts, bool(results.missing))


def write_atomically(path: Path, text: str) -> None:
    """Replace a file in one step: a reader sees the old file or the new file, never a part."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    temporary.write_text(text, encoding="utf-8")
    temporary.replace(path)


def write_record(results: Results, elapsed: float, folder: Path, jobs: int = 1) -> None:
    """Write ``report.jsonl``, motions as ``runs/*.npz``, and, by `jobs` processes, ``replay.json`` to a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    text = "".join(json.dumps(_plain(line), allow_nan=False) + "\n" for line in lines(results, elapsed))
    _write_arrays(results, folder / "runs")
    write_atomically(folder / NAME, replays(results.cases, results.runs, results.dense, jobs))
    write_atomically(folder / "report.jsonl", text)


def _write_arrays(results: Results, folder: Path) -> None:
    folder.mkdir(exist_ok=True)
    numbers: dict[tuple[str, str], int] = {}
    for run in results.runs:
        if run.question.over_time and run.answer is not None:
            key = (run.case, run.engine)
            numbers[key] = numbers.get(key, 0) + 1
            a = run.answer
            arrays = {name: getattr(a, name) for name in run.question.shapes if name != "time"}
            method = run.method.name if run.method else ""
            # softness 0 stands for hard constraints: an NPZ holds no None
            softness = (run.method.softness if run.method else None) or 0.0
            about = {"step": run.step or 0.0, "method": method, "softness": softness}
            target = folder / f"{run.case}.{run.engine}.{numbers[key]}.npz"
            np.savez_compressed(target, time=a.time, **about, **arrays)  # type: ignore[arg-type]


def read_question(folder: Path) -> dict[str, Any]:
    """Read what a report of a folder asked, from its first lines: cases, engines, questions, and whether quickly.

    Raises
    ------
    InvalidInput
        If the lines are not those of a report.
    """
    path = folder / "report.jsonl"
    cases, header, form = set[str](), dict[str, Any](), FORMAT
    with path.open(encoding="utf-8", errors="replace") as handle:
        for line in handle:
            try:
                raw = checked(from_json(line.encode()), form)
            except ValueError as error:
                raise InvalidInput(str(path), f"it is no report ({error})", "Run the suite again.") from None
            if raw["record"] not in ("header", "case"):
                break
            header = header or raw
            form = header.get("format", FORMAT)
            cases |= {raw["name"]} if raw["record"] == "case" else set()
    return {
        "cases": cases,
        "engines": {*header["engines"], *header["missing"]},
        "questions": set(header["questions"]),
        "quick": bool(header.get("quick")),
    }


def read_record(folder: Path) -> Record:
    """Read ``report.jsonl`` of a folder.

    Raises
    ------
    InvalidInput
        If the file does not exist, is not JSON Lines, is of another format, is cut off (without a footer, or with a
        footer that counts more lines), or violates `recordschema`.
    """
    path = folder / "report.jsonl"
    if not path.is_file():
        raise InvalidInput(str(path), "there is no such report", "Give a folder that `consilience run` wrote.")
    found: dict[str, list[dict[str, Any]]] = {k: [] for k in ("header", "case", "run", "comparison", "cell", "footer")}
    again, form = "Run the suite again.", FORMAT
    for number, line in enumerate(bounded_text(path, LARGEST_FILE).removesuffix("\n").split("\n"), start=1):
        where = f"{path}: line {number}"
        try:
            raw = from_json(line.encode(), allow_inf_nan=False)
            # the format first: lines of another format need not match the schema
            if number == 1 and isinstance(raw, dict) and raw.get("format", FORMAT) not in READABLE:
                known = " or ".join(map(str, READABLE))
                raise InvalidInput(str(path), f"its header is not of format {known}", again)
            record = checked(raw, form)
        except ValueError as error:
            raise InvalidInput(where, f"it is not a record of a report ({error})", again) from None
        if (record["record"] == "header") != (number == 1) or found["footer"]:
            raise InvalidInput(where, "the header comes first, the footer last, and each once", again)
        found[record["record"]].append(record)
        form = found["header"][0]["format"]
    footer = next(iter(found["footer"]), None)
    counted = {"cases": len(found["case"]), "runs": len(found["run"]), "comparisons": len(found["comparison"])}
    if footer is None or any(footer[k] != n for k, n in counted.items()):
        raise InvalidInput(str(path), "the report is cut off: its footer is missing or counts more", again)
    (header,) = found["header"]
    for problem in contradictions(header, found["case"], found["run"], found["comparison"], found["cell"]):
        raise InvalidInput(str(path), f"it contradicts itself: {problem}", again)
    if header["format"] < FORMAT:
        return Record.annotated(header, found["case"], found["run"], found["comparison"], footer)
    return Record(header, found["case"], found["run"], found["comparison"], found["cell"], footer)
