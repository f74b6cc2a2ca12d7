"""A case: a mechanism, its initial state, the questions to ask, and the sources."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib import import_module
from typing import Any

import numpy as np

from consilience.case.file.digest import case_digest
from consilience.case.published import Published
from consilience.errors import InvalidInput, in_range, require
from consilience.mechanism import (
    Array,
    Function,
    Initial,
    Mechanism,
    State,
    characteristic_length,
    fastest_rate,
    initial_state,
    random_states,
    refuse_flat_discs,
    refuse_overlap,
    require_states,
    strikes,
)

_OF_TIME = {
    "drives": "motion",
    "springs": "actuator",
    "joint_springs": "actuator",
    "loads": "history",
    "controls": "target",
}
"""Functions of time, by kind of element."""

_TURN = 0.1
"""Angle in rad that a random velocity turns a body in one sample: as fast as the samples resolve well."""

_SLOWEST = 1e-4
"""Least speed of random states, over that of falling by the mechanism's length: below it slip and rest are one."""

LARGEST_MOTION = 2_000_000
"""Largest number of samples times bodies of a trajectory: an answer of 200 MB."""


@dataclass(frozen=True)
class Case:
    """A mechanism with an initial state and the questions to ask about it.

    Attributes
    ----------
    name : str
        File stem, with ``-<variant>`` where the file has variants.
    file : str
        Name of the file, for messages.
    group : str
        Folder of the library; empty for a file from elsewhere.
    call : str
        Name of the case on the command line if that is not `name`: a path, or a member of a family.
    file_digest : str
        Digest of what its file asks; empty for a case without a file (`digest` is that of all cases).
    lines : mapping of str to int
        Lines of the file by what messages name there, as ``contact 'floor'``.
    duration, sample : float, s
        Span of the trajectory and its uniform sampling interval.
    digits : int
        Correct digits that a trajectory should have.
    instants : int
        Number of states of the question `instant`: the initial state, unless something strikes there, then random
        consistent states of `seed`.
    published : tuple of Published
        Expected values.
    """

    name: str
    file: str
    title: str
    mechanism: Mechanism
    initial: Initial
    duration: float
    sample: float
    digits: int
    instants: int
    seed: int
    sources: tuple[str, ...] = ()
    remarks: str = ""
    tags: tuple[str, ...] = field(default=())
    published: tuple[Published, ...] = ()
    group: str = ""
    call: str = ""
    file_digest: str = ""
    lines: Mapping[str, int] = field(default_factory=dict, repr=False, compare=False)

    def __post_init__(self) -> None:
        require_states(self.mechanism, ())
        require(self.initial, Initial, f"case '{self.name}': initial", "Give Initial({'pin': {'angle': 0.5}}).")
        for name in ("duration", "sample"):
            where, remedy = f"case '{self.name}': {name}", "Give a time above zero, in s."
            in_range(where, getattr(self, name), 0.0, np.inf, remedy, True)
        if not _is_multiple(self.duration, self.sample):
            raise InvalidInput(
                f"case '{self.name}': duration and sample",
                f"{self.duration:g} s and {self.sample:g} s",
                "Give a positive sample that divides the duration.",
            )
        size = self.duration / self.sample * len(self.mechanism.bodies)
        if not size <= LARGEST_MOTION:
            raise InvalidInput(
                f"case '{self.name}': trajectory",
                f"samples times bodies are {size:.3g}",
                f"Let them be {LARGEST_MOTION:.3g} at most: a shorter duration, or a longer sample.",
            )
        for group, name in _OF_TIME.items():
            for element in getattr(self.mechanism, group):
                self._refuse_short(f"{group[:-1].replace('_', ' ')} '{element.name}': {name}", getattr(element, name))

    def __repr__(self) -> str:
        m, samples = self.mechanism, f"{len(self.times)} samples over {self.duration:g} s"
        return f"Case '{self.name}': {len(m.bodies)} bodies, {len(m.joints)} joints, {samples}"

    def _repr_html_(self) -> str | None:
        return self.mechanism.drawn(None if self.unassembled else self.initial_state)

    def _refuse_short(self, where: str, function: Function | None) -> None:
        """Refuse a function of time whose table does not reach over the trajectory."""
        table = None if function is None else function.table
        if table is None or table.periodic or (table.x[0] <= 0.0 and self.duration <= table.x[-1]):
            return
        raise InvalidInput(
            f"case '{self.name}': {where}",
            f"its table reaches from {table.x[0]:g} to {table.x[-1]:g} s, the trajectory from 0 to {self.duration:g} s",
            "Give a longer table, or a shorter duration.",
        )

    @cached_property
    def initial_state(self) -> State:
        """Assembled, consistent initial state.

        Raises
        ------
        InvalidInput, CannotAssemble
            The message starts with the case's file.
        """
        try:
            state = initial_state(self.mechanism, self.initial)
            refuse_flat_discs(self.mechanism, state)
            refuse_overlap(self.mechanism, state)
        except InvalidInput as error:
            raise type(error)(f"{self._place(error.where)}: {error.where}", error.what, error.remedy) from None
        return state

    def _place(self, where: str) -> str:
        """Return the file, with the line of what a message names first."""
        named = next((line for name, line in self.lines.items() if where.startswith(name)), None)
        return self.file if named is None else f"{self.file}:{named}"

    @cached_property
    def unassembled(self) -> str:
        """Why the case has no initial state; empty if it has one."""
        return _refusal(lambda: self.initial_state)

    @cached_property
    def states(self) -> list[State]:
        """States of the question `instant`: the initial one, unless something strikes there, then random ones."""
        start = self.initial_state
        first = [] if strikes(self.mechanism, start) else [start]
        return [*first, *random_states(self.mechanism, start, self.instants - len(first), self.seed, self.speed)]

    @property
    def speed(self) -> float:
        """Speed of random states, rad/s and characteristic lengths per s: `_TURN` in a sample, or slow falling."""
        falling = np.linalg.norm(self.mechanism.gravity) / characteristic_length(self.mechanism)
        return max(_TURN / self.sample, _SLOWEST * float(np.sqrt(falling)))

    @cached_property
    def undrawn(self) -> str:
        """Why the states of the question `instant` cannot be drawn; empty if they can."""
        return _refusal(lambda: self.states)

    @cached_property
    def digest(self) -> str:
        """Digest of what the case asks: of its file, or without one, of the file that `save_case` writes."""
        if self.file_digest:
            return self.file_digest
        writer = import_module("consilience.case.file.writer")  # which imports this module, and Pydantic
        return case_digest(tomllib.loads(writer.case_text(self, exact=True)))

    @cached_property
    def fastest_rate(self) -> float:
        """Fastest rate of the mechanism at the initial state, 1/s."""
        return fastest_rate(self.mechanism, self.initial_state)

    @property
    def times(self) -> Array:
        """Sample times of the trajectory, shape (n_t,), s."""
        times = np.arange(round(self.duration / self.sample) + 1) * self.sample
        times[-1] = self.duration  # not a rounding beyond, where a table may have ended
        return times

    @classmethod
    def of(cls, mechanism: Mechanism, initial: Initial | None = None, **span: Any) -> Case:
        """Return a case about a mechanism.

        Parameters
        ----------
        mechanism : Mechanism
            Its name is that of the case.
        initial : Initial, optional
            Default: the drawing, at rest.
        **span
            ``duration`` (5 s), ``sample`` (0.05 s), ``digits`` (8), ``instants`` (20), ``seed`` (1), ``title``, ...
        """
        require_states(mechanism, ())
        name = mechanism.name
        known: dict[str, Any] = {"title": name, "duration": 5.0, "sample": 0.05, "digits": 8, "instants": 20, "seed": 1}
        return cls(name=name, file=name, mechanism=mechanism, initial=initial or Initial(), **known | span)

    def with_span(self, duration: float | None, sample: float | None) -> Case:
        """Return the case with another duration or sample, in s, and the expected values on the new grid.

        Raises
        ------
        InvalidInput
            The sample does not divide the duration.
        """
        span = self.duration if duration is None else duration
        step = self.sample if sample is None else sample
        other = replace(self, duration=span, sample=step, published=())
        return replace(
            other, published=tuple(k for k in self.published if k.time <= span and _is_multiple(k.time, step))
        )


def _is_multiple(value: float, step: float) -> bool:
    return abs(value / step - round(value / step)) <= 1e-9 * max(value / step, 1.0)


def _refusal(make: Callable[[], object]) -> str:
    """Return why something cannot be made; empty if it can."""
    try:
        make()
    except InvalidInput as error:
        return str(error)
    return ""
