"""Files of a motion: JSON, NPZ or CSV."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Any

import numpy as np

from consilience.engine import TrajectoryAnswer
from consilience.errors import InvalidInput
from consilience.mechanism import Array, Mechanism
from consilience.report.contact_values import QUANTITIES as OF_CONTACTS
from consilience.report.contact_values import contact_values, event_values, loss_over_time
from consilience.report.dataframes import QUANTITIES


def _arrays(mechanism: Mechanism, answer: TrajectoryAnswer) -> dict[str, Array]:
    """Collect names, times and observables, and what the motion tells of contacts, stops and dry friction."""
    found = {"time": answer.time, "bodies": np.array([b.name for b in mechanism.bodies])}
    found |= {name: getattr(answer, name) for name in QUANTITIES}
    of_contacts = contact_values(mechanism, answer)
    if of_contacts:
        found |= {"contacts": np.array([c.name for c in mechanism.contacts]), **of_contacts}
    return found | loss_over_time(mechanism, answer) | event_values(mechanism, answer)


def _json(mechanism: Mechanism, answer: TrajectoryAnswer) -> bytes:
    arrays = {name: value.tolist() for name, value in _arrays(mechanism, answer).items()}
    return json.dumps({"units": "SI, rad", **arrays, "counters": answer.counters}).encode()


def _npz(mechanism: Mechanism, answer: TrajectoryAnswer) -> bytes:
    buffer = io.BytesIO()
    arrays: dict[str, Any] = _arrays(mechanism, answer)
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def _csv(mechanism: Mechanism, answer: TrajectoryAnswer) -> bytes:
    columns = ["time"]
    values = [answer.time[:, None]]
    for b, body in enumerate(mechanism.bodies):
        for name, (parts, _, _) in QUANTITIES.items():
            columns += [f"{body.name}.{name}.{part}" for part in parts]
            values.append(getattr(answer, name)[:, b])
    of_contacts = contact_values(mechanism, answer)
    for c, contact in enumerate(mechanism.contacts if of_contacts else ()):
        for name, array in of_contacts.items():
            columns += [f"{contact.name}.{name}.{part}" for part in OF_CONTACTS[name][0]] or [f"{contact.name}.{name}"]
            values.append(array[:, c].reshape(len(answer.time), -1))
    for name, array in loss_over_time(mechanism, answer).items():
        columns.append(name)
        values.append(array[:, None])
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([x for part in row for x in part.tolist()] for row in zip(*values, strict=True))
    return text.getvalue().encode()


_WRITERS = {".json": _json, ".npz": _npz, ".csv": _csv}


def check_target(path: Path) -> None:
    """Refuse a file name whose ending names no format, or whose folder does not exist.

    Raises
    ------
    InvalidInput
        If the file cannot be written.
    """
    if path.suffix not in _WRITERS:
        raise InvalidInput(str(path), f"'{path.suffix}' names no format", f"End it with {', '.join(_WRITERS)}.")
    if not path.resolve().parent.is_dir():
        raise InvalidInput(str(path), "its folder does not exist", "Create the folder first.")


def export_trajectory(mechanism: Mechanism, answer: TrajectoryAnswer, path: Path) -> None:
    """Write the canonical observables of a motion, and what it tells of contacts; the ending chooses the format.

    CSV has no events: they are not of the samples.
    """
    check_target(path)
    path.write_bytes(_WRITERS[path.suffix](mechanism, answer))
