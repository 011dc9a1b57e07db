"""A small reader of NC programs, written without looking at what writes them.

Of each line it knows the words that a measuring program may have, and refuses any other. The
answer is what the machine does: ("rapid" or feed, {axis: mm}), ("dwell", s), ("stop",),
("spindle", rpm).
"""

import re

MODES = {
    "siemens": {"G17", "G40", "G60", "G90", "G94", "G710", "D0"},
    "fanuc": {"G17", "G21", "G40", "G49", "G80", "G90", "G94", "G61", "G54"},
    "linuxcnc": {"G17", "G21", "G40", "G49", "G80", "G90", "G94", "G61.1"},
}
NEEDED = {
    "siemens": {"G90", "G710", "D0"},
    "fanuc": {"G21", "G90", "G54", "G49"},
    "linuxcnc": {"G21", "G90", "G49"},
}
IN_EVERY_MOVE = {"siemens": "SUPA", "linuxcnc": "G53", "fanuc": None}
ENDS = {"siemens": ["M30"], "fanuc": ["G64", "M30"], "linuxcnc": ["G64", "M2"]}
WITH_POINT = re.compile(r"([XYZ])([+-]?\d+\.\d+)")


def run(text, dialect):
    """Read a whole program; it has to end as its controller wants."""
    return list(conversational(text) if dialect == "heidenhain" else iso(text, dialect))


def iso(text, dialect):
    lines = [re.sub(r";.*|\([^()]*\)", "", line).strip() for line in text.splitlines()]
    if dialect != "siemens":
        assert lines[0] == lines[-1] == "%"
        lines = lines[1:-1]
    if dialect == "fanuc":
        assert re.fullmatch(r"O\d{4}", lines.pop(0))
    lines = [line for line in lines if line]
    last = len(lines) - len(ENDS[dialect])
    assert lines[last:] == ENDS[dialect]
    lines = lines[:last]
    modes = set()
    for line in lines:
        words = line.split()
        if set(words) <= MODES[dialect]:
            modes |= set(words)
        elif words == ["M0"]:
            yield ("stop",)
        elif words == ["M5"]:
            yield ("spindle", 0.0)
        elif len(words) == 2 and words[1] == "M3":
            yield ("spindle", float(words[0].removeprefix("S")))
        elif words[0] == "G4":
            yield ("dwell", _seconds(words[1:], dialect))
        else:
            assert modes >= NEEDED[dialect], f"moved before the modes: {line}"
            yield _iso_move(words, dialect, line)


def _seconds(words, dialect):
    (word,) = words
    letter, number = word[0], word[1:]
    assert letter == {"siemens": "F", "fanuc": "P", "linuxcnc": "P"}[dialect]
    assert ("." in number) is (dialect != "fanuc")
    return float(number) / 1000.0 if dialect == "fanuc" else float(number)


def _iso_move(words, dialect, line):
    if IN_EVERY_MOVE[dialect]:
        assert words.pop(0) == IN_EVERY_MOVE[dialect], line
    kind = words.pop(0)
    feed = "rapid"
    if kind == "G1":
        last = words.pop()
        assert last.startswith("F"), line
        assert "." in last, line
        feed = float(last[1:])
    else:
        assert kind == "G0", line
    return (feed, _coordinates(words, line))


def _coordinates(words, line):
    found = {}
    for word in words:
        match = WITH_POINT.fullmatch(word)
        assert match, line
        assert match[1] not in found, line
        found[match[1].lower()] = float(match[2])
    assert found, line
    return found


def conversational(text):
    lines = text.splitlines()
    for number, line in enumerate(lines):
        assert line.startswith(f"{number} "), line
    lines = [re.sub(r";.*", "", line.split(" ", 1)[1]).strip() for line in lines]
    name = re.fullmatch(r"BEGIN PGM (\w+) MM", lines[0])[1]
    assert lines[-2:] == ["M30", f"END PGM {name} MM"]
    body = iter([line for line in lines[1:-2] if line])
    for line in body:
        words = line.split()
        if words[0] == "L":
            assert words[-3] == "R0", line
            assert words[-1] == "M91", line
            assert all(word[1] in "+-" for word in words[1:-3]), line
            feed = "rapid" if words[-2] == "FMAX" else float(words[-2].removeprefix("F"))
            yield (feed, _coordinates(words[1:-3], line))
        elif line == "CYCL DEF 9.0 DWELL TIME":
            seconds = float(next(body).removeprefix("CYCL DEF 9.1 DWELL "))
            assert 0 < seconds <= 3600
            yield ("dwell", seconds)
        elif line.startswith("TOOL CALL S"):
            assert next(body) == "M3"
            yield ("spindle", float(line.removeprefix("TOOL CALL S")))
        elif line == "M5":
            yield ("spindle", 0.0)
        else:
            assert line == "STOP", line
            yield ("stop",)
