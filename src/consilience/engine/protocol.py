"""The protocol an engine's adapter follows, and how adapters are found.

An adapter is a plug-in package with an entry point in the group ``consilience.engines``. It sees a mechanism, a
state and a method, never a case: expected values cannot reach it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from types import ModuleType
from typing import Protocol

from consilience.engine.answers import (
    EngineInfo,
    InstantAnswer,
    Manifest,
    Method,
    ModelAnswer,
    Question,
    TrajectoryAnswer,
    Unsupported,
)
from consilience.engine.installation import adapter_file, lacks_engine, pip_requirement
from consilience.errors import InvalidInput
from consilience.mechanism import Array, Mechanism, State

GROUP = "consilience.engines"


class Engine(Protocol):
    """What the harness asks of an engine. Constructed without arguments, in the worker that owns it.

    A class with variants has a static method ``variants()`` that names them, and takes one as its only argument; an
    engine is then asked for as ``name:variant``, or by its name alone for the usual one.

    Rules for an implementer:

    1. Return canonical observables only (`consilience.engine.answers`); no generalised coordinate crosses the boundary.
    2. Map coordinates from and to body poses and velocities.
    3. Say what cannot be represented in `unsupported`, with the reason; never approximate in silence.
    4. Label each method with its route; name every knob that is not at its default in `Method.settings`.
    5. Fail by raising: the worker turns it into one failed run.
    """

    def info(self) -> EngineInfo:
        """Name and version."""
        ...

    def unsupported(self, mechanism: Mechanism, question: Question) -> tuple[Unsupported, ...]:
        """Everything of the mechanism and question the engine cannot represent; empty if it can."""
        ...

    def methods(self, mechanism: Mechanism, question: Question) -> tuple[Method, ...]:
        """Ways to answer the question, the headline first."""
        ...

    def manifest(self, mechanism: Mechanism) -> Manifest:
        """What the translation keeps exact and what it approximates."""
        ...

    def model(self, mechanism: Mechanism, state: State, method: Method) -> ModelAnswer:
        """Report mass, centre of mass, inertia and freedom of the translated model at a state."""
        ...

    def instant(self, mechanism: Mechanism, states: Sequence[State], method: Method) -> InstantAnswer:
        """Accelerations, joint reactions and energies at consistent states."""
        ...

    def trajectory(
        self, mechanism: Mechanism, state: State, times: Array, method: Method, step: float
    ) -> TrajectoryAnswer:
        """Motion from `state` at ``times[0]``, sampled on the uniform grid `times`.

        `step` is the step size and divides the sample interval; of an adaptive method it is the tolerance.
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
    """Names of installed engines that begin so, for a shell that completes; none is started."""
    return [name for name in installed() if name.startswith(incomplete)]


def installed() -> dict[str, EntryPoint]:
    """Entry points of all installed engines by name; nothing is imported."""
    return {point.name: point for point in sorted(entry_points(group=GROUP), key=lambda p: p.name)}


def load_engine(name: str) -> Engine:
    """Import and construct an engine in this process.

    Parameters
    ----------
    name : str
        ``name`` or ``name:variant``; another version than the installed one needs a worker (`engine.worker`).

    Raises
    ------
    InvalidInput
        If no engine of that name is installed, its package is missing, or it has no such variant.
    ImportError
        If its package does not import.
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


def split_name(name: str) -> tuple[str, str, str]:
    """Name, variant and version of ``NAME[:VARIANT][@VERSION]``; empty where there is none."""
    engine, _, version = name.partition("@")
    base, _, variant = engine.partition(":")
    return base, variant, version


def require_installed(name: str) -> None:
    """Refuse an engine without an installed adapter; nothing is imported, variant and version are not looked at.

    Raises
    ------
    InvalidInput
    """
    known = installed()
    if split_name(name)[0] not in known:
        raise InvalidInput(f"engine '{name}'", "it is not installed", f"Installed engines: {', '.join(known)}.")


def beyond(mechanism: Mechanism, known: Collection[str], name: str) -> tuple[Unsupported, ...]:
    """Features of a mechanism (`Mechanism.features`) that an adapter has no translation for.

    Parameters
    ----------
    known : collection of str
        What the adapter translates.
    name : str
        The engine's name, for the reason.
    """
    return tuple(
        Unsupported(where, f"the adapter of {name} has no translation for: {feature}")
        for feature, where in mechanism.features.items()
        if feature not in known
    )
