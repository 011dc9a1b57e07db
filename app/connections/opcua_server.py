"""thermap as an OPC UA server: each machine's table and verdict, for a PLC to read.

Nothing can be written, called or added by clients, whatever name they sign in with.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from time import monotonic
from typing import Any, Final

from asyncua import Server, ua
from starlette.concurrency import run_in_threadpool

from app.connections.opcua_bounds import bound_server
from app.connections.opcua_certificates import ends_soon, key_pem, now, read_certificate
from app.connections.opcua_nodes import Nodes
from app.connections.opcua_readers import OwnServer, Readers, policies_of
from app.connections.opcua_security import OpcuaServerTable
from app.connections.opcua_values import (
    NO_VALUE,
    NodeValue,
    Snapshot,
    computed_at,
    reading_age,
    seen_of,
    snapshot_of,
    values_of,
)
from app.geometry.components import Component
from app.live.registry import LiveMachine
from app.services.context import Context
from app.services.status import Stored, stored_of_machines
from app.supervision import keep_running

log = logging.getLogger("thermap")

# They log each refused request, with tracebacks of what nobody can read: as many as anybody sends.
for _name in ("uaprocessor", "binary_server_asyncio"):
    logging.getLogger(f"asyncua.server.{_name}").setLevel(logging.CRITICAL)

NAMESPACE: Final = "urn:thermap:machines"
"""Of all nodes; clients find its index by it."""

LOOK_EVERY_S: Final = 0.5
"""How often machines are looked at [s]: a reading is in a PLC's hand that soon."""

JUDGE_EVERY_S: Final = 10.0
"""How often a machine is judged of which nothing has changed [s]: time alone can make a verdict
another one, but not a sensor's health, which is looked at each time."""

ASK_EVERY_S: Final = 2.0
"""How often the database is asked for watches and analyses [s]."""

_BROKEN: Final = ua.StatusCodes.BadInternalError


@dataclass(slots=True)
class _Machine:
    """A machine's nodes, and what they say now."""

    object: ua.NodeId
    layout: tuple[Any, ...]
    objects: dict[str, ua.NodeId] = field(default_factory=dict)
    nodes: dict[str, ua.NodeId] = field(default_factory=dict)
    said: dict[str, NodeValue] = field(default_factory=dict)
    seen: tuple[Any, ...] | None = None
    judged_at_s: float = 0.0

    def nothing(self, path: str, code: int = NO_VALUE) -> NodeValue:
        """Say that a node has no value."""
        last = self.said[path]
        return NodeValue(last.kind, None, code, last.is_array)


class TableServer:
    """The server; `run` serves until it is cancelled, or something is the matter."""

    def __init__(
        self,
        context: Callable[[], Context],
        endpoint: str,
        security: OpcuaServerTable | None = None,
    ) -> None:
        self._context = context
        self._endpoint = endpoint
        self._security = security
        self._machines: dict[str, _Machine] = {}
        self._stored = Stored()
        self.is_listening = False
        self.trouble = ""

    async def run(self) -> None:
        """Serve; what ends it is raised, as where the port is taken."""
        server = await self._made()
        self._machines = {}
        nodes = Nodes(server, await server.register_namespace(NAMESPACE))
        await nodes.begin("Machines")
        await self._look(server, nodes)
        asking = asyncio.create_task(keep_running("OPC UA server: watches and analyses", self._ask))
        try:
            async with server:
                self.is_listening, self.trouble = True, ""
                while True:
                    await asyncio.sleep(LOOK_EVERY_S)
                    await self._look(server, nodes)
        finally:
            self.is_listening = False
            asking.cancel()

    async def _made(self) -> Server:
        """Make the server, with what it offers to whom."""
        security = self._security
        server = Server(OwnServer(Readers(security)))  # type: ignore[arg-type]
        await server.init()
        bound_server(server)
        server.set_endpoint(self._endpoint)
        server.set_server_name("thermap")
        uri: str | None = None
        if security is not None:
            certificate = read_certificate(security.certificate)
            uri = certificate.application_uri
            await server.load_certificate(certificate.der, "der")
            await server.load_private_key(key_pem(security.private_key), format="pem")
            if trouble := certificate.trouble(now()) or ends_soon(certificate):
                log.warning("OPC UA server: %s: %s", security.certificate, trouble)
        await server.set_application_uri(uri or "urn:thermap:server")
        server.set_security_policy(policies_of(security))
        has_users = security is not None and bool(security.users)
        server.set_identity_tokens(
            [ua.UserNameIdentityToken if has_users else ua.AnonymousIdentityToken]
        )
        return server

    def ended(self, words: str) -> None:
        """Take note of why nothing is served."""
        if self.trouble != (trouble := f"cannot serve at {self._endpoint}: {words}"):
            log.warning("OPC UA server: %s; it tries again", trouble)
        self.trouble = trouble

    async def _ask(self) -> None:
        """Ask the database beside the rest: while it hangs, tables go on."""
        while True:
            self._stored = await run_in_threadpool(stored_of_machines, self._context())
            await asyncio.sleep(ASK_EVERY_S)

    async def _look(self, server: Server, nodes: Nodes) -> None:
        """Bring all nodes up to date; what goes wrong with a machine leaves it without values."""
        context = self._context()
        there = {live.current.model.machine.id: live for live in context.live.machines()}
        for gone in self._machines.keys() - there.keys():
            _remove(nodes, self._machines.pop(gone))
        for machine_id, live in there.items():
            try:
                await self._tell(server, nodes, machine_id, live)
            except Exception:
                log.exception("OPC UA server: could not tell of machine %r", machine_id)
                await self._break(server, machine_id, context.now())
            await asyncio.sleep(0)

    async def _tell(self, server: Server, nodes: Nodes, machine_id: str, live: LiveMachine) -> None:
        context = self._context()
        machine = self._machines.get(machine_id)
        # Before the verdict: what changes meanwhile is seen as changed the next time.
        seen, age_s = seen_of(context, live, self._stored)
        is_new = machine is None or machine.seen != seen
        if machine is not None and not is_new and monotonic() - machine.judged_at_s < JUDGE_EVERY_S:
            await self._tell_time(server, machine, age_s, context.now())
            return
        snapshot = snapshot_of(context, live, self._stored)
        values, now = dict(values_of(snapshot)), snapshot.status.computed_at
        layout = _layout(live, snapshot)
        if machine is None or machine.layout != layout:
            if machine is not None:
                _remove(nodes, self._machines.pop(machine_id))
            machine = await _add(nodes, machine_id, layout, values, now)
            self._machines[machine_id] = machine
        else:
            for path in machine.nodes:
                if not path.endswith(_FIXED):
                    # A component that the table does not have keeps its nodes, without a value.
                    value = values.get(path) or machine.nothing(path)
                    await _write(server, machine, path, value, now)
        machine.seen, machine.judged_at_s = seen, monotonic()

    async def _tell_time(
        self, server: Server, machine: _Machine, age_s: float | None, now: datetime
    ) -> None:
        """Say that all is as it was, and how old that is."""
        await _write(server, machine, "ComputedAt", computed_at(now), now)
        await _write(server, machine, "ReadingAge", reading_age(age_s), now)

    async def _break(self, server: Server, machine_id: str, now: datetime) -> None:
        machine = self._machines.get(machine_id)
        if machine is None:
            return
        machine.seen = None
        for path in machine.nodes:
            if not path.endswith(_FIXED):
                await _write(server, machine, path, machine.nothing(path, _BROKEN), now)


async def _add(
    nodes: Nodes,
    machine_id: str,
    layout: tuple[Any, ...],
    values: Mapping[str, NodeValue],
    now: datetime,
) -> _Machine:
    """Make a machine's nodes, all or none, with what they say."""
    top = await nodes.add(machine_id, machine_id, now=now)
    machine = _Machine(top, layout)
    try:
        await _furnish(nodes, machine, machine_id, values, now)
    except BaseException:
        _remove(nodes, machine)
        raise
    return machine


async def _furnish(
    nodes: Nodes, machine: _Machine, machine_id: str, values: Mapping[str, NodeValue], now: datetime
) -> None:
    for path, nothing in _nodes_of(machine.layout):
        above, names = machine.object, path.split("/")
        for depth, name in enumerate(names[:-1], 1):
            folder = "/".join(names[:depth])
            if folder not in machine.objects:
                machine.objects[folder] = await nodes.add(
                    f"{machine_id}/{folder}", name, above, now=now
                )
            above = machine.objects[folder]
        value = machine.said[path] = values.get(path, nothing)
        machine.nodes[path] = await nodes.add(
            f"{machine_id}/{path}", names[-1], above, value, now=now
        )


def _remove(nodes: Nodes, machine: _Machine) -> None:
    nodes.remove(machine.object, (*machine.nodes.values(), *machine.objects.values()))


_FIXED: Final = ("/Unit", "/PositionAxis")
"""What a component's nodes say as long as there are any."""


def _layout(live: LiveMachine, snapshot: Snapshot) -> tuple[Any, ...]:
    """Say which nodes a machine has: also those of components that have no values now."""
    model = live.current.model
    components = {
        member.component: member.backward is not None
        for group in model.groups
        for member in group.members
    }
    for entry in snapshot.table.components if snapshot.table is not None else ():
        has_backward = components.get(entry.component, False)
        components[entry.component] = has_backward or entry.backward_errors is not None
    sensors = tuple(sensor.sensor for sensor in snapshot.status.sensors)
    ordered = sorted(components.items(), key=lambda item: item[0].code)
    return tuple(sorted(sensors)), tuple(ordered)


def _nodes_of(layout: tuple[Any, ...]) -> Iterable[tuple[str, NodeValue]]:
    sensors, components = layout
    text, number = ua.VariantType.String, ua.VariantType.Double
    yield "Name", NodeValue(text, None, NO_VALUE)
    yield "Configuration", NodeValue(text, None, NO_VALUE)
    yield "Verdict", NodeValue(text, None, NO_VALUE)
    yield "State", NodeValue(text, None, NO_VALUE)
    yield "Sentences", NodeValue(text, None, NO_VALUE, is_array=True)
    yield "LastCheck", NodeValue(text, None, NO_VALUE)
    yield "Usable", NodeValue(ua.VariantType.Boolean, None, NO_VALUE)
    yield "Complete", NodeValue(ua.VariantType.Boolean, None, NO_VALUE)
    yield "ModelVersion", NodeValue(ua.VariantType.UInt32, None, NO_VALUE)
    yield "ReadingTime", NodeValue(ua.VariantType.DateTime, None, NO_VALUE)
    yield "ReadingAge", NodeValue(number, None, NO_VALUE)
    yield "ComputedAt", NodeValue(ua.VariantType.DateTime, None, NO_VALUE)
    for sensor in sensors:
        yield f"Temperatures/{sensor}", NodeValue(number, None, NO_VALUE)
    for component, has_backward in components:
        yield from _component_nodes(component, has_backward=has_backward)


def _component_nodes(
    component: Component, *, has_backward: bool
) -> Iterable[tuple[str, NodeValue]]:
    above = f"Components/{component.code}"
    text, number = ua.VariantType.String, ua.VariantType.Double
    yield f"{above}/Unit", NodeValue(text, component.unit.symbol)
    yield f"{above}/PositionAxis", NodeValue(text, component.axis if component.is_table else "")
    yield f"{above}/Positions", NodeValue(number, None, NO_VALUE, is_array=True)
    yield f"{above}/Compensation", NodeValue(number, None, NO_VALUE, is_array=True)
    if has_backward:
        yield f"{above}/BackwardCompensation", NodeValue(number, None, NO_VALUE, is_array=True)
    yield f"{above}/Status", NodeValue(text, None, NO_VALUE)


async def _write(
    server: Server, machine: _Machine, path: str, value: NodeValue, now: datetime
) -> None:
    """Say a value where it is another one; the first time in any case."""
    if machine.said.get(path) == value:
        return
    machine.said[path] = value
    await server.write_attribute_value(machine.nodes[path], value.at(now))
