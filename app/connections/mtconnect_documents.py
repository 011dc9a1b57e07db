"""What an MTConnect agent answers, read from its XML: versions 1.0 to 2.x, by local names.

Every version has a namespace of its own, but the elements that matter here have been the same
since the first: the header's sequence numbers, and observations with `dataItemId`, `name`,
`sequence` and `timestamp` (ANSI/MTC1.4, Part 1.0, "MTConnectStreams" and "MTConnectError").
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final
from xml.etree.ElementTree import Element, ParseError

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from app.decimal_text import read_number
from app.errors import ThermapError, list_names
from app.foreign_text import shown

UNAVAILABLE: Final = "UNAVAILABLE"
"""What an agent says of a data item that has no value."""

LONGEST_EXCERPT: Final = 80
"""Of a text that cannot be read [characters]."""

CODES: Final = 5
"""Of an error document that are repeated."""


class NotMtconnect(ThermapError):
    """What came is not a document of MTConnect; the sentence says what came."""


class AgentRefused(ThermapError):
    """The agent answered with an error document.

    `codes` are its error codes, as OUT_OF_RANGE, INVALID_XPATH or QUEUE_EMPTY.
    """

    def __init__(self, codes: Sequence[str], words: str) -> None:
        reason = shown(f"{list_names(codes[:CODES]) if codes else 'an error'}: {words}")
        super().__init__(f"the agent says {reason}")
        self.codes = frozenset(codes)

    @property
    def is_out_of_range(self) -> bool:
        """Whether what was asked for is not in the agent's buffer (any more).

        The same code refuses a `count`, an `interval` or a `heartbeat`: those it names.
        """
        if any(f"'{name}' must" in str(self) for name in ("count", "interval", "heartbeat")):
            return False
        return bool(self.codes & {"OUT_OF_RANGE", "INVALID_REQUEST_FROM"})


@dataclass(frozen=True, slots=True)
class Observation:
    """A value of a data item.

    `value` is None where the agent has none (UNAVAILABLE) or none that can be read: `text` is
    what it said.
    """

    item: str
    name: str
    sequence: int
    text: str
    value: float | None
    keys: str | None = None

    @property
    def words(self) -> str:
        """Say why there is no value."""
        if self.is_unavailable:
            return f"the agent says that it has no value ({UNAVAILABLE})"
        if self.keys is not None:
            return f"expected a number, got a data set or table with the keys {self.keys}"
        return f"expected a number, got {self.text!r}"

    @property
    def is_unavailable(self) -> bool:
        """Whether the agent says itself that there is no value."""
        return self.text.upper() == UNAVAILABLE


@dataclass(frozen=True, slots=True)
class Streams:
    """An answer to `/current` or `/sample`, observations in order of sequence.

    `instance_id` changes when an agent begins to count sequences anew; `first_sequence` is the
    oldest that its buffer still has, `next_sequence` where to go on. `buffer_size` is how many
    observations it keeps, and so the most that it gives at once; None where it does not say.
    `unnumbered` observations had no sequence, and were left out.
    """

    instance_id: int
    first_sequence: int
    next_sequence: int
    observations: Sequence[Observation]
    buffer_size: int | None = None
    unnumbered: int = 0


@dataclass(frozen=True, slots=True)
class DataItem:
    """A data item as `/probe` describes it; units as MTConnect names them, empty where none."""

    item: str
    name: str
    type: str
    units: str


def read_streams(content: bytes) -> Streams:
    """Read an answer to `/current` or `/sample`.

    Raises
    ------
    AgentRefused
        If it is an error document.
    NotMtconnect
        If it is anything else.
    """
    root = _root_of(content, "MTConnectStreams")
    header = _header_of(root)
    all_observations = [
        _observation(element) for element in root.iter() if "dataItemId" in element.attrib
    ]
    numbered = sorted(
        (observation for observation in all_observations if observation is not None),
        key=lambda item: item.sequence,
    )
    return Streams(
        instance_id=_whole(header, "instanceId"),
        first_sequence=_whole(header, "firstSequence"),
        next_sequence=_whole(header, "nextSequence"),
        observations=numbered,
        buffer_size=_whole(header, "bufferSize") if header.get("bufferSize") else None,
        unnumbered=len(all_observations) - len(numbered),
    )


def read_probe(content: bytes) -> Sequence[DataItem]:
    """Read an answer to `/probe`; errors as `read_streams`."""
    root = _root_of(content, "MTConnectDevices")
    return [
        DataItem(
            item=element.attrib["id"],
            name=element.attrib.get("name", ""),
            type=element.attrib.get("type", ""),
            units=element.attrib.get("units", ""),
        )
        for element in root.iter()
        if _local(element) == "DataItem" and "id" in element.attrib
    ]


def _root_of(content: bytes, expected: str) -> Element:
    """Parse without entities and document types, which nobody needs and attacks are made of."""
    try:
        root: Element = fromstring(content, forbid_dtd=True)
    except DefusedXmlException as why:
        raise NotMtconnect(
            f"expected {expected}, got XML with a document type or entities, which is not read: "
            f"{type(why).__name__}"
        ) from None
    except (ParseError, ValueError, LookupError) as why:
        excerpt = content[:LONGEST_EXCERPT].decode("utf-8", "replace")
        raise NotMtconnect(f"expected {expected} as XML, got {excerpt!r}: {why}") from None
    if _local(root) == "MTConnectError":
        raise _refusal(root)
    if _local(root) != expected:
        raise NotMtconnect(
            f"expected {expected}, got the element {_local(root)[:LONGEST_EXCERPT]!r}"
        )
    return root


def _refusal(root: Element) -> AgentRefused:
    # Before 2.0 every error is an `Error`; since then also `OutOfRange` and others, all with a
    # code, and the words in an `ErrorMessage` below.
    errors = [element for element in root.iter() if "errorCode" in element.attrib]
    words = "; ".join(" ".join(_words_of(element).split()) for element in errors)
    return AgentRefused([element.attrib["errorCode"] for element in errors], words)


def _words_of(error: Element) -> str:
    """Take what is said to people: since 2.6 the request and its parameters stand beside it."""
    messages = [child for child in error if _local(child) == "ErrorMessage"]
    return " ".join(text for element in messages or [error] for text in element.itertext())


def _header_of(root: Element) -> Mapping[str, str]:
    for element in root:
        if _local(element) == "Header":
            return element.attrib
    raise NotMtconnect("expected a Header, got a document without one")


def _whole(header: Mapping[str, str], name: str) -> int:
    text = header.get(name, "")
    if not (text.isascii() and text.isdigit() and len(text) <= 20):
        raise NotMtconnect(
            f"expected a whole number as {name} in the Header, got {text[:LONGEST_EXCERPT]!r}"
        )
    return int(text)


def _observation(element: Element) -> Observation | None:
    """Read one; None without a sequence, by which alone it could be told from an old one."""
    sequence = element.attrib.get("sequence", "")
    if not (sequence.isascii() and sequence.isdigit() and len(sequence) <= 20):
        return None
    text = (element.text or "").strip()
    keys = [child.attrib.get("key", "") for child in element if _local(child) == "Entry"]
    return Observation(
        item=element.attrib["dataItemId"],
        name=element.attrib.get("name", ""),
        sequence=int(sequence),
        text=text[:LONGEST_EXCERPT],
        value=read_number(text, decimal_comma=False),
        keys=list_names(keys, CODES) if keys else None,
    )


def _local(element: Element) -> str:
    # Comments and processing instructions have a function as their tag.
    tag: object = element.tag
    return tag.rpartition("}")[2] if isinstance(tag, str) else ""
