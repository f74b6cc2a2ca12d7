"""The library of shipped cases, and the search for a case by name or path."""

from __future__ import annotations

from dataclasses import replace
from difflib import get_close_matches
from functools import cache
from pathlib import Path

from consilience.case.case import Case
from consilience.case.file.reader import load_file
from consilience.errors import InvalidInput


def case_folder() -> Path:
    """Return the folder of the shipped cases: in the installed package, or beside ``src`` in a checkout."""
    package = Path(__file__).parents[1]
    packaged = package / "cases"
    return packaged if packaged.is_dir() else package.parents[1] / "cases"


def case_names() -> list[str]:
    """Return the names of all shipped cases, one for each variant."""
    return [case.name for case in shipped_cases()]


def case_files() -> list[Path]:
    """Return the files of the shipped cases, sorted by group (folder) and name."""
    return sorted(case_folder().glob("*/*.toml"))


def shipped_cases() -> list[Case]:
    """Return all shipped cases, sorted by group and file."""
    return [case for path in case_files() for case in _shipped(path)]


def _shipped(path: Path) -> list[Case]:
    return list(_read(path, path.stat().st_mtime_ns))


@cache
def _read(path: Path, written: int) -> tuple[Case, ...]:
    """Read a shipped file once for each time at which it was written: who asks again gets the assembled states, too."""
    del written
    return tuple(replace(case, group=path.parent.name) for case in load_file(path))


def cases_like(incomplete: str) -> list[str]:
    """Return the names of shipped files and families with a beginning, for completion in a shell; reads no file."""
    from consilience.case.families import FAMILIES  # noqa: PLC0415 - see `_of_family`

    names = dict.fromkeys((*(path.stem for path in case_files()), *FAMILIES))
    return [name for name in names if name.startswith(incomplete)]


def load_cases(name: str | Path) -> list[Case]:
    """Return the cases of a name: a shipped case or all its variants, a member of a family, or the path of a file.

    A `pathlib.Path` is always a file.

    In the name of a shipped case ``-`` and ``_`` are the same.

    Raises
    ------
    InvalidInput
        There is no such case.
    """
    if not isinstance(name, str | Path):
        raise InvalidInput("case", f"it is a {type(name).__name__}", "Give the name of a case or the path of its file.")
    if isinstance(name, Path) or name.endswith(".toml") or "/" in name:
        return [replace(case, call=str(name)) for case in load_file(Path(name))]
    plain = name.replace("-", "_")
    for path in case_files():
        if plain == path.stem or plain.startswith(f"{path.stem}_"):
            cases = _shipped(path)
            chosen = cases if plain == path.stem else [c for c in cases if c.name.replace("-", "_") == plain]
            if chosen:
                return chosen
    return [replace(case, call=name) for case in _of_family(name)]


def _of_family(name: str) -> list[Case]:
    """Return the cases of a family, which may be given parameters; refuse another name."""
    from consilience.case.families import FAMILIES, family_cases  # noqa: PLC0415 - a shipped file needs none of them

    if ":" in name or name in FAMILIES:
        return family_cases(name)
    near = get_close_matches(name, list(dict.fromkeys([*case_names(), *FAMILIES])), n=5, cutoff=0.5)
    raise InvalidInput(
        f"case '{name}'",
        "there is no shipped case of that name",
        (f"Nearest: {', '.join(near)}; `consilience list` names all" if near else f"Shipped: {', '.join(case_names())}")
        + f". Families: {', '.join(FAMILIES)}, as FAMILY:PARAMETER=VALUE,... The path of a case file works, too.",
    )


def load_case(name: str | Path) -> Case:
    """Return one case by name or path.

    Raises
    ------
    InvalidInput
        There is no such case, or the name stands for several variants.
    """
    cases = load_cases(name)
    if len(cases) > 1:
        known = ", ".join(case.name for case in cases)
        raise InvalidInput(f"case '{name}'", f"it has {len(cases)} variants", f"Name one: {known}.")
    return cases[0]
