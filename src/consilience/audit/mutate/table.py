"""Table of all mutants and hosts: the common mutants in every host, the mutants of an adapter in its own engine."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import ModuleType

from consilience.audit.mutate.common_mutants import COMMON
from consilience.audit.mutate.mutants import Mutant
from consilience.audit.mutate.synthetic import NAME as SYNTHETIC
from consilience.engine import adapter_file, beside_adapter, installed, lacks_engine


def adapters_with_mutants() -> dict[str, ModuleType]:
    """Return the modules ``mutants`` of the adapters whose engine is installed, by the engine's name."""
    found = {}
    for name, point in installed().items():
        if lacks_engine(point) or adapter_file(point, "mutants.py") is None:
            continue
        try:
            found[name] = beside_adapter(point, "mutants") or ModuleType(name)
        except ImportError:  # the campaign states why an engine does not start
            found[name] = ModuleType(name)
    return found


def table_of(adapters: Mapping[str, ModuleType]) -> dict[str, Mutant]:
    """Return mutants by name: the common ones first, then those of each adapter.

    Parameters
    ----------
    adapters : mapping of str to module
        Each has ``MUTANTS``, a tuple of `Mutant`, perhaps ``CONTACT_MUTANTS``, and perhaps ``SOLVER``, the module that
        calls `consilience.engine.solve_constrained` for the accelerations of an instant.

    Raises
    ------
    ValueError
        If two mutants have one name.
    """
    solving = tuple(name for name, module in adapters.items() if hasattr(module, "SOLVER"))
    mutants = [replace(m, hosts=solving if m.solver else (SYNTHETIC, *adapters)) for m in COMMON]
    for name, module in adapters.items():
        own = (*getattr(module, "MUTANTS", ()), *getattr(module, "CONTACT_MUTANTS", ()))
        mutants += [replace(mutant, hosts=(name,)) for mutant in own]
    table = {mutant.name: mutant for mutant in mutants}
    if len(table) < len(mutants):
        names = [mutant.name for mutant in mutants]
        raise ValueError(f"two mutants have one name: {', '.join(n for n in table if names.count(n) > 1)}")
    return table


_ADAPTERS = adapters_with_mutants()

HOSTS = (SYNTHETIC, *_ADAPTERS)
"""Engines in which mutants are planted."""

MUTANTS = table_of(_ADAPTERS)
"""All mutants by name."""
