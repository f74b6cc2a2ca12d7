"""Protocol of an engine's adapter, and search for installed adapters.

An adapter is a plug-in package with an entry point in the group ``consilience.engines``. An adapter receives a
mechanism, states and a method, never a case: expected values cannot reach it.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from types import MappingProxyType, ModuleType
from typing import Protocol

import numpy as np

from consilience.engine.answers import (
    EngineInfo,
    InstantAnswer,
    Manifest,
    Method,
    ModelAnswer,
    TrajectoryAnswer,
    Unsupported,
)
from consilience.engine.installation import adapter_file, lacks_engine, pip_requirement
from consilience.engine.questions import Question
from consilience.errors import InvalidInput, nearest, require
from consilience.mechanism import Array, Mechanism, State

GROUP = "consilience.engines"

WHOLE = 1e-9
"""Largest relative error of a number of steps that counts as whole: rounding of differences of sample times."""


class Engine(Protocol):
    """Protocol of an adapter; an instance is constructed without arguments, in the worker of the engine.

    A class with variants has a static method ``variants()`` that returns their names; its constructor takes the name of
    a variant as its only argument, and users write ``name:variant``, or ``name`` for the usual variant.

    The engine answers a question of the table (`consilience.engine.questions`) by its method of the same name. A
    question without such a method is unsupported, so that an adapter need not know every question.

    Rules for an implementer:

    1. Return canonical observables only (`consilience.engine.answers`), no generalised coordinates.
    2. Convert between the engine's coordinates and the poses and velocities of bodies.
    3. Name every feature that cannot be represented in `unsupported`, with the reason; never approximate silently.
    4. Label each method with its route; list every setting that is not at its default in `Method.settings`.
    5. Fail by raising: the worker turns an exception into one failed run.
    6. Raise `CannotRepresent` where a state, or the course of a motion, is what the engine cannot represent: such a run
       is unsupported.
    """

    def info(self) -> EngineInfo:
        """Return name and version of the engine."""
        ...

    def unsupported(self, mechanism: Mechanism, question: Question) -> tuple[Unsupported, ...]:
        """Return all features of mechanism and question that the engine cannot represent; empty if there are none."""
        ...

    def methods(self, mechanism: Mechanism, question: Question) -> tuple[Method, ...]:
        """Return the methods that answer the question, the headline method first."""
        ...

    def manifest(self, mechanism: Mechanism) -> Manifest:
        """Return the features that the translation keeps exact, and those that it approximates."""
        ...

    def model(self, mechanism: Mechanism, state: State, method: Method) -> ModelAnswer:
        """Return mass, centre of mass, inertia and degrees of freedom of the translated model at a state."""
        ...

    def instant(self, mechanism: Mechanism, states: Sequence[State], method: Method) -> InstantAnswer:
        """Return accelerations, joint reactions and energies at consistent states."""
        ...

    def trajectory(
        self, mechanism: Mechanism, state: State, times: Array, method: Method, step: float
    ) -> TrajectoryAnswer:
        """Integrate the motion from a state at ``times[0]``.

        Parameters
        ----------
        mechanism : Mechanism
        state : State
        times : ndarray, shape (n_t,), s
            Uniform grid of samples.
        method : Method
        step : float
            Step size in s, which divides the sample interval; the tolerance of an adaptive method.
        """
        ...


def beside_adapter(point: EntryPoint, name: str) -> ModuleType | None:
    """A module of an adapter's package beside the engine; None where it has none, or is a single file."""
    # looked for as a file: to ask for it by name imports the package, whose engine may not be there
    if adapter_file(point, f"{name}.py") is None:
        return None
    with _engine_needed(point):
        return import_module(f"{point.module.partition('.')[0]}.{name}")


@contextmanager
def _engine_needed(point: EntryPoint) -> Iterator[None]:
    """Say how to get an engine whose package is missing, in place of the error of the import."""
    try:
        yield
    except ModuleNotFoundError as error:
        if not lacks_engine(point):
            raise
        remedy = f"Install it: pip install '{pip_requirement(point)}'"
        raise InvalidInput(f"engine '{point.name}'", f"its package is not here ({error})", remedy) from None


def engines_like(incomplete: str) -> list[str]:
    """Return names of installed engines that begin so, for completion in a shell; no engine is imported."""
    return [name for name in installed() if name.startswith(incomplete)]


def installed() -> dict[str, EntryPoint]:
    """Return the entry points of all installed engines by name; no engine is imported."""
    # the files of all distributions are read again only when a folder on the path has changed
    return dict(_points(*(_written(folder or os.curdir) for folder in sys.path)))


@lru_cache(maxsize=4)
def _points(*path: tuple[str, int]) -> dict[str, EntryPoint]:
    del path
    return {point.name: point for point in sorted(entry_points(group=GROUP), key=lambda p: p.name)}


def _written(folder: str) -> tuple[str, int]:
    """Return a folder and the time of its last change, in ns; zero if there is no such folder."""
    try:
        return folder, os.stat(folder).st_mtime_ns
    except OSError:
        return folder, 0


def load_engine(name: str) -> Engine:
    """Import and construct an engine in this process.

    Parameters
    ----------
    name : str
        ``name`` or ``name:variant``; a version that is not installed here needs a worker (`engine.worker`).

    Raises
    ------
    InvalidInput
        If no engine of that name is installed, its package is missing, or it has no such variant.
    ImportError
        If the package of the engine cannot be imported.
    """
    require_installed(name)
    base, variant, _ = split_name(name)
    point = installed()[base]
    with _engine_needed(point):
        make = point.load()
    if not variant:
        plain: Engine = make()
        return plain
    known: Collection[str] = make.variants() if hasattr(make, "variants") else ()
    if variant not in known:
        names = ", ".join(known) or "none"
        raise InvalidInput(f"engine '{name}'", f"{base} has no variant '{variant}'", f"It has: {names}.")
    engine: Engine = make(variant)
    return engine


def steps_per_sample(times: Array, step: float) -> int:
    """Return the number of steps in a sample interval, for an engine with a fixed step.

    Parameters
    ----------
    times : ndarray, shape (n_t,), s
        Uniform grid of samples.
    step : float, s

    Raises
    ------
    InvalidInput
        The intervals differ; the step is not positive, longer than the interval, or does not divide the interval.
    """
    intervals = np.diff(times)
    interval = float(intervals[0])
    if np.ptp(intervals) > WHOLE * interval:
        told = f"sample intervals from {np.min(intervals):g} to {np.max(intervals):g} s"
        raise InvalidInput("times", told, "Give a uniform grid: an engine's step divides one interval.")
    ratio = interval / step if step > 0.0 else 0.0
    count = round(ratio) if np.isfinite(ratio) else 0
    if count < 1 or abs(ratio - count) > WHOLE * count:
        near = f"{interval / max(count, 1):g} s" if step > 0.0 else f"{interval:g} s or a whole fraction of it"
        raise InvalidInput("step", f"{step:g} s does not divide the sample interval of {interval:g} s", f"Give {near}.")
    return count


def split_name(name: str) -> tuple[str, str, str]:
    """Return name, variant and version of ``NAME[:VARIANT][@VERSION]``; absent parts are empty."""
    engine, _, version = name.partition("@")
    base, _, variant = engine.partition(":")
    return base, variant, version


def require_installed(name: str) -> None:
    """Refuse an engine without an installed adapter; no engine is imported, variant and version are not checked.

    Raises
    ------
    InvalidInput
    """
    require(name, str, "engine", "Give the name of an engine.")
    known = installed()
    if split_name(name)[0] not in known:
        raise InvalidInput(
            f"engine '{name}'", "it is not installed", nearest(split_name(name)[0], known, "Installed engines")
        )


def feature_names(joints: str, elements: str) -> frozenset[str]:
    """Return the features of the listed kinds of joints and elements, in the names of `Mechanism.features`.

    Parameters
    ----------
    joints, elements : str
        Names, separated by ``", "``.
    """
    return frozenset((*(f"{kind} joint" for kind in joints.split(", ")), *elements.split(", ")))


def _because(reasons: Mapping[str, str], feature: str) -> str:
    return f" ({reasons[feature]})" if feature in reasons else ""


def beyond(
    mechanism: Mechanism, known: Collection[str], name: str, reasons: Mapping[str, str] = MappingProxyType({})
) -> tuple[Unsupported, ...]:
    """Return the features of a mechanism (`Mechanism.features`) for which an adapter has no translation.

    Parameters
    ----------
    known : collection of str
        Features that the adapter translates.
    name : str
        Name of the engine, for the reason.
    reasons : dict, optional
        Why the engine has no translation, by feature.
    """
    return tuple(
        Unsupported(where, f"the adapter of {name} has no translation for: {feature}{_because(reasons, feature)}")
        for feature, where in mechanism.features.items()
        if feature not in known
    )
