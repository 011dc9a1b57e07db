"""The commands of the documents work: each page's, in their order, against a running demo.

Blocks of `sh` and `python` are run in a folder that has the files which the page shows (a block
`csv run1.csv` is a file of that name). What cannot run here is marked ("```sh not-run"):
it installs, starts or needs something else; that its commands and options exist is held by
`test_documentation`.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from scripts.running_demo import running_demo
from tests.documented_pages import PAGES, ROOT

BLOCK = re.compile(r"^```(\w+)(?: ([^\n]*))?\n(.*?)^```$", re.DOTALL | re.MULTILINE)
RUN = {"sh": ["bash", "-euo", "pipefail", "-c"], "python": [sys.executable, "-c"]}
PATIENCE_S = 600


def blocks(page):
    """Give language, what stands behind it, and text of each block of a page."""
    return BLOCK.findall(page.read_text(encoding="utf-8"))


def has_commands(page):
    return any(language in RUN and not more for language, more, _ in blocks(page))


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    """Where the running demo is, and its database, for commands that work beside it."""
    folder = tmp_path_factory.mktemp("demo")
    clean = {name: value for name, value in os.environ.items() if not name.startswith("THERMAP_")}
    with running_demo(folder) as url:
        yield clean | {
            "PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]),
            "PYTHONPATH": str(ROOT),
            "THERMAP_URL": url,
            "THERMAP_DATABASE_URL": f"sqlite:///{folder}/demo.db",
            # What is in the week; among all kinds it is found in tests/simulation/test_week.py.
            "THERMAP_EFFECTS": "thermal-lag",
        }


@pytest.mark.slow
@pytest.mark.parametrize(
    "page", list(filter(has_commands, PAGES)), ids=lambda page: str(page.relative_to(ROOT))
)
def test_the_commands_of_the_page_work_in_their_order(page, environment, tmp_path):
    for language, more, text in blocks(page):
        if language in RUN and not more:
            done = subprocess.run(
                [*RUN[language], text.replace("http://127.0.0.1:8000", environment["THERMAP_URL"])],
                cwd=tmp_path, env=environment, capture_output=True, text=True,
                timeout=PATIENCE_S, stdin=subprocess.DEVNULL,
            )  # fmt: skip
            assert done.returncode == 0, f"{text}\n{done.stdout}\n{done.stderr}"
        elif more and more != "not-run":
            (tmp_path / more).write_text(text, encoding="utf-8")
