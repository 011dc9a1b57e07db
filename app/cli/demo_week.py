"""The demo's second machine: a week of readings and one undeclared effect, to close the loop on."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Group, RenderableType
from rich.text import Text

from app.cli.console import console
from app.cli.demo_machine import make_sure_of
from app.cli.models import comparison_view
from app.cli.options import connect
from app.cli.simulate_campaign import store_maps, store_measured
from app.cli.terminal import echo
from app.errors import Conflict, ThermapError
from app.simulation.week import ID, Week, make_week
from thermap import DEFAULT_URL, ThermapClient, ThermapClientError, UnknownThingError, loop_calls
from thermap.answers import ModelComparisonAnswer


def week_hint(url: str) -> RenderableType:
    """Say how the loop is closed on the week: three commands."""
    at = "" if url == DEFAULT_URL else f" --url {url}"
    commands = (f"thermap analyse {ID} --adopt -o week.html", "thermap demo --later")
    return Group(
        Text.assemble(
            (f"{ID}: ", "bold"),
            "another simulated machine, with a week of readings and 20 visits (loaded within "
            "seconds), and an effect that its model lacks. In another terminal:",
        ),
        *(Text(f"  {command}{at}", no_wrap=True, overflow="ignore") for command in commands),
    )


@contextmanager
def loading_week(url: str) -> Iterator[None]:
    """Load the week beside what else goes on; it is given up where that ends first."""
    ended = threading.Event()

    def load() -> None:
        try:
            with connect(url) as thermap:
                set_up_week(thermap)
        except (ThermapError, ThermapClientError) as error:
            if not ended.is_set():
                echo(f"{ID} is not there: {error}", err=True)

    thread = threading.Thread(target=load, name="week", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()


def set_up_week(thermap: ThermapClient) -> None:
    """Make sure that the service has the machine and its week; the visits come last, at once.

    Raises
    ------
    Conflict
        If a machine of that id is there that is not the simulated one.
    """
    week = make_week()
    if not make_sure_of(thermap, week.machine) and thermap.verifications(ID):
        return
    store_maps(thermap, ID, week.error_maps)
    store_measured(thermap, ID, week.week.readings, week.week.verifications)


def show_later(url: str) -> None:
    """Store the two days after the week, and hold the model before and after against them.

    Raises
    ------
    Conflict
        If there is no week, or nothing was adopted yet.
    """
    with connect(url) as thermap:
        compared = compare_later(thermap, make_week())
    console().print(comparison_view(compared))


def compare_later(thermap: ThermapClient, week: Week) -> ModelComparisonAnswer:
    """Store what came after the week, and compare the active version with the one before it."""
    try:
        versions = thermap.models(ID)
    except UnknownThingError:
        raise Conflict(f"{thermap.base_url} has no machine {ID!r}: start `thermap demo`") from None
    adopted = [version.version for version in versions if version.effects]
    plain = [version.version for version in versions if not version.effects]
    if not adopted or not plain:
        raise Conflict(f"no effect is adopted yet: `thermap analyse {ID} --adopt` first")
    numbers = store_measured(thermap, ID, week.after.readings, week.after.verifications)
    return thermap.send(loop_calls.compare_models(ID, numbers, [plain[-1], adopted[-1]]))
