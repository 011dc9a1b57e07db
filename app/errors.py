"""What can go wrong, in the words of the field; nothing here knows HTTP.

    ThermapError
     ├─ UnknownThing          a machine, map, model, sensor … that does not exist
     ├─ Conflict              what was asked for contradicts what is stored
     │   └─ NoReading         a live table was asked for before the first reading
     ├─ InvalidContent        the content says something that cannot be right
     │   ├─ UnknownComponent      a component's name that nobody uses
     │   ├─ NotEnoughMaps         fewer than two maps: nothing to interpolate between
     │   ├─ SensorUnavailable     no usable temperature, and no stand-in either
     │   └─ OutsideMaps           a temperature beyond what the machine's policy allows
     ├─ StorageUnavailable    the database is away
     │   ├─ StorageFull           it is there, but has no room for more
     │   └─ StorageBusy           it is there, but others write for too long
     │       └─ StorageOvertaken      another's change came first: the same again may succeed
     ├─ QueueFull             too many analyses wait already
     │   └─ MachineQueueFull      of one machine
     ├─ AccessRefused         the key that asks may not do this, or is none any more
     │   ├─ KeyUnknown            there is no such key
     │   └─ NotAllowed            its role is not enough, or it is not for this machine
     ├─ StorageTooNew         the database was written by a newer thermap
     └─ ServiceStopping           the service was told to end, and takes nothing on any more

Each carries one sentence for a person and, where fields are to blame, a
`FieldError` for each of them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class FieldError:
    """One field that is to blame: its path, and what was expected, what came, the unit."""

    field: str
    message: str


class ThermapError(Exception):
    """Anything that thermap refuses to do, with the reason in a sentence."""

    def __init__(self, detail: str, errors: Iterable[FieldError] = ()) -> None:
        super().__init__(detail)
        self.detail = detail
        self.errors: Sequence[FieldError] = tuple(errors)


class UnknownThing(ThermapError):
    """Something that does not exist was named; the sentence lists what exists."""


class Conflict(ThermapError):
    """The request contradicts what is stored."""


class NoReading(Conflict):
    """A live table was asked for, but no usable reading has come."""


class InvalidContent(ThermapError):
    """The content cannot be right: what was expected, what came, and the unit."""

    @classmethod
    def of_field(cls, field: str, message: str) -> InvalidContent:
        """Blame one field."""
        return cls(f"{field}: {message}", [FieldError(field, message)])

    def inside(self, prefix: str) -> InvalidContent:
        """Return the same error with its fields named from one level further out."""
        errors = [FieldError(f"{prefix}.{e.field}", e.message) for e in self.errors]
        errors = errors or [FieldError(prefix, self.detail)]
        return type(self)("; ".join(f"{e.field}: {e.message}" for e in errors), errors)


class UnknownComponent(InvalidContent):
    """A name that is neither an ISO 230-1 code nor the chapter's notation."""


class NotEnoughMaps(InvalidContent):
    """Fewer than two error maps: there is nothing to interpolate between."""


class SensorUnavailable(InvalidContent):
    """A sensor has no usable temperature and no stand-in has one either."""


class OutsideMaps(InvalidContent):
    """A temperature lies outside the maps further than the machine's policy allows."""


class StorageUnavailable(ThermapError):
    """The database cannot be reached."""


class StorageFull(StorageUnavailable):
    """The database is there, but has no room for more; what is stored can be read."""


class StorageBusy(StorageUnavailable):
    """The database is there, but its locks are held for too long."""


class StorageOvertaken(StorageBusy):
    """The database undid a transaction in favour of another's, and nothing of it is left.

    Of two that wait for each other one has to give way. Repeated as a whole it may succeed.
    """


class QueueFull(ThermapError):
    """As many analyses wait as may: later there is room again."""


class MachineQueueFull(QueueFull):
    """As many analyses of one machine wait as may."""


class AccessRefused(ThermapError):
    """A request may not do what it asks for."""


class KeyUnknown(AccessRefused):
    """The key that was stated is none, or none any more."""

    def __init__(self, got: str = "one that is unknown, revoked or too old") -> None:
        super().__init__(
            f"expected a key in the header Authorization: Bearer KEY, got {got}; "
            "`thermap keys create` makes one"
        )


class NotAllowed(AccessRefused):
    """The key's role is not enough, or it is not for this machine."""


class StorageTooNew(ThermapError):
    """The database has migrations that this version does not know."""


class ServiceStopping(ThermapError):
    """The service was told to end: whoever still waits is sent away."""


def list_names(names: Iterable[str], limit: int = 20) -> str:
    """Write names for a sentence: the first `limit`, then how many more there are.

    >>> list_names(["x-middle", "spindle"])
    'x-middle, spindle'
    >>> list_names([])
    'none'
    """
    listed = list(names)
    if not listed:
        return "none"
    more = len(listed) - limit
    first = ", ".join(listed[:limit])
    return f"{first} and {more} more" if more > 0 else first


def existing_names(names: Iterable[str]) -> str:
    """Say what there is, where something else was named.

    >>> existing_names(["1", "2"]), existing_names([])
    ('it has: 1, 2', 'it has none yet')
    """
    listed = list(names)
    return f"it has: {list_names(listed)}" if listed else "it has none yet"


def capitalised(sentence: str, names: Iterable[str] = ()) -> str:
    """Begin a sentence with a capital, unless it begins with a name: upper case is another name.

    >>> capitalised("the disk is full"), capitalised("bed was stuck for 5 h", ["bed"])
    ('The disk is full', 'bed was stuck for 5 h')
    """
    if any(sentence.startswith(name) for name in names):
        return sentence
    return f"{sentence[:1].upper()}{sentence[1:]}"


def counted(number: int, singular: str, more: str | None = None) -> str:
    """Write a number of things for a sentence; `more` where an s does not make the plural.

    >>> counted(1, "point"), counted(0, "point"), counted(2, "entry", "entries")
    ('1 point', '0 points', '2 entries')
    """
    return f"{number} {singular if number == 1 else more or singular + 's'}"


def repeated(names: Iterable[str]) -> list[str]:
    """List, in order, what is named more than once.

    >>> repeated(["b", "a", "b", "c", "a"])
    ['a', 'b']
    """
    return sorted(name for name, times in Counter(names).items() if times > 1)


def expect_each_once(field: str, named: Sequence[int] | Sequence[str]) -> None:
    """Refuse a list that names something twice; InvalidContent blames the field.

    >>> expect_each_once("versions", [2, 3])
    """
    if len(set(named)) < len(named):
        raise InvalidContent.of_field(field, f"expected each once, got {list(named)}")
