"""thermap simulate verification: what an instrument would read on a stored machine, as a file.

The model at the times of stored readings, and noise: a machine that is as its model says. With
`--reversal` it has an effect that the model lacks, for `thermap analyse` to find.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any, Final, TypeAlias

import numpy as np
import typer

from app.cli.asking import ThermapClient, asks
from app.cli.check_files import look_at_visits
from app.cli.options import (
    LabelOption,
    MachineArgument,
    MissingOption,
    Named,
    SeedOption,
    label_of,
    named_option,
    time_option,
    write_file,
)
from app.cli.terminal import echo
from app.effects.observations import Observation, Verification
from app.errors import ThermapError, UnknownComponent, counted, list_names
from app.files.csv_writing import csv_of_check
from app.geometry.components import COMPONENTS, LINEAR_LETTERS, Component, parse_component
from app.services.observations import MeasuredObservation
from thermap import ThermapClientError

OBSERVATION_EVERY: Final = timedelta(seconds=20)
"""So long an instrument takes from one place to the next."""

READINGS_APART: Final = timedelta(minutes=10)
"""So far apart readings serve for what happens between them."""

_DECIMALS: Final = 4
"""Of what is read in µm: a tenth of a nanometre, as the service writes."""

VISITS_APART: Final = timedelta(hours=2)
"""From the beginning of a visit to that of the next, at least."""

_Range: TypeAlias = tuple[float, float] | None
"""First and last position [mm]; None of a component without argument."""


class NothingToSimulate(ThermapError):
    """The service has not what a simulation needs."""


@asks
def simulate_verification(
    thermap: ThermapClient,
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
        Named | None,
        named_option(
            "a reversal value in µm",
            "A reversal value that the model lacks, in the component's unit: half of it with "
            "the sign of the approach.",
            metavar="NAME=UM",
            envvar="THERMAP_REVERSALS",
        ),
    ] = None,
    seed: SeedOption = 0,
    label: LabelOption = None,
    missing_as_zero: MissingOption = False,
) -> None:
    """Write what would be measured on a stored machine that is as its model says, with noise.

    At the times of its stored readings, or as `--plan` has them. With `--reversal` the
    machine has an effect that its model lacks: `thermap analyse` should find it.

    Example: `thermap simulate verification vmc --reversal EXX=4 -o night.csv`
    """
    named = label_of(output, label)
    reversals = _of_components(reversal or {})
    planned = (
        _default_plan(thermap, machine, visits, positions, component, (since, until))
        if plan is None
        else look_at_visits(thermap, machine, [plan])[0].planned.to_verification()
    )
    rng = np.random.default_rng(seed)
    made: list[Observation] = []
    version = 0
    by_setup: dict[str | None, list[Observation]] = {}
    for observation in sorted(planned.observations, key=attrgetter("time_s")):
        by_setup.setdefault(observation.setup, []).append(observation)
    for visit in by_setup.values():
        answer = thermap.predict(
            machine,
            list(map(_question, visit)),
            missing_components="zero" if missing_as_zero else "refuse",
        )
        version = answer.model_version
        for observation, predicted in zip(visit, answer.predicted_um, strict=True):
            if predicted is None:
                continue
            values = np.atleast_1d(np.asarray(predicted, dtype=float))
            values = values + rng.normal(0.0, noise, values.size) if noise else values
            values = (values + _reversed_by(observation, reversals)).round(_DECIMALS)
            made.append(replace(observation, measured=tuple(values.tolist())))
    if not made:
        raise NothingToSimulate(
            f"the model says nothing of machine {machine!r} at these times: there are no "
            "readings around them, or no two error maps"
        )
    simulated = Verification(
        named, made, planned.datum, repeatability_um=noise or None, instrument="simulation"
    )
    notes = (
        f"Simulated from model version {version}, for training, not measured",
        f"Simulated with {_disturbances(noise, seed, reversals)}",
    )
    write_file(output, csv_of_check(machine, simulated, notes))
    if left_out := len(planned.observations) - len(made):
        echo(
            f"note: {counted(left_out, 'observation')} left out: there is no reading around its "
            "time, or no two maps have the component",
            err=True,
        )
    content = f"{counted(len(made), 'observation')} in {counted(len(by_setup), 'visit')}"
    echo(f"{output}: {content}, simulated")


def _question(observation: Observation) -> dict[str, Any]:
    """Write where and when, without what a prediction is not asked."""
    time = datetime.fromtimestamp(observation.time_s, UTC)
    stated = MeasuredObservation.of(observation, time)
    return {
        name: value
        for name, value in stated.items()
        if name != "setup" and not name.startswith("measured")
    }


def _of_components(reversal: Mapping[str, float]) -> dict[str, float]:
    """Index reversal values by the components' codes."""
    reversals = {}
    for name, value in reversal.items():
        component = _parsed(name, "--reversal")
        if not component.is_table:
            raise typer.BadParameter(
                f"{component.code} has no direction of approach", param_hint="--reversal"
            )
        reversals[component.code] = value
    return reversals


def _parsed(name: str, option: str) -> Component:
    try:
        return parse_component(name)[0]
    except UnknownComponent as error:
        raise typer.BadParameter(error.detail, param_hint=option) from None


def _default_plan(
    thermap: ThermapClient,
    machine: str,
    visits: int,
    positions: int,
    components: Sequence[str] | None,
    span: tuple[datetime | None, datetime | None],
) -> Verification:
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
    planned: list[Observation] = []
    for i, start in enumerate(starts):
        # The maps in use can change while a visit lasts, so they are asked for at both its ends.
        end = start + every * count
        around = thermap.readings(machine, start, end + READINGS_APART)
        after = next((one for one in around if one.time >= end), around[-1])
        here = ranges
        for reading in (around[0], after):
            here = here | _ranges_of_table(thermap, machine, reading.temperatures_c, here)
        planned += _visit(start, _places(here, positions), i, every)
    return Verification("planned", planned, is_planned=True)


def _ranges_of_maps(
    thermap: ThermapClient, machine: str, components: Sequence[str] | None
) -> dict[str, _Range]:
    """List the components, and from where to where any map of the active model has them."""
    wanted = {_parsed(name, "--component").code for name in components or ()}
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
        way = 1 if (i + number) % 2 else -1
        along = COMPONENTS[code].axis if position is not None else None
        x, y, z = (way if axis == along else 0 for axis in LINEAR_LETTERS)
        yield Observation(
            (start + i * every).timestamp(),
            (0.0,),
            code,
            None if position is None else round(position, 3),
            directions=(x, y, z),
            setup=f"visit {number + 1}",
        )


def _reversed_by(observation: Observation, reversals: Mapping[str, float]) -> float:
    """Give half a component's reversal value with the sign of the approach."""
    return 0.5 * sum(observation.directions) * reversals.get(observation.component or "", 0.0)


def _disturbances(noise: float, seed: int, reversals: Mapping[str, float]) -> str:
    parts = [f"noise of {noise:g} µm, µrad or µm/m (seed {seed})" if noise else "no noise"]
    parts += [f"a reversal of {value:g} in {code}" for code, value in reversals.items()]
    return ", ".join(parts)
