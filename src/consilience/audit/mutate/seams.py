"""Errors inside an adapter: its names are replaced while a mutant is asked, and put back.

Modules of an adapter are found from the class of the engine that was loaded. A name that is gone makes a mutant that
is not judged, which the summary tells.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np

from consilience.audit.mutate.mutated import Mutated, Planting, SeamError
from consilience.engine import Engine


def module(engine: Engine, name: str) -> Any:
    """Module of the adapter an engine comes from.

    Raises
    ------
    SeamError
        If the adapter has none of that name.
    """
    try:
        return importlib.import_module(f"{type(engine).__module__.partition('.')[0]}.{name}")
    except ModuleNotFoundError as error:
        raise SeamError(f"the adapter has no module {name}") from error


@contextmanager
def replaced(owner: Any, name: str, make: Callable[[Any], Any]) -> Iterator[None]:
    """Replace an attribute, or an entry of a dictionary, by what `make` makes of it.

    Raises
    ------
    SeamError
        If there is none of that name.
    """
    table = owner if isinstance(owner, dict) else vars(owner)
    inherited = not isinstance(owner, dict) and name not in table and hasattr(owner, name)
    if name not in table and not inherited:
        raise SeamError(f"there is no '{name}' to plant in")
    original = getattr(owner, name) if inherited else table[name]
    put = owner.__setitem__ if isinstance(owner, dict) else partial(setattr, owner)
    put(name, make(original))
    try:
        yield
    finally:
        if inherited:
            delattr(owner, name)
        else:
            put(name, original)


def inside(*seams: tuple[str, str, Callable[[Any, float], Any]]) -> Planting:
    """Plant by names of modules of the adapter: each seam is module, attribute, and ``make(original, magnitude)``.

    ``module[NAME]`` is a dictionary of the module; the module ``""`` is the engine object.
    """

    @contextmanager
    def plant(engine: Engine, magnitude: float) -> Iterator[Engine]:
        """The engine itself, with every seam replaced until the end of a ``with``."""
        with ExitStack() as stack:
            for where, name, make in seams:
                owner: Any = engine
                if where:
                    home, _, table = where.partition("[")
                    owner = module(engine, home)
                    if table and not hasattr(owner, table.rstrip("]")):
                        raise SeamError(f"{home} has no {table.rstrip(']')} to plant in")
                    owner = getattr(owner, table.rstrip("]")) if table else owner
                stack.enter_context(replaced(owner, name, partial(_at, make, magnitude)))
            yield engine

    return plant


def _at(make: Callable[[Any, float], Any], magnitude: float, original: Any) -> Any:
    return make(original, magnitude)


def with_settings(change: Callable[[dict[str, Any], float], dict[str, Any]]) -> Planting:
    """Plant in the settings of a method: the engine is asked by other settings than the method says."""

    @contextmanager
    def plant(engine: Engine, magnitude: float) -> Iterator[Engine]:
        """The engine behind a mutant that alters the settings it is asked by."""
        mutant = Mutated(engine, magnitude)

        def own(method: Any) -> Any:
            return replace(method, settings=method.settings | change(method.settings, magnitude))

        mutant._own = own  # type: ignore[method-assign]
        yield mutant

    return plant


def on_result(change: Callable[[Any, float], None]) -> Callable[[Any, float], Any]:
    """Let a function's result be changed in place, each object once."""

    def make(original: Any, magnitude: float) -> Any:
        """The function to put in place of `original`."""
        seen: list[Any] = []

        def altered(*arguments: Any, **named: Any) -> Any:
            """The original's result, changed unless it has been before."""
            result = original(*arguments, **named)
            if not any(result is known for known in seen):
                seen.append(result)
                change(result, magnitude)
            return result

        return altered

    return make


def wrapped(change: Callable[..., Any]) -> Callable[[Any, float], Any]:
    """Replace a function by ``change(original, magnitude, *arguments)``."""

    def make(original: Any, magnitude: float) -> Any:
        return lambda *arguments, **named: change(original, magnitude, *arguments, **named)

    return make


class Proxy(SimpleNamespace):
    """A module with some of its functions replaced."""

    def __init__(self, original: Any, **other: Any) -> None:
        super().__init__(**other)
        self._original = original

    def __getattr__(self, name: str) -> Any:
        return getattr(self._original, name)


# ---------------------------------------------------------------- adapters that solve or integrate with the harness


def _lower_triangle(solve: Any, magnitude: float, M: Any, f: Any, J: Any, gamma: Any) -> Any:
    """Solve with a mass matrix whose lower triangle is missing, or smaller by a fraction."""
    return solve(np.triu(M) + (1.0 - magnitude) * np.tril(M, -1), f, J, gamma)


@contextmanager
def lower_triangle(engine: Engine, magnitude: float) -> Iterator[Engine]:
    """Plant `_lower_triangle` in the module of an adapter that its ``mutants`` name as ``SOLVER``."""
    seam = (module(engine, "mutants").SOLVER, "solve_constrained", wrapped(_lower_triangle))
    with inside(seam)(engine, magnitude) as planted:
        yield planted


def _first_order_step(
    _: Any, magnitude: float, derivative: Any, y: Any, step: float, count: int, record: Any, every: int
) -> Any:
    """Runge-Kutta of order four with a part `magnitude` of Euler's method in it."""
    record(y)
    for n in range(1, count + 1):
        k1 = derivative(y)
        k2 = derivative(y + 0.5 * step * k1)
        k3 = derivative(y + 0.5 * step * k2)
        k4 = derivative(y + step * k3)
        mean = (k1 + 2.0 * (k2 + k3) + k4) / 6.0
        y = y + step * (mean + magnitude * (k1 - mean))
        if n % every == 0:
            record(y)
    return y


first_order_step = wrapped(_first_order_step)
