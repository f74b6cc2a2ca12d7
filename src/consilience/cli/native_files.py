"""Files of a native model: the adapter's export, with a manifest."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from consilience.case import Case
from consilience.cli.options import writing
from consilience.engine import Question, beside_adapter, installed, load_engine, require_installed
from consilience.errors import InvalidInput
from consilience.mechanism import Mechanism, State

Exporter = Callable[[str, Mechanism, State], Mapping[str, str]]
"""Function from a title, a mechanism and its state to the texts of files by their names.

An adapter's package may have such a function, ``export_model`` in a module ``export``.
"""


def exporter(engine: str) -> Exporter:
    """Find the function of an adapter that writes native models.

    Raises
    ------
    InvalidInput
        If the engine is not installed, or its adapter writes no native models.
    """
    require_installed(engine)
    point = installed()[engine.partition(":")[0]]
    module = None if point.module.partition(".")[0] == "consilience" else beside_adapter(point, "export")
    if module is None:
        raise InvalidInput(f"engine '{engine}'", "its adapter writes no native models", "Choose another engine.")
    found: Exporter = module.export_model
    return found


def native_files(case: Case, engine: str, state: State | None = None) -> dict[str, str]:
    """Write the native model of a case for an engine: texts by the names of the files.

    Parameters
    ----------
    case : Case
    engine : str
    state : State, optional
        State at the start; by default the initial state of the case.

    Raises
    ------
    InvalidInput
        If the engine cannot represent the case, or its adapter cannot write the case.
    """
    write = exporter(engine)
    adapter = load_engine(engine)
    for missing in adapter.unsupported(case.mechanism, Question.INSTANT):
        raise InvalidInput(f"{engine}, {missing.feature}", missing.reason, "Choose another engine.")
    files = dict(write(f"{case.name}: {case.title}", case.mechanism, state or case.initial_state))
    info, manifest = adapter.info(), adapter.manifest(case.mechanism)
    lines = [f"# {case.title}", "", f"`{case.name}` ({case.file}) for {info.name} {info.version}.", ""]
    lines += [f"- exact: {text}" for text in manifest.exact]
    lines += [f"- approximated: {text}" for text in manifest.approximated]
    lines += ["", "`python run.py` prints the accelerations of all bodies in the initial state, world axes, SI.", ""]
    return files | {"manifest.md": "\n".join(lines)}


def write_native(files: Mapping[str, str], folder: Path) -> None:
    """Write the files of a native model to a new or empty folder.

    Raises
    ------
    InvalidInput
        If the folder holds anything, or cannot be written.
    """
    with writing(folder, "Name another folder."):
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise InvalidInput(str(folder), "there is something in it", "Name a new folder: nothing is overwritten.")
        for name, text in files.items():
            (folder / name).write_text(text, encoding="utf-8")
