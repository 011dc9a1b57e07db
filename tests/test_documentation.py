"""The documents say what is true: names exist, commands exist, the HTTP page is current."""

import importlib
import re
from pathlib import Path

import pytest

from scripts.write_http_reference import PAGE, openapi_document, write_page

ROOT = Path(__file__).parent.parent
METHODS = sorted((ROOT / "docs" / "methods").glob("*.md"))
PAGES = [
    ROOT / "README.md",
    ROOT / "CHANGELOG.md",
    *sorted((ROOT / "docs").glob("*.md")),
    *METHODS,
]


def test_http_reference_is_what_the_service_says():
    written = write_page(openapi_document())
    assert PAGE.read_text(encoding="utf-8") == written, (
        "the HTTP interface changed: run `python scripts/write_http_reference.py`, look at the "
        "difference, and write it into CHANGELOG.md"
    )


def named_objects():
    for page in PAGES:
        for name in sorted(set(re.findall(r"`(app(?:\.\w+)+)`", page.read_text(encoding="utf-8")))):
            yield pytest.param(name, id=f"{page.name}:{name}")


@pytest.mark.parametrize("name", list(named_objects()))
def test_named_objects_exist(name):
    parts = name.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            thing = importlib.import_module(".".join(parts[:cut]))
        except ModuleNotFoundError:
            continue
        for attribute in parts[cut:]:
            thing = getattr(thing, attribute)
        return
    pytest.fail(f"there is no {name}")


def named_files():
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for name in sorted(set(re.findall(r"\]\((?!http)([^)#]+)", text))):
            yield pytest.param(page.parent / name, id=f"{page.name}:{name}")
        for name in sorted(set(re.findall(r"`((?:tests|docs|benchmarks|scripts)/[\w/.-]+)", text))):
            yield pytest.param(ROOT / name.split("::")[0], id=f"{page.name}:{name}")


@pytest.mark.parametrize("path", list(named_files()))
def test_named_files_exist(path):
    assert path.exists()


def named_tests():
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for name in sorted(set(re.findall(r"`(tests/[\w/]+\.py::\w+)`", text))):
            yield pytest.param(*name.split("::"), id=f"{page.name}:{name}")


@pytest.mark.parametrize(("file", "test"), list(named_tests()))
def test_named_tests_exist(file, test):
    assert f"def {test}(" in (ROOT / file).read_text(encoding="utf-8")


def named_without_a_file():
    for page in METHODS:
        text = page.read_text(encoding="utf-8")
        files = sorted(set(re.findall(r"`(tests/[\w/]+\.py)", text)))
        for name in sorted(set(re.findall(r"`(test_\w+)`", text))):
            yield pytest.param(files, name, id=f"{page.name}:{name}")


@pytest.mark.parametrize(("files", "test"), list(named_without_a_file()))
def test_tests_named_on_a_methods_page_are_in_a_file_that_it_names(files, test):
    assert any(f"def {test}(" in (ROOT / file).read_text(encoding="utf-8") for file in files)


def test_every_dependency_has_its_reason():
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    block = text.split("dependencies = [")[1].split("]\n")[0]
    reasons = (ROOT / "docs" / "dependencies.md").read_text(encoding="utf-8")
    for name in re.findall(r'"([a-z][a-z0-9-]+)', block):
        assert f"| {name} |" in reasons, f"{name} has no reason in docs/dependencies.md"


def test_the_first_screen_of_the_readme_has_both_commands():
    first_screen = (ROOT / "README.md").read_text(encoding="utf-8")[:2500]
    assert "pip install . && thermap demo" in first_screen
    assert 'pip install -e ".[test]" && pytest' in first_screen
