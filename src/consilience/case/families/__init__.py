"""Parametric families of cases: mechanisms of any size, stiffness or distance from a singular pose.

``family`` or ``family:parameter=value,parameter=value`` is the name of a case everywhere. Every family is a function of
documented parameters that returns the tables of a case file, with values of a closed form if there is one. The same
parameters give the same case.
"""

from __future__ import annotations

from consilience.case.case import Case
from consilience.case.families.chains import chain, mass_ratio, planar_chain
from consilience.case.families.contacts import balls_in_line, box_stack, sliding_cube
from consilience.case.families.loops import closed_ring, four_bar, parallel_rods, scissor, windows
from consilience.case.families.parameters import (
    Family,
    Parameter,
    Range,
    parameters,
    read_name,
    shown,
    shown_parameters,
)
from consilience.case.families.simbenchmark import ball_lattice, balls_on_box
from consilience.case.families.single import single_joint, top
from consilience.case.families.springs import spring_chain, stiff_spring
from consilience.case.file.reader import cases_from_tables
from consilience.case.file.values import TomlTable
from consilience.errors import InvalidInput

FAMILIES: dict[str, Family] = {
    family.__name__: family
    for family in (
        windows,
        parallel_rods,
        scissor,
        closed_ring,
        four_bar,
        chain,
        planar_chain,
        mass_ratio,
        spring_chain,
        stiff_spring,
        top,
        single_joint,
        sliding_cube,
        balls_in_line,
        box_stack,
        balls_on_box,
        ball_lattice,
    )
}
"""Families by name."""


def is_family(name: str) -> bool:
    """Tell whether a name has the form of a member of a family; parameters are not checked."""
    return ":" in name or name in FAMILIES


def family_table(name: str) -> tuple[str, TomlTable]:
    """Return the name of a member, parameters in order, and the tables of its case file.

    Parameters
    ----------
    name : str
        ``family`` or ``family:parameter=value,...``; missing parameters have their defaults.

    Raises
    ------
    InvalidInput
        Unknown family or parameter, a parameter given twice, a value of the wrong type or out of its range.
    """
    family, given = read_name(name, FAMILIES)
    try:
        table = FAMILIES[family](**given)
    except InvalidInput as error:
        raise InvalidInput(f"case '{name}': {error.where}", error.what, error.remedy) from None
    said = ",".join(f"{key}={shown(given[key])}" for key in parameters(FAMILIES[family]) if key in given)
    return (f"{family}:{said}" if said else family), table


def family_cases(name: str) -> list[Case]:
    """Return the case of a member of a family; see `family_table`."""
    full, table = family_table(name)
    return cases_from_tables(full, full, table)


__all__ = [
    "Case",
    "Family",
    "InvalidInput",
    "Parameter",
    "Range",
    "TomlTable",
    "balls_in_line",
    "box_stack",
    "cases_from_tables",
    "chain",
    "closed_ring",
    "four_bar",
    "mass_ratio",
    "parallel_rods",
    "parameters",
    "planar_chain",
    "read_name",
    "scissor",
    "shown",
    "shown_parameters",
    "single_joint",
    "sliding_cube",
    "spring_chain",
    "stiff_spring",
    "top",
    "windows",
]
