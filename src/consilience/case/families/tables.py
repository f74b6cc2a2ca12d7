"""Tables of a case file for families, with the fields of `consilience.case.file.schema`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from consilience.case.file.values import TomlTable
from consilience.mechanism import Array, quaternion_from_rotation


def numbers(values: ArrayLike) -> list[float]:
    """Return a list of numbers."""
    return np.asarray(values, dtype=float).tolist()


def body(name: str, mass: float, at: ArrayLike, R: Array, com: ArrayLike, inertia: ArrayLike) -> TomlTable:
    """Return the table of a body.

    Parameters
    ----------
    name : str
    mass : float, kg
    at : array_like, shape (3,), m
        Origin in the world.
    R : ndarray, shape (3, 3)
        Axes of the body as columns, in the world.
    com : array_like, shape (3,), m
        Centre of mass in body axes, from the origin.
    inertia : array_like, shape (6,) or (3, 3), kg m^2
        About the centre of mass, body axes: xx, yy, zz, xy, xz, yz, or the tensor.
    """
    entries = np.asarray(inertia, dtype=float)
    if entries.ndim == 2:
        entries = entries[(0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)]
    return {
        "name": name,
        "mass": float(mass),
        "at": numbers(at),
        "orientation": {"quaternion": numbers(quaternion_from_rotation(R))},
        "com": numbers(com),
        "inertia": dict(zip(("xx", "yy", "zz", "xy", "xz", "yz"), numbers(entries), strict=True)),
    }


def joint(
    name: str, kind: str, predecessor: str, successor: str, at: ArrayLike, axis: ArrayLike, **more: Any
) -> TomlTable:
    """Return the table of a joint.

    Parameters
    ----------
    name, kind, predecessor, successor : str
    at : array_like, shape (3,), m
        Origin of F and M, in the world.
    axis : array_like, shape (3,)
        Along z of F and M, in the world.
    **more
        Further fields.
    """
    table = {"name": name, "kind": kind, "predecessor": predecessor, "successor": successor, "at": numbers(at)}
    return table | {"axis": numbers(axis)} | more


def known(
    of: tuple[str, str], observable: str, time: float, value: ArrayLike, uncertainty: float, source: str
) -> TomlTable:
    """Return the table of a value in closed form.

    Parameters
    ----------
    of : (str, str)
        ("body", name) or ("joint", name).
    observable : str
    time : float, s
    value : array_like
        SI units; vectors in world axes.
    uncertainty : float
        Of each component.
    source : str
        The formula.
    """
    return {
        of[0]: of[1],
        "observable": observable,
        "time": float(time),
        "value": numbers(value),
        "uncertainty": float(uncertainty),
        "origin": "closed form",
        "source": source,
    }


def case_table(
    title: str,
    remarks: str,
    sources: Sequence[str],
    tags: Sequence[str],
    mechanism: TomlTable,
    initial: TomlTable,
    span: tuple[float, float],
    published: Sequence[TomlTable] = (),
) -> TomlTable:
    """Return the tables of a case file.

    Parameters
    ----------
    title, remarks : str
    sources, tags : sequence of str
    mechanism : dict
        Gravity (m/s^2, world axes), and lists of tables: body, joint, spring, ...
    initial : dict
        Held coordinates and rates.
    span : (float, float), s
        Duration and sample.
    published : sequence of dict
        Values in closed form, see `known`.
    """
    return {
        "title": title,
        "sources": list(sources),
        "remarks": remarks.strip(),
        "tags": ["family", *tags],
        **mechanism,
        "initial": initial,
        "trajectory": {"duration": span[0], "sample": span[1], "digits": 8},
        "instant": {"states": 10, "seed": 1},
        **({"published": list(published)} if published else {}),
    }
