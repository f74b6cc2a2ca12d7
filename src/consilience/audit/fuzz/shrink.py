"""Shrink a case that shows a disagreement to the smallest that still shows it. Hypothesis does the shrinking.

The case is a list of choices (`reductions`), the largest of each as it is; Hypothesis is handed that list as one that
fails, through its entrance for other fuzzers, and finds the least list that fails still. First parts are taken away,
many at once, then fewer; then what is left is made simpler; and both again until nothing more goes. It is handed few
choices at a time: it looks for order among them, too, which here is none, and the time for that grows fast.
"""

from __future__ import annotations

import time
import tomllib
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from consilience.audit.fuzz.population import read_text
from consilience.audit.fuzz.reductions import AS_IS, knobs, parts, simplified, without
from consilience.audit.random_mechanisms import GAP, rank_of
from consilience.case.file.values import TomlTable
from consilience.case.file.writer import table_text
from consilience.errors import ConsilienceError, InvalidInput
from consilience.mechanism import RANK_TOLERANCE, Mechanism

CHOICES = 24
"""Choices that Hypothesis is handed at a time."""

ROUNDS = 3

Shows = Callable[[str], bool]
"""Whether the case of a text still shows the disagreement."""


def require_hypothesis() -> None:
    """Say early that it is missing.

    Raises
    ------
    InvalidInput
    """
    try:
        import hypothesis  # noqa: F401, PLC0415 - an extra: only a fuzz needs it
    except ImportError:
        raise InvalidInput(
            "Hypothesis", "it is not installed, and shrinks what a fuzz finds", "Install consilience[fuzz]."
        ) from None


@dataclass
class Shrinker:
    """One disagreement on its way to the smallest case.

    Attributes
    ----------
    text : str
        Case file: the smallest so far that shows it.
    shows : callable
    limit : float, s
        Time after which nothing more is tried.
    tried : int
        Cases asked about.
    """

    text: str
    shows: Shows
    limit: float = 120.0
    tried: int = 0
    _end: float = field(init=False)
    _known: dict[str, bool] = field(init=False, default_factory=dict)
    _gap: float = field(init=False)

    def __post_init__(self) -> None:
        self._end = time.monotonic() + self.limit
        clear = rank_of(read_text(self.text, "shrunk").mechanism)[1]
        # a shrunk mechanism is no nearer to a singular pose than the one that was met
        self._gap = GAP if clear else 10.0 * RANK_TOLERANCE

    def shrink(self) -> str:
        """Text of the smallest case found that shows it; the one that was given if it does not show there."""
        if not self._asked(self.text):
            return self.text
        for _ in range(ROUNDS):
            before = self.text
            self._take_away()
            self._simplify()
            if self.text == before or self._over:
                break
        return self.text

    def _take_away(self) -> None:
        """Take groups of parts away, and groups half as large where none went."""
        size = len(parts(*self._read()))
        while size and not self._over:
            table, mechanism = self._read()
            found = parts(table, mechanism)
            groups = [found[n : n + size] for n in range(0, len(found), size)]
            count = len(found)
            for first in range(0, len(groups), CHOICES):
                table, mechanism = self._read()
                left = set(parts(table, mechanism))
                block = [[part for part in group if part in left] for group in groups[first : first + CHOICES]]
                self._minimise(
                    len(block),
                    1,
                    lambda keep, b=block, t=table, m=mechanism: without(  # type: ignore[misc]
                        t, m, [part for group, kept in zip(b, keep, strict=True) if not kept for part in group]
                    ),
                )
            if len(parts(*self._read())) == count:
                size //= 2

    def _simplify(self) -> None:
        count = len(knobs(self._read()[0]))
        for first in range(0, count, CHOICES):
            table, _ = self._read()
            if self._over or len(knobs(table)) != count:  # an element went with the joint it was on
                return
            some = min(CHOICES, count - first)
            rest = count - first - some
            self._minimise(
                some,
                AS_IS,
                lambda c, t=table, f=first, r=rest: simplified(t, [*[AS_IS] * f, *c, *[AS_IS] * r]),  # type: ignore[misc]
            )

    @property
    def _over(self) -> bool:
        return time.monotonic() > self._end

    def _read(self) -> tuple[TomlTable, Mechanism]:
        return tomllib.loads(self.text), read_text(self.text, "shrunk").mechanism

    def _asked(self, text: str) -> bool:
        """Whether a text shows it; each is asked about once, and none when the time is over."""
        if text not in self._known:
            self._known[text] = not self._over and self._is_sound(text) and self._tell(text)
        return self._known[text]

    def _tell(self, text: str) -> bool:
        self.tried += 1
        return self.shows(text)

    def _is_sound(self, text: str) -> bool:
        """Whether it is a case, can move, and has constraints clearly of one rank or another."""
        try:
            case = read_text(text, "shrunk")
            freedom, clear = rank_of(case.mechanism, self._gap)
            return bool(freedom and clear and case.initial_state)
        except ConsilienceError:
            return False

    def _minimise(self, count: int, most: int, build: Callable[[Sequence[int]], TomlTable]) -> None:
        """Let Hypothesis find the least choices, of 0 to `most` each, that show it still."""
        from hypothesis import HealthCheck, Phase, Verbosity, given, settings  # noqa: PLC0415 - an extra
        from hypothesis import strategies as st  # noqa: PLC0415
        from hypothesis.database import InMemoryExampleDatabase  # noqa: PLC0415

        class Disagreement(Exception):
            """What Hypothesis is to keep up."""

        @settings(
            database=InMemoryExampleDatabase(),
            phases=(Phase.reuse, Phase.shrink),
            deadline=None,
            suppress_health_check=list(HealthCheck),
            verbosity=Verbosity.quiet,
            print_blob=False,
        )
        @given(st.lists(st.integers(0, most), min_size=count, max_size=count))
        def attempt(choices: list[int]) -> None:
            """Ask about the mechanism of the choices, and raise if engines still disagree on it."""
            key = tuple(choices)
            if key not in texts and not self._over:
                texts[key] = table_text(build(choices))
            if key in texts and self._asked(texts[key]):
                text = texts[key]
                smallest[:] = [text]
                raise Disagreement

        texts: dict[tuple[int, ...], str] = {}
        smallest: list[str] = []
        entrance: Any = attempt
        try:
            entrance.hypothesis.fuzz_one_input(b"\xff" * 64 * (count + 4))
        except Disagreement:  # kept as the example to shrink; without one (the time is over) there is nothing to do
            with suppress(Disagreement):
                attempt()
        if smallest:
            self.text = smallest[0]
