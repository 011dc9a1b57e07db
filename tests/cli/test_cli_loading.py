"""What a command loads: help, version and completion need neither service nor numerics."""

import json
import subprocess
import sys

import pytest

from app import __version__
from app.cli.application import COMMANDS, load
from tests.cli.conftest import ENVIRONMENT

HEAVY = {
    *("thermap.calls", "httpx", "app.services", "app.storage", "app.stated"),
    *("scipy", "numpy", "sqlalchemy", "alembic", "fastapi", "uvicorn", "plotly"),
}
SERVICE = {
    *("app.services", "app.live", "app.main", "app.storage.tables"),
    *("sqlalchemy", "alembic", "fastapi", "uvicorn", "scipy", "plotly"),
}

LOADED = """
import json, sys
from app.cli import main
sys.argv = ["thermap", *sys.argv[1:]]
try:
    main()
finally:
    print(json.dumps(sorted(sys.modules)), file=sys.stderr)
"""


def loaded(*arguments, **environment):
    """Run a command in a process of its own; give what it wrote and the modules it loaded."""
    done = subprocess.run(
        [sys.executable, "-c", LOADED, *arguments],
        capture_output=True,
        text=True,
        env=ENVIRONMENT | environment,
        timeout=120,
    )
    return done.stdout, set(json.loads(done.stderr.splitlines()[-1]))


def test_the_version_needs_nothing():
    said, modules = loaded("--version")
    assert said == f"thermap {__version__}\n"
    assert not modules & HEAVY
    assert not {name for name in modules if name.startswith("app.cli.")} - {
        "app.cli.application",
        "app.cli.terminal",
    }


@pytest.mark.slow
@pytest.mark.parametrize("words", [(), ("machines",), ("maps", "delete"), ("verifications",)])
def test_help_needs_no_numerics_and_no_service(words):
    said, modules = loaded(*words, "--help")
    assert "Usage: thermap" in said
    assert not modules & HEAVY


@pytest.mark.parametrize(
    ("written", "completed"),
    [("thermap ma", {"machines", "maps"}), ("thermap maps de", {"delete"})],
)
def test_completion_needs_no_numerics_and_no_service(written, completed):
    said, modules = loaded(
        _THERMAP_COMPLETE="complete_bash",
        COMP_WORDS=written,
        COMP_CWORD=str(len(written.split()) - 1),
    )
    assert set(said.split()) == completed
    assert not modules & HEAVY


@pytest.mark.slow
def test_commands_that_only_ask_the_service_do_not_load_it(service_url):
    said, modules = loaded("machines", "list", THERMAP_URL=service_url)
    assert "mcfv5050" in said
    assert not modules & SERVICE


def test_the_list_of_commands_says_what_each_says_of_itself():
    for name, summary in COMMANDS.items():
        assert load(name).help.split("\n\n")[0].replace("\n", " ") == summary
