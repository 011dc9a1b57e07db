"""Where one is in an agent's sequence of observations, and what was lost on the way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from app.connections.mtconnect_documents import Observation, Streams
from app.errors import counted


#                   /probe, /current
#    no place ────────────────────────────> at `next_sequence` ───┐ /sample, same instanceId: what
#     ^  ^                                     │    │        ^   │ is numbered from there on; where
#     │  └── instanceId changed: restarted ────┤    │        └───┘ the agent's first is behind it,
#     │  └── the sequence went back ───────────┘    │              the rest was overwritten
#     │                                            │
#     └── OUT_OF_RANGE: overwritten, `leave` ──────┘ /current alone: the items are the same
#
# Numbers mean something within one instance only. After a restart the agent counts from elsewhere,
# and may have other data items: these are found anew, and what was observed in between is lost.
@dataclass(slots=True)
class Place:
    """The place in an agent's sequence; without one, `/current` is to be asked for.

    Parameters
    ----------
    say
        Takes a sentence on what was lost.
    lost
        Observations of the agent that were overwritten before they were read.
    gaps, restarts
        How often that happened, and how often the agent began to count anew.
    """

    say: Callable[[str], None]
    instance_id: int | None = None
    next_sequence: int | None = None
    lost: int = 0
    gaps: int = 0
    restarts: int = 0
    _left_at: int | None = field(default=None)

    def leave(self) -> None:
        """Give the place up: what was asked for is out of the agent's range."""
        self._left_at = self.next_sequence
        self.next_sequence = None

    def take_current(self, streams: Streams) -> list[Observation]:
        """Take what holds now, and begin or go on behind it."""
        self._note_restart(streams)
        # After a restart there is none: its numbers cannot be compared with those before.
        if self._left_at is not None:
            self._note_gap(streams.next_sequence - self._left_at)
        self._left_at = None
        self.next_sequence = streams.next_sequence
        return list(streams.observations)

    def take_sample(self, streams: Streams) -> list[Observation]:
        """Take what came since; empty, and no place any more, where the agent restarted."""
        expected = self.next_sequence
        if expected is None or self._note_restart(streams):
            self.next_sequence = None
            return []
        if streams.next_sequence < expected:
            # The same instance counts backwards: its numbers mean nothing, so begin anew.
            self.say(
                f"the agent's sequence went back from {expected} to {streams.next_sequence} "
                "without a new instanceId"
            )
            self.restarts += 1
            self.next_sequence = None
            return []
        if streams.first_sequence > expected:
            self._note_gap(streams.first_sequence - expected)
        self.next_sequence = streams.next_sequence
        # Those before were taken already; some agents repeat them.
        return [
            observation for observation in streams.observations if observation.sequence >= expected
        ]

    def _note_restart(self, streams: Streams) -> bool:
        instance_before, self.instance_id = self.instance_id, streams.instance_id
        if instance_before is None or instance_before == streams.instance_id:
            return False
        self.restarts += 1
        self._left_at = None
        self.say(
            f"the agent restarted (instanceId {instance_before} became {streams.instance_id}): "
            "what it "
            "observed in between is not known"
        )
        return True

    def _note_gap(self, lost: int) -> None:
        if lost <= 0:
            return
        self.gaps += 1
        self.lost += lost
        self.say(
            f"{counted(lost, 'observation')} of the agent, of any data items, were overwritten "
            "before they were read: ask more often, or give the agent a larger buffer"
        )
