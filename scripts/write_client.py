"""Write the generated half of `thermap`: the shapes that travel, and the blocking client.

The shapes of answers come from the service's OpenAPI document, the blocking client from the
awaiting one. Tests hold that the files are what this script writes.

    python scripts/write_client.py
"""

from __future__ import annotations

import inspect
import json
import re
import shutil
import subprocess
import sysconfig
import tempfile
import textwrap
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import unasync
from datamodel_code_generator import InputFileType, generate
from datamodel_code_generator.enums import DataModelType
from datamodel_code_generator.format import Formatter, PythonVersion
from datamodel_code_generator.parser import LiteralType

from app.effects.claim import AnsweredClaim
from app.services.change_model import ModelChange
from app.services.controllers import ControllerHead
from app.storage.records import VerificationExtent
from scripts.openapi_document import openapi_document

PACKAGE: Final = Path(__file__).parent.parent / "thermap"

_HEAD: Final = (
    "What the service answers with.\n\n"
    "Written by `scripts/write_client.py` from the service's OpenAPI document.\n"
)

_BASES: Final = {
    **dict.fromkeys(("ComponentCompensationAnswer", "ComponentAnswer"), "thermap.table.TableEntry"),
    **dict.fromkeys(
        ("ErrorMapAnswer", "MeasurementAnswer", "DriftStateAnswer"), "thermap.table.Components"
    ),
    "CompensationAnswer": "thermap.table.CompensationTable",
}
"""Shapes that say more than their fields."""

_COMMON: Final = {
    kind.__name__: kind for kind in (ModelChange, VerificationExtent, AnsweredClaim, ControllerHead)
}
"""What several answers have in common as the service has it, which is not published by itself."""

_KEPT: Final = frozenset(("type", "format", "enum", "const", "required", "default", "description"))
"""What a schema says that is read from it; limits are the service's to check, and may widen."""

_LIKENESS: Final = 3
"""So many fields at least make one answer a kind of another that has them all."""

_LINE: Final = 100
_INDENT: Final = " " * 4
_LONG: Final = re.compile(rf'^{_INDENT}"""(?=.{{{_LINE - 9},}}$)(.+)"""$', re.MULTILINE)
"""A field's description that is longer than a line may be."""

_Schema = dict[str, Any]
_REFERENCE: Final = "#/components/schemas/"


def write_shapes(document: Mapping[str, Any]) -> dict[str, str]:
    """Write the module of shapes.

    Parameters
    ----------
    document
        The OpenAPI document that the service publishes.

    Returns
    -------
    dict
        Name of a file in `thermap` to its content.
    """
    with tempfile.TemporaryDirectory() as folder:
        generate(
            json.dumps(_for_generator(document)),
            input_file_type=InputFileType.OpenAPI,
            output=Path(folder) / "answers.py",
            output_model_type=DataModelType.PydanticV2BaseModel,
            target_python_version=PythonVersion.PY_311,
            base_class="thermap.shape.Shape",
            base_class_map=_BASES,
            enum_field_as_literal=LiteralType.All,
            strict_nullable=True,
            use_standard_collections=True,
            use_union_operator=True,
            use_exact_imports=True,
            use_schema_description=True,
            use_field_description=True,
            use_inline_field_description=True,
            use_single_line_docstring=True,
            use_double_quotes=True,
            disable_future_imports=True,
            disable_timestamp=True,
            custom_file_header='""',
            formatters=[Formatter.BUILTIN],
        )
        text = _finished((Path(folder) / "answers.py").read_text("utf-8"))
    return {"answers.py": formatted(text, "answers.py")}


def write_blocking() -> dict[str, str]:
    """Write the blocking client's modules; name of a file in `thermap` to its content."""
    names = {
        "AsyncThermapClient": "ThermapClient",
        "AsyncClient": "Client",
        "AsyncBaseTransport": "BaseTransport",
        "aclose": "close",
        "aread": "read",
        "aiter_lines": "iter_lines",
        "asyncio": "time",
    }
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "_async" / "client.py"
        copy.parent.mkdir()
        shutil.copy(PACKAGE / "_async" / "client.py", copy)
        rule = unasync.Rule("/_async/", "/_sync/", additional_replacements=names)
        unasync.unasync_files([str(copy)], [rule])
        found["_sync/client.py"] = (Path(folder) / "_sync" / "client.py").read_text("utf-8")
    said = {
        "\n\n`scripts/write_client.py` makes the blocking client of this one.\n":
        "\n\nWritten by `scripts/write_client.py` from the awaiting one, which does not block.\n",
        "Coroutine[Any, Any, Answer]": "Answer",
    }  # fmt: skip
    for name, text in found.items():
        for awaiting, blocking in said.items():
            text = text.replace(awaiting, blocking)
        found[name] = formatted(text, name)
    return found


def formatted(text: str, name: str) -> str:
    """Lay a file out and sort its imports as the house does; `name` is its name in `thermap`."""
    ruff = shutil.which("ruff") or str(Path(sysconfig.get_path("scripts")) / "ruff")
    stated = ("--stdin-filename", str(PACKAGE / name), "-")
    for words in (("check", "--quiet", "--fix-only", "--select", "I,F401"), ("format", "--quiet")):
        text = subprocess.run(
            [ruff, *words, *stated], input=text, capture_output=True, text=True, check=True,
            encoding="utf-8", cwd=PACKAGE.parent,
        ).stdout  # fmt: skip
    return text


def _finished(text: str) -> str:
    """Give the generated module its head, and lines of our length."""
    text = text.replace('""', f'"""{_HEAD}"""', 1)
    for name, base in _BASES.items():  # which the generator leaves out where there are parents
        also = base.rpartition(".")[2]
        text = text.replace(f"class {name}(ModelChange):", f"class {name}(ModelChange, {also}):")
    return _LONG.sub(lambda found: _wrapped(found[1]), text)


def _wrapped(description: str) -> str:
    width = _LINE - len(_INDENT)
    lines = textwrap.wrap(f'"""{description}', width, break_long_words=False)
    return textwrap.indent("\n".join([*lines, '"""']), _INDENT)


def _for_generator(document: Mapping[str, Any]) -> dict[str, Any]:
    """Write a document of the answers' shapes alone."""
    published: Mapping[str, _Schema] = document["components"]["schemas"]
    answers = _answers(document)
    shapes = {
        name: schema
        for name, schema in published.items()
        if name in answers and "properties" in schema
    }
    shapes |= {name: _common(kind, shapes) for name, kind in _COMMON.items()}
    written = {
        name: _Written(published, shapes).shape(schema, _parents(name, shapes))
        for name, schema in shapes.items()
    }
    return {
        "openapi": document["openapi"],
        "info": document["info"],
        "paths": {},
        "components": {"schemas": written},
    }


def _answers(document: Mapping[str, Any]) -> set[str]:
    """Name every shape that is in an answer to what succeeds; `thermap.errors` reads refusals."""
    published = document["components"]["schemas"]
    waiting = [
        name
        for operations in document["paths"].values()
        for operation in operations.values()
        for status, response in operation["responses"].items()
        if status.startswith("2")
        for name in _named_in(response)
    ]
    found: set[str] = set()
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            waiting += _named_in(published[name])
    return found


def _named_in(part: Any) -> Iterator[str]:
    if isinstance(part, dict):
        for key, value in part.items():
            yield from [value.removeprefix(_REFERENCE)] if key == "$ref" else _named_in(value)
    elif isinstance(part, list):
        for value in part:
            yield from _named_in(value)


def _common(kind: type[Any], answers: Mapping[str, _Schema]) -> _Schema:
    """Describe what answers have in common, as most of them that have it do."""
    names = inspect.get_annotations(kind).keys()
    described = [
        {
            "description": inspect.getdoc(kind),
            "properties": {name: p for name, p in one["properties"].items() if name in names},
            "required": [name for name in one.get("required", ()) if name in names],
        }
        for one in answers.values()
        if names <= one["properties"].keys()
    ]
    return max(described, key=described.count)


def _parents(name: str, answers: Mapping[str, _Schema]) -> list[str]:
    """Find the answers of which another one is a kind: it has all their fields, and more.

    So a function for a CompensationAnswer takes a CurrentCompensationAnswer too.
    """
    own = answers[name]["properties"].items()
    parents: list[str] = []
    inherited: set[str] = set()
    for other in sorted(answers, key=lambda n: (-len(answers[n]["properties"]), n)):
        fields = answers[other]["properties"]
        is_kind = len(own) > len(fields) >= _LIKENESS and all(f in own for f in fields.items())
        if is_kind and (not parents or (other in _COMMON and not fields.keys() <= inherited)):
            parents.append(other)
            inherited |= fields.keys()
    return parents


class _Written:
    """Writes schemas for the generator: without limits, titles and examples."""

    def __init__(self, published: Mapping[str, _Schema], shapes: Mapping[str, _Schema]) -> None:
        self._published = published
        self._shapes = shapes

    def shape(self, schema: _Schema, parents: Iterable[str]) -> _Schema:
        """Write a shape, on top of the fields of its parents where it has any."""
        references = [{"$ref": _REFERENCE + parent} for parent in parents]
        inherited = {f for parent in parents for f in self._shapes[parent]["properties"]}
        required = set(schema.get("required", ()))
        own = {
            field: self._field(described, field in required)
            for field, described in schema["properties"].items()
            if field not in inherited
        }
        written = {
            "type": "object",
            "description": schema.get("description", ""),
            "properties": own,
            "required": [field for field in own if field in required],
        }
        if not references:
            return written
        return {"description": written.pop("description"), "allOf": [*references, written]}

    def _field(self, schema: _Schema, required: bool) -> _Schema:
        written = self._kind(schema)
        empty: Any = {"object": {}, "array": []}.get(written.get("type", ""))
        if not required and empty is not None:
            written.setdefault("default", empty)  # a default_factory's, which is not published
        return written

    def _kind(self, schema: _Schema) -> _Schema:
        written = {key: value for key, value in schema.items() if key in _KEPT}
        for key in ("anyOf", "oneOf"):
            if key in schema:
                written[key] = [self._kind(one) for one in schema[key]]
        for key in ("items", "additionalProperties"):
            if isinstance(schema.get(key), dict):
                written[key] = self._kind(schema[key])
        names = schema.get("propertyNames", {})
        if "enum" in names:
            written["propertyNames"] = {"type": "string", "enum": names["enum"]}
        if "$ref" in schema:
            name = schema["$ref"].removeprefix(_REFERENCE)
            if name in self._shapes:
                written["$ref"] = _REFERENCE + name
            else:  # a word or a mapping, which needs no class of its own
                written = self._kind(self._published[name]) | written
        return written


def write(files: Iterable[tuple[str, str]]) -> None:
    """Write files into the package."""
    for name, text in files:
        (PACKAGE / name).write_text(text, encoding="utf-8")
        print(f"wrote {PACKAGE / name}")


if __name__ == "__main__":
    write(write_blocking().items())
    write(write_shapes(openapi_document()).items())
