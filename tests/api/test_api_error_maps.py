"""Error maps over HTTP."""

from copy import deepcopy
from datetime import timedelta

import pytest

from tests.service_examples import (
    MACHINE,
    MAPS,
    ROOM,
    START,
    by_code,
    contents,
    error_map,
    iso,
    problem,
    reading,
    table,
)

pytestmark = pytest.mark.anyio

PATH = f"{ROOM}/error-maps"
WARM = {"x-middle": 40.0, "y-front": 39.0, "z-column": 42.0, "spindle": 45.0}


async def stored(client, *components, **changes):
    """Store a map of these components at 40 °C."""
    return await client.post(
        PATH,
        json=error_map("Run #9", 40.0, **({"components": list(components)} | changes)),
    )


async def test_a_map_comes_back_as_it_was_stated(client):
    content = error_map(
        "Run #9",
        40.0,
        measuring_lines_mm={
            "x": [0, 250, 100],
            "y": {"point_mm": [250, 0, 100], "tool_offset_mm": [0, 0, 160]},
        },
        repeatability_um=0.5,
        instrument="laser vector",
    )
    answer = await client.post(PATH, json=content)
    assert answer.status_code == 201
    shown = answer.json()
    assert answer.headers["location"] == f"{PATH}/{shown['id']}"
    for field in ("label", "measured_at", "temperatures_c", "measuring_lines_mm"):
        assert shown[field] == content[field]
    assert shown["repeatability_um"] == 0.5
    assert shown["instrument"] == "laser vector"
    assert shown["stored_at"] == iso(START)
    assert shown["in_active_model"] is True
    assert shown["warnings"] == []
    assert shown["components"][:3] == [
        component | {"chapter": chapter}
        for component, chapter in zip(
            content["components"][:3], ("D_x(x)", "A_y(x)", "D_z(z)"), strict=True
        )
    ]
    assert shown["components"][3] == {
        "component": "SXY",
        "value_um_per_m": -40.0,
        "chapter": "S_xy",
        "iso": "C0Y",
        "iso_value_urad": 40.0,
    }
    assert (await client.get(f"{PATH}/{shown['id']}")).json() == shown


async def test_maps_are_listed_in_the_order_in_which_they_were_stored(client):
    listed = (await client.get(PATH)).json()
    assert [m["label"] for m in listed] == list(MAPS)
    assert all(m["in_active_model"] for m in listed)
    assert [m["temperatures_c"]["x-middle"] for m in listed] == list(MAPS.values())


async def test_what_is_optional_and_was_not_stated_is_left_out(client):
    shown = (await client.get(PATH)).json()[0]
    assert not {"repeatability_um", "instrument"} & set(shown)
    assert not {"backward_errors_um", "errors_urad"} & set(shown["components"][0])


@pytest.mark.parametrize(
    ("name", "stated"),
    [("SXY", "um_per_m"), ("X0C", "um"), ("A0C", "urad")],
)
async def test_a_single_value_may_have_the_name_that_tables_give_it(client, name, stated):
    content = error_map("Run #9", 40.0, components=[{"component": name, f"error_{stated}": 3.0}])
    answer = await client.post(PATH, json=content)
    assert answer.status_code == 201, answer.text
    assert answer.json()["components"][0][f"value_{stated}"] == 3.0
    content["label"], content["components"][0][f"value_{stated}"] = "both", 3.0
    (error,) = problem(await client.post(PATH, json=content), 422)["errors"]
    assert error["field"] == f"components.0.error_{stated}"
    assert "unknown field" in error["message"]


async def test_emoji_and_200_characters_are_a_label(client):
    for label in ("Lauf 🌡️ nº 1 «warm»", "x" * 200, "🔥" * 200):
        t_c = 40.0 + len(label) % 7 * 3 + (label[0] == "x")
        answer = await client.post(PATH, json=error_map(label, t_c))
        assert answer.status_code == 201, answer.text
        shown = (await client.get(f"{PATH}/{answer.json()['id']}")).json()
        assert shown["label"] == label


async def test_the_same_map_again_is_the_map_that_is_there(client, app):
    content = error_map("Run #9", 40.0, instrument="laser")
    first = await client.post(PATH, json=content)
    before = contents(app)
    reordered = deepcopy(content)
    reordered["components"].reverse()
    reordered["measured_at"] = "2026-02-28T07:00:00.000+01:00"
    for again in (content, reordered):
        answer = await client.post(PATH, json=again)
        assert answer.status_code == 200
        assert answer.json() == first.json()
        assert answer.headers["location"] == first.headers["location"]
    assert contents(app) == before


def _changed(change):
    content = error_map("Run #1", 20.0)
    change(content)
    return content


@pytest.mark.parametrize(
    "content",
    [
        _changed(lambda m: m["components"][0]["errors_um"].__setitem__(1, 1e-300)),
        _changed(lambda m: m["components"].pop()),
        _changed(lambda m: m["components"][0].update(backward_errors_um=[0.0, 0.0, 0.0])),
        _changed(lambda m: m["temperatures_c"].update(spindle=25.000000000000004)),
        _changed(lambda m: m.update(repeatability_um=0.0)),
        _changed(lambda m: m.update(measuring_lines_mm={"x": [0, 0, 0]})),
    ],
    ids=["tiny error", "component less", "backward", "last bit", "repeatability", "line"],
)
async def test_other_content_under_a_label_is_a_conflict(client, app, content):
    before = contents(app)
    found = problem(await client.post(PATH, json=content), 409)
    assert "'Run #1'" in found["detail"]
    assert contents(app) == before


async def test_labels_are_each_machines_own(client):
    await client.post("/v1/machines", json=MACHINE | {"id": "other"})
    answer = await client.post("/v1/machines/other/error-maps", json=error_map("Run #1", 33.0))
    assert answer.status_code == 201
    map_id = answer.json()["id"]
    problem(await client.get(f"{PATH}/{map_id}"), 404)
    problem(await client.delete(f"{PATH}/{map_id}"), 404)
    assert (await client.get(f"/v1/machines/other/error-maps/{map_id}")).status_code == 200


async def test_a_map_too_near_to_another_is_refused_and_nothing_stays(client, app):
    before = contents(app)
    found = problem(await client.post(PATH, json=error_map("Run #2", 24.05)), 409)
    assert "Run #2" in found["detail"]
    assert "Run #3" in found["detail"]
    assert "0.05 °C" in found["detail"]
    assert contents(app) == before


async def test_where_the_machine_asks_for_it_near_maps_are_averaged(client):
    await client.patch(ROOM, json={"same_temperature": "mean"})
    near = error_map("Run #2", 24.0)
    near["components"][0]["errors_um"] = [0.0, 6.0, 30.0]
    assert (await client.post(PATH, json=near)).status_code == 201
    answer = await client.post(
        f"{ROOM}/compensation", json={"temperatures_c": {"x-middle": 24.0, "z-column": 26.0}}
    )
    exx = by_code(answer.json())["EXX"]
    assert exx["errors_um"] == [0.0, 5.0, 25.0]  # half of 4 and 6, of 20 and 30
    assert exx["upper_map" if exx["weight"] else "lower_map"] == "Run #2 + Run #3"


@pytest.mark.parametrize(
    ("positions_mm", "said"),
    [([0], "one position"), ([0, 25, 49], "are its positions in mm?"), ([0, 500], None)],
    ids=["one", "short", "whole travel"],
)
async def test_what_is_unusual_about_a_table_is_said(client, positions_mm, said):
    answer = await stored(client, table("EXX", positions_mm, [p / 10 for p in positions_mm]))
    assert answer.status_code == 201
    warnings = answer.json()["warnings"]
    assert [said in w for w in warnings] == [True] if said else warnings == []


@pytest.mark.parametrize(
    ("positions_mm", "said"),
    [
        ([0, 0.25, 0.5], "got 0 to 0.5 mm: were they meant in m,"),
        ([0, 250e3, 500e3], "got 0 to 500000 mm: were they meant in µm,"),
    ],
)
async def test_positions_in_another_unit_are_refused_with_what_was_expected(
    client, positions_mm, said
):
    """The first map of a machine is followed at once: a warning beside it came too late."""
    lying = table("EXX", positions_mm, [0.0, 2.0, 5.0])
    for query in ("", "?preview=true"):
        body = error_map("Run #9", 40.0, components=[table("EBX", [0, 1], [0, 1], "urad"), lying])
        found = problem(await client.post(PATH + query, json=body), 422)
        (error,) = found["errors"]
        assert error["field"] == "components.1.positions_mm"
        expected = "expected positions of EXX in mm, on an axis of 0 to 500 mm, "
        assert error["message"].startswith(expected + said)
    assert len((await client.get(PATH)).json()) == len(MAPS)


async def test_temperatures_that_were_exchanged_are_asked_about(client):
    """Where there are readings of the map's time: two columns of a table in the wrong order."""
    measured_at = START - timedelta(hours=3)
    await client.post(f"{ROOM}/readings", json=reading(measured_at - timedelta(minutes=1), 40.0))
    right = error_map("Run #9", 40.0, measured_at=iso(measured_at))
    asked = {}
    for x_c, z_c in ((40.0, 42.0), (42.0, 40.0)):
        stated = right["temperatures_c"] | {"x-middle": x_c, "z-column": z_c}
        body = right | {"temperatures_c": stated}
        answer = await client.post(f"{PATH}?preview=true", json=body)
        asked[x_c] = answer.json()["warnings"]
    assert asked[40.0] == []
    (said,) = asked[42.0]
    assert said.endswith("where it states 42.0 and 40.0 °C: are the two exchanged?")


HOT = {"x-middle": 77.0, "y-front": 77.0, "z-column": 78.8}


@pytest.mark.parametrize(
    ("temperatures_c", "errors", "said"),
    [
        (HOT, [0.0, 12.0], "are they in °F? Then they are 25.0 to 26.0 °C"),
        (HOT | {"z-column": 40.0}, [0.0, 12.0], None),
        (WARM, [0.0, 0.012], "they may be in mm instead of µm"),
        (WARM, [0.0, 0.0], None),
    ],
    ids=["fahrenheit", "one is hot", "millimetres", "zeros"],
)
async def test_numbers_that_may_be_in_another_unit_are_asked_about(
    client, temperatures_c, errors, said
):
    """Before the map is stored as after: a table that is wrong by it says nothing more."""
    asked = error_map("Run #9", 40.0, temperatures_c=temperatures_c)
    asked["components"] = [table("EXX", [0, 500], [0, 0], backward_errors_um=errors)]
    before = await client.post(PATH, params={"preview": "true"}, json=asked)
    after = await client.post(PATH, json=asked)
    assert (before.status_code, after.status_code) == (200, 201)
    for answer in (before, after):
        warnings = answer.json()["warnings"]
        assert [said in w for w in warnings] == [True] if said else warnings == []


async def test_errors_that_may_be_compensations_are_asked_about(client):
    """Before and after the map is stored; the latest reading, between other maps, shows nothing."""
    exx, *rest = error_map("Run #4", 27.0)["components"]
    asked = error_map("Run #4", 27.0, components=[exx | {"errors_um": [0.0, -7.0, -35.0]}, *rest])
    answers = [
        await client.post(PATH, params={"preview": "true"}, json=asked),
        await client.post(PATH, json=asked),
        await client.post(PATH, json=asked),
    ]
    assert [answer.status_code for answer in answers] == [200, 201, 200]
    for answer in answers:
        (warning,) = answer.json()["warnings"]
        assert warning.startswith("EXX would fit the maps beside it with the opposite sign")


async def test_a_copy_beside_the_map_that_it_was_made_of_is_asked_about(client):
    copy = error_map("Run #1", 20.0) | {"label": "copy"}
    copy["temperatures_c"] = dict.fromkeys(copy["temperatures_c"], 27.0)
    (warning,) = (await client.post(PATH, json=copy)).json()["warnings"]
    assert warning.startswith("its errors are those of map 'Run #1' to the last digit")


@pytest.mark.parametrize(
    ("errors_um", "said"),
    [
        ([0.0, 0.007, 0.035], "would fit the maps beside it 1000 times as large"),
        ([35.0, 7.0, 0.0], "would fit the maps beside it with the positions the other way round"),
        (
            [0.0, 900.0, 1400.0],
            "more than temperatures explain lies between this map and map 'Run #3'",
        ),
    ],
)
async def test_errors_of_another_kind_than_those_beside_them_are_asked_about(
    client, errors_um, said
):
    exx, *rest = error_map("Run #4", 27.0)["components"]
    asked = error_map("Run #4", 27.0, components=[exx | {"errors_um": errors_um}, *rest])
    (warning,) = (await client.post(PATH, json=asked)).json()["warnings"]
    assert "EXX" in warning
    assert said in warning


TOO_LARGE = "expected errors within ±10000 µm, got 12000 µm: is it in another unit"


async def test_an_error_that_no_machine_has_is_refused_however_it_comes(client):
    """As JSON and as a file; the file's answer names its line."""
    stated = error_map("Run #9", 40.0, temperatures_c=WARM)
    stated["components"] = [table("EXX", [0, 500], [0, 0], backward_errors_um=[0.0, 12_000.0])]
    for params in ({}, {"preview": "true"}):
        refused = problem(await client.post(PATH, params=params, json=stated), 422)
        assert [e["field"] for e in refused["errors"]] == ["components.0.backward_errors_um"]
        assert refused["errors"][0]["message"].startswith(TOO_LARGE)
    file = "# label: Run #9\n# measured_at: 2026-03-01T06:00:00Z\n" + "".join(
        f"# temperature {name}: {t_c}\n" for name, t_c in WARM.items()
    )
    file += "component,position_mm,error_um\nEXX,0,0\nEXX,500,12000\n"
    headers = {"content-type": "text/csv"}
    answer = await client.post(
        f"{ROOM}/files", params={"name": "run-9.csv"}, content=file, headers=headers
    )
    assert TOO_LARGE in problem(answer, 422)["detail"]


async def test_the_place_of_a_rotary_axis_is_no_error(client):
    """It may lie a hand's breadth beside the nominal axis; a metre and more is refused."""
    rotary = {"component": "XOC", "value_um": 120_000.0}
    assert (await stored(client, rotary)).status_code == 201


async def test_positions_beyond_the_travel_are_stored_with_a_warning(client):
    answer = await stored(client, table("EXX", [-10, 600], [0, 1]))
    assert answer.status_code == 201
    (warning,) = answer.json()["warnings"]
    assert "EXX" in warning
    assert "-10 to 600 mm" in warning


@pytest.mark.parametrize(
    ("changes", "field", "said"),
    [
        ({"temperatures_c": WARM | {"x-middle": 81.0}}, "temperatures_c.x-middle", "80 °C"),
        ({"temperatures_c": WARM | {"x-middle": 313.15}}, "temperatures_c.x-middle", "kelvin"),
        ({"temperatures_c": WARM | {"nose": 40.0}}, "temperatures_c.nose", "x-middle"),
        (
            {"temperatures_c": {"z-column": 42.0}},
            "temperatures_c",
            "expected a temperature of x-middle in °C",
        ),
        ({"measuring_lines_mm": {"w": [0, 0, 0]}}, "measuring_lines_mm.w", "'w'"),
    ],
    ids=["out of range", "kelvin", "unknown sensor", "sensor missing", "measuring line"],
)
async def test_a_map_that_does_not_fit_its_machine_is_refused(client, app, changes, field, said):
    before = contents(app)
    found = problem(await client.post(PATH, json=error_map("Run #9", 40.0, **changes)), 422)
    (error,) = found["errors"]
    assert error["field"] == field
    assert said in error["message"]
    assert contents(app) == before


async def test_an_axis_that_the_machine_lacks_is_refused(client):
    lathe = MACHINE | {"id": "lathe", "configuration": "FZX", "axes": {}}
    await client.post("/v1/machines", json=lathe)
    content = error_map("Run #1", 20.0, components=[table("EYY", [0, 1], [0, 1])])
    found = problem(await client.post("/v1/machines/lathe/error-maps", json=content), 422)
    assert "EYY" in found["detail"]
    assert "FZX" in found["detail"]


async def test_a_deleted_map_is_gone_and_its_label_is_free(client):
    first = (await client.get(PATH)).json()[0]
    answer = await client.delete(f"{PATH}/{first['id']}")
    assert (answer.status_code, answer.content) == (204, b"")
    found = problem(await client.get(f"{PATH}/{first['id']}"), 404)
    assert "Run #3" in found["detail"]
    problem(await client.delete(f"{PATH}/{first['id']}"), 404)
    assert [m["label"] for m in (await client.get(PATH)).json()] == ["Run #3", "Run #6"]
    again = await client.post(PATH, json=error_map("Run #1", 18.0))
    assert again.status_code == 201
    assert again.json()["id"] != first["id"]


async def test_deleting_a_map_changes_the_table_at_once(client):
    stated = {"temperatures_c": {"x-middle": 22.0, "z-column": 24.0}}
    run_3 = (await client.get(PATH)).json()[1]["id"]
    before = by_code((await client.post(f"{ROOM}/compensation", json=stated)).json())["EXX"]
    assert (before["lower_map"], before["upper_map"]) == ("Run #1", "Run #3")
    await client.delete(f"{PATH}/{run_3}")
    after = by_code((await client.post(f"{ROOM}/compensation", json=stated)).json())["EXX"]
    assert (after["lower_map"], after["upper_map"]) == ("Run #1", "Run #6")
    assert after["weight"] == pytest.approx(0.2)


async def test_after_the_last_map_is_deleted_there_is_no_table(client):
    for stored_map in (await client.get(PATH)).json():
        await client.delete(f"{PATH}/{stored_map['id']}")
    stated = {"temperatures_c": {"x-middle": 22.0, "z-column": 24.0}}
    problem(await client.post(f"{ROOM}/compensation", json=stated), 422)
    assert (await client.get(f"{ROOM}/models")).json()[-1]["maps"] == []
