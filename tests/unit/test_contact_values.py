"""What files and frames of a motion tell of contacts, stops and dry friction."""

import csv
import json

import numpy as np
import pytest

from consilience.case import load_case
from consilience.mechanism import rotation_from_quaternion
from consilience.reference import simulate
from consilience.reference.contact import simulate_with_contacts
from consilience.report.dataframes import to_xarray
from consilience.report.trajectory_files import export_trajectory
from contact_problems import BALL, LEVEL, G, Lab

LAB, MASS, REBOUND, DROP = Lab(), 2.0, 0.5, 0.2
HITS = np.sqrt(2.0 * DROP / G)
TIMES = np.linspace(0.0, 0.3, 4)
"""One impact, between the third sample and the last."""


@pytest.fixture(scope="module")
def dropped():
    mechanism = LAB.free_body(MASS, BALL, LEVEL, [LAB.sphere(0.1, name="floor", restitution=REBOUND)])
    start = LAB.state((0.0, 0.0, 0.1 + DROP), (0.0, 0.0, 0.0))
    return mechanism, simulate_with_contacts(mechanism, start, TIMES)[0]


def check(gap, impulse, mode, loss, event):
    """A fall, ``v = sqrt(2 g h)`` and a rebound with e v: the impulse is ``(1 + e) m v``."""
    speed = np.sqrt(2.0 * G * DROP)
    flown = TIMES[-1] - HITS
    expected = [*(DROP - 0.5 * G * TIMES[:3] ** 2), REBOUND * speed * flown - 0.5 * G * flown**2]
    np.testing.assert_allclose(np.array(gap, dtype=float), expected, atol=1e-11)
    along = np.array(impulse, dtype=float) @ LAB.axes[:, 2]
    np.testing.assert_allclose(along, [0.0, 0.0, 0.0, (1.0 + REBOUND) * MASS * speed], atol=1e-10)
    assert list(mode) == ["separated"] * 4
    np.testing.assert_allclose(
        np.array(loss, dtype=float)[[2, 3]], [0.0, (1 - REBOUND**2) * MASS * G * DROP], atol=1e-10
    )
    assert event is None or event == (pytest.approx(HITS, abs=1e-11), "floor", "impact")


def test_files_of_a_motion_tell_gaps_impulses_modes_losses_and_events(dropped, tmp_path):
    for ending in ("json", "npz", "csv"):
        export_trajectory(*dropped, tmp_path / f"motion.{ending}")
    with np.load(tmp_path / "motion.npz") as stored:
        arrays = dict(stored)
    for found in (json.loads((tmp_path / "motion.json").read_text()), arrays):
        assert list(found["contacts"]) == ["floor"]
        event = tuple(found[f"event_{part}"][0] for part in ("time", "element", "kind"))
        gap, impulse, mode = (np.array(found[f"contact_{part}"])[:, 0] for part in ("gap", "impulse", "mode"))
        check(gap, impulse, mode, found["contact_loss"], event)
    with (tmp_path / "motion.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    gap, mode, loss = (
        [row[name] for row in rows] for name in ("floor.contact_gap", "floor.contact_mode", "contact_loss")
    )
    impulse = [[row[f"floor.contact_impulse.{axis}"] for axis in "xyz"] for row in rows]
    check(gap, impulse, mode, loss, None)


def test_a_dataset_tells_them_with_units(dropped):
    pytest.importorskip("xarray")
    found = to_xarray(*dropped)
    event = tuple(found[f"event_{part}"].values[0] for part in ("time", "element", "kind"))
    own = found.sel(contact="floor")
    check(own.contact_gap, own.contact_impulse.values, own.contact_mode.values, found.contact_loss, event)
    units = {
        name: found[name].attrs["units"] for name in ("contact_gap", "contact_impulse", "contact_loss", "event_time")
    }
    assert units == {"contact_gap": "m", "contact_impulse": "N s", "contact_loss": "J", "event_time": "s"}


def test_events_name_stops_and_dry_friction_and_motions_without_contacts_have_none(tmp_path):
    case = load_case("wheel_caught_by_stop")
    motion, _ = simulate_with_contacts(case.mechanism, case.initial_state, case.times)
    export_trajectory(case.mechanism, motion, tmp_path / "wheel.npz")
    with np.load(tmp_path / "wheel.npz") as stored:
        assert set(stored["event_element"]) <= {"stops", "bearing"}
        assert "contacts" not in stored
        turned = (
            rotation_from_quaternion(stored["quat_WB"][-1, 0]) @ rotation_from_quaternion(stored["quat_WB"][0, 0]).T
        )
    assert np.arccos((np.trace(turned) - 1.0) / 2.0) == pytest.approx(0.5, abs=1e-9)  # from 0.5 rad to the stop
    smooth = load_case("double_pendulum")
    plain = simulate(smooth.mechanism, smooth.initial_state, smooth.times[:3])
    export_trajectory(smooth.mechanism, plain, tmp_path / "plain.npz")
    with np.load(tmp_path / "plain.npz") as stored:
        assert set(stored) == {"time", "bodies", "p_WB", "quat_WB", "v_WB_W", "w_WB_W"}
