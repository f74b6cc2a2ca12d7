"""Arguments and options shared by the commands, and the cases, engines, questions and files that they name."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from enum import StrEnum
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, Annotated

import typer

from consilience.errors import InvalidInput, nearest

if TYPE_CHECKING:
    from consilience.case import Case
    from consilience.engine import Profile, Question
    from consilience.suite.cluster import Cluster

CORES = os.cpu_count() or 2


class OutputFormat(StrEnum):
    """Formats of commands that print."""

    TEXT = "text"
    MARKDOWN = "markdown"
    JSON = "json"


def _cases_like(incomplete: str) -> list[str]:
    from consilience.case import cases_like

    return cases_like(incomplete)


def _engines_like(incomplete: str) -> list[str]:
    from consilience.engine import engines_like

    return engines_like(incomplete)


def _questions_like(incomplete: str) -> list[str]:
    from consilience.engine import Question

    return [str(question) for question in Question if question.startswith(incomplete)]


CaseName = Annotated[str, typer.Argument(help="Name or case file.", autocompletion=_cases_like)]
AnyCaseName = Annotated[
    str, typer.Argument(help="Name, case file, or family such as windows:count=3.", autocompletion=_cases_like)
]
CaseNames = Annotated[
    list[str] | None,
    typer.Argument(metavar="CASE", help="Names or case files; default: all.", autocompletion=_cases_like),
]
CaseFiles = Annotated[
    list[str], typer.Argument(metavar="FILE", help="Case files, names, or families.", autocompletion=_cases_like)
]
EngineNames = Annotated[
    list[str] | None,
    typer.Option("-e", "--engine", help="Engine; repeat it. Default: all.", autocompletion=_engines_like),
]
EngineName = Annotated[str, typer.Option("-e", "--engine", autocompletion=_engines_like)]
EngineToTranslate = Annotated[
    str, typer.Option("-e", "--engine", help="Engine whose model to write.", autocompletion=_engines_like)
]
QuestionNames = Annotated[
    list[str] | None,
    typer.Option("-q", "--question", help="Question; repeat it. Default: all.", autocompletion=_questions_like),
]
Jobs = Annotated[int, typer.Option("-j", "--jobs", min=1, help="Engines that work at a time.")]
JobLimit = Annotated[float, typer.Option(min=0.1, help="Time limit of one job in s.")]
MessageLimit = Annotated[float, typer.Option(min=0.1, help="Time limit of one message to an engine in s.")]
TablesFile = Annotated[Path | None, typer.Option("-o", "--output", help="Markdown file for the tables.")]
Tags = Annotated[list[str] | None, typer.Option("--tag", help="Only cases with this tag or of this group; repeat it.")]
ReportFolder = Annotated[Path, typer.Argument(help="Folder of a report.")]
Verbose = Annotated[bool, typer.Option("-v", "--verbose", help="Say on stderr what happens, and when.")]
Form = Annotated[OutputFormat, typer.Option("-f", "--format", help="How to write it.")]


def chosen_cases(names: list[str] | None) -> list[Case]:
    """Load the named cases; all shipped cases if none is named.

    Raises
    ------
    InvalidInput
        If one cannot be read, or has no start.
    """
    found, refused = sound_cases(names)
    if refused:
        raise _together(refused)
    return found


def sound_cases(names: list[str] | None) -> tuple[list[Case], list[InvalidInput]]:
    """Load the named cases that have a start, all shipped ones if none is named, with what is wrong with the others.

    Raises
    ------
    InvalidInput
        If none can be read and has a start.
    """
    from consilience.case import load_cases, shipped_cases

    if not names:
        return shipped_cases(), []
    found: list[Case] = []
    refused: list[InvalidInput] = []
    for name in names:
        try:
            loaded = load_cases(name)
        except InvalidInput as error:
            refused.append(error)
            continue
        for case in loaded:
            try:
                _ = case.initial_state
                found.append(case)
            except InvalidInput as error:  # it does not assemble, or bodies overlap: no engine is asked, and none fails
                refused.append(error)
    if not found:
        raise _together(refused)
    return found, refused


def _together(refused: list[InvalidInput]) -> InvalidInput:
    """Return one error that tells the first of several, and how many more there are."""
    from consilience.case.file.problems import InvalidCase

    return refused[0] if len(refused) == 1 else InvalidCase(refused)


def tagged_cases(cases: list[Case], tags: list[str] | None) -> list[Case]:
    """Choose the cases that have one of the tags, or whose group has that name.

    Raises
    ------
    InvalidInput
        If no case has a tag.
    """
    for tag in tags or []:
        if not any(tag in (case.group, *case.tags) for case in cases):
            known = sorted({name for case in cases for name in (case.group, *case.tags) if name})
            raise InvalidInput(f"tag '{tag}'", "no chosen case has it", nearest(tag, known, "Tags and groups"))
    return [case for case in cases if not tags or set(tags) & {case.group, *case.tags}]


def chosen_engines(names: list[str] | None) -> list[str]:
    """Check that the named engines are installed; return all installed engines if none is named."""
    from consilience.engine import installed, require_installed

    for name in names or []:
        require_installed(name)
    return list(dict.fromkeys(names or installed()))


def chosen_profile(name: str) -> Profile:
    """Return the profile of a name."""
    from consilience.engine import Profile

    if name not in tuple(Profile):
        raise InvalidInput(f"profile '{name}'", "it is not one we know", nearest(name, map(str, Profile), "Profiles"))
    return Profile(name)


def chosen_questions(names: list[str] | None) -> list[Question]:
    """Return the named questions in the order of `Question`; all questions if none is named."""
    from consilience.engine import Question

    known = [str(q) for q in Question]
    for name in names or []:
        if name not in known:
            raise InvalidInput(f"question '{name}'", "it is not one we know", nearest(name, known, "Questions"))
    return [q for q in Question if not names or str(q) in names]


def connect_cluster(address: str | None) -> AbstractContextManager[Cluster | None]:
    """Connect to the Dask scheduler at an address; without an address there is no cluster.

    Raises
    ------
    InvalidInput
        If Dask is not installed.
    ClusterError
        If no scheduler answers at the address.
    """
    if address is None:
        return nullcontext()
    try:
        from consilience.suite.cluster import Cluster
    except ModuleNotFoundError as error:
        if error.name != "distributed":
            raise
        raise InvalidInput("--scheduler", "Dask is not installed", "Install consilience[cluster].") from None
    return Cluster(address)


# ---------------------------------------------------------------- files


def require_folder(path: Path, content: str) -> Path:
    """Refuse a path at which no folder for the content can be, before work that would be lost."""
    if path.exists() and not path.is_dir():
        raise InvalidInput(str(path), "it is a file", f"Give a folder for the {content}.")
    _require_writable(next(above for above in (path, *path.absolute().parents) if above.exists()), path)
    return path


def require_place(path: Path | None) -> None:
    """Refuse a path at which no file can be written, before work that would be lost; None stands for no file."""
    if path is None:
        return
    if path.is_dir():
        raise InvalidInput(str(path), "it is a folder", "Give a file.")
    if not path.absolute().parent.exists():
        raise InvalidInput(str(path), "its folder does not exist", "Create the folder first.")
    _require_writable(path if path.exists() else path.absolute().parent, path)


def _require_writable(there: Path, path: Path) -> None:
    if not there.is_dir() and there.absolute() != path.absolute():
        raise InvalidInput(str(path), f"it cannot be written ({there} is a file)", "Choose another place.")
    if not os.access(there, os.W_OK):
        raise InvalidInput(str(path), f"it cannot be written ({there} is read-only)", "Choose another place.")
    if there.is_dir():
        with writing(path), TemporaryFile(dir=there):  # there are folders that nobody can create a file in
            pass


@contextmanager
def writing(path: Path, remedy: str = "Choose another place.") -> Iterator[None]:
    """Turn errors of the file system into bad input, while a file or a folder is written."""
    try:
        yield
    except OSError as error:
        raise InvalidInput(str(path), f"it cannot be written ({error.strerror})", remedy) from None


def write_new_case(path: Path, text: str) -> None:
    """Write a case file; refuse a file that exists."""
    with writing(path):
        try:
            with path.open("x", encoding="utf-8") as handle:
                handle.write(text)
        except FileExistsError:
            raise InvalidInput(str(path), "it exists, and nothing is overwritten", "Choose another name.") from None


def require_ending(path: Path, content: str, *endings: str) -> None:
    """Refuse a path for the content that has none of the endings."""
    if path.suffix not in endings:
        raise InvalidInput(str(path), f"it is no name of a {content}", f"Let it end with {', '.join(endings)}.")
