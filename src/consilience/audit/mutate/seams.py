"""Errors inside an adapter: names of its modules are replaced while a mutant is asked, and restored afterwards.

The class of the loaded engine gives the package of the adapter. If a name is gone, the mutant is not judged, and the
summary lists the mutant with the reason.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any
from unittest import mock

import numpy as np

from consilience.audit.mutate.mutated import Planting, SeamError, changed
from consilience.engine import Engine, Method


def module(engine: Engine, name: str) -> Any:
    """Return a module of the adapter of an engine.

    Raises
    ------
    SeamError
        If the adapter has no module of that name.
    """
    try:
        return importlib.import_module(f"{type(engine).__module__.partition('.')[0]}.{name}")
    except ModuleNotFoundError as error:
        raise SeamError(f"the adapter has no module {name}") from error


@contextmanager
def replaced(owner: Any, name: str, make: Callable[[Any], Any]) -> Iterator[None]:
    """Replace an attribute, or an entry of a dictionary, by ``make(original)`` until the end of a ``with``.

    Raises
    ------
    SeamError
        If there is no such attribute or entry.
    """
    is_table = isinstance(owner, dict)
    if not (name in owner if is_table else hasattr(owner, name)):
        raise SeamError(f"there is no '{name}' to plant in")
    if is_table:
        change: Any = mock.patch.dict(owner, {name: make(owner[name])})
    else:
        change = mock.patch.object(owner, name, make(getattr(owner, name)))
    with change:
        yield


def inside(*seams: tuple[str, str, Callable[[Any, float], Any]]) -> Planting:
    """Plant in names of the adapter: each seam is the owner, the attribute, and ``make(original, magnitude)``.

    The owner is a module of the adapter; ``module[NAME]`` is a dictionary of the module, ``""`` the engine object.
    """

    @contextmanager
    def plant(engine: Engine, magnitude: float) -> Iterator[Engine]:
        """Yield the engine itself, with every seam replaced until the end of a ``with``."""
        with ExitStack() as stack:
            for where, name, make in seams:
                made = partial(_made, make, magnitude)
                stack.enter_context(replaced(_owner(engine, where), name, made))
            yield engine

    return plant


def _owner(engine: Engine, where: str) -> Any:
    if not where:
        return engine
    home, _, table = where.rstrip("]").partition("[")
    owner = module(engine, home)
    if not table:
        return owner
    if not hasattr(owner, table):
        raise SeamError(f"{home} has no {table} to plant in")
    return getattr(owner, table)


def _made(make: Callable[[Any, float], Any], magnitude: float, original: Any) -> Any:
    return make(original, magnitude)


def with_settings(change: Callable[[dict[str, Any], float], dict[str, Any]]) -> Planting:
    """Plant in the settings of methods: the host answers by other settings than the engine declares."""

    def own(method: Method, magnitude: float) -> Method:
        return replace(method, settings=method.settings | change(method.settings, magnitude))

    return changed(own_method=own)


def on_result(change: Callable[[Any, float], None]) -> Callable[[Any, float], Any]:
    """Replace a function by one that changes the result in place, each object once."""

    def make(original: Any, magnitude: float) -> Any:
        seen: list[Any] = []

        def altered(*arguments: Any, **named: Any) -> Any:
            """Return the result of the original, changed when it is returned for the first time."""
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
    """A module with some functions replaced."""

    def __init__(self, original: Any, **other: Any) -> None:
        super().__init__(**other)
        self._original = original

    def __getattr__(self, name: str) -> Any:
        return getattr(self._original, name)


# ---------------------------------------------------------------- adapters that solve or integrate with the harness


def _lower_triangle(solve: Any, magnitude: float, M: Any, f: Any, J: Any, gamma: Any) -> Any:
    """Solve with a mass matrix whose lower triangle is smaller by a fraction; 1: missing.

    Parameters
    ----------
    solve : callable
        The original, `consilience.engine.solve_constrained`.
    magnitude : float
    M, f, J, gamma : ndarray
        Mass matrix (n, n), forces (n,), constraint Jacobian (m, n) and right-hand side (m,).
    """
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
    """Integrate by the classical Runge-Kutta method, with a fraction of Euler's increment in each step.

    Parameters
    ----------
    magnitude : float
        Fraction; 1 is Euler's method.
    derivative : callable
        Right-hand side f(y).
    y : ndarray
        Initial state.
    step : float, s
    count : int
        Number of steps.
    record : callable
        Called with the initial state and the state of each sample.
    every : int
        Steps per sample.
    """
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
