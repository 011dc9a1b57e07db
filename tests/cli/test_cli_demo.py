"""thermap demo: within seconds a compensation table, labelled as simulated, and a clean end."""

import io
import os
import re
import select
import signal
import time
from datetime import UTC, datetime, timedelta

import pytest
from rich.console import Console

from app.cli.demo_machine import HISTORY, set_up
from app.cli.demo_view import current_view, short_line
from app.cli.demo_week import compare_later, set_up_week, week_hint
from app.cli.listening import listening
from app.errors import Conflict
from app.simulation.week import make_week
from tests.cli.conftest import ended
from thermap import ThermapClient


def read_until(process, words, within_s=120.0):
    """Read a process' output until it has these words."""
    end, text = time.monotonic() + within_s, ""
    while words not in text:
        ready, _, _ = select.select([process.stdout], [], [], end - time.monotonic())
        assert ready, f"no {words!r} within {within_s} s in:\n{text}"
        part = os.read(process.stdout.fileno(), 65536).decode()
        assert part, f"ended before {words!r}:\n{text}\n{process.stderr.read()}"
        text += part
    return text


@pytest.mark.slow
def test_a_table_in_a_pipe_and_a_service_behind_it(start, tmp_path):
    process = start("demo", "--port", "0")
    text = read_until(process, "minus the error")
    assert text.count("SIMULATED") == 2
    assert "thermap analyse mcfv5050-week --adopt" in text
    # The chapter's argument: three maps leave less than two, two less than none.
    rows = re.findall(r"(?:none|#1, #6|#1, #3, #6) +((?:\d+\.\d\d *){6})\n", text)
    remains = [[float(number) for number in row.split()] for row in rows]
    assert len(remains) == 9
    assert all(a < b < c for c, b, a in zip(*remains[:3], strict=True))
    assert re.search(r"x-middle \d\d\.\d\d °C, Run #\d to Run #\d, weight \d\.\d\d", text)
    assert "ISO C0Y" in text
    url = re.search(r"http://127.0.0.1:\d+", text)[0]
    with ThermapClient(url) as client:
        before = client.current_table("mcfv5050").table.reading_time
        end = time.monotonic() + 60.0
        while client.current_table("mcfv5050").table.reading_time == before:
            assert time.monotonic() < end, f"no reading after {before}"
            time.sleep(0.1)
    assert (tmp_path / "thermap" / "thermap-demo.db").is_file()
    code, _, err = ended(process, signal.SIGINT)
    assert (code, err) == (0, "")


@pytest.mark.slow
def test_on_a_terminal_it_ends_with_ctrl_c_too(start_on_terminal, tmp_path):
    process, terminal = start_on_terminal(24, 80, "demo", "--port", "0")
    text, end = "", time.monotonic() + 120.0
    while "minus the error" not in text:
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


@pytest.mark.slow
@pytest.mark.parametrize("columns", [80, 120])
def test_the_table_has_every_component_in_the_width_of_the_terminal(client, columns):
    client.delete_machine("mcfv5050")
    table = client.current_table(set_up(client)).table
    console = Console(file=io.StringIO(), width=columns, highlight=False)
    console.print(current_view(table, columns))
    text = console.file.getvalue()
    assert max(map(len, text.splitlines())) <= columns
    assert all(entry.component in text for entry in table.components)
    assert short_line(table).count("greatest") == 1


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
    assert (table.complete, table.warnings, len(table.components)) == (True, [], 21)
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


def later_without_week(run, url, *typed, **environment):
    """Where `thermap demo --later` looked for the week: a service without it says its URL."""
    found = run("demo", "--later", *typed, **environment)
    assert found.exit_code == 1
    return f"{url} has no machine 'mcfv5050-week'" in found.stderr


def test_later_finds_the_service_as_every_other_command_does(run, service_url, no_service_url):
    port = service_url.rpartition(":")[2]
    assert later_without_week(run, service_url, THERMAP_URL=service_url)
    assert later_without_week(run, service_url, "--url", service_url, THERMAP_URL=no_service_url)
    assert later_without_week(run, service_url, "--port", port, THERMAP_URL=no_service_url)
    assert later_without_week(run, service_url, THERMAP_PORT=port)


def test_a_demo_that_starts_its_own_service_refuses_the_url_of_another(run, service_url):
    found = run("demo", "--url", service_url, "--port", "0")
    assert found.exit_code == 2
    assert "--no-serve" in found.stderr


def test_the_week_s_commands_are_whole_lines_however_narrow_the_terminal():
    console = Console(file=io.StringIO(), width=40, highlight=False)
    console.print(week_hint("http://127.0.0.1:18100"), crop=False)
    lines = console.file.getvalue().splitlines()
    assert "  thermap demo --later --url http://127.0.0.1:18100" in lines


@pytest.fixture
def week(client):
    """The week, as the demo loads it."""
    set_up_week(client)
    yield make_week()
    client.delete_machine("mcfv5050-week")


@pytest.mark.slow
def test_the_week_is_analysed_adopted_and_held_against_what_came_later(thermap, client, week):
    assert len(client.verifications("mcfv5050-week")) == 1
    set_up_week(client)  # a demo that starts again
    assert len(client.verifications("mcfv5050-week")) == 1
    with pytest.raises(Conflict, match="no effect is adopted yet"):
        compare_later(client, week)
    found = thermap("analyse", "mcfv5050-week", "--adopt", "--effects", "thermal-lag")
    assert found.exit_code == 0, found.output
    (component,) = week.effects[0]["components"]
    assert component in found.stdout
    compared = compare_later(client, week)
    before, after = (one.overall.rms for one in compared.versions)
    assert after < before
    of = {one.component: i for i, one in enumerate(compared.versions[0].components)}
    before, after = (one.components[of[component]].rms for one in compared.versions)
    assert after < 0.6 * before


@pytest.mark.slow
def test_a_machine_of_that_id_that_is_not_simulated_gets_no_simulated_reading(client):
    client.create_machine(make_week().machine | {"name": "A real one"})
    try:
        with pytest.raises(Conflict, match="not the simulated one"):
            set_up_week(client)
        assert client.error_maps("mcfv5050-week") == []
    finally:
        client.delete_machine("mcfv5050-week")
