"""thermap demo: within seconds a compensation table, labelled as simulated, and a clean end."""

import os
import re
import select
import signal
import time
from datetime import UTC, datetime, timedelta

import pytest

from app.cli.demo_machine import HISTORY, set_up
from app.cli.listening import listening
from app.client import ThermapClient
from app.errors import Conflict
from tests.cli.conftest import ended


def read_until(process, words, within_s=20.0):
    """Read a process' output until it has these words."""
    end, text = time.monotonic() + within_s, ""
    while words not in text:
        ready, _, _ = select.select([process.stdout], [], [], end - time.monotonic())
        assert ready, f"no {words!r} within {within_s} s in:\n{text}"
        part = os.read(process.stdout.fileno(), 65536).decode()
        assert part, f"ended before {words!r}:\n{text}\n{process.stderr.read()}"
        text += part
    return text


def test_a_table_in_a_pipe_and_a_service_behind_it(start, tmp_path):
    process = start("demo", "--port", "0")
    text = read_until(process, "minus the error")
    assert text.count("SIMULATED") == 2
    # The chapter's argument: three maps leave less than two, two less than none.
    rows = [line for line in text.splitlines() if re.search(r"#1, #|none \(", line)]
    remains = [float(row[31:39]) for row in rows]
    assert len(remains) == 9
    assert remains[2] < remains[1] < remains[0]
    assert re.search(r"x-middle \d\d\.\d\d °C, Run #\d to Run #\d, weight \d\.\d\d", text)
    assert "ISO C0Y" in text
    url = re.search(r"http://127.0.0.1:\d+", text)[0]
    with ThermapClient(url) as client:
        before = client.current_table("mcfv5050").table.reading_time
        time.sleep(1.2)
        assert client.current_table("mcfv5050").table.reading_time > before
    assert (tmp_path / "thermap" / "thermap-demo.db").is_file()
    code, _, err = ended(process, signal.SIGINT)
    assert (code, err) == (0, "")


def test_a_live_view_on_a_terminal_that_ends_with_ctrl_c(start_on_terminal, tmp_path):
    process, terminal = start_on_terminal(24, 80, "demo", "--port", "0")
    text, end = "", time.monotonic() + 20.0
    while text.count("computed") < 3:
        assert select.select([terminal], [], [], end - time.monotonic())[0], text
        text += os.read(terminal, 65536).decode(errors="replace")
    process.send_signal(signal.SIGINT)
    while True:
        try:
            text += os.read(terminal, 65536).decode(errors="replace")
        except OSError:  # Linux' way to say that the other side is closed
            break
    assert process.wait(10.0) == 0
    assert "Traceback" not in text
    # The whole table fits 24 lines: its last component is there.
    assert "SZX" in text


def test_setting_up_again_changes_nothing(client):
    client.delete_machine("mcfv5050")
    assert set_up(client) == "mcfv5050"
    versions, maps = client.models("mcfv5050"), client.error_maps("mcfv5050")
    assert [m.label for m in maps] == ["Run #1", "Run #3", "Run #6"]
    assert set_up(client) == "mcfv5050"
    assert (client.models("mcfv5050"), client.error_maps("mcfv5050")) == (versions, maps)


def test_history_comes_before_the_first_live_reading(client):
    client.delete_machine("mcfv5050")
    set_up(client)
    now = datetime.now(UTC)
    readings = client.readings("mcfv5050")
    assert now - HISTORY - timedelta(seconds=10) < readings[0].time < now - timedelta(minutes=4)
    assert now - timedelta(seconds=10) < readings[-1].time <= now
    table = client.current_table("mcfv5050").table
    assert (table.complete, table.warnings, len(table.components)) == (True, [], 12)
    assert {s.health for s in table.sensors} == {"ok"}


def test_a_real_machine_of_that_name_is_left_alone(client):
    with pytest.raises(Conflict, match="not the simulated one"):
        set_up(client)
    assert client.readings("mcfv5050") == []


def test_a_port_in_use(run, tmp_path):
    with listening("127.0.0.1", 0, "demo") as opened:
        port = opened.getsockname()[1]
        found = run("demo", "--port", port, "--database-url", f"sqlite:///{tmp_path}/x.db")
    assert found.exit_code == 1
    assert f"try `thermap demo --port {port + 1}`" in found.stderr
