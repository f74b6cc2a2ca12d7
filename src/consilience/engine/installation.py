"""Installation of engines: files of an adapter's package, the distribution of its engine, and how pip gets it."""

from __future__ import annotations

import re
from importlib.metadata import EntryPoint, PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

REQUIREMENTS = "worker-requirements.txt"
"""File in an adapter's package: the distribution that is the engine on its first line, without a version."""


_OF_EXTRA = re.compile(r"""(?P<distribution>[\w.-]+)[^;]*;.*\bextra\s*==\s*['"](?P<extra>[\w.-]+)['"]""")


def adapter_file(point: EntryPoint, name: str) -> Path | None:
    """Return the path of a file in an adapter's package; None if there is no such file. No engine is imported."""
    spec = find_spec(point.module.partition(".")[0])
    folders = (spec.submodule_search_locations or ()) if spec else ()
    return next((path for folder in folders if (path := Path(folder) / name).is_file()), None)


def engine_distribution(point: EntryPoint) -> str:
    """Return the distribution that is the engine of an adapter; empty if the adapter names none."""
    path = adapter_file(point, REQUIREMENTS)
    return path.read_text(encoding="utf-8").split()[0] if path else ""


def lacks_engine(point: EntryPoint) -> bool:
    """Whether the engine that an adapter names is not installed; nothing is imported."""
    wanted = engine_distribution(point)
    try:
        return bool(wanted) and not version(wanted)
    except PackageNotFoundError:
        return True


def pip_requirement(point: EntryPoint) -> str:
    """Return the requirement by which pip gets an engine, such as ``consilience[ENGINE]``.

    Of the extras of the adapter's distribution that require the engine, the one with the fewest requirements counts;
    without such an extra the requirement is the engine's distribution.
    """
    wanted = engine_distribution(point)
    if not wanted or point.dist is None:
        return wanted
    extras: dict[str, list[str]] = {}
    for text in point.dist.requires or ():
        if found := _OF_EXTRA.match(text):
            extras.setdefault(found["extra"], []).append(found["distribution"].lower())
    fitting = [extra for extra, needs in extras.items() if wanted.lower() in needs]
    return f"{point.dist.name}[{min(fitting, key=lambda extra: len(extras[extra]))}]" if fitting else wanted
