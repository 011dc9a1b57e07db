"""Catalogues: everything that pages say has a text, with the same places in it."""

import copy
import re
from importlib.resources import files

import pytest

from app.message import Message, Quantity, several
from app.pages.languages import ENGLISH, LANGUAGES, catalogue, messages_of_scripts
from app.pages.reader import read_reader
from app.pages.wording import _, counted, said, said_near
from scripts.update_catalogues import messages_in_code
from tests.api.test_api_dashboard import feed, shown
from tests.service_examples import START, reading

OTHERS = [language for language in LANGUAGES if language != ENGLISH]
SCRIPTS = (files("app.pages") / "assets").glob("*.js")
PLACE = re.compile(r"%\(\w+\)[.\d]*[a-z]|%%")


@pytest.fixture(autouse=True)
def nobody():
    yield
    read_reader({})


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("language", OTHERS)
def test_every_message_has_a_text_with_the_same_places(language):
    # gettext passes over what is marked as doubtful.
    assert not [message.id for message in catalogue(language) if message.id and message.fuzzy]
    texts = {message.id: message.string for message in catalogue(language) if message.id}
    in_code = {message.id for message in messages_in_code() if message.id}
    assert set(texts) == in_code, "python -m scripts.update_catalogues"
    for ids, strings in texts.items():
        known = [ids, *([strings] if isinstance(ids, str) else [])]
        forms = [strings] if isinstance(ids, str) else strings
        assert all(forms), ids
        places = [set(PLACE.findall(one)) for one in ([ids] if isinstance(ids, str) else ids)]
        for form in forms:
            assert set(PLACE.findall(form)) in places, (known, form)


def test_a_sentence_of_the_service_is_said_in_the_readers_language_and_units():
    size = Quantity(2.0, 2, "K")
    where = Message("%(size)s above the hottest map", size=size)
    told = Message("%(matter)s: %(consequence)s.", matter=where, consequence="EXX")
    assert told == "2.00 K above the hottest map: EXX."
    assert copy.deepcopy(told) == told
    read_reader({"thermap-temperature": "F"}, "de-DE")
    assert said(copy.deepcopy(told)) == "3,60 °F über der wärmsten Karte: EXX."
    assert said(several("%(count)s map", "%(count)s maps", count=2)) == "2 Karten"
    assert counted(1, "%(count)s map", "%(count)s maps") == "1 Karte"
    assert _("%(axis)s axis", axis="X") == "X-Achse"


def test_what_is_english_for_everybody_is_marked_as_such():
    assert said_near("odd <b>", START) == "odd <b>"
    read_reader({"thermap-language": "de"})
    assert said_near("odd <b>", START) == '<span lang="en">odd &lt;b&gt;</span>'


@pytest.mark.parametrize(
    ("stated", "accepted", "language"),
    [("", "", "en"), ("", "fr,de;q=0.5", "de"), ("en", "de", "en"), ("xx", "de-CH", "de")],
)
def test_the_browsers_language_holds_until_another_is_chosen(stated, accepted, language):
    read_reader({"thermap-language": stated}, accepted)
    assert _("Machines") == {"en": "Machines", "de": "Maschinen"}[language]


def test_scripts_get_what_they_say():
    said_by_scripts = messages_of_scripts("de")
    assert said_by_scripts["Not stored."] == ["Nicht gespeichert."]
    # What stands inside of another call is not found there.
    source = "".join(one.read_text() for one in SCRIPTS)
    asked = re.findall(r"""\bt\("((?:[^"\\]|\\.)*)\"""", source)
    assert len(asked) > 100
    assert [one for one in asked if one not in said_by_scripts] == []
    assert "Trust now" not in said_by_scripts
    assert messages_of_scripts(ENGLISH) == {}


@pytest.mark.anyio
async def test_a_page_is_german_with_commas_and_the_api_is_not(client):
    await feed(client, reading(START, 25.0))
    client.cookies.set("thermap-temperature", "F")
    client.headers["Accept-Language"] = "de-DE,de;q=0.9,en;q=0.5"
    page = await shown(client, "/machines/mcfv5050")
    assert "Verlässlich" in page.text
    assert "77,00 °F" in page.text
    assert "Komponenten liegen zwischen ihren Karten, bei frischen Temperaturen." in page.text
    answer = (await client.get("/v1/machines/mcfv5050/status")).json()
    assert answer["sentences"][0].endswith(
        "components lie between their maps, on fresh temperatures."
    )
    assert answer["sensors"][0]["temperature_c"] == 25.0


@pytest.mark.anyio
@pytest.mark.parametrize(
    "path",
    ["/", "/new-machine", "/fleet", "/login", "/machines/none"]
    + [f"/machines/mcfv5050{one}" for one in ("", "/loop", "/maps", "/maps/1", "/volume")]
    + [f"/machines/mcfv5050{one}" for one in ("/history", "/events", "/setup", "/export")],
)
async def test_every_page_says_its_language_and_offers_the_choice(client, path):
    await feed(client, reading(START, 25.0))
    client.cookies.set("thermap-language", "de")
    client.cookies.set("thermap-length", "in")
    answer = await client.get(path, headers={"Accept": "text/html"}, follow_redirects=True)
    assert '<html lang="de"' in answer.text
    assert 'data-reader="language"' in answer.text
    assert len(answer.content) < 300_000
