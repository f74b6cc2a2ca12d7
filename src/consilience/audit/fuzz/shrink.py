"""Shrinking of a case to the smallest case that still shows a disagreement, by Hypothesis.

A case is a list of choices (see `reductions`); the largest value of each choice leaves the part unchanged. Hypothesis
gets that list as a failing example through `fuzz_one_input`, and finds the least list that still fails. First parts
are removed, many at once, then fewer; then the remaining parts are simplified; both are repeated until neither changes
the case. Hypothesis gets few choices at a time, because it also tries to reorder them, in superlinear time.
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
"""Choices that Hypothesis gets at a time."""

ROUNDS = 3
"""Repetitions of removal and simplification at most."""


def require_hypothesis() -> None:
    """Refuse to fuzz without Hypothesis.

    Raises
    ------
    InvalidInput
        If Hypothesis is not installed.
    """
    try:
        import hypothesis  # noqa: F401, PLC0415 - an extra: only a fuzz needs it
    except ImportError:
        raise InvalidInput(
            "Hypothesis", "it is not installed, and shrinks what a fuzz finds", "Install consilience[fuzz]."
        ) from None


@dataclass
class Shrinker:
    """A disagreement that is being shrunk.

    Attributes
    ----------
    text : str
        Case file of the smallest case so far that shows the disagreement.
    shows : callable
        Whether the case of a text shows the disagreement.
    limit : float, s
        Time limit of shrinking.
    tried : int
        Number of cases asked about.
    """

    text: str
    shows: Callable[[str], bool]
    limit: float = 120.0
    tried: int = 0
    _end: float = field(init=False)
    _known: dict[str, bool] = field(init=False, default_factory=dict)
    _gap: float = field(init=False)

    def __post_init__(self) -> None:
        self._end = time.monotonic() + self.limit
        clear = rank_of(read_text(self.text, "shrunk").mechanism)[1]
        # a shrunk mechanism may be no nearer to a singular pose than the mechanism that was drawn
        self._gap = GAP if clear else 10.0 * RANK_TOLERANCE

    def shrink(self) -> str:
        """Return the text of the smallest case found; the given text if its case does not show the disagreement."""
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
        """Remove groups of parts, and groups half as large once no group can be removed."""
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
        """Simplify the parts of the case, some at a time."""
        count = len(knobs(self._read()[0]))
        for first in range(0, count, CHOICES):
            table, _ = self._read()
            if self._over or len(knobs(table)) != count:  # an element was removed with its joint
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
        """Whether the case of a text shows the disagreement; each text is asked about once, within the time limit."""
        if text not in self._known:
            sound = not self._over and self._is_sound(text)
            self.tried += sound
            self._known[text] = sound and self.shows(text)
        return self._known[text]

    def _is_sound(self, text: str) -> bool:
        """Whether a text is a case that can move, with constraints of a clear numerical rank."""
        try:
            case = read_text(text, "shrunk")
            freedom, clear = rank_of(case.mechanism, self._gap)
            return bool(freedom and clear and case.initial_state)
        except ConsilienceError:
            return False

    def _minimise(self, count: int, most: int, build: Callable[[Sequence[int]], TomlTable]) -> None:
        """Let Hypothesis find the least choices, from 0 to `most`, whose case still shows the disagreement."""
        from hypothesis import HealthCheck, Phase, Verbosity, given, settings  # noqa: PLC0415 - an extra
        from hypothesis import strategies as st  # noqa: PLC0415
        from hypothesis.database import InMemoryExampleDatabase  # noqa: PLC0415

        class ShrinkTarget(Exception):
            """Failure that Hypothesis preserves while shrinking."""

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
            """Ask about the case of the choices, and raise if engines still disagree."""
            key = tuple(choices)
            if key not in texts and not self._over:
                texts[key] = table_text(build(choices))
            if key in texts and self._asked(texts[key]):
                smallest[:] = [texts[key]]
                raise ShrinkTarget

        texts: dict[tuple[int, ...], str] = {}
        smallest: list[str] = []
        entrance: Any = attempt
        try:
            entrance.hypothesis.fuzz_one_input(b"\xff" * 64 * (count + 4))
        except ShrinkTarget:  # the failing example to shrink; there is none once the time is over
            with suppress(ShrinkTarget):
                attempt()
        if smallest:
            self.text = smallest[0]
