"""Tables and maps as an engineer works with them: by name, as arrays, frames and plots."""

import importlib.util

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib import pyplot as plt

from app.geometry.components import COMPONENTS
from thermap import table as tables
from thermap.answers import CompensationAnswer, ErrorMapAnswer

ENTRY = {
    "chapter": "", "axis": None, "sensor": "x-middle", "temperature_c": 24.0, "lower_map": "a",
    "upper_map": "b", "weight": 0.5, "status": "interpolated", "effects": [],
}  # fmt: skip
TABLE = CompensationAnswer.model_validate(
    {
        "machine": "vmc <1>",
        "model_version": 3,
        "computed_at": "2026-03-01T06:00:00Z",
        "complete": False,
        "warnings": ["EBX: <b>old</b>"],
        "components": [
            ENTRY
            | {
                "component": "EXX",
                "positions_mm": [0, 100, 500],
                "errors_um": [0, 4, 20],
                "standard_errors_um": [0.1, 0.2, 0.3],
                "compensation_um": [0, -4, -20],
                "backward_errors_um": [1, 5, 21],
                "backward_standard_errors_um": [0.4, 0.5, 0.6],
                "backward_compensation_um": [-1, -5, -21],
            },
            ENTRY
            | {
                "component": "EYX",
                "positions_mm": [0, 250],
                "errors_um": [0, 3],
                "compensation_um": [0, -3],
            },
            ENTRY
            | {
                "component": "SXY",
                "error_um_per_m": -24.0,
                "standard_error_um_per_m": 0.8,
                "compensation_um_per_m": 24.0,
            },
        ],
    }
)
MAP = ErrorMapAnswer.model_validate(
    {
        "id": 1,
        "label": "cold",
        "stored_at": "2026-03-01T06:00:00Z",
        "measured_at": "2026-03-01T06:00:00Z",
        "temperatures_c": {"x-middle": 20.0},
        "in_active_model": True,
        "components": [
            {"component": "EBX", "positions_mm": [0, 500], "errors_urad": [0, 40]},
            {"component": "SXY", "value_um_per_m": -20.0, "standard_error_um_per_m": 0.8},
        ],
    }
)


@pytest.fixture(autouse=True)
def no_window():
    mpl.use("Agg")
    yield
    plt.close("all")


def test_components_are_there_by_their_names():
    assert TABLE["EXX"] is TABLE.components[0]
    assert TABLE["SXY"].status == "interpolated"
    assert ("EXX" in TABLE, "EZZ" in TABLE, 3 in TABLE) == (True, False, False)
    assert (list(TABLE), len(TABLE)) == (["EXX", "EYX", "SXY"], 3)
    assert list(MAP) == ["EBX", "SXY"]
    with pytest.raises(KeyError, match="expected one of EXX, EYX, SXY, got 'EZZ'"):
        TABLE["EZZ"]
    empty = TABLE.model_copy(update={"components": []})
    assert empty
    assert len(empty.to_dataframe()) == 0
    assert len(empty.to_xarray()) == 0
    with pytest.raises(KeyError, match="expected one of no components at all, got 'EXX'"):
        empty["EXX"]
    with pytest.raises(ValueError, match="expected components to draw, got none"):
        empty.plot()


def test_an_answer_is_compared_and_written_as_before():
    assert CompensationAnswer.model_validate_json(TABLE.model_dump_json()) == TABLE
    assert next(iter(TABLE.model_dump())) == "machine"


def test_arrays_are_those_of_one_direction():
    entry = TABLE["EXX"]
    forward, backward = (entry.to_numpy(direction) for direction in entry.directions)
    assert (forward.direction, backward.direction) == ("+", "-")
    assert forward.positions_mm.tolist() == [0.0, 100.0, 500.0]
    assert forward.error.tolist() == entry.errors_um
    assert forward.compensation.tolist() == entry.compensation_um == entry.compensation
    assert not np.signbit(forward.compensation[0])
    assert forward.standard_error.tolist() == entry.standard_errors == [0.1, 0.2, 0.3]
    assert backward.error.tolist() == [1.0, 5.0, 21.0]
    assert backward.compensation.tolist() == entry.backward_compensation_um
    assert backward.standard_error.tolist() == [0.4, 0.5, 0.6]
    assert entry.to_numpy().direction == "+"
    with pytest.raises(ValueError, match=r"expected one of both for EYX, got '\+'"):
        TABLE["EYX"].to_numpy("+")


def test_a_single_value_is_an_array_without_positions():
    arrays = TABLE["SXY"].to_numpy()
    assert (arrays.positions_mm, arrays.unit, arrays.direction) == (None, "µm/m", "both")
    assert (arrays.error.shape, float(arrays.error), float(arrays.compensation)) == ((), -24, 24)
    assert float(arrays.standard_error) == 0.8
    assert float(MAP["SXY"].to_numpy().error) == -20.0


def test_a_frame_has_a_row_for_each_position_and_direction():
    frame = TABLE.to_dataframe()
    assert list(frame.columns) == [
        "component", "position_mm", "direction", "error", "compensation", "standard_error", "unit",
    ]  # fmt: skip
    assert len(frame) == 3 + 3 + 2 + 1
    one = frame[(frame.component == "EXX") & (frame.direction == "-")]
    assert one.position_mm.tolist() == [0.0, 100.0, 500.0]
    assert one.error.tolist() == [1.0, 5.0, 21.0]
    assert one.compensation.tolist() == [-1.0, -5.0, -21.0]
    assert one.standard_error.tolist() == [0.4, 0.5, 0.6]
    assert frame[frame.component == "EYX"].standard_error.isna().all()
    (single,) = frame[frame.component == "SXY"].to_dict("records")
    assert np.isnan(single.pop("position_mm"))
    assert single == {
        "component": "SXY", "direction": "both", "error": -24.0, "compensation": 24.0,
        "standard_error": 0.8, "unit": "µm/m",
    }  # fmt: skip
    assert MAP.to_dataframe().unit.tolist() == ["µrad", "µrad", "µm/m"]


def test_a_dataset_has_a_variable_for_each_component():
    data = TABLE.to_xarray()
    assert list(data) == ["EXX", "EYX", "SXY"]
    assert data["EXX"].dims == ("quantity", "direction", "x_mm")
    assert data.x_mm.attrs == {"units": "mm"}
    at = data["EXX"].sel(quantity="error", direction="-", x_mm=100)
    assert (float(at), data["EXX"].attrs["units"]) == (5.0, "µm")
    eyx = data["EYX"].sel(quantity="compensation")
    assert eyx.dropna("x_mm").x_mm.values.tolist() == [0.0, 250.0]
    assert float(eyx.sel(x_mm=250)) == -3.0
    assert float(data["SXY"].sel(quantity="standard_error")) == 0.8


def test_the_axis_of_a_variable_is_the_components():
    for code, component in COMPONENTS.items():
        if component.is_table:
            numbers = {"positions_mm": [0, 1], component.input_field: [0, 1]}
            one = {"component": code} | numbers
            content = MAP.model_dump(mode="json", exclude_none=True) | {"components": [one]}
            data = ErrorMapAnswer.model_validate(content).to_xarray()
            assert data[code].dims == ("quantity", f"{component.axis}_mm")


def test_a_plot_has_axes_for_each_unit():
    lengths, angles = TABLE.plot()
    assert lengths.get_ylabel() == "compensation [µm]"
    assert lengths.get_xlabel() == "position [mm]"
    forward, backward, straightness = lengths.get_lines()
    assert forward.get_ydata().tolist() == [0.0, -4.0, -20.0]
    assert (forward.get_linestyle(), backward.get_linestyle()) == ("-", "--")
    assert [one.get_label() for one in lengths.get_lines()] == ["EXX +", "EXX -", "EYX"]
    assert forward.get_color() == backward.get_color() != straightness.get_color()
    assert lengths.get_legend() is not None
    assert angles.get_ylabel() == "compensation [µm/m]"
    (level,) = angles.get_lines()
    assert set(level.get_ydata()) == {24.0}
    assert (angles.get_xlabel(), list(angles.get_xticks())) == ("", [])  # there are no positions


def test_a_plot_is_of_what_is_asked():
    (axes,) = MAP.plot("EBX")
    assert axes.get_ylabel() == "error [µrad]"
    (axes,) = TABLE.plot("EXX", quantity="standard_error")
    assert axes.get_ylabel() == "standard error [µm]"
    assert axes.get_lines()[0].get_ydata().tolist() == [0.1, 0.2, 0.3]
    with pytest.raises(KeyError, match="got 'EZZ'"):
        TABLE.plot("EZZ")
    with pytest.raises(ValueError, match="expected error, compensation, standard_error, got 'x'"):
        TABLE.plot(quantity="x")


def test_a_notebook_shows_a_table():
    page = TABLE._repr_html_()
    assert "machine vmc &lt;1&gt; · model_version 3 · complete False" in page
    assert "<li>EBX: &lt;b&gt;old&lt;/b&gt;</li>" in page
    for row in (
        "<td>EXX +</td><td>0 … 500</td><td>0 … 20</td><td>-20 … 0</td><td>µm</td>",
        "<td>EXX -</td><td>0 … 500</td><td>1 … 21</td><td>-21 … -1</td><td>µm</td>",
    ):
        assert f"<tr>{row}<td>interpolated</td></tr>" in page
    assert "<td>SXY</td><td></td><td>-24</td><td>24</td><td>µm/m</td>" in page
    assert "label cold" in MAP._repr_html_()


@pytest.mark.parametrize(
    ("method", "package", "extra"),
    [
        ("to_dataframe", "pandas", "notebook"),
        ("to_xarray", "xarray", "notebook"),
        ("plot", "matplotlib", "notebook"),
        ("to_dataframe", "numpy", "numpy"),
    ],
)
def test_a_package_that_is_not_there_is_named_with_its_extra(monkeypatch, method, package, extra):
    there = importlib.util.find_spec
    monkeypatch.setattr(tables, "find_spec", lambda name: None if name == package else there(name))
    with pytest.raises(ImportError, match=rf'needs {package}, .*"thermap-client\[{extra}\]"'):
        getattr(TABLE, method)()
