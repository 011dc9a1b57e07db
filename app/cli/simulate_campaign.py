"""thermap simulate campaign: a machine with an effect that nobody declared, as files or stored.

The simulator shares no code with the search, so what it plants is a fair question.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from app.cli.options import UrlOption, connect, expect_finite
from app.cli.terminal import echo
from app.errors import counted, list_names
from app.simulation.undeclared import FAMILIES, UNKNOWN, Campaign, make_campaign, make_record
from app.simulation.undeclared.files import campaign_files
from thermap import DEFAULT_URL

if TYPE_CHECKING:
    from thermap import ThermapClient

MISTAKES: Final = (
    *("exchanged-sensors", "map-factor", "map-temperature", "clock-offset", "mirrored-axis"),
    *("late-sensor", "ageing-sensor", "detached-sensor", "tool-length", "wrong-map"),
)
"""People's and instruments': made once, whatever they touch."""

NONE, DRAWN = "none", "unknown"

READINGS_AT_ONCE: Final = 10_000
"""As the service takes them."""

Body = Mapping[str, Any]


def simulate_campaign(
    context: typer.Context,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FOLDER",
            help=(
                "Folder for the files that `thermap import` and `thermap analyse` read, and for "
                "truth.json."
            ),
        ),
    ] = None,
    store: Annotated[
        bool,
        typer.Option(
            "--store", help="Store machine, maps, readings and verifications in the service."
        ),
    ] = False,
    effect: Annotated[
        list[str] | None,
        typer.Option(
            envvar="THERMAP_EFFECTS",
            metavar="EFFECT",
            help=(
                "Effect to plant; repeat for several, and repeat one to plant it on another "
                "component or sensor too: none (alone); unknown (one that no kind of the search "
                f"describes, drawn with the seed); {', '.join(FAMILIES)}; "
                f"{', '.join(UNKNOWN)}. A variant may follow, as in backlash:along-axis."
            ),
        ),
    ] = None,
    size: Annotated[
        float,
        typer.Option(
            min=0.0, help="Standard deviation of the effect, in multiples of the repeatability."
        ),
    ] = 3.0,
    seed: Annotated[
        int,
        typer.Option(min=0, help=("The same seed gives the same campaign.")),
    ] = 1,
    machine: Annotated[
        str | None,
        typer.Option("--machine", "-m", help=("The machine's id; made from the seed if left out.")),
    ] = None,
    visits: Annotated[
        int,
        typer.Option(min=4, max=1000, help=("Number of visits, each a verification.")),
    ] = 30,
    record: Annotated[
        float | None,
        typer.Option(
            metavar="HOURS",
            min=0.1,
            max=1000.0,
            help="One continuous record with one set-up instead of visits.",
        ),
    ] = None,
    every: Annotated[
        float,
        typer.Option(metavar="MIN", help=("Time from one block of a record to the next.")),
    ] = 20.0,
    observations: Annotated[
        int,
        typer.Option(min=1, max=1000, help="Observations in a visit or a block, 20 s apart."),
    ] = 24,
    split: Annotated[
        float | None,
        typer.Option(
            metavar="MIN",
            min=1.0,
            help="Split the same values into one verification for every so many minutes.",
        ),
    ] = None,
    later: Annotated[
        int,
        typer.Option(min=0, max=200, help="Later visits, which appear in truth.json only."),
    ] = 10,
    repeatability: Annotated[float, typer.Option(metavar="UM", min=0.0)] = 1.0,
    heavy_tails: Annotated[
        bool,
        typer.Option(
            "--heavy-tails",
            help="Student's t with three degrees of freedom instead of normal scatter.",
        ),
    ] = False,
    resolution: Annotated[
        float,
        typer.Option(metavar="UM", min=0.0, help=("Values are rounded to multiples of it.")),
    ] = 0.0,
    wander: Annotated[
        float,
        typer.Option(
            metavar="UM", min=0.0, help="Standard deviation of a shift that wanders in time."
        ),
    ] = 0.0,
    wander_tilt: Annotated[
        float,
        typer.Option(metavar="UM", min=0.0, help=("The same of a tilt, at the ends of travel.")),
    ] = 0.0,
    wander_time: Annotated[
        float,
        typer.Option(metavar="MIN", min=0.1, help=("Correlation time of shift and tilt.")),
    ] = 60.0,
    instrument_drift: Annotated[
        float,
        typer.Option(
            metavar="UM",
            min=0.0,
            help="Drift of the instrument per hour, from the start of each set-up.",
        ),
    ] = 0.0,
    warm_up: Annotated[
        float,
        typer.Option(
            metavar="UM", min=0.0, help="Warm-up of the instrument, alike in every set-up."
        ),
    ] = 0.0,
    setup_correlation: Annotated[
        float,
        typer.Option(min=0.0, max=0.99, help="Correlation of each set-up with the one before."),
    ] = 0.0,
    url: UrlOption = DEFAULT_URL,
) -> None:
    """Make a machine with an undeclared effect: maps, readings, verifications, and the truth.

    Scatter is stated in each component's own unit (µm, µrad, µm/m). truth.json says what was
    planted and what is true at later times; its `asked` is what to ask predictions for.

    Example: `thermap simulate campaign --effect thermal-lag --seed 3 -o lagging`

    Example: `thermap simulate campaign --record 30 --wander 1 --effect backlash -o record`
    """
    expect_finite(context.params)
    _expect_once(effect or ())
    if output is None and not store:
        raise typer.BadParameter("expected a folder, or --store, got neither", param_hint="-o")
    if output is not None and output.exists() and (output.is_file() or any(output.iterdir())):
        raise typer.BadParameter(
            f"expected a folder that is new or empty, got {str(output)!r}", param_hint="-o"
        )
    conditions = {
        "observations_per_visit": observations,
        "later_visits": later,
        "repeatability_um": repeatability,
        "heavy_tails": heavy_tails,
        "measured_quantum_um": resolution,
        "wander_um": wander,
        "wander_tilt_um": wander_tilt,
        "wander_min": wander_time,
        "instrument_drift_um_per_h": instrument_drift,
        "warm_up_um": warm_up,
        "setup_correlation": setup_correlation,
    }
    campaign = _simulated(seed, effect or [NONE], size, visits, record, every, conditions)
    name = machine or campaign.machine["id"]
    described = {**campaign.machine, "id": name}
    verifications = (
        campaign.verifications if split is None else campaign.as_many_verifications(split)
    )
    if output is not None:
        _write(campaign, output, described, verifications)
    if store:
        with connect(url) as thermap:
            thermap.create_machine(described)
            store_maps(thermap, name, campaign.error_maps)
            store_measured(thermap, name, campaign.readings, verifications)
    readings = counted(len(campaign.readings), "reading")
    content = f"{readings}, {counted(len(verifications), 'verification')}"
    echo(f"machine {name!r}: {content}, simulated with seed {seed}")
    if output is not None:
        _say_what_next(output, name, stored=store)


def _expect_once(effects: Sequence[str]) -> None:
    """Refuse nothing beside something, and the same mistake or unknown twice.

    An effect of the machine is planted again on what the first one left; a mistake would undo or
    enlarge the first.
    """
    kinds = [name.partition(":")[0] for name in effects]
    if NONE in kinds and len(kinds) > 1:
        others = [name for name in effects if name != NONE]
        beside = f"{list_names(others)} beside it" if others else "it twice"
        raise typer.BadParameter(f"expected none alone, got {beside}", param_hint="--effect")
    for kind in (*MISTAKES, DRAWN):
        if kinds.count(kind) > 1:
            raise typer.BadParameter(f"expected {kind} once, got it twice", param_hint="--effect")


def _simulated(
    seed: int,
    effects: Sequence[str],
    size: float,
    visits: int,
    record: float | None,
    every: float,
    conditions: dict[str, Any],
) -> Campaign:
    """Simulate, and say as an option's fault what cannot be."""
    planted = [_drawn(seed, effects) if name == DRAWN else name for name in effects if name != NONE]
    try:
        if record is None:
            return make_campaign(seed, planted, size, visits, **conditions)
        conditions["observations"] = conditions.pop("observations_per_visit")
        return make_record(seed, planted, size, record, every, **conditions)
    except ValueError as wrong:
        raise typer.BadParameter(str(wrong)) from None


def _drawn(seed: int, effects: Sequence[str]) -> str:
    """Draw one that is not stated by its name too: from the seed's on, the next that is free."""
    kinds = {name.partition(":")[0] for name in effects}
    drawn = list(UNKNOWN)
    first = seed % len(drawn)
    free = [k for k in (*drawn[first:], *drawn[:first]) if k not in kinds]
    if not free:
        raise typer.BadParameter(
            "expected unknown beside effects that leave one to be drawn, got all of them by name",
            param_hint="--effect",
        )
    return free[0]


def _write(campaign: Campaign, folder: Path, machine: Body, verifications: Sequence[Body]) -> None:
    """Write the bodies of requests, and the truth in a file of its own."""
    files = campaign_files(campaign)
    bodies = {n: body for n, body in files.items() if not n.startswith("verification-")}
    bodies["machine.json"] = machine
    bodies |= {f"verification-{i:03d}.json": body for i, body in enumerate(verifications, start=1)}
    folder.mkdir(parents=True, exist_ok=True)
    for name, body in bodies.items():
        text = json.dumps(body, allow_nan=False, ensure_ascii=False)
        (folder / name).write_text(text + "\n", encoding="utf-8")


def _say_what_next(folder: Path, machine: str, *, stored: bool) -> None:
    echo(f"truth: {folder / 'truth.json'}")
    if not stored:
        stems = ("machine", "error-map-*", "readings-*")
        files = " ".join(str(folder / f"{stem}.json") for stem in stems)
        echo(f"thermap import {files} --machine {machine}")
        echo(f"thermap analyse {machine} $(printf -- '-v %s ' {folder / 'verification-*.json'})")


def store_maps(thermap: ThermapClient, machine: str, error_maps: Sequence[Body]) -> None:
    """Store a simulated machine's maps."""
    for error_map in error_maps:
        thermap.store_error_map(machine, error_map)


def store_measured(
    thermap: ThermapClient, machine: str, readings: Sequence[Body], verifications: Sequence[Body]
) -> list[int]:
    """Store readings and verifications; what is there already stays as it is. Give the numbers."""
    for first in range(0, len(readings), READINGS_AT_ONCE):
        thermap.store_readings(machine, readings[first : first + READINGS_AT_ONCE])
    return [thermap.store_verification(machine, verification).id for verification in verifications]
