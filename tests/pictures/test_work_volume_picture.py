"""What is drawn is nominal plus exaggeration times error; what is said is the real error."""

import math

import numpy as np
import plotly.io
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.errors import InvalidContent
from app.geometry.chain import Chain
from app.geometry.error_field import ErrorField
from app.geometry.error_table import Table
from app.geometry.volumetric_accuracy import volumetric_accuracy
from app.geometry.work_volume import WorkVolume, points_of
from app.pictures import distorted_volume
from tests.geometry.example_fields import NONRIGID, TOOL, constant_field, random_field
from tests.pictures.example_pictures import (
    CUBE,
    GANTRY,
    LATHE,
    LINE,
    NO_ERRORS,
    VOLUMES,
    lines_of,
    picture,
    random_picture,
    trace,
)


def drawn_points(figure):
    columns = [[v for t in figure.data for v in t[a] if v is not None] for a in "xyz"]
    return np.array(columns).T


def directions(figure):
    """What is rightward and upward in the picture, and toward the viewer."""
    camera = figure.layout.scene.camera
    eye = np.array([camera.eye.x, camera.eye.y, camera.eye.z])
    across = np.cross([camera.up.x, camera.up.y, camera.up.z], eye)
    across /= np.linalg.norm(across)
    upward = np.cross(eye, across)
    return across, upward / np.linalg.norm(upward), eye / np.linalg.norm(eye)


def test_a_stretched_axis_is_drawn_where_one_reckons_it_by_hand():
    # 40 µm times 500 are 20 mm: the corner at 500 mm is drawn at 520 mm.
    figure = picture(exaggeration=500.0)
    shafts = [points for points, _ in lines_of(trace(figure, "error vectors"))]
    assert [[500.0, 0.0, 0.0], [520.0, 0.0, 0.0]] in [s.tolist() for s in shafts]
    # At 125 mm it is a quarter of it; at 0 mm there is no error and no vector.
    assert [[125.0, 0.0, 0.0], [130.0, 0.0, 0.0]] in [s.tolist() for s in shafts]
    assert {s[0][0] for s in shafts} == {125.0, 250.0, 375.0, 500.0}
    edges = np.vstack([points for points, _ in lines_of(trace(figure, "distorted box"))])
    assert edges[:, 0].max() == 520.0
    assert edges[:, 1:].max() == 500.0


@pytest.mark.slow
@settings(max_examples=30)
@given(st.integers(0, 50), st.sampled_from(["XYFZ", "FXYZ", "FZX"]), st.sampled_from([*VOLUMES]))
def test_every_vector_is_the_exaggerated_error(seed, chain, name):
    field = random_field(chain, NONRIGID, seed)
    figure = picture(field, VOLUMES[name], TOOL, arrows_per_axis=3)
    shafts = lines_of(trace(figure, "error vectors"))
    starts = np.array([points[0] for points, _ in shafts])
    vectors = np.array([points[1] for points, _ in shafts]) - starts
    errors_um, _ = field.at(starts, TOOL)
    factor = figure.layout.meta["exaggeration"]
    # Coordinates are rounded to 6 digits of the diagonal, starts a little beside their points.
    rounding_mm = 1.1e-5 * VOLUMES[name].diagonal_mm
    assert np.allclose(vectors, factor * errors_um / 1000.0, rtol=0, atol=3 * rounding_mm)


@pytest.mark.slow
@pytest.mark.parametrize("name", VOLUMES)
def test_heads_end_where_vectors_end(name):
    figure = random_picture(VOLUMES[name])
    heads = trace(figure, "error vectors", "mesh3d")
    tips = np.array([heads.x, heads.y, heads.z]).T[list(heads.k[::6])]
    ends = np.array([points[1] for points, _ in lines_of(trace(figure, "error vectors"))])
    assert np.array_equal(tips, ends)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["error vectors", "distorted box"])
def test_under_the_mouse_are_nominal_position_and_real_error(name):
    field = random_field(kinds=NONRIGID, seed=3)
    figure = picture(field, CUBE, TOOL, exaggeration=250.0)
    rows = np.vstack([rows for _, rows in lines_of(trace(figure, name))])
    points = np.vstack([points for points, _ in lines_of(trace(figure, name))])
    errors_um, _ = field.at(rows[:, :3], TOOL)
    assert np.allclose(rows[:, 3:6], errors_um, atol=0.002)
    assert np.allclose(rows[:, 6], np.linalg.norm(errors_um, axis=1), atol=0.002)
    ends = slice(1, None, 2) if name == "error vectors" else slice(None)
    drawn = rows[ends, :3] + 250.0 * errors_um[ends] / 1000.0
    assert np.allclose(points[ends], drawn, atol=0.01)
    assert "µm" in trace(figure, name).hovertemplate
    assert "mm" in trace(figure, name).hovertemplate


def test_colours_are_lengths_from_none_to_the_largest():
    figure = random_picture(CUBE)
    box = trace(figure, "distorted box")
    lengths = [None if x is None else row[6] for x, row in zip(box.x, box.customdata, strict=True)]
    assert [c for c, n in zip(box.line.color, lengths, strict=True) if n is not None] == [
        n for n in lengths if n is not None
    ]
    assert len(box.line.color) == len(box.x)
    assert figure.layout.coloraxis.cmin == 0
    assert figure.layout.coloraxis.cmax >= max(n for n in lengths if n is not None) - 0.001
    assert "µm" in figure.layout.coloraxis.colorbar.title.text


def test_edges_pass_every_node_of_the_tables():
    field = random_field(seed=5, positions=4)
    figure = picture(field, CUBE, TOOL)
    edges = lines_of(trace(figure, "distorted box"))
    assert len(edges) == 12
    for i, axis in enumerate("xyz"):
        along = [rows[:, i] for _, rows in edges if np.ptp(rows[:, i]) > 0]
        assert len(along) == 4
        for positions in along:
            assert set(field.nodes_mm(axis)) <= set(positions)
            assert positions[0] == 0.0
            assert positions[-1] == 500.0


def test_tables_of_very_many_nodes_keep_the_picture_small():
    fine = np.linspace(0.0, 500.0, 4001)
    many = {code: Table(fine, np.sin(fine / 30.0)) for code in ("EXX", "EYX", "EYY", "EZZ")}
    figure = picture(ErrorField.make(Chain.parse("XYFZ"), many), CUBE)
    assert len(figure.to_json()) < 300_000


@pytest.mark.parametrize(
    ("volume", "edges"), [(CUBE, 12), (LATHE, 4), (LINE, 1), (GANTRY, 12)], ids=str
)
def test_the_nominal_box_has_its_edges(volume, edges):
    lines = [points for points, _ in lines_of(trace(random_picture(volume), "nominal box"))]
    assert len(lines) == edges
    corners = {tuple(point) for points in lines for point in points}
    ends = [sorted(set(range_)) for range_ in volume.ranges_mm]
    assert corners == {tuple(point) for point in points_of(*ends)}


@pytest.mark.slow
@pytest.mark.parametrize("name", VOLUMES)
def test_the_marked_point_is_the_one_of_the_volumetric_accuracy(name):
    field = random_field("FXYZ", seed=4, high=3000.0)
    figure = picture(field, VOLUMES[name], TOOL)
    worst = volumetric_accuracy(field, VOLUMES[name], TOOL).with_arms
    mark = trace(figure, "largest error")
    assert mark.customdata[0][:3] == pytest.approx(worst.worst_point_mm, abs=0.1)
    assert mark.customdata[0][6] == pytest.approx(worst.definition_1, rel=1e-4)
    (label,) = figure.layout.scene.annotations
    said_um = label.text.removeprefix("<b>").removesuffix(" µm</b>")
    assert float(said_um) == pytest.approx(worst.definition_1, rel=0.005)
    assert f"Largest error {said_um} µm at X" in figure.layout.meta["drawn"]
    starts = [points[0] for points, _ in lines_of(trace(figure, "error vectors"))]
    assert any(np.allclose(start, worst.worst_point_mm, atol=0.1) for start in starts)


@pytest.mark.slow
def test_among_too_many_nodes_ends_are_looked_at(monkeypatch):
    monkeypatch.setattr(distorted_volume, "MOST_POINTS", 60)
    field = random_field(seed=2, positions=40)
    largest = trace(picture(field, CUBE), "largest error").customdata[0][6]
    corners = np.linalg.norm(field.at(CUBE.lattice(2))[0], axis=1).max()
    everywhere = volumetric_accuracy(field, CUBE).with_arms.definition_1
    assert corners - 0.001 <= largest <= everywhere + 0.001


@pytest.mark.slow
@pytest.mark.parametrize("name", VOLUMES)
def test_a_millimetre_is_equally_long_along_all_axes(name):
    scene = random_picture(VOLUMES[name]).layout.scene
    assert scene.aspectmode == "manual"
    scales = [scene.aspectratio[a] / np.ptp(scene[f"{a}axis"].range) for a in "xyz"]
    assert scales == pytest.approx([scales[0]] * 3)
    assert scene.camera.projection.type == "orthographic"


@pytest.mark.parametrize("name", VOLUMES)
def test_all_that_is_drawn_is_in_the_picture_and_fills_it(name):
    figure = random_picture(VOLUMES[name])
    scene = figure.layout.scene
    ranges = np.array([scene[f"{a}axis"].range for a in "xyz"])
    points = drawn_points(figure)
    assert (points >= ranges[:, 0]).all()
    assert (points <= ranges[:, 1]).all()
    scale = scene.aspectratio.x / np.ptp(ranges[0])
    across, upward, _ = directions(figure)
    seen = scale * (points - ranges.mean(axis=1))
    wide, tall = np.abs(seen @ across).max() / 1.25, np.abs(seen @ upward).max() / 0.82
    assert max(wide, tall) <= 1.0
    assert max(wide, tall) > 0.8


def test_a_flat_volume_lies_in_the_picture():
    figure = random_picture(LATHE)
    _, _, eye = directions(figure)
    assert abs(eye[1]) > 0.99
    assert not figure.layout.scene.yaxis.visible
    assert {points[0][1] for points, _ in lines_of(trace(figure, "error vectors"))} == {0.0}


@pytest.mark.parametrize("name", VOLUMES)
def test_in_a_narrow_window_an_axis_has_one_label_with_both_ends(name):
    layout = random_picture(VOLUMES[name]).layout
    changes = layout.meta["narrow"]["changes"]
    for axis, (low, high) in zip("xyz", VOLUMES[name].ranges_mm, strict=True):
        words = changes.get(f"scene.{axis}axis.ticktext", [])
        assert bool(words) == (low < high)
        if words:
            assert len(words) == len(layout.scene[f"{axis}axis"].tickvals)
            (label,) = filter(None, words)
            assert label.startswith(f"<b>{axis.upper()}</b> ")
            assert label.endswith(f"{high:g} mm".replace("-", "−"))


def test_in_a_narrow_window_the_colour_scale_is_as_wide_as_it_and_above_the_box():
    changes = random_picture(next(iter(VOLUMES.values()))).layout.meta["narrow"]["changes"]
    scale = {name: changes[f"coloraxis.colorbar.{name}"] for name in ("orientation", "len", "y")}
    assert scale == {"orientation": "h", "len": 0.9, "y": 1.0}
    assert changes["coloraxis.colorbar.ticksuffix"] == " µm"
    assert changes["scene.domain.y"][1] < 0.9


@pytest.mark.parametrize("long_mm", [2500.0, 4000.0])
def test_an_axis_without_two_round_numbers_shows_its_ends(long_mm):
    # There is room for two or three intervals; of steps of 500 mm only 1500 lies inside.
    volume = WorkVolume((0.0, long_mm), (0.0, 0.8 * long_mm), (1010.0, 1990.0))
    axis = random_picture(volume, exaggeration=1.0).layout.scene.zaxis
    assert axis.tickvals == (1010.0, 1990.0)
    assert axis.ticktext == ("1010", "<b>Z</b> 1990 mm")


@pytest.mark.slow
@settings(max_examples=30)
@given(
    st.lists(st.tuples(st.floats(-4e4, 4e4), st.floats(0.01, 4e4)), min_size=3, max_size=3).map(
        lambda sides: WorkVolume(*((low, low + long) for low, long in sides))
    )
)
def test_any_box_has_a_picture(volume):
    figure = random_picture(volume, arrows_per_axis=2)
    again = plotly.io.from_json(figure.to_json())
    assert np.isfinite(drawn_points(again)).all()
    assert all(scale > 0 for scale in again.layout.scene.aspectratio.to_plotly_json().values())


def test_the_factor_is_said():
    assert "drawn 500 times larger" in picture(exaggeration=500.0).layout.meta["drawn"]
    assert "as large as they are" in picture(exaggeration=1.0).layout.meta["drawn"]
    assert "drawn 4 times smaller" in picture(exaggeration=0.25).layout.meta["drawn"]
    figure = picture()
    assert figure.layout.meta["drawn"] == (
        "Errors (actual minus nominal) drawn 2000 times larger. Largest error 40.0 µm at "
        "X 500, Y 0, Z 0 mm (ex +40.0, ey +0.0, ez +0.0 µm)."
    )
    assert "2000 times larger" in figure.layout.annotations[0].text


@pytest.mark.parametrize("wanted", [None, 500.0])
def test_without_errors_the_nominal_box_is_drawn_and_said(wanted):
    figure = picture(NO_ERRORS, exaggeration=wanted)
    assert [t.name for t in figure.data] == ["nominal box"]
    assert "No errors" in figure.layout.meta["drawn"]
    assert figure.layout.meta["exaggeration"] == (wanted or 1.0)
    assert not figure.layout.coloraxis.showscale
    assert plotly.io.from_json(figure.to_json()).to_dict() == figure.to_dict()


def test_rounding_is_no_error():
    figure = picture(constant_field("XYFZ", {"EXX": 1e-9, "EYY": -1e-10}))
    assert "No errors" in figure.layout.meta["drawn"]
    assert figure.layout.meta["exaggeration"] == 1.0


def test_errors_of_a_nanometre_are_drawn():
    figure = picture(constant_field("XYFZ", {"EXX": 0.001}))
    assert trace(figure, "largest error").customdata[0][3] == 0.001
    assert "0.00100 µm" in figure.layout.meta["drawn"]


def test_texts_are_shown_letter_by_letter():
    figure = picture(title="<b>Mill</b> & <script>alert(1)</script>", subtitle="<a href='x'>y</a>")
    assert (
        figure.layout.title.text
        == "&lt;b&gt;Mill&lt;/b&gt; &amp; &lt;script&gt;alert(1)&lt;/script&gt;"
    )
    assert figure.layout.title.subtitle.text == "&lt;a href='x'&gt;y&lt;/a&gt;"
    assert figure.layout.meta["title"] == "<b>Mill</b> & <script>alert(1)</script>"


def test_nothing_is_offered_to_be_sent_to_the_cloud():
    assert "sendChartToCloud" in picture().layout.modebar.remove


@pytest.mark.slow
def test_a_process_wide_template_changes_nothing(monkeypatch):
    plain = picture().to_json()
    monkeypatch.setattr(plotly.io.templates, "default", "plotly_dark")
    assert picture().to_json() == plain


@pytest.mark.parametrize(
    ("wanted", "message"),
    [
        ({"exaggeration": 0.0}, "exaggeration: expected a finite factor above 0, got 0"),
        ({"exaggeration": -5.0}, "expected a finite factor above 0, got -5"),
        ({"exaggeration": math.nan}, "expected a finite factor above 0, got nan"),
        ({"exaggeration": math.inf}, "expected a finite factor above 0, got inf"),
        ({"exaggeration": 1e6}, "the largest error, 40 µm, no longer than 2 diagonals of 866"),
        ({"arrows_per_axis": 1}, "arrows_per_axis: expected 2 to 12 .*, got 1"),
        ({"arrows_per_axis": 13}, "expected 2 to 12 .*, got 13"),
        ({"tool": [[0.0, 0.0, 1.0]] * 2}, "expected one tool offset of 3 coordinates in mm"),
        ({"tool": (0.0, math.nan, 1.0)}, "tool_offset_mm: expected finite numbers"),
        ({"volume": WorkVolume((1.0, 1.0), (2.0, 2.0), (3.0, 3.0))}, "got a point"),
        ({"field": constant_field("XYFZ", {"EXX": 1e200})}, "errors: expected finite numbers"),
        ({"field": constant_field("XYFZ", {"EXX": [[1.0], [2.0]]})}, "expected one thermal state"),
    ],
    ids=[
        "zero",
        "negative",
        "nan",
        "infinite",
        "huge",
        "one arrow",
        "many arrows",
        "two tools",
        "nan tool",
        "point",
        "huge error",
        "two states",
    ],
)
def test_what_draws_no_picture_is_refused(wanted, message):
    with pytest.raises(InvalidContent, match=message):
        picture(**wanted)
