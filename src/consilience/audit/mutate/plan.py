"""Plans of campaigns: mutants, hosts and mechanisms of the full and of the short campaign."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from consilience.audit.mutate.campaign import MutationTask, SubjectKey, tasks_of
from consilience.audit.mutate.mutants import Mutant
from consilience.audit.mutate.subjects import CASES, MOTIONS, random_subjects
from consilience.audit.mutate.table import HOSTS, MUTANTS
from consilience.engine import Question, beside_adapter, installed
from consilience.errors import InvalidInput, nearest

FIRST_SEED = 1000
"""First seed of the random mechanisms of mutants; those of the correct adapters start at zero."""

BODIES = 5
"""Largest number of bodies of the random mechanisms of mutants: few bodies show an error as well, in less time."""

_SHORT_INSTANTS: tuple[SubjectKey, ...] = (
    *("double_pendulum", "nonlinear_springs", "slider_crank"),
    *(1000, 1011, 1037, 1047, 1053),
)
"""A few mechanisms that together have what every error acts on."""

_SHORT_CORRECT = 6
_SMALL = 1e-6
"""The short campaign plants the largest magnitude and the magnitude nearest to this number."""


def mutants_named(names: Sequence[str]) -> list[Mutant]:
    """Return mutants by name or by number of the trap; all mutants without a name.

    Raises
    ------
    InvalidInput
    """
    chosen = []
    for name in names:
        found = [m for m in MUTANTS.values() if name in (m.name, str(m.trap))]
        if not found:
            raise InvalidInput(f"mutant '{name}'", "there is none", nearest(name, MUTANTS, "Mutants"))
        chosen += found
    return chosen or list(MUTANTS.values())


def hosts_named(names: Sequence[str]) -> list[str]:
    """Return hosts by name; all hosts without a name.

    Raises
    ------
    InvalidInput
    """
    for name in names:
        if name in installed():
            beside_adapter(installed()[name], "mutants")  # the error of a missing engine says how to install it
        if name not in HOSTS:
            raise InvalidInput(f"engine '{name}'", "nothing is planted in it", nearest(name, HOSTS, "Hosts"))
    return list(names or HOSTS)


def full(
    mutants: Sequence[Mutant], hosts: Sequence[str], mechanisms: int, correct: int
) -> tuple[list[MutationTask], list[SubjectKey]]:
    """Return the tasks of the full campaign, and the mechanisms for the correct adapters.

    The numbers `mechanisms` and `correct` are those of random mechanisms, for mutants and for correct adapters.
    """
    instants: list[SubjectKey] = [*CASES, *random_subjects(mechanisms, FIRST_SEED, BODIES)]
    return tasks_of(mutants, hosts, instants, MOTIONS), list(random_subjects(correct))


def short(mutants: Sequence[Mutant], hosts: Sequence[str]) -> tuple[list[MutationTask], list[SubjectKey]]:
    """Return the tasks and mechanisms of a campaign of a minute.

    Each mutant is planted in one host, in turn, at two magnitudes (motions: one), and judged on few mechanisms until
    one catches it.
    """
    chosen = []
    for n, mutant in enumerate(mutants):
        here = [host for host in mutant.hosts if host in hosts]
        near = min(mutant.magnitudes, key=lambda e: abs(e / _SMALL - 1.0) if e else float("inf"))
        magnitudes = tuple(dict.fromkeys((mutant.magnitudes[0], near)))
        if mutant.question is Question.TRAJECTORY:
            magnitudes = magnitudes[:1]
        if here:
            chosen.append(replace(mutant, hosts=(here[n % len(here)],), magnitudes=magnitudes))
    tasks = tasks_of(chosen, hosts, _SHORT_INSTANTS, MOTIONS)
    return [replace(task, until_caught=True) for task in tasks], list(random_subjects(_SHORT_CORRECT))
