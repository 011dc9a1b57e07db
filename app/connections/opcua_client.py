"""Follow an OPC UA server for as long as it is told to, through restarts, silence and nonsense.

Subscriptions die unnoticed: the server forgets one, or stops looking at a node; the library stops
asking for what is published; and what does not change says nothing in any case. So nothing is
believed only because it was not contradicted: every few seconds the nodes are read and compared
with what the subscription told, and only what a reading has just confirmed is told again.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from typing import Final

from asyncua import Client, ua

from app.connections.follower import Followed, Follower, NewValue
from app.connections.opcua_observations import (
    Observed,
    node_of,
    observe,
    source_time,
    stated_unit,
    status_words,
)
from app.connections.opcua_session import (
    ANSWER_S,
    MOST_NODES,
    Access,
    find_units,
    read_nodes,
    session_with,
    why_refused,
    words_of_failure,
)
from app.errors import ThermapError

log = logging.getLogger("thermap")

LOOK_EVERY_S: Final = 5.0
"""How often the nodes are read and compared with what the subscription told [s]."""

KEEP_ALIVE_S: Final = 5.0
"""After so long without a change a server is to say that the subscription lives [s]."""

LIFETIME_S: Final = 60.0
"""After so long without a sign of the client a server may forget the subscription [s]."""

CLOCK_TOLERANCE_S: Final = 5.0
"""A server's clock that differs by more says nothing about when a value was measured [s]."""

STILL_S: Final = 12.0
"""A server whose own time stands still for so long does nothing any more [s]."""


# A follower's life, again and again (`keep_running`):
#
#    open a session ─> find nodes and units ─> subscribe ─> look, every LOOK_EVERY_S
#          ^                                                 │
#          └─────────── SubscriptionDied, ContactLost ───────┤ ended by the server, contact lost
#                                                            │ nothing published for `_silence_s`
#                                                            │ its clock stands still for STILL_S
#                                                            │ a node is there that was unknown
#                                                            │ a node differs for `_patience_s`
#
# And what is believed of one node, each time that all are read:
#
#             read as it was told
#    told ────────────────────────────> confirmed: handed on again after `repeated_s`
#     │ ^  read as it was told
#     v │
#    doubted ── for `_patience_s` ────> SubscriptionDied
#     ^ │ told something meanwhile: the doubt begins anew
#     └─┘
class ContactLost(ThermapError):
    """There is no contact with the server; the sentence says why."""


class SubscriptionDied(ContactLost):
    """The subscription is not to be relied on any more."""

    def __init__(self, why: str) -> None:
        super().__init__(f"the subscription died, a new one is made: {why}")


class ServerFollower(Follower):
    """Follows the nodes of one server.

    Parameters
    ----------
    publishing_s
        How often the server is to say what has changed [s].
    repeated_s
        What has not changed is handed on again after so long, if it holds [s].
    """

    sender = "server"

    def __init__(
        self,
        access: Access,
        followed: Mapping[str, Followed],
        take: Callable[[Sequence[NewValue]], None],
        now: Callable[[], datetime],
        *,
        publishing_s: float,
        repeated_s: float,
    ) -> None:
        super().__init__(f"OPC UA {access.endpoint}", followed, take)
        self._access = access
        self._now = now
        self._publishing_s = publishing_s
        self._repeated_s = repeated_s
        self.died = 0
        """Subscriptions that were given up because they told too little."""
        self._forget()

    def _forget(self) -> None:
        """Begin anew: of another subscription nothing holds."""
        self._nodes: dict[str, ua.NodeId] = {}
        self._names: dict[int, str] = {}
        self._units = {}
        self._refused: dict[str, int] = {}
        self._told: dict[str, Observed] = {}
        self._times_told: dict[str, int] = {}
        self._doubted: dict[str, tuple[int, float]] = {}
        self._handed_on_at: dict[str, float] = {}
        self._server_time: datetime | None = None
        self._moved_at = 0.0
        self._is_clock_right = True
        self._patience_s = self._publishing_s
        self._silence_s = LIFETIME_S
        self._heard_at = 0.0
        self._ended = asyncio.Event()
        self._end_words = ""

    async def _follow(self) -> None:
        try:
            await self._subscribe_and_watch()
        except SubscriptionDied:
            self.died += 1
            raise
        except (ua.UaError, OSError, TimeoutError) as why:
            words = words_of_failure(why)
            if not self.is_connected:
                words = await why_refused(self._access, why)
            raise ContactLost(words) from None

    async def _subscribe_and_watch(self) -> None:
        self._forget()
        async with session_with(self._access, self._lost) as client:
            self._trouble.forget()
            await self._find(client)
            await self._subscribe(client)
            self.is_connected = True
            await self._watch(client)

    async def _find(self, client: Client) -> None:
        """Find the nodes and their units; what there is not is said, the others are followed."""
        namespaces = await client.get_namespace_array()
        for name, wanted in self._followed.items():
            node = node_of(wanted.source, namespaces)
            if isinstance(node, str):
                self._trouble.say_of(name, node)
            else:
                self._nodes[name] = node
        names = [name for name in self._nodes if self._followed[name].temperature is not None]
        units_found = await find_units(client, [self._nodes[name] for name in names])
        for name, units in zip(names, units_found, strict=True):
            if not self._choose_unit(name, stated_unit(units)):
                del self._nodes[name]

    async def _subscribe(self, client: Client) -> None:
        session = client.uaclient.session
        parameters = ua.CreateSubscriptionParameters()
        parameters.RequestedPublishingInterval = 1000.0 * self._publishing_s
        parameters.RequestedMaxKeepAliveCount = max(1, round(KEEP_ALIVE_S / self._publishing_s))
        # At least three times the keep-alive, which is what the standard asks for.
        parameters.RequestedLifetimeCount = max(
            3 * parameters.RequestedMaxKeepAliveCount, round(LIFETIME_S / self._publishing_s)
        )
        self._heard_at = _clock()
        subscription = await session.create_subscription(parameters, self._published)
        interval_s = subscription.RevisedPublishingInterval / 1000.0
        # By what the server has made of what was asked for, which may be much slower. One sign of
        # life may be missing.
        self._silence_s = 2.0 * interval_s * subscription.RevisedMaxKeepAliveCount + ANSWER_S
        self._patience_s = max(self._publishing_s, interval_s) + 1.0
        names = list(self._nodes)
        self._names = dict(enumerate(names, 1))
        for begin in range(0, len(names), MOST_NODES):
            some = names[begin : begin + MOST_NODES]
            items = [self._item(begin + i, name) for i, name in enumerate(some, 1)]
            results = await session.create_monitored_items(
                ua.CreateMonitoredItemsParameters(
                    SubscriptionId=subscription.SubscriptionId,
                    TimestampsToReturn=ua.TimestampsToReturn.Both,
                    ItemsToCreate=items,
                )
            )
            for name, result in zip(some, results, strict=True):
                self._note_item(name, result)

    def _item(self, handle: int, name: str) -> ua.MonitoredItemCreateRequest:
        """Ask for the newest value at each time of publishing; older ones are of no use."""
        return ua.MonitoredItemCreateRequest(
            ItemToMonitor=ua.ReadValueId(
                NodeId=self._nodes[name], AttributeId=ua.AttributeIds.Value
            ),
            MonitoringMode=ua.MonitoringMode.Reporting,
            RequestedParameters=ua.MonitoringParameters(
                ClientHandle=ua.UInt32(handle),
                SamplingInterval=1000.0 * self._publishing_s,
                QueueSize=ua.UInt32(1),
                DiscardOldest=True,
            ),
        )

    def _note_item(self, name: str, result: ua.MonitoredItemCreateResult) -> None:
        if not result.StatusCode.is_good():
            self._refused[name] = result.StatusCode.value
            self._trouble.say_of(
                name,
                f"expected a node that can be followed, got {status_words(result.StatusCode)} for "
                f"{self._followed[name].source}",
            )
            return
        # A change is sampled, then published: until it could have been told, to read something else
        # is no contradiction.
        slowest_s = max(0.0, result.RevisedSamplingInterval / 1000.0) + self._publishing_s + 1.0
        self._patience_s = max(self._patience_s, slowest_s)

    def _published(self, result: ua.PublishResult) -> None:
        """Take what the server publishes; without anything in it, it says that it lives."""
        try:
            self._heard_at = _clock()
            for notification in result.NotificationMessage.NotificationData or ():
                if isinstance(notification, ua.DataChangeNotification):
                    self._take_changes(notification.MonitoredItems)
                elif isinstance(notification, ua.StatusChangeNotification):
                    self._end(f"the server ended it: {status_words(notification.Status)}")
        except Exception:  # the library would only log it, where nobody looks
            log.exception("OPC UA: could not take what %s published", self._access.endpoint)

    def _take_changes(self, items: Sequence[ua.MonitoredItemNotification]) -> None:
        new_values: list[NewValue] = []
        for item in items:
            name = self._names.get(item.ClientHandle)
            if name is None:
                continue
            # What comes first is what held already: its source may have measured it long ago.
            is_change = name in self._told
            observed = observe(item.Value)
            self._told[name] = observed
            self._times_told[name] = self._times_told.get(name, 0) + 1
            time = source_time(item.Value) if is_change else None
            new_values.append(self._found(name, observed, time))
        self._hand_on(new_values)

    def _found(self, name: str, observed: Observed, time: datetime | None) -> NewValue:
        if observed.value is None:
            self._trouble.say_of(name, observed.words)
            return NewValue(name, None)
        value = self._converted(name, observed.value)
        if time is not None and not self._is_usable(name, time):
            time = None
        return NewValue(name, value, time)

    def _is_usable(self, name: str, time: datetime) -> bool:
        """Whether a source's time may be the reading's; an old one may: it claims less."""
        if not self._is_clock_right:
            return False
        ahead_s = (time - self._now()).total_seconds()
        if ahead_s > CLOCK_TOLERANCE_S:
            self._trouble.say_of(name, f"its source's clock is {ahead_s:.1f} s ahead; not used")
            return False
        return True

    def _hand_on(self, new_values: Sequence[NewValue]) -> None:
        """Hand on what belongs together as of one time, the latest: nothing came before it was."""
        if not new_values:
            return
        at = _clock()
        for new_value in new_values:
            self._handed_on_at[new_value.name] = at
        times = [one.time for one in new_values if one.time is not None]
        if times:
            latest = max(times)
            together = latest - timedelta(seconds=self._publishing_s)
            new_values = [
                NewValue(one.name, one.value, latest)
                if one.time is not None and one.time >= together
                else one
                for one in new_values
            ]
        self._take(new_values)

    async def _watch(self, client: Client) -> None:
        """Compare what is with what was told, until they differ for too long."""
        while True:
            await self._look(client)
            try:
                async with asyncio.timeout(LOOK_EVERY_S):
                    await self._ended.wait()
            except TimeoutError:
                continue
            raise SubscriptionDied(self._end_words)

    async def _look(self, client: Client) -> None:
        names = list(self._nodes)
        nodes = [_STATE, _TIME, *(self._nodes[name] for name in names)]
        state, time, *data_values = await read_nodes(client, nodes)
        self._judge_server(state, time)
        silent_s = _clock() - self._heard_at
        if silent_s > self._silence_s:
            raise SubscriptionDied(f"nothing was published for {silent_s:.0f} s")
        confirmed = []
        for name, data_value in zip(names, data_values, strict=True):
            if name in self._refused:
                self._look_at_refused(name, data_value)
            elif self._holds(name, observe(data_value)):
                confirmed.append(name)
        self._repeat(confirmed)

    def _judge_server(self, state: ua.DataValue, time: ua.DataValue) -> None:
        """Say what the server says of itself; a server whose time stands still does nothing."""
        words = ""
        code = state.Value.Value if state.Value is not None else None
        if isinstance(code, int) and code != ua.ServerState.Running:
            words = f"expected a running server, got the state {_state_name(code)}"
        server_time = time.Value.Value if time.Value is not None else None
        if isinstance(server_time, datetime):
            ahead_s = (_aware(server_time) - self._now()).total_seconds()
            self._is_clock_right = abs(ahead_s) <= CLOCK_TOLERANCE_S + ANSWER_S / 2.0
            if not self._is_clock_right:
                where = "ahead of" if ahead_s > 0 else "behind"
                words = words or (
                    f"the server's clock is {abs(ahead_s):.0f} s {where} the service's: its times "
                    "are not used"
                )
            if server_time != self._server_time:
                self._server_time, self._moved_at = server_time, _clock()
            elif _clock() - self._moved_at > STILL_S:
                raise SubscriptionDied("the server's time stands still")
        self._trouble.say(words)

    def _look_at_refused(self, name: str, value: ua.DataValue) -> None:
        """Follow a node anew that is there by now; what else was refused stays so."""
        status = value.StatusCode
        was_unknown = self._refused[name] in _NO_NODE
        if was_unknown and (status is None or status.value not in _NO_NODE):
            raise SubscriptionDied(f"the server has the node of {name} now")

    def _holds(self, name: str, observed: Observed) -> bool:
        """Whether what was told is so; where it is not for too long, nobody is told anything."""
        if self._told.get(name) == observed:
            self._doubted.pop(name, None)
            return observed.value is not None
        times, at = self._times_told.get(name, 0), _clock()
        doubted = self._doubted.get(name)
        if doubted is None or doubted[0] != times:
            self._doubted[name] = (times, at)
        elif at - doubted[1] > self._patience_s:
            raise SubscriptionDied(
                f"{name} is {_in_words(observed)} when it is read, and "
                f"{_in_words(self._told.get(name))} "
                f"was told {at - doubted[1]:.0f} s before"
            )
        return False

    def _repeat(self, confirmed: Sequence[str]) -> None:
        """Hand on again what holds and was not handed on for long."""
        # There is a look only every LOOK_EVERY_S: better half of that too early than too late.
        due = _clock() - self._repeated_s + LOOK_EVERY_S / 2.0
        self._hand_on(
            [
                self._found(name, self._told[name], None)
                for name in confirmed
                if self._handed_on_at.get(name, due) <= due
            ]
        )

    async def _lost(self, why: Exception) -> None:
        self._end(f"contact was lost: {words_of_failure(why)}")

    def _end(self, words: str) -> None:
        self._end_words = words
        self._ended.set()


_STATE: Final = ua.NodeId(ua.Int32(ua.ObjectIds.Server_ServerStatus_State))
_TIME: Final = ua.NodeId(ua.Int32(ua.ObjectIds.Server_ServerStatus_CurrentTime))

_NO_NODE: Final = frozenset(
    {
        ua.StatusCodes.BadNodeIdUnknown,
        ua.StatusCodes.BadNodeIdInvalid,
        ua.StatusCodes.BadAttributeIdInvalid,
    }
)


def _clock() -> float:
    return asyncio.get_running_loop().time()


def _aware(time: datetime) -> datetime:
    return time if time.tzinfo is not None else time.replace(tzinfo=UTC)


def _state_name(code: int) -> str:
    return ua.ServerState(code).name if code in list(ua.ServerState) else str(code)


def _in_words(observed: Observed | None) -> str:
    if observed is None:
        return "nothing"
    return "without a value" if observed.value is None else f"{observed.value:g}"
