"""Registry of all formulations by name; the module of a formulation is imported at its first use."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from math import inf
from types import ModuleType
from typing import Any

from consilience.engine import TrajectoryAnswer, Unsupported
from consilience.errors import InvalidInput
from consilience.mechanism import Mechanism
from consilience.reference.bodies.smooth_equations import first_contact, refuse_contacts
from consilience.reference.formulations.protocol import Formulation


@dataclass(frozen=True)
class FormulationEntry:
    """Registered formulation.

    Attributes
    ----------
    title : str
    source : str
        Source of the equations, by the keys of docs/formulations.md.
    maker : str
        Class or function of `consilience.reference`, as ``module.function``, called with a mechanism; integrator of a
        system of index 2 or 3.
    arguments : dict
        Further arguments of `maker`.
    order : int or None
        Order of an integrator with constant steps; None otherwise.
    residual : float
        Largest residual of the rows along a motion, in tolerances: larger where velocities are not projected, infinite
        where motions drift by design.
    """

    title: str
    source: str
    maker: str
    arguments: dict[str, Any] = field(default_factory=dict)
    order: int | None = None
    residual: float = 1.0

    @property
    def module(self) -> ModuleType:
        """Module of `maker`, imported."""
        return import_module(f"consilience.reference.{self.maker.rpartition('.')[0]}")

    def load(self) -> Callable[..., Any]:
        """Return `maker` with its further arguments."""
        return partial(getattr(self.module, self.maker.rpartition(".")[2]), **self.arguments)


def _kernel(name: str, title: str, source: str) -> FormulationEntry:
    return FormulationEntry(title, source, "formulations.body_velocities.KernelFormulation", {"name": name})


_ORIENTATIONS = {
    "euler_parameters": "Euler parameters",
    "euler_angles": "Euler angles z-x-z",
    "bryant_angles": "Bryant angles x-y-z",
    "rodrigues_parameters": "Rodrigues parameters",
    "rotation_vector": "the rotation vector",
}
_MASSES = {"": "symmetrised", "_plain": "plain"}


def _form(name: str, title: str, residual: float = 1.0) -> FormulationEntry:
    maker = "formulations.coordinates.DescriptorForm"
    return FormulationEntry(title, "C4 (4.55)-(4.97)", maker, {"name": name}, residual=residual)


FORMULATIONS: dict[str, FormulationEntry] = {
    "relative": FormulationEntry(
        "minimal form in relative joint coordinates, articulated bodies",
        "C4 (4.99)-(4.110), Featherstone",
        "tree.formulation.RelativeCoordinates",
    ),
    "descriptor": _kernel("descriptor", "descriptor form, Euler parameters", "MASS (36)-(39), C4 (4.84)-(4.97)"),
    "null_space": _kernel("null_space", "minimal form, null space by SVD", "C4 (4.99)-(4.110)"),
    "null_space_qr": _kernel("null_space_qr", "minimal form, null space by QR", "C4 (4.99)-(4.110)"),
    "coordinate_partitioning": _kernel(
        "coordinate_partitioning", "minimal form, independent velocities", "C4 (4.99)-(4.110), Wehage and Haug 1982"
    ),
    "articulated_body": _kernel("articulated_body", "recursive, articulated bodies", "C4 (4.99)-(4.110), Featherstone"),
    "composite_body": _kernel("composite_body", "recursive, composite bodies", "C4 (4.99)-(4.110), Featherstone"),
    "lagrange": FormulationEntry("Lagrange, second kind", "C4 (4.111)-(4.116)", "formulations.lagrange.Lagrange"),
    "point_coordinates": FormulationEntry(
        "point coordinates", "ATTIA (1)-(25)", "formulations.point_coordinates.PointCoordinates"
    ),
    **{
        f"descriptor_{kind}{suffix}": _form(f"descriptor_{kind}{suffix}", f"descriptor form in {title}, {mass}")
        for kind, title in _ORIENTATIONS.items()
        for suffix, mass in _MASSES.items()
    },
    "descriptor_baumgarte": _form(
        "descriptor_baumgarte", "descriptor form, stabilised by Baumgarte's method", residual=inf
    ),
    "descriptor_unprojected": _form("descriptor_unprojected", "descriptor form without stabilisation", residual=inf),
}
"""Formulations of index 1 and minimal form, for every integrator."""


SYSTEMS: dict[str, FormulationEntry] = {
    "descriptor_index_2": FormulationEntry(
        "descriptor form of index 2 after Gear, Leimkuhler and Gupta; Radau IIA",
        "EXU",
        "formulations.dae_radau.integrate_dae",
        {"index": 2},
    ),
    "descriptor_index_3": FormulationEntry(
        "descriptor form of index 3; Radau IIA",
        "EXU",
        "formulations.dae_radau.integrate_dae",
        {"index": 3},
        residual=1e3,
    ),
    "generalised_alpha": FormulationEntry(
        "descriptor form of index 3 on the group of poses; generalised-alpha",
        "EXU",
        "formulations.dae_generalised_alpha.generalised_alpha",
        {},
        order=2,
    ),
}
"""Formulations of index 2 and 3, each with an integrator of its own.

Accelerations at an instant are those of index 1, from the hidden constraints ``Q a = gamma``.
"""


def entry(name: str) -> FormulationEntry:
    """Return the entry of a formulation; of one of `SYSTEMS` that of its index-1 form.

    Raises
    ------
    InvalidInput
        If there is no such formulation.
    """
    if name in SYSTEMS:
        return FORMULATIONS["descriptor"]
    if name not in FORMULATIONS:
        known = ", ".join((*FORMULATIONS, *SYSTEMS))
        raise InvalidInput(f"formulation '{name}'", "there is none of that name", f"Formulations: {known}.")
    return FORMULATIONS[name]


def largest_residual(name: str) -> float:
    """Return the largest residual of the rows along a motion in a formulation, in tolerances."""
    return (SYSTEMS[name] if name in SYSTEMS else entry(name)).residual


def system(name: str) -> Callable[..., TrajectoryAnswer]:
    """Return the integrator of a formulation of `SYSTEMS`: function of mechanism, state, times, tolerance or step."""
    return SYSTEMS[name].load()


def unsupported(name: str, mechanism: Mechanism) -> tuple[Unsupported, ...]:
    """List the features of a mechanism that a formulation cannot represent, with reasons."""
    found: tuple[Unsupported, ...] = entry(name).module.unsupported(mechanism)
    return found + first_contact(mechanism)


def formulation(name: str, mechanism: Mechanism) -> Formulation:
    """Return the equations of motion of a mechanism in a formulation.

    Raises
    ------
    InvalidInput
        Unknown name, or a mechanism that the formulation cannot represent.
    """
    chosen = entry(name)
    refuse_contacts(mechanism)
    made: Formulation = chosen.load()(mechanism)
    return made
