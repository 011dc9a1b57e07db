"""thermap worker --check: whether a worker lives, as its own file says."""

import json
import signal
import threading
import time
from contextlib import suppress

import pytest

from app.cli.beat import LIVES_S, Beat, check_beat
from app.cli.listening import exiting_on_signals, wait_for_signal
from app.errors import InvalidContent
from tests.databases import reachable


@pytest.fixture
def file(tmp_path):
    return tmp_path / "worker.beat"


def test_a_worker_lives_as_long_as_it_writes(file, monkeypatch):
    now = [1000.0]
    monkeypatch.setattr("app.cli.beat.monotonic", lambda: now[0])
    beat = Beat(file)
    beat.begin()
    assert check_beat(file) == (True, "the worker lives; its database has not answered yet")
    beat.write(True)
    now[0] += LIVES_S - 1.0
    assert check_beat(file) == (True, "the worker lives")
    now[0] += 1.0
    assert check_beat(file) == (False, "the worker has not looked at its queue for 60 s")
    beat.write(False)
    words = "the worker lives; its database has not answered for 60 s"
    assert check_beat(file) == (True, words)
    now[0] = 5.0  # the computer was started anew, and the file is still there
    assert not check_beat(file)[0]
    beat.end()
    assert check_beat(file) == (False, f"no worker writes {file}")


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"beat_s": "x", "queue_answered_s": null}'])
def test_another_file_is_no_worker(file, text):
    file.write_text(text)
    lives, words = check_beat(file)
    assert not lives
    assert words.startswith(f"{file} is not what a worker writes")


def test_a_file_that_cannot_be_written_is_said_at_the_start_and_ends_no_worker(tmp_path, caplog):
    beat = Beat(tmp_path / "nowhere" / "worker.beat")
    with pytest.raises(InvalidContent, match="expected a file that can be written"):
        beat.begin()
    beat.write(True)
    assert "cannot write that this worker lives" in caplog.text


def test_the_check_needs_to_know_the_file(run):
    found = run("worker", "--check", columns=200)
    assert found.exit_code == 2
    assert "--beat-file" in found.stderr


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["sqlite", "postgresql"])
def test_a_worker_writes_while_it_runs_and_no_more(start, run, file, databases, kind):
    url = reachable(databases.migrated, kind)
    process = start("worker", "--database-url", url, "--beat-file", str(file))
    until(lambda: written(file) is not None, process)
    assert run("worker", "--check", "--beat-file", str(file)).exit_code == 0
    first = written(file)
    until(lambda: written(file) > first, process)
    process.send_signal(signal.SIGTERM)
    assert process.wait(60) == 0
    found = run("worker", "--check", "--beat-file", str(file))
    assert (found.exit_code, found.stderr) == (1, f"no worker writes {file}\n")
    databases.give_back(url)


def written(file):
    """When the queue answered last, as the file has it."""
    with suppress(FileNotFoundError):
        return json.loads(file.read_text())["queue_answered_s"]
    return None


def until(is_so, process):
    deadline = time.monotonic() + 120.0
    while not is_so():
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.05)


def test_a_signal_that_another_thread_takes_ends_the_wait_too():
    """The system chooses who takes a process' signal; that does not wake the main thread."""

    def take():
        time.sleep(0.2)  # until then the main thread waits
        signal.pthread_kill(threading.get_ident(), signal.SIGTERM)

    other = threading.Thread(target=take)

    def wait():
        other.start()
        wait_for_signal()

    with exiting_on_signals(), pytest.raises(SystemExit):
        wait()
    other.join()
