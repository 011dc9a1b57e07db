"""No pattern of the project takes longer than a text is long: none can be made to freeze."""

import ast
import importlib
import pkgutil
import re
from functools import cache
from pathlib import Path

import pytest

import app
import thermap
from tests.backtracking import quadratic_text

PATTERN_METHODS = {"match", "fullmatch", "search", "sub", "subn", "split", "findall", "finditer"}


@cache
def modules():
    """Import every module of both packages."""
    return [
        importlib.import_module(one.name)
        for package in (app, thermap)
        for one in pkgutil.walk_packages(package.__path__, f"{package.__name__}.")
        if not one.name.endswith("__main__")
    ]


def text_of(module):
    return Path(module.__file__).read_text(encoding="utf-8")


@cache
def uses():
    """List every pattern with each method that is used of it, and where."""
    return list(found_uses())


def found_uses():
    """Look into modules that hold a pattern, or what makes one, under a name."""
    for module in modules():
        values = vars(module).values()
        if not any(value is re or isinstance(value, re.Pattern) for value in values):
            continue
        where = module.__name__
        for node in ast.walk(ast.parse(text_of(module))):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                value = getattr(module, node.value.id, None)
                if isinstance(value, re.Pattern) and node.attr in PATTERN_METHODS:
                    yield value, node.attr, where
            if (
                isinstance(node, ast.Call)
                and isinstance(node.func, ast.Attribute)
                and getattr(module, getattr(node.func.value, "id", ""), None) is re
                and node.func.attr in PATTERN_METHODS
            ):
                first = node.args[0]
                text = getattr(module, first.id) if isinstance(first, ast.Name) else first.value
                yield re.compile(text), node.func.attr, where


def compiled():
    """Give every pattern that a module holds, in a collection too, and where."""
    for module in modules():
        for value in vars(module).values():
            inside = value.values() if isinstance(value, dict) else value
            held = [value, *(inside if isinstance(inside, (list, tuple, set, dict)) else ())]
            for one in held:
                if isinstance(one, re.Pattern):
                    yield one, module.__name__


@pytest.mark.slow
def test_a_pattern_takes_as_many_steps_as_its_text_is_long():
    each = {(one.pattern, one.flags, method): (one, where) for one, method, where in uses()}
    slow = [
        f"{where}: {one.pattern!r}.{method}: {text}"
        for (_, _, method), (one, where) in each.items()
        if (text := quadratic_text(one, method))
    ]
    assert slow == []


def test_every_compiled_pattern_is_among_them():
    used = {(one.pattern, one.flags) for one, _, _ in uses()}
    unseen = [
        f"{where}: {one.pattern!r}"
        for one, where in compiled()
        if (one.pattern, one.flags) not in used
    ]
    assert unseen == []


def test_no_pattern_is_compiled_where_the_test_does_not_look():
    """A pattern stands in a module: one made in a function would be held by nothing."""
    wrong = [
        f"{module.__name__}, line {node.lineno}"
        for module in modules()
        if "re.compile" in (text := text_of(module))
        for function in ast.walk(ast.parse(text))
        if isinstance(function, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda))
        for node in ast.walk(function)
        if isinstance(node, ast.Attribute)
        and node.attr == "compile"
        and getattr(node.value, "id", "") == "re"
    ]
    assert wrong == []


def test_pydantic_matches_with_an_engine_of_linear_time():
    """Its own engine is one; `python-re` would be Python's."""
    assert [module for module in modules() if "regex_engine" in text_of(module)] == []


@pytest.mark.parametrize(
    ("pattern", "method"),
    [
        (r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", "fullmatch"),
        (r"([A-Z][A-Z -]*?)\s*::", "fullmatch"),
        (r"(?P<name>.+?)(?:\s*[\[(](?P<unit>[^\])]*)[\])]?|_c)?", "fullmatch"),
        (r"a\]\s*=?\s*(\w+)", "match"),
        (r"<b([^>]*)>(.*?)</b>", "findall"),
        (r"\{(.*)\}", "search"),
        (r"(a|b)*c|(a|ab)*d", "search"),
        (r"(?:x+)+y", "match"),
        (r"\s+$", "search"),
        (r"(?<=[\d.,\s])[a-zA-Z][^\d]*$", "search"),
    ],
)
def test_quadratic_patterns_are_recognised(pattern, method):
    assert quadratic_text(re.compile(pattern, re.DOTALL), method)


@pytest.mark.parametrize(
    ("pattern", "method"),
    [
        (r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?", "fullmatch"),
        (r"\{(.*)\}", "fullmatch"),
        (r'"[^"]*"', "sub"),
        (r"\s*+;", "match"),
        pytest.param(r"[a-c]{1,64}x", "search", marks=pytest.mark.slow),
        (r"(?<![a-z])([xyz])\d?(?!\w)", "findall"),
    ],
)
def test_linear_patterns_are_not(pattern, method):
    assert quadratic_text(re.compile(pattern), method) is None
