"""Data frames of motions and reports: values, labels and units in pandas, polars and xarray."""

import numpy as np
import pytest

from consilience.engine import EngineInfo, Method, Question, Route, Run, Status, TrajectoryAnswer
from consilience.errors import InvalidInput
from consilience.mechanism import quaternion_from_rotation_vector
from consilience.report import dataframes
from consilience.report.record import write_record
from consilience.suite import Results
from mechanisms import chain

MECHANISM = chain("free", "revolute", seed=2)
BODIES = [body.name for body in MECHANISM.bodies]
RNG = np.random.default_rng(4)
TIMES = np.linspace(0.0, 0.3, 4)
ANSWER = TrajectoryAnswer(
    TIMES,
    RNG.normal(size=(4, 2, 3)),
    np.array([[quaternion_from_rotation_vector(RNG.normal(size=3)) for _ in BODIES] for _ in TIMES]),
    RNG.normal(size=(4, 2, 3)),
    RNG.normal(size=(4, 2, 3)),
    {"steps": 7},
)
UNITS = {"p_WB": "m", "quat_WB": "1", "v_WB_W": "m/s", "w_WB_W": "rad/s"}


def test_pandas_has_every_value_at_its_time_and_body_with_its_unit():
    table = dataframes.to_pandas(MECHANISM, ANSWER)
    for n, t in enumerate(TIMES):
        for b, body in enumerate(BODIES):
            row = table.loc[(t, body)]
            np.testing.assert_array_equal(row[["p_WB.x", "p_WB.y", "p_WB.z"]], ANSWER.p_WB[n, b])
            np.testing.assert_array_equal(row[[f"quat_WB.e{k}" for k in range(4)]], ANSWER.quat_WB[n, b])
            np.testing.assert_array_equal(row[["v_WB_W.x", "v_WB_W.y", "v_WB_W.z"]], ANSWER.v_WB_W[n, b])
            np.testing.assert_array_equal(row[["w_WB_W.x", "w_WB_W.y", "w_WB_W.z"]], ANSWER.w_WB_W[n, b])
    assert set(table.attrs["units"]) == {"time", *table.columns}
    assert all(unit == UNITS[c.partition(".")[0]] for c, unit in table.attrs["units"].items() if c != "time")
    assert table.attrs["counters"] == {"steps": 7}


def test_polars_has_the_same_rows_and_units_are_told():
    table = dataframes.to_polars(MECHANISM, ANSWER)
    same = dataframes.to_pandas(MECHANISM, ANSWER).reset_index()
    assert table.columns == list(same.columns)
    for column in table.columns:
        assert table[column].to_list() == same[column].to_list()
    assert dataframes.units(table.columns)["v_WB_W.z"] == "m/s"
    assert "body" not in dataframes.units(table.columns)


def test_xarray_has_axes_labels_and_units():
    data = dataframes.to_xarray(MECHANISM, ANSWER)
    for name, unit in UNITS.items():
        np.testing.assert_array_equal(data[name].values, getattr(ANSWER, name))
        assert data[name].attrs["units"] == unit
        assert data[name].attrs["long_name"]
    assert data.time.attrs["units"] == "s"
    assert list(data.body.values) == BODIES
    assert float(data.quat_WB.sel(body=BODIES[1], parameter="e2").isel(time=3)) == ANSWER.quat_WB[3, 1, 2]
    assert float(data.w_WB_W.sel(body=BODIES[0], axis="y").isel(time=1)) == ANSWER.w_WB_W[1, 0, 1]
    assert data.attrs["steps"] == 7


@pytest.fixture
def report(tmp_path):
    """Write a report of one case with two motions of one engine and no comparison; return its path."""
    from consilience.case import load_case

    case = load_case("double_pendulum")
    results = Results([case], [Question.TRAJECTORY], {"mine": EngineInfo("mine", "1", "1")})
    method = Method("RK4", Route.NATIVE, 4, (1, 2))
    results.runs = [
        Run(case.name, "mine", Question.TRAJECTORY, method, n, 0.1 / (n + 1), Status.ANSWERED, ANSWER) for n in range(2)
    ]
    write_record(results, 1.0, tmp_path)
    return tmp_path


def test_motions_of_a_report(report):
    every = dataframes.motions(report, "double_pendulum")
    assert every.p_WB.dims == ("run", "time", "body", "axis")
    assert list(every.engine.values) == ["mine", "mine"]
    assert list(every.step.values) == [0.1, 0.05]
    np.testing.assert_array_equal(every.v_WB_W.isel(run=1).values, ANSWER.v_WB_W)
    assert every.v_WB_W.attrs["units"] == "m/s"
    assert list(every.body.values) == ["upper", "lower"]
    with pytest.raises(InvalidInput, match="double_pendulum"):
        dataframes.motions(report, "four_bar")


def test_comparisons_of_a_report(report, monkeypatch):
    from consilience.report.exports import spreadsheet

    row = dict.fromkeys(spreadsheet.COLUMNS) | {"case": "c", "digits": 9.5, "horizon": None}
    monkeypatch.setattr(spreadsheet, "rows", lambda record: iter([row, row | {"horizon": 0.4}]))
    table = dataframes.report_to_pandas(report)
    assert list(table.columns) == list(spreadsheet.COLUMNS)
    assert table.attrs["labels"] == spreadsheet.COLUMNS
    assert table.attrs["units"]["cpu"] == "s"
    assert dataframes.report_to_polars(report)["horizon"].to_list() == [None, 0.4]


def test_a_library_that_is_not_there_is_named_with_the_remedy(monkeypatch):
    def none(name):
        raise ModuleNotFoundError(name)

    monkeypatch.setattr(dataframes, "import_module", none)
    for make in (dataframes.to_pandas, dataframes.to_polars, dataframes.to_xarray):
        with pytest.raises(InvalidInput, match=r"pip install 'consilience\[frames\]'"):
            make(MECHANISM, ANSWER)


def test_frames_are_those_of_the_libraries():
    import pandas as pd
    import polars as pl
    import xarray as xr

    assert isinstance(dataframes.to_pandas(MECHANISM, ANSWER), pd.DataFrame)
    assert isinstance(dataframes.to_polars(MECHANISM, ANSWER), pl.DataFrame)
    assert isinstance(dataframes.to_xarray(MECHANISM, ANSWER), xr.Dataset)
