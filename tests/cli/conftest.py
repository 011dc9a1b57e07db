"""The command line in this process and in one of its own, and a service to speak to."""

import fcntl
import os
import pty
import signal
import struct
import subprocess
import sys
import termios
import time
from pathlib import Path

import httpx
import pytest
from typer.testing import CliRunner

from app.cli import application
from app.cli.listening import listening, serving, url_of
from app.main import create_app
from app.settings import Settings
from tests.service_examples import furnish_database
from thermap import ThermapClient

ROOT = Path(__file__).parent.parent.parent
ENVIRONMENT = {
    name: value
    for name, value in os.environ.items()
    if name not in ("COLUMNS", "LINES") and not name.startswith("THERMAP_")
} | {"PYTHONPATH": str(ROOT)}


@pytest.fixture
def service_and_url(databases):
    """A running service with the example machine and three maps, and where it listens."""
    database_url = databases.prepared("sqlite", furnish_database)
    service = create_app(Settings(database_url=database_url))
    with listening("127.0.0.1", 0, "serve") as opened, serving(service, opened, "warning"):
        yield service, url_of(opened)
    databases.give_back(database_url)


@pytest.fixture
def service_url(service_and_url):
    """Where a running service with the example machine and three maps listens."""
    return service_and_url[1]


@pytest.fixture
def client(service_url):
    with ThermapClient(service_url) as client:
        yield client


@pytest.fixture
def no_service_url():
    """A URL where nobody listens."""
    with listening("127.0.0.1", 0, "serve") as opened:
        return url_of(opened)


@pytest.fixture
def run():
    """Run a command in this process."""

    def run_here(*arguments, columns=80, **environment):
        words = [str(argument) for argument in arguments]
        env = {"COLUMNS": str(columns)} | environment
        return CliRunner().invoke(application, words, env=env, prog_name="thermap")

    return run_here


@pytest.fixture
def thermap(service_url, run):
    """Run a command against the running service."""

    def run_there(*arguments, **options):
        return run(*arguments, THERMAP_URL=service_url, **options)

    return run_there


@pytest.fixture
def start(tmp_path):
    """Start commands in processes of their own, and end them whatever happens."""
    started = []

    def start_apart(*arguments, **streams):
        process = subprocess.Popen(
            [sys.executable, "-m", "app", *map(str, arguments)],
            **streams or {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True},
            cwd=tmp_path,
            env=ENVIRONMENT | {"XDG_DATA_HOME": str(tmp_path), "TERM": "xterm"},
            # A shell that runs the tests in the background lets them ignore Ctrl+C, and all
            # that they start.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )
        started.append(process)
        return process

    yield start_apart
    for process in started:
        process.kill()
        process.communicate()


@pytest.fixture
def start_on_terminal(start):
    """Start commands on a terminal of some rows and columns; give our side of it too."""
    opened = []

    def start_there(rows, columns, *arguments):
        ours, theirs = pty.openpty()
        opened.append(ours)
        fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
        process = start(*arguments, stdin=theirs, stdout=theirs, stderr=theirs)
        os.close(theirs)
        return process, ours

    yield start_there
    for ours in opened:
        os.close(ours)


@pytest.fixture
def free_port():
    with listening("127.0.0.1", 0, "serve") as opened:
        return opened.getsockname()[1]


def wait_until_it_answers(url, within_s=120.0):
    end = time.monotonic() + within_s
    while time.monotonic() < end:
        try:
            return httpx.get(f"{url}/healthz", trust_env=False).json()
        except httpx.TransportError:
            time.sleep(0.05)
    raise AssertionError(f"nothing at {url} within {within_s} s")


def ended(process, number=signal.SIGTERM, within_s=120.0):
    """Send a signal and wait; return exit code, stdout, stderr."""
    process.send_signal(number)
    out, err = process.communicate(timeout=within_s)
    return process.returncode, out, err
