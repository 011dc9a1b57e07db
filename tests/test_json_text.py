"""Long JSON is read in pieces, and as a reading as a whole would have it."""

import json
import random

import jiter
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app import json_text
from app.json_text import NoJsonError, RepeatedNameError, read_json

NAMES = st.text('ab"\\,:[]{} é\n', max_size=6)
DOCUMENTS = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | NAMES,
    lambda inner: st.lists(inner, max_size=8) | st.dictionaries(NAMES, inner, max_size=8),
    max_leaves=60,
)


def by_the_library(text):
    try:
        return jiter.from_json(text, catch_duplicate_keys=True)
    except ValueError:
        return ValueError


def in_pieces(text, size):
    """Cut a text that one would not cut, into pieces and blocks of some bytes."""
    with pytest.MonkeyPatch.context() as smaller:
        smaller.setattr(json_text, "SHORT_TEXT", size)
        smaller.setattr(json_text, "_BLOCK", 7)
        try:
            return read_json(text)
        except ValueError:
            return ValueError


SIZES = st.sampled_from([4, 16, 64])


@pytest.mark.slow
@given(
    size=SIZES, document=DOCUMENTS, indent=st.sampled_from([None, 0, 3]), ascii_only=st.booleans()
)
def test_pieces_read_what_the_whole_says(size, document, indent, ascii_only):
    text = json.dumps(document, indent=indent, ensure_ascii=ascii_only).encode()
    assert in_pieces(text, size) == document


@pytest.mark.slow
@given(size=SIZES, document=DOCUMENTS, seed=st.integers(0, 2**32), changes=st.integers(1, 3))
def test_damaged_text_is_refused_where_the_library_refuses_it(size, document, seed, changes):
    text = bytearray(json.dumps(document).encode())
    drawn = random.Random(seed)
    for _ in range(changes):
        at = drawn.randrange(len(text) + 1)
        text[at : at + drawn.randrange(2)] = drawn.choice(
            [b",", b"[", b"]", b"{", b"}", b'"', b"\\", b":", b"-", b"1", b" ", b"null", b"\xff"]
        )
    assert in_pieces(bytes(text), size) == by_the_library(bytes(text))


BAD = [
    b"[" + b"0," * 9000 + b"]",
    b"[" + b"0," * 9000 + b",0]",
    b"[" + b"[0]," * 9000 + b"0}",
    b"{" + b'"a" : 1 ,' * 9000 + b"}",
    b'{"a": -[' + b"0," * 9000 + b"0]}",
    b'{"a" [' + b"0," * 9000 + b"0]}",
    b'{"a": [' + b"0," * 9000 + b"0] 1}",
    b"[" + b"0," * 9000 + b"0] x",
    b"x [" + b"0," * 9000 + b"0]",
    b"[" + b"0," * 9000 + b'"]',
    b"\\[" + b"0," * 9000 + b"0]",
    b"," + b" " * 20_000,
    b"9" * 20_000,
    b"[" * 20_000 + b"]" * 20_000,
    b"]" * 10_000 + b"[" * 10_000,
]


@pytest.mark.parametrize("text", BAD, ids=lambda text: repr(text[:12]))
def test_long_text_that_is_none(text):
    with pytest.raises((NoJsonError, RepeatedNameError)):
        read_json(text)


@pytest.mark.parametrize("size", [1, 4000])
def test_a_repeated_name_is_named_wherever_it_stands(size):
    many = ",".join(f'"n{i}": [{i}, "x"]' for i in range(size))
    for text in (
        f'{{"a\\u0062": 1, {many}, "ab": 2}}',
        f'[{{"ab": {{{many}}}, "ab": 1}}]',
        f'[[{{"c": {{"ab": 1, "ab": 2}}}}], {{{many}}}]',
    ):
        with pytest.raises(RepeatedNameError) as refused:
            read_json(text.encode())
        assert refused.value.name == "ab"


@pytest.mark.slow
def test_long_values_of_every_kind():
    values = [
        " " * 100_000,
        [],
        {},
        ["\\" * 70_001, '"' * 70_001, "[,]{}" * 20_000],
        {"x": {"y": [[1.5, -2e-7, True, None]] * 20_000}, "z": 1},
        [[0.0, 1.25, 2.0]] * 50_000,
    ]
    for value in values:
        text = json.dumps(value)
        for spaced in (text, f"{' ' * 20_000}{text}\n", text.replace("[]", f"[{' ' * 20_000}]")):
            assert read_json(spaced.encode()) == value


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (b"[" + b"0," * 5_000_001 + b"0]", "values"),
        (b'["' + b"a" * 3_000_000 + b'"]', "bytes"),
        (b"[" * 40 + b"0," * 10_000 + b"0" + b"]" * 40, "levels"),
        (b"{" + b",".join(b'"%x":0' % i for i in range(6000)) + b"}", "names"),
    ],
    ids=["values", "bytes", "levels", "names"],
)
def test_more_than_anyone_needs(text, said):
    with pytest.raises(NoJsonError, match=said):
        read_json(text)


def test_escapes_over_the_edges_of_blocks():
    for backslashes in range(1, 9):
        for shift in range(9):
            text = b"a" * shift + b"\\" * backslashes + b'"'
            found, carried = [], False
            for start in range(0, len(text), 4):
                block = np.frombuffer(text[start : start + 4], dtype=np.uint8)
                at, carried = json_text._escaped(block, carried)
                found += [start + int(i) for i in at]
            expected = shift + backslashes in found
            assert expected == (backslashes % 2 == 1)
