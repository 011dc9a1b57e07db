"""The documents say what is true: what they name exists."""

import importlib
import re
import subprocess
from functools import cache

import pytest

from app.cli.application import COMMANDS, load
from scripts.openapi_document import openapi_document
from tests.documented_pages import PAGES, ROOT

RUN = re.compile(r"python -m ((?:benchmarks|examples|tests)(?:\.\w+)*)")
NAMED = re.compile(r"`((?:app|thermap)(?:\.\w+)+)`")
CODE = re.compile(r"```.*?```|`[^`\n]+`", re.DOTALL)
CODE_BLOCK = re.compile(r"^```.*?^```", re.DOTALL | re.MULTILINE)
COMMAND = re.compile(r"(?<![\w./-])thermap ([a-z][a-z-]*)\b([^`\n|#]*)")
OPTION = re.compile(r"(?<![\w-])--?[a-z][a-z-]*")
ROOMS = ("app", "thermap", "examples", "tests")
VARIABLE = re.compile(r"\bTHERMAP_[A-Z_]*[A-Z]\b")
COMMIT = re.compile(r"`([0-9a-f]{7,40})`")


def test_named_routes_exist():
    page = (ROOT / "docs" / "http.md").read_text(encoding="utf-8")
    named = {
        (method.lower(), path.replace("…", "/v1/machines/{machine}"))
        for method, path in re.findall(r"`(GET|POST|PUT|PATCH|DELETE) ([^`?]+)`", page)
    }
    paths = openapi_document()["paths"]
    assert len(named) > 30
    assert named <= {(method, path) for path, operations in paths.items() for method in operations}


def test_named_objects_exist():
    missing = [
        f"{page.name}: {name}"
        for page in PAGES
        for name in sorted(set(NAMED.findall(page.read_text(encoding="utf-8"))))
        if not exists(name)
    ]
    assert missing == []


def exists(name):
    parts = name.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            thing = importlib.import_module(".".join(parts[:cut]))
        except ModuleNotFoundError:
            continue
        for attribute in parts[cut:]:
            if not hasattr(thing, attribute):
                return False
            thing = getattr(thing, attribute)
        return True
    return False


def test_named_files_exist():
    named = []
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        named += [page.parent / name for name in re.findall(r"\]\((?!http)([^)#]+)", text)]
        named += [
            ROOT / name.split("::")[0]
            for name in re.findall(r"`((?:tests|docs|benchmarks|examples|scripts)/[\w/.-]+)", text)
        ]
    assert len(named) > 100
    assert [str(path) for path in named if not path.exists()] == []


def test_named_sections_exist():
    named = [
        (page, file, section)
        for page in PAGES
        for file, section in re.findall(
            r"\]\((?!http)([^)#\s]*)#([^)]+)\)", page.read_text(encoding="utf-8")
        )
    ]
    assert len(named) > 20
    assert [
        f"{page.name}: {file}#{section}"
        for page, file, section in named
        if section not in sections(page.parent / file if file else page)
    ] == []


def sections(page):
    """Give the sections of a page as links name them."""
    text = CODE_BLOCK.sub("", page.read_text(encoding="utf-8"))
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    words = [re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).lower() for heading in headings]
    return {re.sub(r"[^\w\- ]", "", heading).replace(" ", "-") for heading in words}


def test_named_programs_exist():
    missing = [
        f"{page.name}: {name}"
        for page in PAGES
        for name in sorted(set(RUN.findall(page.read_text(encoding="utf-8"))))
        if not any((ROOT / name.replace(".", "/")).with_suffix(end).exists() for end in (".py", ""))
    ]
    assert missing == []


def test_named_commands_and_options_exist():
    named = [
        (page, command, rest)
        for page in PAGES
        for code in CODE.findall(page.read_text(encoding="utf-8").replace("\\\n", " "))
        for command, rest in COMMAND.findall(code)
    ]
    assert len(named) > 100
    missing = [
        f"{page.name}: thermap {command}{rest}: {option}"
        for page, command, rest in named
        for option in [command, *OPTION.findall(rest)]
        if option not in known_of(command, rest.split())
    ]
    assert missing == []


loaded = cache(load)


def known_of(command, words):
    """Name a command, where there is one, and the options of what the words after it say."""
    if command not in COMMANDS:
        return set()
    meant = loaded(command)
    parts = getattr(meant, "commands", {})
    if parts and words and words[0] not in parts and not words[0].startswith("-"):
        return set()
    for word in words:
        meant = parts.get(word, meant)
    options = {name for one in meant.params for name in (*one.opts, *one.secondary_opts)}
    return options | {command, "--help", "-h"}


def variables_of(command):
    """Name the variables that set the options of a command, and of those below it."""
    for option in command.params:
        yield from [option.envvar] if isinstance(option.envvar, str) else option.envvar or ()
    for below in getattr(command, "commands", {}).values():
        yield from variables_of(below)


def test_named_variables_exist():
    sources = [*ROOT.glob("*.yml"), *(ROOT / "compose").rglob("*")]
    sources += [p for room in ROOMS for p in (ROOT / room).rglob("*.py")]
    known = {
        name
        for path in sources
        if path.is_file()
        for name in VARIABLE.findall(path.read_text(encoding="utf-8"))
    }
    known |= {name for command in COMMANDS for name in variables_of(load(command))}
    missing = [
        f"{page.name}: {name}"
        for page in PAGES
        for name in sorted(set(VARIABLE.findall(page.read_text(encoding="utf-8"))) - known)
    ]
    assert missing == []


def test_named_tests_exist():
    defined = {
        name
        for path in (ROOT / "tests").rglob("test_*.py")
        for name in re.findall(r"def (test_\w+)\(", path.read_text(encoding="utf-8"))
    }
    named = [
        (page, name)
        for page in PAGES
        for name in re.findall(r"`(?:[\w/.]+::)?(test_\w+)`", page.read_text(encoding="utf-8"))
    ]
    assert len(named) > 80
    assert [f"{page.name}: {name}" for page, name in named if name not in defined] == []


def test_named_commits_are_in_the_history():
    if git("rev-parse", "--is-shallow-repository") != (0, "false"):
        pytest.skip("there is no whole history here")
    missing = [
        f"{page.name}: {name}"
        for page in PAGES
        for name in sorted(set(COMMIT.findall(page.read_text(encoding="utf-8"))))
        if git("merge-base", "--is-ancestor", name, "HEAD")[0] != 0
    ]
    assert missing == []


def git(*words):
    """Git's exit code and its answer about the folder of the project; 127 where there is no git."""
    # A folder unpacked inside another repository has no history of its own.
    if not (ROOT / ".git").exists():
        return 128, ""
    try:
        done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True)
    except FileNotFoundError:
        return 127, ""
    return done.returncode, done.stdout.strip()


def test_every_dependency_has_its_reason():
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    lines = text.split("\ndependencies = [\n")[1].split("]\n")[0].splitlines()
    assert [line for line in lines if not re.search(r'^    "[^"]+", # \w|, # /', line)] == []


def test_the_readme_and_its_pictures_are_short():
    assert (ROOT / "README.md").stat().st_size < 8_000
    pictures = sorted((ROOT / "docs" / "pictures").iterdir())
    assert len(pictures) == 3
    assert all(picture.stat().st_size < 150_000 for picture in pictures)


def test_the_first_screen_of_the_readme_has_both_commands():
    first_screen = (ROOT / "README.md").read_text(encoding="utf-8")[:2500]
    assert "pip install . && thermap demo" in first_screen
    assert 'pip install -e ".[test]" && pytest' in first_screen
