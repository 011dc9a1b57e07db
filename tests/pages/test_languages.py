"""Catalogues: everything that pages say has a text, with the same places in it."""

import re
from importlib.resources import files

import pytest
from markupsafe import Markup

from app.languages import ENGLISH, LANGUAGES, catalogue, messages_of_scripts, translations
from app.languages.recognised import (
    NAMES,
    is_said_by_the_service,
    parts_of,
    recognised,
)
from app.pages.reader import read_reader
from app.pages.wording import _, said
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


def patterns_of_the_service(language):
    """List what the service says: pattern, and its text, where a count is not one."""
    for message in catalogue(language):
        if message.id and any(is_said_by_the_service(file) for file, _lines in message.locations):
            if isinstance(message.id, str):
                yield message.id, message.string
            else:
                yield message.id[1], translations(language).ngettext(*message.id, 2)


def filled(pattern):
    """Give values that a pattern may have: names, figures, and nothing where places touch."""
    literals, places = parts_of(pattern)
    values = {}
    for at, place in enumerate(places):
        is_name = NAMES.fullmatch(place.rstrip("0123456789"))
        value = f"Sensor {'ABCDEFGHIJ'[at]}" if is_name else f"{at + 2}.5"
        clings = (at > 0 and not literals[at]) or literals[at][-1:].isalpha()
        clings = clings or literals[at + 1][:1].isalpha()
        values.setdefault(place, "" if clings else value)
    return values


def without_marks(text):
    return text.replace("\ue000", "").replace("\ue001", "")


@pytest.mark.parametrize("language", OTHERS)
def test_every_sentence_of_the_service_is_recognised_as_itself(language):
    patterns = list(patterns_of_the_service(language))
    assert len(patterns) > 1000
    wrong = [
        (pattern, said_anew)
        for pattern, text in patterns
        if (said_anew := recognised(language, pattern % filled(pattern))) is None
        or without_marks(said_anew) != text % filled(pattern)
    ]
    assert wrong == []


@pytest.mark.parametrize("language", OTHERS)
def test_what_says_the_same_in_english_says_the_same_in_other_languages(language):
    texts = {}
    for pattern, text in patterns_of_the_service(language):
        literals, places = parts_of(pattern)
        kinds = tuple(bool(NAMES.fullmatch(place.rstrip("0123456789"))) for place in places)
        numbered = text
        for at, place in enumerate(places):
            numbered = numbered.replace(f"%({place})s", f"%({at})s")
        texts.setdefault((literals, kinds), {})[numbered] = pattern
    assert [both for both in texts.values() if len(both) > 1] == []


@pytest.mark.parametrize(
    ("english", "german"),
    [
        (
            "Column is 2.00 K above the hottest map: 2 components are held at Map 24.",
            "Column ist 3,60 °F über der wärmsten Karte: "
            "2 Komponenten bleiben auf den Werten von Map 24.",
        ),
        ("map Run 6 is at 26.3 ± 0.2 °C", None),
        (
            "EXX, EYX: given from 0 to 508 mm only at this temperature, because map 'Hot, 2' "
            "covers 0 to 508 mm; the maps together reach from 0 to 1016 mm",
            "EXX, EYX: bei dieser Temperatur nur von 0,00 bis 20,00 in gegeben, weil Karte "
            "'Hot, 2' umfasst 0,00 bis 20,00 in; die Karten zusammen reichen von 0,00 bis 40,00 in",
        ),
        (
            "EXX, EYX and 1 more follow Bed front rather than Column (share 1.02 ± 0.03)",
            "EXX, EYX und 1 weitere folgen Bed front statt Column (Anteil 1,02 ± 0,03)",
        ),
        (
            "EXX has a reversal value of 6.08 ± 0.06 µm at X 254 mm, rising by 1.0 µm per 100 mm",
            "EXX hat eine Umkehrspanne von 6,08 ± 0,06 µm bei X 10,00 in, "
            "steigend um 1,0 µm je 3,94 in",
        ),
        ("fall from 2.27 to 1.13", "fallen von 2,27 auf 1,13"),
        ("name from 'Mill' to 'Mill 2'", "name von 'Mill' auf 'Mill 2'"),
        ("assigned EXX to Column, EYX to Bed", "zugeordnet EXX zu Column, EYX zu Bed"),
        ("map Run 6 stored", "Karte Run 6 gespeichert"),
        ("Bed is stale", "Bed ist veraltet"),
        (
            "Karte 1.csv, line 7, column 3 (error [µm]): expected a number in µm, got 'abc'",
            "Karte 1.csv, Zeile 7, Spalte 3 (error [µm]): erwartet eine Zahl in µm, erhalten 'abc'",
        ),
        (
            "Karte 1.csv: expected text (CSV) or an Excel workbook, got a file of another kind",
            "Karte 1.csv: erwartet Text (CSV) oder eine Excel-Mappe, "
            "erhalten eine Datei anderer Art",
        ),
        (
            "Column has not been read since 20:08 UTC: 8 components rest on it.",
            "Column wurde seit 20:08 UTC nicht gelesen: 8 Komponenten beruhen darauf.",
        ),
        (
            "x-middle has not been read since 20:08:11 UTC, where a reading usually comes every "
            "1 s: 13 components rest on it.",
            "x-middle wurde seit 20:08:11 UTC nicht gelesen, wo sonst alle 1 s eine Meldung "
            "kommt: 13 Komponenten beruhen darauf.",
        ),
        (
            "There is no table: a-1 jumped from 24.5 to 75 °C within 1 s, expected at most "
            "5 °C/min; b-2 jumped from 24.7 to 77 °C within 1 s, expected at most 5 °C/min. "
            "Nothing stands in for it, and 2 components cannot be computed.",
            "Es gibt keine Tabelle: a-1 sprang in 1 s von 76,1 auf 167 °F, erwartet höchstens "
            "5 °C/min; b-2 sprang in 1 s von 76,5 auf 171 °F, erwartet höchstens 5 °C/min. "
            "Nichts springt dafür ein, und 2 Komponenten sind nicht zu berechnen.",
        ),
        ("assigned EXX to T1", "zugeordnet EXX zu T1"),
        (
            "There is no table: Bett vorne, for EXX, EYX: expected a temperature within the maps' "
            "20 to 28 °C, got 29.2 °C.",
            "Es gibt keine Tabelle: Bett vorne, für EXX, EYX: erwartet eine Temperatur innerhalb "
            "von 68 bis 82 °F der Karten, erhalten 84,6 °F.",
        ),
        ("nobody knows <b>", None),
    ],
)
def test_a_sentence_is_said_as_a_whole_or_not_at_all(english, german):
    read_reader({"thermap-temperature": "F", "thermap-length": "in"}, "de-DE")
    if german is None:
        assert said(english) == Markup('<span lang="en">{}</span>').format(english)
    else:
        assert said(english) == german


def test_units_are_the_readers_in_english_too():
    told = "Column is 2.00 K above the hottest map: 2 components are held at Map 24."
    assert said(told) == told
    read_reader({"thermap-temperature": "F"})
    assert said(told) == told.replace("2.00 K", "3.60 °F")


def test_names_of_users_stay_as_they_are():
    read_reader({"thermap-language": "de"})
    assert said("table, stale is missing: no reading has it") == (
        "table, stale fehlt: in keiner Meldung enthalten"
    )


def test_of_several_sentences_each_is_said_for_itself():
    read_reader({"thermap-language": "de"})
    assert said("It is adopted by default. Nobody said <b>.") == (
        'Er wird ohne Weiteres übernommen. <span lang="en">Nobody said &lt;b&gt;.</span>'
    )


def test_a_text_that_fits_everywhere_is_given_up():
    read_reader({"thermap-language": "de"})
    long = "EXX to Column of 3 to 4, " * 40
    assert said(long) == Markup('<span lang="en">{}</span>').format(long)


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
