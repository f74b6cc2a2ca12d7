"""Questions that are put to engines: the rows of one table, and the check of an answer against its row.

A row says what an engine is asked, what its answer must be, and who compares and shows the answer. The requests, the
codec, the store, the suite, the judge and the report read the table; docs/add-a-question.md shows how a row is added.
This room imports NumPy alone: a row names its comparison and its display as ``module:name``, imported where needed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cache
from importlib import import_module
from types import NoneType
from typing import Any, ClassVar, get_args, get_type_hints

import numpy as np

from consilience.mechanism import Mechanism

UNIT = 1e-9
"""How far the norm of a quaternion in an answer may be from one."""

Answer = Any
"""An answer: an object of the class that the row of its question names."""

Shape = tuple[int | str, ...]

_ROWS: dict[str, Question] = {}

ANSWERS: dict[str, type] = {}
"""Classes of answers by their names."""


class _QuestionTable(type):
    """Iterate over the rows of a class, in the order in which the questions are asked and judged."""

    def __iter__(cls) -> Iterator[Question]:
        return iter(tuple(_ROWS.values()))


class Question(str, metaclass=_QuestionTable):
    """A question to engines: its name, with its row of the table.

    ``Question("instant")`` is the row of that name, ``Question.add`` adds a row, and iteration over the class gives all
    rows. An engine answers by its method of the same name, ``engine.instant(mechanism, *arguments)``.

    Attributes
    ----------
    description : str
        What is asked, in one line for readers of a report.
    arguments : tuple of str
        What the engine's method receives after the mechanism, in order: ``state``, ``states``, ``times``, ``method``,
        ``step``, or names of parameters.
    answer : type
        Dataclass of the answer.
    shapes : dict
        Shape of each array and number of the answer. A size is a number, ``count`` (states or samples asked),
        ``bodies``, ``joints``, ``contacts``, or any other name: a size the engine chooses, the same wherever the name
        stands.
    judge : str or type
        Subclass of `compare.judges.QuestionJudge`, which compares the answers with the reference.
    facts : str or callable, optional
        Function of the report for facts beside the compared quantities, as `report.facts.instant_facts`.
    parameters : str or callable, optional
        Function of a case that returns the parameters of the question by name.
    """

    MODEL: ClassVar[Question]
    INSTANT: ClassVar[Question]
    TRAJECTORY: ClassVar[Question]

    description: str
    arguments: tuple[str, ...]
    answer: type
    shapes: Mapping[str, Shape]
    judge: str | type
    facts: str | Callable[..., Any]
    parameters: str | Callable[..., Mapping[str, Any]]

    def __new__(cls, name: str) -> Question:
        """Return the row of a name.

        Raises
        ------
        ValueError
            If the table has no such row.
        """
        if isinstance(name, str) and name in _ROWS:
            return _ROWS[name]
        raise ValueError(f"{name!r} is not a valid {cls.__name__}")

    def __reduce__(self) -> tuple[type[Question], tuple[str]]:
        return Question, (str(self),)

    @staticmethod
    def add(
        name: str,
        *,
        description: str,
        arguments: tuple[str, ...],
        answer: type,
        shapes: Mapping[str, Shape],
        judge: str | type,
        facts: str | Callable[..., Any] = "",
        parameters: str | Callable[..., Mapping[str, Any]] = "",
    ) -> Question:
        """Add a row to the table, or replace the row of that name.

        Parameters
        ----------
        name, description, arguments, answer, shapes, judge, facts, parameters : see the attributes of this class
        """
        question = str.__new__(Question, name)
        question.description, question.arguments = description, arguments
        question.answer, question.shapes = answer, shapes
        question.judge, question.facts, question.parameters = judge, facts, parameters
        _ROWS[name], ANSWERS[answer.__name__] = question, answer
        return question

    @property
    def at_states(self) -> bool:
        """Whether the question is asked at several states at once, and not at the initial one."""
        return "states" in self.arguments

    @property
    def over_time(self) -> bool:
        """Whether the answer is a motion."""
        return "times" in self.arguments

    @property
    def at_levels(self) -> bool:
        """Whether the question is asked at several step sizes or tolerances."""
        return "step" in self.arguments

    def sample_count(self, states: int, times: int = 0) -> int:
        """Return how many states or samples an answer has to given numbers of states and times."""
        return times if self.over_time else states if self.at_states else 1


def load_named(name: str | Callable[..., Any]) -> Any:
    """Return the object that a row names as ``module:name``, or the object itself if the row holds it."""
    if not isinstance(name, str):
        return name
    module, _, attribute = name.partition(":")
    return getattr(import_module(module), attribute)


@cache
def _optional(answer: type) -> frozenset[str]:
    """Names of the fields of an answer that may be None."""
    return frozenset(name for name, hint in get_type_hints(answer).items() if NoneType in get_args(hint))


def defects(answer: object, question: Question, mechanism: Mechanism, count: int) -> list[str]:
    """List what is wrong with the form of an answer: type, shapes, values that are not finite, quaternions not unit.

    Parameters
    ----------
    answer : object
    question : Question
    mechanism : Mechanism
    count : int
        Number of states or of samples that were asked, see `Question.sample_count`.
    """
    if not isinstance(answer, question.answer):
        return [f"the answer is a {type(answer).__name__}, not a {question.answer.__name__}"]
    sizes = {"count": count} | {group: len(getattr(mechanism, group)) for group in ("bodies", "joints", "contacts")}
    found = []
    for name, shape in question.shapes.items():
        value = getattr(answer, name)
        if value is None and name in _optional(question.answer):
            continue
        try:
            array = np.asarray(value)
        except ValueError as error:
            found.append(f"{name} is no array: {error}")
            continue
        expected = _resolved(shape, array.shape, sizes)
        if array.dtype.kind not in "fi":
            found.append(f"{name} holds {array.dtype}, not numbers")
        elif array.shape != expected:
            found.append(f"{name} has shape {array.shape}, not {expected}")
        elif not np.all(np.isfinite(array)):
            found.append(f"{name} has {int(np.sum(~np.isfinite(array)))} values that are not finite")
        elif name == "quat_WB" and np.max(np.abs(np.linalg.norm(array, axis=-1) - 1.0), initial=0.0) > UNIT:
            found.append(f"{name} holds quaternions that are not unit to {UNIT:g}")
    return found


def _resolved(shape: Shape, found: tuple[int, ...], sizes: dict[str, int]) -> tuple[int, ...]:
    """Return a shape in numbers; a size that the engine chooses is read from its first array."""
    for name, size in zip(shape, found, strict=False):
        if isinstance(name, str):
            sizes.setdefault(name, size)
    return tuple(sizes.get(size, 0) if isinstance(size, str) else size for size in shape)
