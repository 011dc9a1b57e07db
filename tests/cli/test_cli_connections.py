"""How connections fare in a terminal, and their file before the service starts with it."""

import json
from datetime import UTC, datetime

from rich.console import Console

from app.cli.connections import connections_view
from thermap.answers import Connection, ConnectionsNow

FILE = """
[[mtconnect]]
name = "mill"
machine = "vmc"
url = "http://127.0.0.1:9"
sensors = { x-middle = "X" }
"""


def test_a_service_without_connections(run, service_url):
    result = run("connections", "--url", service_url)
    assert result.exit_code == 0
    assert "no connections; `thermap serve --config FILE.toml`" in result.stdout
    assert "0 readings stored, 0 dropped, 0 values refused" in result.stdout
    result = run("connections", "--url", service_url, "--json")
    assert json.loads(result.stdout)["connections"] == []


def test_those_with_trouble_come_first():
    def one(name, **more):
        return Connection(
            **{
                "name": name,
                "kind": "opcua",
                "machines": ["vmc"],
                "endpoint": "opc.tcp://h:4840",
                "connected": True,
                "last_value_at": datetime(2026, 3, 1, 6, tzinfo=UTC),
                "known": 3,
                "trouble": "",
                "lost": 0,
                "taken": 4,
                "dropped": 0,
                "refused": 0,
                **more,
            }
        )

    found = ConnectionsNow(
        connections=[
            one("good"),
            one("gone", connected=False, last_value_at=None, trouble="no answer in time"),
            one("odd", trouble="x-middle: expected a number", lost=2),
        ],
        stored=5,
        dropped=1,
        refused=1,
        last_refusal="machine 'vmc': no",
        wrong_clocks=7,
        machines_with_wrong_clocks=["vmc"],
    )
    console = Console(width=200, record=True, highlight=False)
    console.print(connections_view(found))
    lines = console.export_text().splitlines()
    assert [line.split()[0] for line in lines[1:4]] == ["gone", "odd", "good"]
    assert "no answer in time" in lines[1]
    assert "x-middle: expected a number; 2 observations lost" in lines[2]
    assert "2026-03-01 06:00" in lines[3]
    assert lines[5] == (
        "5 readings stored, 1 dropped, 1 value refused, 7 values with a wrong clock; now of vmc"
    )
    assert lines[6] == "last refused: machine 'vmc': no"


def test_a_file_is_checked_without_a_service(run, tmp_path):
    path = tmp_path / "thermap.toml"
    path.write_text(FILE, encoding="utf-8")
    result = run("connections", "check", str(path), columns=500)
    assert (result.exit_code, result.stdout) == (0, f"{path}: 1 connection: mill\n")
    path.write_text(FILE + "every = 1\n", encoding="utf-8")
    result = run("connections", "check", str(path), columns=500)
    assert result.exit_code == 1
    assert "mtconnect.0.every: extra inputs are not permitted" in result.stderr
