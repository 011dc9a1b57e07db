"""People are told of alarms: by real messages to receivers on this computer."""

import math
from datetime import timedelta

import pytest

pytest.importorskip("apprise", reason="the extra notify is not installed")
pytest.importorskip("aiosmtpd")

from app.connections.config import read_connections
from app.connections.notify_receiver import NotifyReceiver, NotifyTable
from app.errors import InvalidContent
from app.services import events, tell_receivers
from app.services.events import AlarmLog
from app.services.tell_receivers import ReceiverTelling
from tests.connections.receiver_examples import Webhook, mail_server
from tests.service_examples import (
    MACHINE,
    ROOM,
    client_of,
    error_map,
    furnish_database,
    problem,
    reading,
)

pytestmark = pytest.mark.anyio

SINCE = "Sun 1 Mar 2026, 07:01 CET"


def receiver(url, **stated):
    table = {"name": "maintenance", "url": url, "zone": "Europe/Prague"} | stated
    return NotifyReceiver(NotifyTable.model_validate(table), "http://shop:8000")


class Shop:
    """A service whose temperatures, clock and receivers move when they are told to."""

    def __init__(self, app, client, clock, receivers):
        self.app, self.client, self.clock = app, client, clock
        self.log = AlarmLog(app.state.context)
        self.telling = ReceiverTelling(app.state.context, receivers)

    async def at(self, t_c, minutes=1.0, room=ROOM):
        """Let some time pass, and a reading come; above 30 °C the machine is limited."""
        self.clock.advance(60.0 * minutes)
        answer = await self.client.post(f"{room}/readings", json=reading(self.clock(), t_c))
        assert answer.status_code == 201, answer.text
        for _ in range(3):
            self.log.look()
        self.telling.look()

    async def warm(self, t_c, minutes, every=1):
        """The same for a time, a reading every so many minutes."""
        for _ in range(0, minutes, every):
            await self.at(t_c, every)

    async def receiver(self):
        answer = await self.client.get("/v1/receivers")
        assert answer.status_code == 200, answer.text
        (one,) = answer.json()["receivers"]
        return one


@pytest.fixture
def app(new_app, databases):
    """On SQLite: what is asked of the database, others ask of both kinds."""
    return new_app(databases.prepared("sqlite", furnish_database))


@pytest.fixture
def hook(monkeypatch):
    monkeypatch.setattr(tell_receivers, "FIRST_PAUSE_S", 0.0)
    # A slow computer looks at all machines too, and at none because time has passed meanwhile.
    monkeypatch.setattr(events, "AT_MOST_S", math.inf)
    monkeypatch.setattr(events, "JUDGED_AGAIN_S", math.inf)
    with Webhook().open() as opened:
        yield opened


@pytest.fixture
async def shop(app, client, clock, hook):
    return Shop(app, client, clock, [receiver(hook.url)])


async def test_an_alarm_is_told_once_and_its_end_once(shop, hook):
    await shop.at(29.0)
    assert hook.came == []
    await shop.warm(30.5, 8)
    ((title, text),) = hook.came
    assert title == "thermap: MCFV5050LN limited"
    lines = text.splitlines()
    assert lines[0] == "MCFV5050LN (mcfv5050): limited, since Sun 1 Mar 2026, 07:02 CET"
    assert "0.50 K above" in lines[1]
    assert lines[-2].startswith("To do: let the machine come back to the temperatures of its maps")
    assert lines[-1] == "http://shop:8000/machines/mcfv5050"
    await shop.warm(29.0, 9)
    assert len(hook.came) == 1  # it may come again
    await shop.warm(29.0, 5)
    assert [title for title, _ in hook.came[1:]] == ["thermap: MCFV5050LN trusted again"]
    assert "It was limited from Sun 1 Mar 2026, 07:02 CET to" in hook.came[1][1]
    await shop.warm(29.0, 30, every=5)
    assert len(hook.came) == 2
    told = await shop.receiver()
    assert (told["sent"], told["trouble"], told["waiting"]) == (hook.came[1][0], "", [])


async def test_what_comes_and_goes_is_one_message(shop, hook):
    for _ in range(6):
        await shop.warm(30.5, 2)
        await shop.warm(29.0, 2)
    assert len(hook.came) == 1
    await shop.warm(29.0, 11)
    assert len(hook.came) == 2


async def test_what_lasts_shorter_than_asked_for_is_not_told(app, client, clock, hook):
    shop = Shop(app, client, clock, [receiver(hook.url, after_s=600.0)])
    await shop.warm(30.5, 5)
    await shop.warm(29.0, 20)
    assert hook.came == []


async def test_what_lasts_is_told_again(app, client, clock, hook):
    shop = Shop(app, client, clock, [receiver(hook.url, repeat_h=1.0)])
    await shop.warm(30.5, 110, every=5)
    assert [title for title, _ in hook.came] == [
        "thermap: MCFV5050LN limited",
        "thermap: MCFV5050LN still limited",
    ]


async def test_a_receiver_that_was_away_is_told_later_once(shop, hook):
    hook.answer = 503
    await shop.warm(30.5, 20)
    told = await shop.receiver()
    assert hook.came == []
    assert "503" in told["trouble"]
    assert told["waiting"] == ["mcfv5050"]
    assert told["trouble_since"] < told["trouble_since"][:14] + "59:59Z"
    page = (await shop.client.get("/machines/mcfv5050/events")).text
    assert "Not told: " in page
    hook.answer = 200
    await shop.warm(30.6, 10)
    assert [title for title, _ in hook.came] == ["thermap: MCFV5050LN limited"]
    assert "since Sun 1 Mar 2026, 07:01 CET" in hook.came[0][1]
    assert (await shop.receiver())["trouble"] == ""


async def test_what_came_and_went_while_it_was_away_is_told_too(shop, hook):
    hook.answer = 503
    await shop.warm(30.5, 5)
    await shop.at(29.0)
    await shop.warm(29.0, 30, every=5)
    hook.answer = 200
    await shop.warm(29.0, 10)
    ((title, text),) = hook.came
    assert title == "thermap: MCFV5050LN was limited, is trusted again"
    assert "It was limited from Sun 1 Mar 2026, 07:01 CET to Sun 1 Mar 2026, 07:06 CET" in text


async def test_many_machines_are_one_message(shop, client, clock, hook):
    """Alarms of many machines that come together, and one each minute after that."""
    rooms = [f"/v1/machines/m{i}" for i in range(25)]
    for i, room in enumerate(rooms):
        machine = MACHINE | {"id": f"m{i}", "name": f"Mill {i}"}
        assert (await client.post("/v1/machines", json=machine)).status_code == 201
        for label, t_c in (("Run #1", 20.0), ("Run #6", 30.0)):
            stored = await client.post(f"{room}/error-maps", json=error_map(label, t_c))
            assert stored.status_code == 201
    for room in rooms[:-4]:
        await shop.at(31.0, 0.0, room)
    clock.advance(61)
    for room in rooms[-4:]:
        await shop.at(31.0, 1.0, room)
    assert len(hook.came) == 1
    assert (await shop.receiver())["waiting"]
    await shop.warm(29.0, 6)
    assert len(hook.came) <= 3
    ((first, text), (second, rest), *_) = hook.came
    assert first == "thermap: 24 machines: 3 not trusted, 21 limited"  # three were not read yet
    assert text.startswith("Mill 22 (m22): not trusted, since ")
    assert text.endswith("… and 4 more machines: http://shop:8000/")
    assert second == "thermap: 4 machines: 4 limited"
    assert rest.count("To do: ") == 4


async def test_after_a_restart_nothing_is_told_again(shop, hook):
    await shop.warm(30.5, 10)
    again = Shop(shop.app, shop.client, shop.clock, [receiver(hook.url)])
    await again.warm(30.5, 10)
    assert len(hook.came) == 1
    last = Shop(shop.app, shop.client, shop.clock, [receiver(hook.url)])
    await last.warm(29.0, 12)
    assert len(hook.came) == 2


async def test_of_two_services_one_sends(new_app, postgresql_example, clock, hook):
    apps = [new_app(postgresql_example) for _ in range(2)]
    tellings = [ReceiverTelling(app.state.context, [receiver(hook.url)]) for app in apps]
    async with client_of(apps[0]) as client:
        shop = Shop(apps[0], client, clock, [])
        for _ in range(8):
            await shop.at(30.5)
            for telling in tellings:
                if telling._is_ours():
                    telling.look()
        assert len(hook.came) == 1
        tellings[0].stop()
        for _ in range(14):
            await shop.at(29.0)
            if tellings[1]._is_ours():
                tellings[1].look()
        assert [title for title, _ in hook.came[1:]] == ["thermap: MCFV5050LN trusted again"]
        tellings[1].stop()


async def test_a_receiver_of_the_worst_alone_is_told_of_nothing_else(app, client, clock, hook):
    shop = Shop(app, client, clock, [receiver(hook.url, verdicts=["not-trusted"])])
    await shop.warm(30.5, 20)
    assert hook.came == []
    clock.advance(3600)  # no reading for an hour
    shop.log = AlarmLog(app.state.context)  # which judges at once
    for _ in range(3):
        shop.log.look()
    clock.advance(120)
    shop.telling.look()
    ((title, text),) = hook.came
    assert title == "thermap: MCFV5050LN not trusted"
    assert "To do: see whether the sensors and the program that sends" in text


async def test_other_machines_are_not_told_of(app, client, clock, hook):
    shop = Shop(app, client, clock, [receiver(hook.url, machines=["lathe"])])
    await shop.warm(30.5, 10)
    assert hook.came == []


async def test_an_email_arrives(app, client, clock):
    with mail_server() as (port, came):
        url = f"mailto://127.0.0.1:{port}/?from=thermap@shop.example&to=anna@shop.example"
        shop = Shop(app, client, clock, [receiver(url)])
        await shop.warm(30.5, 5)
    (mail,) = came
    assert mail["subject"] == "thermap: MCFV5050LN limited"
    assert "anna@shop.example" in mail["to"]
    body = mail.get_body(("plain", "html")).get_content()
    assert SINCE in body
    assert "http://shop:8000/machines/mcfv5050" in body


async def test_a_test_message_is_asked_for_anywhere_and_sent_by_who_has_the_receiver(shop, hook):
    shop.telling.look()
    hook.answer = 401
    answer = await shop.client.post("/v1/receivers/maintenance/test")
    assert answer.status_code == 202
    assert answer.json()["tested_at"] is None
    shop.telling.look()
    told = await shop.receiver()
    assert "401" in told["test_failure"] or "nauthor" in told["test_failure"]
    hook.answer = 200
    shop.clock.advance(60)
    await shop.client.post("/v1/receivers/maintenance/test")
    for _ in range(3):
        shop.telling.look()
    ((title, text),) = hook.came
    assert title == "thermap: test"
    assert "“maintenance”" in text
    told = await shop.receiver()
    assert told["test_failure"] == ""
    assert told["tested_at"] >= told["test_asked_at"]
    unknown = await shop.client.post("/v1/receivers/nobody/test")
    assert "maintenance" in problem(unknown, 404)["detail"]


async def test_who_runs_no_more_is_said(shop, hook):
    shop.telling.look()
    shop.clock.advance(3600)
    told = await shop.receiver()
    assert told["trouble"] == "no service runs that has it in its file"


async def test_an_address_is_shown_nowhere(app, client, clock):
    away = Webhook()  # nobody listens
    shop = Shop(app, client, clock, [receiver(away.url.replace("://", "://user:pa55word@"))])
    await shop.warm(30.5, 3)
    shown = (await shop.client.get("/v1/receivers")).text
    page = (await shop.client.get("/machines/mcfv5050/events")).text
    for text in (shown, page):
        assert "error occurred" in text
        assert "pa55word" not in text
        assert "t0ken" not in text


NOTIFY = '[[notify]]\nname = "n"\n'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (NOTIFY, "expected `url` or `url_env`, got both or none"),
        (NOTIFY + 'url_env = "THERMAP_NONE"\n', "got 'THERMAP_NONE': it is unset"),
        (NOTIFY + 'url = "nothing://pa55word"\n', "that begins with nothing://"),
        (NOTIFY + 'url = "pa55word"\n', "got one of 8 characters"),
        (NOTIFY + 'url = "json://h"\nzone = "Mars/Base"\n', "such as Europe/Prague, got 'Mars/B"),
        (NOTIFY + 'url = "json://h"\nverdicts = ["bad"]\n', "some of not-trusted, limited"),
        (NOTIFY + 'url = "json://h"\nlink = "shop"\n', "notify.0.link: string should match"),
        (NOTIFY + 'url = "json://h"\nafter_s = -1\n', "notify.0.after_s"),
        (2 * (NOTIFY + 'url = "json://h"\n'), "expected each name once, got 'n' again"),
    ],
)
def test_a_wrong_file_says_what_was_expected_and_no_address(tmp_path, text, words):
    path = tmp_path / "thermap.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InvalidContent) as refused:
        read_connections(path)
    assert words in refused.value.detail
    assert "pa55word" not in refused.value.detail


def test_times_are_as_the_file_says(tmp_path):
    path = tmp_path / "thermap.toml"
    path.write_text(NOTIFY + 'url = "json://h"\nafter_s = 30.0\nrepeat_h = 2.0\n', encoding="utf-8")
    (table,) = read_connections(path).notify
    rules = NotifyReceiver(table, "").rules
    assert (rules.after, rules.repeat_after) == (timedelta(seconds=30), timedelta(hours=2))
