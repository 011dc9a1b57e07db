"""The pages on which a machine is made and set up: axes, sensors, maps, what follows which."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import groupby
from typing import Any, Final

from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS
from app.pages.dashboard.numbers import number
from app.pages.environment import render_live, render_machine
from app.pages.reader import day_and_time
from app.pages.wording import _, counted, listed, message
from app.services.dashboard import SetupView
from app.thermal.machine import Machine
from app.thermal.sensor_assignment import Proposal, SensorCorrelation

CONFIGURATIONS: Final = ("XYFZ", "FXYZ", "XFYZ", "YFXZ", "XFZY", "ZFXY", "FYXZ", "FZX")
"""Offered where one is typed; a lathe with two axes stands last."""

FIRST_ROWS: Final = [{"name": "", "stand_in": ""}] * 4
"""Rows for sensors of a machine without any; a further row is a copy of the last."""

USUAL_CONFIGURATION: Final = "XYFZ"


@dataclass(frozen=True, slots=True)
class Step:
    """A step of the set-up: whether it is done, and what it has or what it needs."""

    title: str
    is_done: bool
    words: str


@dataclass(frozen=True, slots=True)
class Source:
    """A connection beside HTTP that brings readings of the machine, and how it fares."""

    name: str
    is_connected: bool
    trouble: str


def new_machine_page(now: datetime) -> str:
    """Write the page on which a machine is made."""
    return render_live(
        "dashboard/new_machine.html",
        page="new",
        stream="/v1/stream",
        now=now,
        form={
            "id": "",
            "name": "",
            "serial_number": "",
            "configuration": USUAL_CONFIGURATION,
            "travels": {},
            "sensors": FIRST_ROWS,
        },
        links=links_of(Chain.parse(USUAL_CONFIGURATION)),
        configurations=CONFIGURATIONS,
    )


def setup_page(
    view: SetupView, sources: Sequence[Source], now: datetime, methods: Mapping[str, str]
) -> str:
    """Write the page of a machine's set-up."""
    machine = view.machine
    steps = list(_steps(view))
    return render_machine(
        "setup",
        "/setup",
        machine.id,
        machine.name,
        now,
        view=view,
        steps=steps,
        next_step=next((i for i, step in enumerate(steps) if not step.is_done), None),
        form=_form(machine),
        links=links_of(machine.chain),
        configurations=CONFIGURATIONS,
        sensors=list(machine.sensors),
        groups=list(_groups(view)),
        differing=[
            one.code
            for one in view.proposals
            if one.proposed_sensor not in (None, one.current_sensor)
        ],
        reading=json.dumps({"temperatures_c": dict.fromkeys(machine.sensors, 20.0)}),
        lines=list(_lines(machine)),
        sources=sources,
        methods=methods,
    )


def links_of(chain: Chain) -> list[str]:
    """Name what stands between workpiece and tool, in the order of the machine.

    >>> links_of(Chain.parse("XYFZ"))
    ['workpiece', 'Y', 'X', 'bed', 'Z', 'tool']
    """
    carried = [axis.upper() for axis in reversed(chain.workpiece)]
    tool = (axis.upper() for axis in chain.tool)
    return [message("workpiece"), *carried, message("bed"), *tool, message("tool")]


def _form(machine: Machine) -> dict[str, Any]:
    return {
        "id": machine.id,
        "name": machine.name,
        "serial_number": machine.serial_number or "",
        "configuration": machine.chain.text,
        "travels": {axis: (t.min_mm, t.max_mm) for axis, t in machine.axes.items()},
        "sensors": [
            {"name": sensor.name, "stand_in": sensor.stand_in or ""}
            for sensor in machine.sensors.values()
        ]
        or FIRST_ROWS,
    }


def _steps(view: SetupView) -> Iterator[Step]:
    machine, maps = view.machine, view.version.maps if view.version else []
    sensors = counted(len(machine.sensors), "%(count)s sensor", "%(count)s sensors")
    yield Step(_("Machine"), bool(machine.sensors), f"{machine.chain.text}, {sensors}")
    states = "" if len(maps) > 1 else _("; a table needs maps of two thermal states")
    stored = counted(len(maps), "%(count)s map", "%(count)s maps")
    yield Step(_("Maps"), len(maps) > 1, stored + states)
    without = [p.code for p in view.proposals if p.current_sensor is None]
    follow = (
        _("%(codes)s follow no sensor", codes=listed(without, 6))
        if without
        else _("every component has one")
    )
    yield Step(_("Sensors"), bool(maps) and not without, follow if maps else _("after the maps"))
    at = view.status.reading_time
    arrived = _("none has come yet") if at is None else _("latest %(time)s", time=day_and_time(at))
    yield Step(_("Readings"), at is not None, arrived)


def _groups(view: SetupView) -> Iterator[dict[str, Any]]:
    """Group the components of the maps by their axis, each with what it may follow."""
    for axis, group in groupby(view.proposals, lambda p: COMPONENTS[p.code].axis):
        title = _("%(axis)s axis", axis=axis.upper()) if axis else _("Squareness and location")
        yield {"title": title, "rows": [_row(proposal) for proposal in group]}


def _row(proposal: Proposal) -> dict[str, Any]:
    return {
        "code": proposal.code,
        "current": proposal.current_sensor or "",
        "proposed": proposal.proposed_sensor or "",
        "reason": proposal.reason,
        "cells": [_cell(one, proposal) for one in proposal.correlations],
    }


def _cell(one: SensorCorrelation, proposal: Proposal) -> dict[str, Any]:
    low_high = None if one.r_low is None or one.r_high is None else (one.r_low, one.r_high)
    interval = "" if low_high is None else f", 95 % {low_high[0]:+.2f} to {low_high[1]:+.2f}"
    maps = counted(one.maps, "%(count)s map", "%(count)s maps")
    return {
        "sensor": one.sensor,
        "is_current": one.sensor == proposal.current_sensor,
        "is_proposed": one.sensor == proposal.proposed_sensor,
        "ties": one.ties_with_best,
        "r": "–" if one.r is None else number(one.r),
        "title": one.reason or f"r {one.r:+.3f}{interval}, {maps}",
    }


def _lines(machine: Machine) -> Iterator[tuple[str, str]]:
    """Write for each way in, but HTTP, its title and the lines for the service's file."""
    sensors = list(machine.sensors)
    broker = '[[mqtt]]\nname = "shop broker"\nhost = "192.168.10.5"\nclient_id = "thermap-1"\n'
    topics = "\n".join(
        f"[[mqtt.topics]]\ntopic = {_quoted(f'shop/{machine.id}/{name}')}\n"
        f"machine = {_quoted(machine.id)}\nsensor = {_quoted(name)}\n"
        for name in sensors
    )
    yield "MQTT", f"{broker}\n{topics}"
    nodes = "\n".join(f'{_quoted(name)} = "ns=2;s={_node(name)}"' for name in sensors)
    yield (
        "OPC UA",
        f'[[opcua]]\nname = "control of {machine.id}"\nmachine = {_quoted(machine.id)}\n'
        f'endpoint = "opc.tcp://192.168.10.30:4840"\n\n[opcua.sensors]\n{nodes}\n',
    )
    items = "\n".join(f'{_quoted(name)} = "{_node(name)}"' for name in sensors)
    yield (
        "MTConnect",
        f'[[mtconnect]]\nname = "agent of {machine.id}"\nmachine = {_quoted(machine.id)}\n'
        f'url = "http://192.168.10.20:5000/{machine.id}"\n\n[mtconnect.sensors]\n{items}\n',
    )


def _quoted(text: str) -> str:
    """Write a text as TOML does, which is JSON's way too."""
    return json.dumps(text)


def _node(name: str) -> str:
    return name.replace(" ", "_")
