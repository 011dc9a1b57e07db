"""thermap simulate verification: what an instrument would read on a stored machine, as a file.

The model at the times of stored readings, and noise: a machine that is as its model says. With
`--reversal` it has an effect that the model lacks, for `thermap analyse` to find.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, TypeAlias

import typer

from app.cli.options import (
    LabelOption,
    MachineArgument,
    MissingOption,
    SeedOption,
    UrlOption,
    connect,
    expect_finite,
    label_of,
    read_named_numbers,
    time_option,
    write_file,
)
from app.cli.terminal import echo
from app.csv_text import csv_line, no_formula
from app.errors import ThermapError, UnknownComponent, counted, list_names
from thermap import DEFAULT_URL

if TYPE_CHECKING:
    from thermap import ThermapClient

OBSERVATION_EVERY: Final = timedelta(seconds=20)
"""So long an instrument takes from one place to the next."""

READINGS_APART: Final = timedelta(minutes=10)
"""So far apart readings serve for what happens between them."""

_DECIMALS: Final = 4
"""Of what is read in µm: a tenth of a nanometre, as the service writes."""

_COLUMNS: Final = (
    *("time", "component", "position_mm", "direction", "measured_um", "measured_urad"),
    *(f"{stem}_{axis}_mm" for stem in ("point", "tool") for axis in "xyz"),
    *(f"measured_{axis}_um" for axis in "xyz"),
    *(f"direction_{axis}" for axis in "xyz"),
    "setup",
)

VISITS_APART: Final = timedelta(hours=2)
"""From the beginning of a visit to that of the next, at least."""

Observation = dict[str, Any]
"""One observation as the service takes it, without its value."""

_Range: TypeAlias = tuple[float, float] | None
"""First and last position [mm]; None of a component without argument."""


class NothingToSimulate(ThermapError):
    """The service has not what a simulation needs."""


@dataclass(frozen=True, slots=True)
class _Plan:
    """Observations visit by visit, and what the file says above them."""

    visits: Sequence[Sequence[Observation]]
    datum: str


def simulate_verification(
    context: typer.Context,
    machine: MachineArgument,
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="CSV, as `thermap analyse --verification` reads it.",
        ),
    ],
    plan: Annotated[
        Path | None,
        typer.Option(
            envvar="THERMAP_PLAN_FILE",
            metavar="FILE",
            help="Observations to be made, a verification's CSV without values; without it every "
            "component is visited several times.",
        ),
    ] = None,
    visits: Annotated[int, typer.Option(min=1, max=1000, help="Visits of the machine.")] = 10,
    positions: Annotated[
        int,
        typer.Option(min=1, max=100, help="Positions of a component in a visit."),
    ] = 5,
    component: Annotated[
        list[str] | None,
        typer.Option(
            envvar="THERMAP_COMPONENTS",
            metavar="NAME",
            help="A component that is measured, such as EXX; all of the model without it.",
        ),
    ] = None,
    since: Annotated[datetime | None, time_option("--from", "No visit before it.")] = None,
    until: Annotated[datetime | None, time_option("--to", "No visit after it.")] = None,
    noise: Annotated[
        float,
        typer.Option(
            metavar="UM", min=0.0, help="Standard deviation of one value in µm (µrad, µm/m)."
        ),
    ] = 0.5,
    reversal: Annotated[
        list[str] | None,
        typer.Option(
            envvar="THERMAP_REVERSALS",
            metavar="NAME=UM",
            help="A reversal value that the model lacks, in the component's unit: half of it with "
            "the sign of the approach.",
        ),
    ] = None,
    seed: SeedOption = 0,
    label: LabelOption = None,
    missing_as_zero: MissingOption = False,
    url: UrlOption = DEFAULT_URL,
) -> None:
    """Write what would be measured on a stored machine that is as its model says, with noise.

    At the times of its stored readings, or as `--plan` has them. With `--reversal` the
    machine has an effect that its model lacks: `thermap analyse` should find it.

    Example: `thermap simulate verification vmc --reversal EXX=4 -o night.csv`
    """
    import numpy as np

    expect_finite(context.params)
    named = label_of(output, label)
    reversals = _read_reversals(reversal)
    with connect(url) as thermap:
        planned = (
            _default_plan(thermap, machine, visits, positions, component, (since, until))
            if plan is None
            else _stated_plan(thermap, machine, plan)
        )
        rng = np.random.default_rng(seed)
        rows: list[Sequence[Any]] = []
        left_out = 0
        version = 0
        for visit in planned.visits:
            answer = thermap.predict(
                machine,
                _predictable(visit),
                missing_components="zero" if missing_as_zero else "refuse",
            )
            version = answer.model_version
            for observation, predicted in zip(visit, answer.predicted_um, strict=True):
                if predicted is None:
                    left_out += 1
                    continue
                values = np.atleast_1d(np.asarray(predicted, dtype=float))
                values = values + rng.normal(0.0, noise, values.size) if noise else values
                values += _reversed_by(observation, reversals)
                rows.append(_row(observation, [round(float(v), _DECIMALS) for v in values]))
    if not rows:
        raise NothingToSimulate(
            f"the model says nothing of machine {machine!r} at these times: there are no "
            "readings around them, or no two error maps"
        )
    head = [
        f"label: {named}",
        f"machine: {machine}",
        f"datum: {planned.datum}",
        "instrument: simulation",
        # Sentences without a colon are read by people alone.
        f"Simulated from model version {version}, for training, not measured",
        f"Simulated with {_disturbances(noise, seed, reversals)}",
    ]
    head += [f"repeatability_um: {noise:g}"] if noise else []
    write_file(output, _written(head, rows))
    if left_out:
        echo(
            f"note: {counted(left_out, 'observation')} left out: there is no reading around its "
            "time, or no two maps have the component",
            err=True,
        )
    content = f"{counted(len(rows), 'observation')} in {counted(len(planned.visits), 'visit')}"
    echo(f"{output}: {content}, simulated")


def _predictable(visit: Iterable[Observation]) -> list[Observation]:
    """Leave out what a prediction does not ask for."""
    return [{k: v for k, v in observation.items() if k != "setup"} for observation in visit]


def _read_reversals(texts: Sequence[str] | None) -> dict[str, float]:
    """Read reversal values by the components' codes."""
    from app.geometry.components import parse_component

    reversals = {}
    named = read_named_numbers(texts, "--reversal", "a reversal value in µm")
    for name, value in named.items():
        component, _ = _parsed(name, "--reversal", parse_component)
        if not component.is_table:
            raise typer.BadParameter(
                f"{component.code} has no direction of approach", param_hint="--reversal"
            )
        reversals[component.code] = value
    return reversals


def _parsed(name: str, option: str, parse: Any) -> Any:
    try:
        return parse(name)
    except UnknownComponent as error:
        raise typer.BadParameter(error.detail, param_hint=option) from None


def _stated_plan(thermap: ThermapClient, machine: str, file: Path) -> _Plan:
    """Read a plan; what it states as a set-up is a visit."""
    from app.cli.check_files import look_at_visits

    ((_, visit),) = look_at_visits(thermap, machine, [file])
    body = visit.planned.model_dump(mode="json", exclude_none=True)
    ordered = sorted(
        map(_approached, body["observations"]), key=lambda o: datetime.fromisoformat(o["time"])
    )
    setups: dict[str | None, list[Observation]] = {}
    for observation in ordered:
        setups.setdefault(observation.get("setup"), []).append(observation)
    return _Plan(list(setups.values()), body.get("datum", "absolute"))


def _default_plan(
    thermap: ThermapClient,
    machine: str,
    visits: int,
    positions: int,
    components: Sequence[str] | None,
    span: tuple[datetime | None, datetime | None],
) -> _Plan:
    """Visit the components in turn at times that the stored readings cover evenly."""
    ranges = _ranges_of_maps(thermap, machine, components)
    count = positions * len(ranges)
    readings = thermap.readings(machine, *span, every_s=VISITS_APART.total_seconds())
    times = [stored.time for stored in readings]
    every = OBSERVATION_EVERY
    starts = _spread(times, visits, every * count)
    if times and not starts:
        # A service that has just begun: one visit, as quick as its readings are young.
        last = thermap.readings(machine, times[0], span[1])[-1].time
        every = min(every, (last - times[0]) / count)
        starts = times[:1] if every else []
    if not starts:
        raise NothingToSimulate(
            f"machine {machine!r} has no two readings at those times; `thermap replay` sends "
            "recorded ones"
        )
    if len(starts) < visits:
        echo(
            f"note: {counted(len(starts), 'visit')} instead of {visits}: the stored readings have "
            f"no more that are {VISITS_APART / timedelta(hours=1):g} hours apart",
            err=True,
        )
    if every < OBSERVATION_EVERY:
        echo(
            f"note: an observation every {every.total_seconds():.2g} s: the stored readings cover "
            "no more",
            err=True,
        )
    planned = []
    for i, start in enumerate(starts):
        # The maps in use can change while a visit lasts, so they are asked for at both its ends.
        end = start + every * count
        around = thermap.readings(machine, start, end + READINGS_APART)
        after = next((one for one in around if one.time >= end), around[-1])
        here = ranges
        for reading in (around[0], after):
            here = here | _ranges_of_table(thermap, machine, reading.temperatures_c, here)
        planned.append(list(_visit(start, _places(here, positions), i, every)))
    return _Plan(planned, "absolute")


def _ranges_of_maps(
    thermap: ThermapClient, machine: str, components: Sequence[str] | None
) -> dict[str, _Range]:
    """List the components, and from where to where any map of the active model has them."""
    from app.geometry.components import COMPONENTS, parse_component

    wanted = {_parsed(name, "--component", parse_component)[0].code for name in components or ()}
    ranges: dict[str, _Range] = {}
    for error_map in thermap.error_maps(machine):
        for table in error_map.components if error_map.in_active_model else ():
            at_mm = table.positions_mm
            if at_mm is None:
                ranges[table.component] = None
                continue
            low, high = ranges.get(table.component) or (at_mm[0], at_mm[-1])
            ranges[table.component] = (min(low, at_mm[0]), max(high, at_mm[-1]))
    absent = sorted(wanted - ranges.keys())
    if absent or not ranges:
        raise NothingToSimulate(
            f"the model of machine {machine!r} lacks {list_names(absent)}; "
            f"it has {list_names(ranges)}"
        )
    return {c: ranges[c] for c in COMPONENTS if c in (wanted or ranges) and c in ranges}


def _ranges_of_table(
    thermap: ThermapClient,
    machine: str,
    temperatures_c: Mapping[str, float],
    ranges: Mapping[str, _Range],
) -> dict[str, _Range]:
    """Find from where to where the maps in use reach at a visit, within the axes' travel.

    None of it where the service gives no table at these temperatures: nothing is predicted there
    either, and that is said.
    """
    from app.geometry.components import COMPONENTS
    from thermap import ThermapClientError

    try:
        table = thermap.compensation(machine, temperatures_c)
    except ThermapClientError:
        return {}
    travel = thermap.machine(machine).axes
    ranges_by_code: dict[str, _Range] = {}
    for entry in table.components:
        ends = ranges.get(entry.component)
        if ends is None:
            continue
        at_mm = entry.positions_mm or ()
        # Errors that are the same everywhere are measured as far as any map goes.
        low, high = ends
        if len(at_mm) > 1 and max(low, at_mm[0]) < min(high, at_mm[-1]):
            low, high = max(low, at_mm[0]), min(high, at_mm[-1])
        axis = travel.get(str(COMPONENTS[entry.component].axis))
        if axis is not None:
            low, high = max(low, axis.min_mm), min(high, axis.max_mm)
        ranges_by_code[entry.component] = (low, high)
    return ranges_by_code


def _places(ranges: Mapping[str, _Range], positions: int) -> list[tuple[str, float | None]]:
    """List component and position, evenly over each range."""
    places: list[tuple[str, float | None]] = []
    for code, ends in ranges.items():
        if ends is None:
            # One value in a visit would not show its scatter.
            places += [(code, None)] * positions
        else:
            low, high = ends
            steps = range(positions)
            places += [(code, low + (high - low) * (i + 0.5) / positions) for i in steps]
    return places


def _spread(times: Sequence[datetime], visits: int, lasting: timedelta) -> list[datetime]:
    """Choose beginnings of visits evenly among times; the last visit ends before the last time."""
    possible = [time for time in times if times[-1] - time >= lasting]
    if len(possible) <= visits:
        return possible
    last = len(possible) - 1
    return [possible[round(i * last / max(visits - 1, 1))] for i in range(visits)]


def _visit(
    start: datetime,
    places: Sequence[tuple[str, float | None]],
    number: int,
    every: timedelta,
) -> Iterator[Observation]:
    """Go through all places, from both sides in turn."""
    for i, (code, position) in enumerate(places):
        observation: Observation = {
            "time": (start + i * every).isoformat().replace("+00:00", "Z"),
            "component": code,
            "setup": f"visit {number + 1}",
        }
        if position is not None:
            sign = "+" if (i + number) % 2 else "-"
            observation |= {"position_mm": round(position, 3), "direction": sign}
        yield observation


def _approached(observation: Observation) -> Observation:
    """State a component's approach by one sign, as a file does; the service has one an axis."""
    from app.geometry.components import COMPONENTS

    code, signs = _code(observation), observation.get("direction")
    if not code or not isinstance(signs, dict):
        return observation
    sign = signs.get(str(COMPONENTS[code].axis))
    rest = {name: value for name, value in observation.items() if name != "direction"}
    return rest if sign is None else {**rest, "direction": sign}


def _reversed_by(observation: Mapping[str, Any], reversals: Mapping[str, float]) -> float:
    """Give half a component's reversal value with the sign of the approach."""
    sign = {"+": 0.5, "-": -0.5}.get(str(observation.get("direction")), 0.0)
    return sign * reversals.get(_code(observation), 0.0)


def _code(observation: Mapping[str, Any]) -> str:
    from app.geometry.components import parse_component

    name = observation.get("component")
    return parse_component(name)[0].code if name else ""


def _row(observation: Observation, values: Sequence[float]) -> list[Any]:
    """Write one observation's line."""
    from app.geometry.components import COMPONENTS
    from app.units import Unit

    time, code, setup = observation["time"], _code(observation), observation.get("setup", "")
    if not code:
        signs = observation.get("direction", {})
        tool = observation.get("tool_offset_mm", ["", "", ""])
        places = [*observation["point_mm"], *tool, *values]
        return [time, *[""] * 5, *places, *(signs.get(axis, "") for axis in "xyz"), setup]
    is_angle = COMPONENTS[code].unit in (Unit.URAD, Unit.UM_PER_M)
    cells = ["", values[0]] if is_angle else [values[0], ""]
    place = [observation.get("position_mm", ""), observation.get("direction", "")]
    return [time, observation["component"], *place, *cells, *[""] * 12, setup]


def _written(head: Iterable[str], rows: Sequence[Sequence[Any]]) -> str:
    """Write the file, without the columns that hold nothing."""
    used = [i for i in range(len(_COLUMNS)) if any(row[i] != "" for row in rows)]
    lines = [f"# {no_formula(line)}\n" for line in head]
    lines.append(csv_line(_COLUMNS[i] for i in used))
    lines += [csv_line(row[i] for i in used) for row in rows]
    return "".join(lines)


def _disturbances(noise: float, seed: int, reversals: Mapping[str, float]) -> str:
    parts = [f"noise of {noise:g} µm, µrad or µm/m (seed {seed})" if noise else "no noise"]
    parts += [f"a reversal of {value:g} in {code}" for code, value in reversals.items()]
    return ", ".join(parts)
