"""Sentences of the service as they stand in its code, as messages of the catalogues.

An f-string is a message whose places are named after what stands in them: `f"{one.sensor} is late"`
becomes `%(sensor)s is late`. A choice of two texts inside of it makes two messages.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from itertools import product
from typing import Any, Final

_PLACE: Final = re.compile(r"%\(\w+\)s")
_WORD: Final = re.compile(r"(?<![\w%])(?!(?:mm|min|rpm|ms)\b)[A-Za-z]?[a-z]{2,}(?![\w/])")
_FIELD: Final = re.compile(r"(?<!\{)\{(\w+)(?:![rs])?(?::[^{}]*)?\}(?!\})")
"""A place of `str.format`."""

_NOT_SAID: Final = re.compile(
    "getLogger|compile|Field|doc|message|getattr|hasattr|setattr|debug|info|warning|error"
    "|exception|critical|log|text|execute|ValueError|TypeError|AssertionError|KeyError"
    "|RuntimeError|LookupError|IndexError|AttributeError|NotImplementedError|TypeVar"
    "|strftime|encode"
)
"""Calls whose arguments no page shows: logs, mistakes in the code, descriptions of the API."""

_OF_THE_FIRST: Final = re.compile(
    "list_names|sorted|capitalised|list|tuple|set|abs|float|int|str|len|min|max|repr|map"
    "|round|join|dict_values|format|next|iter|true_minus|escape|dict|count"
)
"""Calls that are named after what they are given."""


def sentences(
    fileobj: Any, *_: object, options: object = None
) -> Iterator[tuple[int, str | None, Any, list[str]]]:
    """Extract them, as Babel calls it: line, function, message or messages, comments."""
    finder = _Finder()
    finder.visit(ast.parse(fileobj.read()))
    for line, function, message in finder.found:
        yield line, function, message, []


class _Finder(ast.NodeVisitor):
    def __init__(self) -> None:
        self.found: list[tuple[int, str | None, Any]] = []

    def visit_Expr(self, node: ast.Expr) -> None:
        """Pass over docstrings."""
        if not isinstance(node.value, ast.Constant):
            self.generic_visit(node)

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        """Take what sensors and analyses may be, of one word each."""
        for one in node.body if node.name in ("Health", "AnalysisStatus") else ():
            if isinstance(one, ast.Assign) and _is_text(one.value):
                self.found.append((one.lineno, None, one.value.value))
        self.generic_visit(node)

    def visit_Assign(self, node: ast.Assign) -> None:
        """Take names of kinds of effects, with spaces too."""
        if _is_text(node.value) and getattr(node.targets[0], "id", "") == "kind":
            kind = node.value.value
            self.found += [(node.lineno, None, kind), (node.lineno, None, kind.replace("-", " "))]
        else:
            self.visit(node.value)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        """Take constants of one word."""
        if node.value is None:
            return
        name = getattr(node.target, "id", "")
        if _is_text(node.value) and name.isupper() and re.fullmatch("[a-z]+", node.value.value):
            self.found.append((node.lineno, None, node.value.value))
        else:
            self.visit(node.value)

    def visit_Call(self, node: ast.Call) -> None:
        """Take what is said by a name, and the words that a call chooses from."""
        name = _called(node)
        texts = [one.value for one in node.args if _is_text(one)]
        if name in ("_", "message", "verb"):
            self.found += [(node.lineno, None, text) for text in texts]
        elif name == "counted" and texts:
            one, more = texts[0], (texts[1:] or [f"{texts[0]}s"])[0]
            if "%(count)s" not in one:
                one, more = f"%(count)s {one}", f"%(count)s {more}"
            self.found.append((node.lineno, "ngettext", (one, more)))
        if not _NOT_SAID.fullmatch(name):
            for part in (*node.args, *node.keywords):
                if not (name in ("_", "message", "verb", "counted") and _is_text(part)):
                    self.visit(part)
            self.visit(node.func)

    def visit_Dict(self, node: ast.Dict) -> None:
        """Take values, and keys that are said."""
        for part in (*node.keys, *node.values):
            if part is not None and (part in node.values or not _is_text(part)):
                self.visit(part)

    def visit_IfExp(self, node: ast.IfExp) -> None:
        """Take the words that are chosen from."""
        if _is_choice(node):
            for one in (node.body, node.orelse):
                if _is_text(one) and re.fullmatch("[A-Za-z][a-z]+", one.value):
                    self.found.append((node.lineno, None, one.value))
        self.generic_visit(node)

    def visit_Subscript(self, node: ast.Subscript) -> None:
        """Pass over keys."""
        self.visit(node.value)

    def visit_Compare(self, node: ast.Compare) -> None:
        """Pass over what something is compared with."""

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        """Take an f-string, and what stands inside of it."""
        self._take(node, _messages(node))
        for part in node.values:
            if isinstance(part, ast.FormattedValue) and not _is_choice(part.value):
                self.visit(part.value)

    def visit_Constant(self, node: ast.Constant) -> None:
        """Take a text that is more than a word."""
        if _is_text(node):
            self._take(node, [node.value.replace("%", "%%")])

    def _take(self, node: ast.expr, messages: list[str]) -> None:
        for message in messages:
            said = _FIELD.sub(r"%(\1)s", message)
            literal = _PLACE.sub("\0", said)
            if " " in literal and not re.search("[\n<]", literal) and _WORD.search(literal):
                self.found.append((node.lineno, None, said))


def _messages(node: ast.JoinedStr) -> list[str]:
    """Write an f-string with named places, once for each choice in it."""
    names: dict[str, str] = {}
    parts = [_forms(part, names) for part in node.values]
    return ["".join(form) for form in product(*parts)]


def _forms(node: ast.expr, names: dict[str, str]) -> list[str]:
    if isinstance(node, ast.Constant):
        return [str(node.value).replace("%", "%%")]
    if isinstance(node, ast.JoinedStr):
        return ["".join(form) for form in product(*(_forms(part, names) for part in node.values))]
    if isinstance(node, ast.FormattedValue) and _is_choice(node.value):
        return _forms(node.value, names)
    if isinstance(node, ast.IfExp):
        return [*_forms(node.body, names), *_forms(node.orelse, names)]
    assert isinstance(node, ast.FormattedValue)
    value = ast.unparse(node.value)
    if value not in names:
        name = _name_of(node.value) or "value"
        taken = sum(1 for other in names.values() if other.rstrip("0123456789") == name)
        names[value] = f"{name}{taken + 1}" if taken else name
    return [f"%({names[value]})s"]


def _is_choice(node: ast.expr) -> bool:
    """Whether it is one of texts that stand there."""
    if isinstance(node, ast.IfExp):
        return _is_choice(node.body) and _is_choice(node.orelse)
    return isinstance(node, ast.JoinedStr) or _is_text(node)


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def _called(node: ast.Call) -> str:
    function = node.func
    return function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")


def _name_of(node: ast.expr) -> str:
    """Name a value after what it is."""
    match node:
        case ast.Name(id=name) | ast.Attribute(attr=name):
            return name.strip("_").lower().rstrip("0123456789_")
        case ast.Call(args=args) if _called(node) == "counted":
            text = next((one.value for one in args if _is_text(one)), "")
            return re.sub(r"\W+", "_", text)
        case ast.Call(args=[first, *more]) if _OF_THE_FIRST.fullmatch(_called(node)):
            return _name_of(more[0] if _called(node) == "map" and more else first)
        case ast.Call(func=ast.Attribute(value=value)) if _OF_THE_FIRST.fullmatch(_called(node)):
            return _name_of(value)
        case ast.Call():
            return _called(node).strip("_")
        case ast.Subscript(value=value) | ast.UnaryOp(operand=value) | ast.BinOp(left=value):
            return _name_of(value)
        case ast.GeneratorExp(elt=value) | ast.ListComp(elt=value) | ast.Starred(value=value):
            return _name_of(value)
        case ast.IfExp(body=value):
            return _name_of(value)
    return ""
