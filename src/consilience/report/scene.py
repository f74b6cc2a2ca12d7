"""Scene of a mechanism: lines and labelled places in coordinates of the bodies, to be drawn in any pose.

Lines and places are those of the picture of a case (`figure3d`), each fixed to the body that carries it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from consilience.mechanism import Array, Mechanism, State, rotation_from_quaternion
from consilience.report.figure3d import Figure3D, PlaceLabel, Polyline, connections, figure_of

Scene = dict[str, Any]
"""Data of a scene, as `replayschema.ReplayScene`."""

DECIMALS = 6
"""Decimals of coordinates relative to the size of the mechanism."""


def scene(mechanism: Mechanism, state: State) -> Scene:
    """Make the scene of a mechanism from a state.

    Coordinates of a body are in its frame B, those of the ground (body -1) in the world; m.
    """
    figure = figure_of(mechanism, state)
    p, R = _placements(state.p_WB, state.quat_WB)
    decimals = DECIMALS - int(np.floor(np.log10(max(float(np.max(np.abs(figure.points), initial=0.0)), 1e-12))))

    def local(body: int, point: Array) -> list[float]:
        return [round(float(x), decimals) + 0.0 for x in R[body].T @ (point - p[body])]

    def along(body: int, axis: Array | None) -> list[float] | None:
        return None if axis is None else [round(float(x), DECIMALS) + 0.0 for x in R[body].T @ axis]

    return {
        "gravity": [float(x) for x in mechanism.gravity],
        "p": [[float(x) for x in p] for p in state.p_WB],
        "quat": [[float(x) for x in q] for q in state.quat_WB],
        "bodies": [
            {"letter": m.letter, "name": m.name, "body": m.body, "point": local(m.body, m.point)} for m in figure.bodies
        ],
        "joints": [
            {
                "letter": m.letter,
                "name": m.name,
                "kind": m.kind,
                "body": m.body,
                "point": local(m.body, m.point),
                "axis": along(m.body, m.axis),
                "ground": m.ground,
                "between": [joint.predecessor, joint.successor],
            }
            for m, joint in zip(figure.joints, mechanism.joints, strict=True)
        ],
        "lines": [
            {"body": line.body, "kind": line.kind, "points": [local(line.body, p) for p in line.points]}
            for line in figure.lines
            if line.ends is None
        ],
        "ties": [
            {"kind": tie.kind, "ends": list(tie.ends), "points": list(map(local, tie.ends, tie.points))}
            # the frames of a joint may be apart at another time
            for tie in connections(mechanism, state)
            if tie.ends is not None
        ],
    }


def _placements(p: Array, quats: Array) -> tuple[Array, Array]:
    """Return origins, shape (n + 1, 3), and rotation matrices of the bodies; last, as body -1, those of the ground."""
    return np.vstack([p, np.zeros(3)]), np.concatenate([rotation_from_quaternion(quats), np.eye(3)[None]])


def figure_of_scene(drawn: Scene) -> Figure3D:
    """Make the figure of a scene in the poses of its state."""
    p, R = _placements(np.array(drawn["p"]).reshape(-1, 3), np.array(drawn["quat"]).reshape(-1, 4))

    def placed(body: int, point: list[float]) -> Array:
        return np.asarray(p[body] + R[body] @ np.array(point))

    def mark(m: Scene, kind: str) -> PlaceLabel:
        body, axis = m["body"], m.get("axis")
        turned = None if axis is None else R[body] @ np.array(axis)
        return PlaceLabel(m["letter"], m["name"], kind, placed(body, m["point"]), turned, m.get("ground", False), body)

    # coordinates are rounded: ends nearer than the rounding coincide
    reaches = [abs(x) for part in ("lines", "ties", "joints", "bodies") for m in drawn[part] for x in _numbers(m)]
    apart = 10.0 ** (1 - DECIMALS) * max(reaches, default=1.0)
    lines = [
        Polyline(m["body"], m["kind"], np.array([placed(m["body"], x) for x in m["points"]])) for m in drawn["lines"]
    ]
    for tie in drawn["ties"]:
        i, j = tie["ends"]
        ends = np.array([placed(i, tie["points"][0]), placed(j, tie["points"][1])])
        if np.linalg.norm(ends[0] - ends[1]) > apart:
            lines.append(Polyline(-1, tie["kind"], ends, (i, j)))
    return Figure3D(
        tuple(lines),
        tuple(mark(m, m["kind"]) for m in drawn["joints"]),
        tuple(mark(m, "body") for m in drawn["bodies"]),
        np.array(drawn["gravity"]),
    )


def _numbers(drawn: Scene) -> Iterator[float]:
    """List the coordinates of a line or of a place."""
    for point in drawn.get("points", [drawn.get("point", [])]):
        yield from point
