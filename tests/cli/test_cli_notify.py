"""Who is told of alarms, in a terminal; and a test message that is waited for."""

from datetime import UTC, datetime

import pytest
from rich.console import Console

from app.cli.listening import listening, serving, url_of
from app.cli.notify import receivers_view
from app.main import create_app
from app.settings import Settings
from tests.connections.receiver_examples import Webhook
from tests.service_examples import UNHURRIED
from thermap.answers import Receiver, Receivers


def test_a_service_without_receivers(run, service_url):
    result = run("notify", "--url", service_url)
    assert result.exit_code == 0
    assert "nobody is told of alarms: [[notify]] in the file of" in result.stdout
    result = run("notify", "test", "--url", service_url)
    assert result.exit_code == 1
    assert "there is no receiver" in result.stderr
    result = run("notify", "test", "anna", "--url", service_url)
    assert result.exit_code == 1
    assert "there is no receiver 'anna'" in result.stderr


def test_a_test_message_is_waited_for(run, databases, tmp_path):
    pytest.importorskip("apprise")
    url = databases.migrated("sqlite")
    config = tmp_path / "thermap.toml"
    with Webhook().open() as hook:
        config.write_text(
            f'[[notify]]\nname = "anna"\nurl = "{hook.url}"\n'
            '[[notify]]\nname = "away"\nurl = "json://127.0.0.1:9"\n'
        )
        checked = run("connections", "check", str(config), columns=500)
        assert "2 receivers: anna, away" in checked.stdout
        service = create_app(Settings(database_url=url, config=config, **UNHURRIED))
        with listening("127.0.0.1", 0, "serve") as socket, serving(service, socket, "warning"):
            address = url_of(socket)
            while "anna" not in run("notify", "--url", address).stdout:
                pass  # it looks for the first time a second after its start
            result = run("notify", "test", "anna", "--url", address)
            assert (result.exit_code, result.stdout) == (0, "anna: sent by JSON\n")
            result = run("notify", "test", "away", "--url", address)
            assert result.exit_code == 1
            assert "away: not sent: " in result.stderr
    assert [title for title, _ in hook.came] == ["thermap: test"]
    databases.give_back(url)


def test_those_that_cannot_be_told_come_first():
    at = datetime(2026, 3, 1, 6, tzinfo=UTC)

    def one(name, **more):
        return Receiver(
            **{
                "name": name,
                "service": "E-Mail",
                "machines": [],
                "trouble": "",
                "trouble_since": None,
                "waiting": [],
                "sent_at": at,
                "sent": "thermap: vmc limited",
                "test_asked_at": None,
                "tested_at": None,
                "test_failure": "",
                **more,
            }
        )

    console = Console(width=200, no_color=True)
    away = one("away", trouble="no answer", trouble_since=at, waiting=["vmc"], machines=["vmc"])
    with console.capture() as captured:
        console.print(receivers_view(Receivers(receivers=[one("good"), away])))
    lines = captured.get().splitlines()
    rows = [line for line in lines if "E-Mail" in line]
    assert rows[0].startswith("away")
    assert "no answer, since 2026-03-01 06:00" in rows[0]
    assert "all" in rows[1]
