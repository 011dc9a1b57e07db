"""Components by name, as arrays, frames and plots: of tables, maps and measurements.

numpy, pandas, xarray and matplotlib are imported by the method that needs them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, ClassVar, Final, Literal, Protocol, TypeAlias, TypeVar

from thermap.shape import Shape

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd
    import xarray as xr
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    FloatArray: TypeAlias = NDArray[np.float64]

Direction: TypeAlias = Literal["+", "-", "both"]
"""Of approach; `both` where there is one error for both."""

Quantity: TypeAlias = Literal["error", "compensation", "standard_error"]

_QUANTITIES: Final[tuple[Quantity, ...]] = ("error", "compensation", "standard_error")
_UNITS: Final = {
    "um": "µm",
    "urad": "µrad",
    "um_per_m": "µm/m",
    "urad_per_m": "µrad/m",
}
"""How a field's name spells a unit, and how people do."""

_BEFORE: Final[dict[Direction, str]] = {"+": "", "-": "backward_", "both": ""}
"""With what names of fields begin that have the numbers of a direction."""

_STEMS: Final = ("errors", "slopes", "error", "value")
"""With what the name of the field begins that has the errors."""

_FACTS: Final = ("machine", "label", "model_version", "measured_at", "reading_time", "complete")
"""What of an answer stands above its components."""


_NUMPY: Final = '"thermap-client[numpy]"'
_NOTEBOOK: Final = '"thermap[notebook]" or "thermap-client[notebook]"'


def needs(package: str, what: str) -> Any:
    """Import a package that the client does without.

    Raises
    ------
    ImportError
        If it is not installed; the sentence names the extra that brings it.
    """
    name = package.partition(".")[0]
    if find_spec(name) is None:
        extra = _NUMPY if name == "numpy" else _NOTEBOOK
        raise ImportError(f"{what} needs {name}, which is not installed: pip install {extra}")
    return import_module(package)


@dataclass(frozen=True, slots=True, eq=False)
class ComponentArrays:
    """One component's numbers, approached from one direction, all in `unit`.

    Parameters
    ----------
    positions_mm
        Shape (n,); None for a single value.
    error
        Actual minus nominal. Shape (n,), or () for a single value.
    compensation
        Minus the error. The same shape.
    standard_error
        One standard deviation of both, NaN where it is not known. The same shape.
    """

    component: str
    direction: Direction
    positions_mm: FloatArray | None
    error: FloatArray
    compensation: FloatArray
    standard_error: FloatArray
    unit: str


class TableEntry(Shape):
    """What a component says of itself, whichever fields its unit names."""

    if TYPE_CHECKING:
        component: str
        positions_mm: list[float] | None

    @property
    def unit(self) -> str:
        """The unit of this component's errors and compensation."""
        return _UNITS[self._spelled_unit]

    @property
    def errors(self) -> list[float] | float:
        """Actual minus nominal, in `unit`: a list over the positions, or a single number."""
        return self._errors("")

    @property
    def compensation(self) -> list[float] | float:
        """Minus the error, in `unit`: a list over the positions, or a single number."""
        return _minus(self.errors)

    @property
    def standard_errors(self) -> list[float] | float | None:
        """One standard deviation of the errors, in `unit`; None where it is not known."""
        return self._standard_errors("")

    @property
    def directions(self) -> tuple[Direction, ...]:
        """Directions of approach that have errors of their own; `both` where they have none."""
        has_own = getattr(self, f"backward_{self._error_field}", None) is not None
        return ("+", "-") if has_own else ("both",)

    def to_numpy(self, direction: Direction | None = None) -> ComponentArrays:
        """Give the numbers as arrays, of the first of `directions` where none is stated."""
        np = needs("numpy", "to_numpy")
        chosen = direction or self.directions[0]
        if chosen not in self.directions:
            raise ValueError(
                f"direction: expected one of {', '.join(self.directions)} for {self.component}, "
                f"got {direction!r}"
            )
        before = _BEFORE[chosen]
        error = np.asarray(self._errors(before), dtype=float)
        positions = self.positions_mm
        standard_errors = self._standard_errors(before)
        return ComponentArrays(
            self.component,
            chosen,
            None if positions is None else np.asarray(positions, dtype=float),
            error,
            0.0 - error,
            np.full_like(error, np.nan)
            if standard_errors is None
            else np.asarray(standard_errors, dtype=float),
            self.unit,
        )

    def _errors(self, before: str) -> list[float] | float:
        value: list[float] | float = getattr(self, before + self._error_field)
        return value

    def _standard_errors(self, before: str) -> list[float] | float | None:
        names = (f"{before}standard_{stem}_{self._spelled_unit}" for stem in ("errors", "error"))
        return next((v for name in names if (v := getattr(self, name, None)) is not None), None)

    @property
    def _spelled_unit(self) -> str:
        return self._error_field.partition("_")[2]

    @property
    def _error_field(self) -> str:
        names = (f"{stem}_{unit}" for stem in _STEMS for unit in _UNITS)
        return next(name for name in names if getattr(self, name, None) is not None)


Entry = TypeVar("Entry", bound=TableEntry)
_EntryOut = TypeVar("_EntryOut", bound=TableEntry, covariant=True)


class _HasComponents(Protocol[_EntryOut]):
    @property
    def components(self) -> Sequence[_EntryOut]: ...


class Components(Shape):
    """An answer with components: `answer["EXX"]`, `"EXX" in answer`, codes by iteration."""

    drawn: ClassVar[Quantity] = "error"

    if TYPE_CHECKING:
        components: Sequence[TableEntry]

    def __getitem__(self: _HasComponents[Entry], component: str) -> Entry:
        """Give a component by its code; KeyError names those that there are."""
        for entry in self.components:
            if entry.component == component:
                return entry
        there = ", ".join(entry.component for entry in self.components)
        raise KeyError(f"expected one of {there or 'no components at all'}, got {component!r}")

    def __iter__(self) -> Iterator[str]:  # type: ignore[override]
        """Go through the components' codes."""
        return (entry.component for entry in self.components)

    def __contains__(self, component: object) -> bool:
        return any(entry.component == component for entry in self.components)

    def __len__(self) -> int:
        return len(self.components)

    def __bool__(self) -> bool:
        """An answer is one also without components."""
        return True

    def to_dataframe(self) -> pd.DataFrame:
        """Make a pandas frame, one row for each component, position and direction.

        Columns are `component`, `position_mm` (NaN for a single value), `direction`, `error`,
        `compensation`, `standard_error` (NaN where it is not known), and `unit`, in which these
        three are.
        """
        pandas = needs("pandas", "to_dataframe")
        columns: dict[str, list[Any]] = {"component": [], "position_mm": [], "direction": []}
        columns |= {quantity: [] for quantity in _QUANTITIES} | {"unit": []}
        for arrays in self._arrays():
            n = arrays.error.size
            positions = arrays.positions_mm
            columns["component"] += [arrays.component] * n
            columns["position_mm"] += [float("nan")] if positions is None else positions.tolist()
            columns["direction"] += [arrays.direction] * n
            for quantity in _QUANTITIES:
                columns[quantity] += getattr(arrays, quantity).ravel().tolist()
            columns["unit"] += [arrays.unit] * n
        return pandas.DataFrame(columns)

    def to_xarray(self) -> xr.Dataset:
        """Make an xarray dataset with a variable for each component; its `units` say in which unit.

        Dimensions are `quantity` (error, compensation, standard_error), `direction` where each
        direction of approach has errors of its own, and the axis, such as `x_mm`. Components of one
        axis share its positions: where one has none of another's, it is NaN.
        """
        xarray = needs("xarray", "to_xarray")
        np = needs("numpy", "to_xarray")
        variables = {}
        for entry in self.components:
            lines = [entry.to_numpy(direction) for direction in entry.directions]
            values = np.stack([[getattr(a, q) for a in lines] for q in _QUANTITIES])
            coordinates: dict[str, Any] = {"quantity": list(_QUANTITIES)}
            if len(lines) > 1:
                coordinates["direction"] = list(entry.directions)
            else:
                values = values[:, 0]
            if entry.positions_mm is not None:
                axis = f"{entry.component[2].lower()}_mm"  # EBX, EYY^x: errors along X and Y
                coordinates[axis] = (axis, lines[0].positions_mm, {"units": "mm"})
            variables[entry.component] = xarray.DataArray(
                values, coordinates, list(coordinates), attrs={"units": entry.unit}
            )
        dataset: xr.Dataset = xarray.Dataset(variables)
        return dataset

    def plot(self, *components: str, quantity: Quantity | None = None) -> list[Axes]:
        """Draw these components, or all, with matplotlib: one axes below the other for each unit.

        Bands are one standard error wide on each side, dashes the approach in the negative
        direction, level lines single values.

        Parameters
        ----------
        quantity
            `compensation` of a compensation table, `error` of all else where none is stated.
        """
        pyplot = needs("matplotlib.pyplot", "plot")
        quantity = quantity or self.drawn
        if quantity not in _QUANTITIES:
            raise ValueError(f"quantity: expected {', '.join(_QUANTITIES)}, got {quantity!r}")
        chosen = [self[code] for code in components or self]
        units = dict.fromkeys(entry.unit for entry in chosen)
        if not units:
            raise ValueError("expected components to draw, got none")
        _, axes = pyplot.subplots(
            len(units), squeeze=False, figsize=(8.0, 3.0 * len(units)), layout="constrained"
        )
        for unit, plot_axes in zip(units, axes[:, 0], strict=True):
            for i, entry in enumerate(entry for entry in chosen if entry.unit == unit):
                _draw(plot_axes, entry, quantity, f"C{i}")
            plot_axes.set(ylabel=f"{quantity.replace('_', ' ')} [{unit}]")
            if all(e.positions_mm is None for e in chosen if e.unit == unit):
                plot_axes.set_xticks([])
            else:
                plot_axes.set_xlabel("position [mm]")
            plot_axes.legend(ncols=3, fontsize="small")
        return list(axes[:, 0])

    def _arrays(self) -> Iterator[ComponentArrays]:
        return (e.to_numpy(direction) for e in self.components for direction in e.directions)

    def _repr_html_(self) -> str:
        """Write what a notebook shows: a row for each component, from its least to its largest."""
        facts = {name: getattr(self, name, None) for name in _FACTS}
        caption = " · ".join(
            f"{name} {value}" for name, value in facts.items() if value is not None
        )
        heads = ("component", "positions [mm]", "error", "compensation", "unit", "status")
        rows = []
        for entry in self.components:
            for direction in entry.directions:
                errors = entry._errors(_BEFORE[direction])
                spans = (_span(n) for n in (entry.positions_mm, errors, _minus(errors)))
                status = getattr(entry, "status", "")
                rows.append((_label(entry, direction), *spans, entry.unit, status))
        lines = "".join(
            f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows
        )
        warnings = "".join(f"<li>{escape(text)}</li>" for text in getattr(self, "warnings", ()))
        return (
            f"<table><caption>{escape(caption)}</caption>"
            f"<thead><tr>{''.join(f'<th>{head}</th>' for head in heads)}</tr></thead>"
            f"<tbody>{lines}</tbody></table>{warnings and f'<ul>{warnings}</ul>'}"
        )


class CompensationTable(Components):
    """A compensation table."""

    drawn: ClassVar[Quantity] = "compensation"


def _draw(axes: Axes, entry: TableEntry, quantity: Quantity, color: str) -> None:
    for direction in entry.directions:
        arrays = entry.to_numpy(direction)
        values = getattr(arrays, quantity)
        style: dict[str, Any] = {"color": color, "linestyle": "--" if direction == "-" else "-"}
        label = _label(entry, direction)
        if arrays.positions_mm is None:
            axes.axhline(float(values), label=label, **style)
            continue
        axes.plot(arrays.positions_mm, values, label=label, marker=".", **style)
        if quantity != "standard_error":
            low, high = values - arrays.standard_error, values + arrays.standard_error
            axes.fill_between(arrays.positions_mm, low, high, color=color, alpha=0.15)


def _label(entry: TableEntry, direction: Direction) -> str:
    return entry.component if direction == "both" else f"{entry.component} {direction}"


def _minus(values: list[float] | float) -> list[float] | float:
    """Change the sign, and never make −0."""
    return [0.0 - v for v in values] if isinstance(values, list) else 0.0 - values


def _span(values: Sequence[float] | float | None) -> str:
    if values is None:
        return ""
    if isinstance(values, float):
        return f"{values:.4g}"
    return f"{min(values):.4g} … {max(values):.4g}"
