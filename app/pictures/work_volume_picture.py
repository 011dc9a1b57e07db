"""The picture of a machine in three dimensions: how it is distorted at one thermal state."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from numpy.typing import ArrayLike

from app.errors import InvalidContent
from app.geometry.error_field import ErrorField
from app.geometry.volumetric_error import NO_TOOL
from app.geometry.work_volume import WorkVolume
from app.pictures.box_lines import Counts, box_edges, face_lines, points_along_axes
from app.pictures.colours import INK, LENGTH_SCALE
from app.pictures.distorted_volume import DistortedVolume
from app.pictures.error_vectors import SHAFT_PX, VECTORS, error_vectors
from app.pictures.layout import Remarks, Texts, layout
from app.pictures.traces import Rounding, Trace, error_lines, hover, plain_lines, rows_of
from app.pictures.words import drawn_sentence

if TYPE_CHECKING:
    from plotly.graph_objects import Figure  # type: ignore[import-untyped]

MOST_ARROWS_PER_AXIS: Final = 12
"""More hide one another."""

NOMINAL_PX: Final = 2.5
EDGE_PX: Final = 5
FACE_PX: Final = 1.5

NO_REMARKS: Final = Remarks()

BOX: Final = "box"
"""What the legend shows and hides together."""


def work_volume_picture(
    field: ErrorField,
    volume: WorkVolume,
    tool_offset_mm: ArrayLike = NO_TOOL,
    *,
    title: str,
    subtitle: str = "",
    exaggeration: float | None = None,
    arrows_per_axis: int = 5,
    remarks: Remarks = NO_REMARKS,
) -> Figure:
    """Draw the work volume as it should be, as it is, and the error vectors between.

    Parameters
    ----------
    volume
        The work volume; axes that the machine does not have are without length.
    tool_offset_mm : array-like, shape (3,) [mm]
    title, subtitle
        Whose errors these are, and in which state; shown letter by letter.
    exaggeration
        Drawn is nominal + exaggeration × error. By default a round factor that makes
        the largest error easy to see.
    arrows_per_axis
        Error vectors along each axis of a cube, 2 to 12; long axes have more of them
        and short ones fewer.
    remarks
        What is to be said against these errors; shown above the drawing.

    Returns
    -------
    plotly.graph_objects.Figure
        To be turned by hand; under the mouse are the nominal position [mm] and the
        real error [µm]. `layout.meta` has `title`, `subtitle` and `drawn` as plain
        text, `exaggeration`, and the remarks: `complete`, `warnings`, `counted_as_zero`.

    Raises
    ------
    InvalidContent
        If the field has several thermal states, the volume is a point, there is more
        than one tool offset, the factor is not above 0 or draws errors longer than
        two diagonals, or the arrows are too few or too many.

    Notes
    -----
    Errors are actual minus nominal. The largest one is looked for at the tables' nodes
    in the volume, as in `volumetric_accuracy`.

    Examples
    --------
    >>> from app.geometry.chain import Chain
    >>> from app.geometry.error_table import Table
    >>> field = ErrorField.make(Chain.parse("XYFZ"), {"EXX": Table([0, 500], [0, 40])})
    >>> volume = WorkVolume((0.0, 500.0), (0.0, 500.0), (0.0, 400.0))
    >>> work_volume_picture(field, volume, title="Mill 7").layout.meta["exaggeration"]
    1000.0
    """
    # plotly and its first figure take some 0.2 s: the service shall not pay that at its
    # start, nor whoever asks for no picture.
    from plotly.graph_objects import Figure

    _check_arrows(arrows_per_axis)
    distorted = DistortedVolume.make(field, volume, tool_offset_mm, exaggeration)
    rounding = Rounding.of(volume, distorted.largest_um)
    traces = _traces(distorted, points_along_axes(volume, arrows_per_axis), rounding)
    texts = Texts(title, subtitle, drawn_sentence(distorted, rounding), remarks)
    return Figure({"data": traces, "layout": layout(distorted, traces, texts, rounding)})


def _check_arrows(arrows_per_axis: int) -> None:
    if not 2 <= arrows_per_axis <= MOST_ARROWS_PER_AXIS:
        raise InvalidContent.of_field(
            "arrows_per_axis",
            f"expected 2 to {MOST_ARROWS_PER_AXIS} error vectors along an axis, "
            f"got {arrows_per_axis}",
        )


def _traces(distorted: DistortedVolume, counts: Counts, rounding: Rounding) -> list[Trace]:
    """The nominal box, and where there are errors the distorted one with its vectors."""
    nominal = {
        **plain_lines(box_edges(distorted.volume), rounding, NOMINAL_PX),
        "name": "nominal box",
    }
    if not distorted.has_errors:
        return [nominal]
    return [
        nominal,
        *_distorted_box(distorted, counts, rounding),
        *error_vectors(distorted, counts, rounding),
        _legend_key("distorted box", BOX, EDGE_PX),
        _legend_key("error vectors", VECTORS, SHAFT_PX),
        _worst_mark(distorted, rounding),
    ]


def _distorted_box(distorted: DistortedVolume, counts: Counts, rounding: Rounding) -> list[Trace]:
    edges = box_edges(distorted.volume, distorted.field)
    across = face_lines(distorted.volume, distorted.field, counts)
    traces = [
        {
            **error_lines([distorted.at(edge) for edge in edges], rounding, EDGE_PX),
            "name": "distorted box",
            "legendgroup": BOX,
            "showlegend": False,
        }
    ]
    if across:
        lines = error_lines([distorted.at(line) for line in across], rounding, FACE_PX)
        # Thin lines under the mouse would stand before the vectors between them.
        del lines["customdata"], lines["hovertemplate"]
        quiet = {"hoverinfo": "skip", "opacity": 0.5, "showlegend": False}
        traces.append({**lines, **quiet, "name": "distorted faces", "legendgroup": BOX})
    return traces


def _legend_key(name: str, group: str, width_px: float) -> Trace:
    """A line for the legend alone: of lines in many colours plotly shows a black one."""
    return {
        "type": "scatter3d",
        "mode": "lines",
        **{"x": [None], "y": [None], "z": [None]},
        "line": {"width": width_px, "color": LENGTH_SCALE[len(LENGTH_SCALE) // 2]},
        "name": name,
        "legendgroup": group,
    }


def _worst_mark(distorted: DistortedVolume, rounding: Rounding) -> Trace:
    """A ring around the drawn end of the largest error."""
    worst = distorted.worst
    x, y, z = worst.drawn_mm.round(rounding.mm).T.tolist()
    return {
        "type": "scatter3d",
        "mode": "markers",
        **{"x": x, "y": y, "z": z},
        "marker": {"size": 7, "symbol": "circle-open", "color": INK, "line": {"width": 2}},
        "name": "largest error",
        **hover(rows_of(worst, rounding), rounding),
    }
