"""Files of a motion: JSON, NPZ or CSV."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import numpy as np

from consilience.engine import TrajectoryAnswer
from consilience.errors import InvalidInput
from consilience.mechanism import Mechanism
from consilience.report.dataframes import QUANTITIES


def _json(mechanism: Mechanism, answer: TrajectoryAnswer) -> bytes:
    bodies = [b.name for b in mechanism.bodies]
    arrays = {name: getattr(answer, name).tolist() for name in QUANTITIES}
    document = {"units": "SI, rad", "bodies": bodies, "time": answer.time.tolist(), **arrays}
    return json.dumps({**document, "counters": answer.counters}).encode()


def _npz(mechanism: Mechanism, answer: TrajectoryAnswer) -> bytes:
    buffer = io.BytesIO()
    arrays = {name: getattr(answer, name) for name in QUANTITIES}
    np.savez_compressed(buffer, time=answer.time, bodies=np.array([b.name for b in mechanism.bodies]), **arrays)
    return buffer.getvalue()


def _csv(mechanism: Mechanism, answer: TrajectoryAnswer) -> bytes:
    columns = ["time"]
    values = [answer.time[:, None]]
    for b, body in enumerate(mechanism.bodies):
        for name, (parts, _, _) in QUANTITIES.items():
            columns += [f"{body.name}.{name}.{part}" for part in parts]
            values.append(getattr(answer, name)[:, b])
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([repr(float(x)) for x in row] for row in np.hstack(values))
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
    """Write the canonical observables of a motion; the ending of the name chooses the format."""
    check_target(path)
    path.write_bytes(_WRITERS[path.suffix](mechanism, answer))
