"""Motions and reports as data frames: pandas, polars, xarray, each with units and labels.

The three libraries are optional (``pip install 'consilience[frames]'``); each is imported when it is needed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from consilience.engine import TrajectoryAnswer
from consilience.errors import InvalidInput
from consilience.mechanism import Array, Mechanism
from consilience.report.contact_values import LOSSES, contact_values, event_values, loss_over_time
from consilience.report.contact_values import QUANTITIES as OF_CONTACTS

if TYPE_CHECKING:
    import pandas
    import polars
    import xarray

AXES = ("x", "y", "z")
PARAMETERS = ("e0", "e1", "e2", "e3")

QUANTITIES: dict[str, tuple[tuple[str, ...], str, str]] = {
    "p_WB": (AXES, "m", "position of the body's origin in the world"),
    "quat_WB": (PARAMETERS, "1", "orientation of the body, unit quaternion, scalar first"),
    "v_WB_W": (AXES, "m/s", "velocity of the body's origin, world axes"),
    "w_WB_W": (AXES, "rad/s", "angular velocity of the body, world axes"),
}
"""Observables of a motion: components, unit, label."""

TIME = ("s", "time")


def units(columns: Sequence[str]) -> dict[str, str]:
    """Return the units of columns named ``time`` or ``QUANTITY.component``; other columns have no unit.

    Parameters
    ----------
    columns : sequence of str
        Columns of a frame; polars frames have no attributes of their own.

    Returns
    -------
    dict of str
    """
    known = {"time": TIME[0]} | {f"{q}.{c}": unit for q, (parts, unit, _) in QUANTITIES.items() for c in parts}
    return {column: known[column] for column in columns if column in known}


def _library(name: str) -> Any:
    try:
        return import_module(name)
    except ModuleNotFoundError:
        where, remedy = f"data frames of {name}", "Install it: pip install 'consilience[frames]'."
        raise InvalidInput(where, f"{name} is not installed", remedy) from None


def _columns(answer: TrajectoryAnswer) -> dict[str, Array]:
    """Collect the values by column, over time and bodies; the index of the body varies faster."""
    return {
        f"{name}.{part}": getattr(answer, name)[:, :, n].ravel()
        for name, (parts, _, _) in QUANTITIES.items()
        for n, part in enumerate(parts)
    }


def to_pandas(mechanism: Mechanism, answer: TrajectoryAnswer) -> pandas.DataFrame:
    """Convert a motion to a pandas frame: a row for each time and body.

    Parameters
    ----------
    mechanism : Mechanism
        The names of its bodies index the rows.
    answer : TrajectoryAnswer

    Returns
    -------
    pandas.DataFrame
        Index ``(time, body)``; columns ``p_WB.x`` to ``w_WB_W.z``; ``attrs``: ``units``, ``labels``, ``counters``.

    Raises
    ------
    InvalidInput
        If pandas is not installed.
    """
    pd = _library("pandas")
    index = pd.MultiIndex.from_product([answer.time, [b.name for b in mechanism.bodies]], names=["time", "body"])
    frame = pd.DataFrame(_columns(answer), index=index)
    frame.attrs = {
        "units": units(["time", *frame.columns]),
        "labels": {name: label for name, (_, _, label) in QUANTITIES.items()},
        "counters": dict(answer.counters),
    }
    return frame


def to_polars(mechanism: Mechanism, answer: TrajectoryAnswer) -> polars.DataFrame:
    """Convert a motion to a polars frame: a row for each time and body; `units` returns the units of its columns.

    Returns
    -------
    polars.DataFrame
        Columns ``time``, ``body`` and ``p_WB.x`` to ``w_WB_W.z``.

    Raises
    ------
    InvalidInput
        If polars is not installed.
    """
    pl = _library("polars")
    names = [b.name for b in mechanism.bodies]
    rows = {"time": np.repeat(answer.time, len(names)), "body": names * len(answer.time)}
    return pl.DataFrame(rows | _columns(answer))


def to_xarray(mechanism: Mechanism, answer: TrajectoryAnswer) -> xarray.Dataset:
    """Convert a motion to an xarray dataset, with the attributes of netCDF conventions.

    Returns
    -------
    xarray.Dataset
        Dimensions ``time``, ``body``, ``axis`` (x, y, z) and ``parameter`` (e0 to e3), with contacts ``contact``, with
        events ``event``; each variable has ``units`` and ``long_name``.

    Raises
    ------
    InvalidInput
        If xarray is not installed.
    """
    xr = _library("xarray")
    arrays = {name: getattr(answer, name) for name in QUANTITIES}
    found = _dataset(xr, answer.time, [b.name for b in mechanism.bodies], arrays)
    about = {"title": f"motion of {mechanism.name}", "frame": "W: world, right-handed", "conventions": "SI, radians"}
    return _with_contacts(found, mechanism, answer).assign_attrs(about | dict(answer.counters))


def _with_contacts(found: Any, mechanism: Mechanism, answer: TrajectoryAnswer) -> Any:
    """Return a dataset with what a motion tells of contacts, stops and dry friction."""
    own = contact_values(mechanism, answer)
    for name, array in own.items():
        parts, unit, label = OF_CONTACTS[name]
        found[name] = (("time", "contact", *(["axis"] if parts else [])), array, _about(unit, label))
    for name, array in loss_over_time(mechanism, answer).items():
        found[name] = ("time", array, _about(*LOSSES[name]))
    for name, array in event_values(mechanism, answer).items():
        found[name] = ("event", array, {"units": TIME[0]} if name == "event_time" else {})
    return found.assign_coords(contact=[c.name for c in mechanism.contacts]) if own else found


def _about(unit: str, label: str) -> dict[str, str]:
    return {"long_name": label} | ({"units": unit} if unit else {})


def many_to_xarray(
    mechanism: Mechanism, time: Array, arrays: Mapping[str, Array], parameters: Mapping[str, Array], grid: bool
) -> xarray.Dataset:
    """Convert motions of many sets to one dataset.

    Parameters
    ----------
    mechanism : Mechanism
    time : ndarray, shape (n_t,), s
    arrays : mapping of str to ndarray
        Observables; dimensions of the sets in front.
    parameters : mapping of str to ndarray
    grid : bool
        Whether each parameter is a dimension; else the one dimension is ``set``, and parameters are its coordinates.

    Raises
    ------
    InvalidInput
        If xarray is not installed.
    """
    xr = _library("xarray")
    sets = tuple(parameters) if grid else ("set",)
    found = _dataset(xr, time, [b.name for b in mechanism.bodies], arrays, sets)
    about = {"title": f"motions of {mechanism.name}", "frame": "W: world, right-handed", "conventions": "SI, radians"}
    own = {name: (name if grid else "set", values) for name, values in parameters.items()}
    return found.assign_coords(own).assign_attrs(about)


def _dataset(xr: Any, time: Array, bodies: list[str], arrays: Mapping[str, Array], sets: tuple[str, ...] = ()) -> Any:
    """Make a dataset of observables by name, with dimensions for sets in front."""
    variables = {
        name: (
            (*sets, "time", "body", "axis" if parts is AXES else "parameter"),
            np.asarray(arrays[name]),
            {"units": unit, "long_name": label},
        )
        for name, (parts, unit, label) in QUANTITIES.items()
    }
    coordinates = {
        "time": ("time", time, {"units": TIME[0], "long_name": TIME[1]}),
        "body": bodies,
        "axis": list(AXES),
        "parameter": list(PARAMETERS),
    }
    return xr.Dataset(variables, coordinates)


def motions(folder: Path | str, case: str) -> xarray.Dataset:
    """Read all motions of a case in a report, at every level and softness, as one dataset.

    Parameters
    ----------
    folder : path
        Folder of a report.
    case : str
        Name of a case of the report.

    Returns
    -------
    xarray.Dataset
        Variables of `to_xarray`, with a first dimension ``run`` and its coordinates ``engine``, ``method``, ``step``
        (s, or a tolerance) and ``softness`` (0: hard).

    Raises
    ------
    InvalidInput
        If xarray is not installed, or there is no such report, case or motion.
    """
    xr = _library("xarray")
    from consilience.report.record import read_record  # noqa: PLC0415

    record = read_record(Path(folder))
    about = {c["name"]: c for c in record.cases}
    if case not in about:
        raise InvalidInput(f"case '{case}'", "the report does not have it", f"Cases: {', '.join(about)}.")
    stored = [
        (engine, path)
        for engine in record.header["engines"]
        for path in sorted((Path(folder) / "runs").glob("*.npz"), key=_number)
        if path.name == f"{case}.{engine}.{_number(path)}.npz"
    ]
    if not stored:
        raise InvalidInput(str(folder), f"it has no motions of '{case}'", "Run it with the question trajectory.")
    found = [_read_motion(xr, path, about[case]["bodies"]) for _, path in stored]
    runs = {name: ("run", [told[name] for _, told in found]) for name in ("method", "step", "softness")}
    whole = xr.concat([motion for motion, _ in found], "run")
    return whole.assign_coords({"engine": ("run", [engine for engine, _ in stored])} | runs)


def _number(path: Path) -> int:
    """Return the number of a stored motion among those of its case and engine."""
    return int(path.name.split(".")[-2])


def _read_motion(xr: Any, path: Path, bodies: list[str]) -> tuple[Any, dict[str, str | float]]:
    with np.load(path, allow_pickle=False) as stored:
        told: dict[str, str | float] = {"method": str(stored["method"])}
        told |= {name: float(stored[name]) for name in ("step", "softness")}
        return _dataset(xr, stored["time"], bodies, stored), told


def report_to_pandas(folder: Path | str) -> pandas.DataFrame:
    """Read the comparisons of a report as a pandas frame: a row for each case, engine, question and method.

    Returns
    -------
    pandas.DataFrame
        The columns of ``consilience export --format csv``; ``attrs`` has ``units`` and ``labels``.

    Raises
    ------
    InvalidInput
        If pandas is not installed, or there is no such report.
    """
    pd = _library("pandas")
    rows, labels = _report_rows(folder)
    frame = pd.DataFrame(rows)
    frame.attrs = {"units": {"step": "s or 1", "horizon": "s", "cpu": "s", "digits": "1"}, "labels": labels}
    return frame


def report_to_polars(folder: Path | str) -> polars.DataFrame:
    """Read the comparisons of a report as a polars frame, with the columns of `report_to_pandas`.

    Raises
    ------
    InvalidInput
        If polars is not installed, or there is no such report.
    """
    return _library("polars").DataFrame(_report_rows(folder)[0], infer_schema_length=None)


def _report_rows(folder: Path | str) -> tuple[list[dict[str, Any]], dict[str, str]]:
    """Return the rows of a report, and the meaning of their columns."""
    from consilience.report.exports.spreadsheet import COLUMNS, rows  # noqa: PLC0415 - only reports need it
    from consilience.report.record import read_record  # noqa: PLC0415 - only this reads reports

    return [{name: row.get(name) for name in COLUMNS} for row in rows(read_record(Path(folder)))], COLUMNS
