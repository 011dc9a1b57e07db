"""A shop names its sensors in its own language: they go through every door."""

from unicodedata import normalize

import pytest

from tests.service_examples import START, client_of, iso, problem, running

SENSORS = ["Bett vorne", "Säule", "Wärme Spindel"]
MACHINE = {
    "id": "vmc",
    "name": "Fräse",
    "configuration": "XYFZ",
    "axes": {"x": {"min_mm": 0, "max_mm": 500}},
    "sensors": [{"name": name} for name in SENSORS],
}


def map_file(label, t_c):
    head = "".join(f"# temperature {name}: {t_c}\n" for name in SENSORS)
    head += f"# label: {label}\n# measured_at: {iso(START)}\n"
    return f"{head}position_mm,EXX_um\n0,0\n500,{10 * t_c}\n"


@pytest.mark.anyio
async def test_sensors_with_letters_of_any_language(sqlite_url):
    with running(sqlite_url) as service:
        async with client_of(service) as client:
            assert (await client.post("/v1/machines", json=MACHINE)).status_code == 201
            for label, t_c in (("kalt", 20), ("warm", 30)):
                answer = await client.post(
                    "/v1/machines/vmc/files",
                    params={"name": f"{label}.csv"},
                    content=map_file(label, t_c).encode(),
                    headers={"content-type": "text/csv"},
                )
                assert answer.status_code == 201, answer.text
            answer = await client.put("/v1/machines/vmc/sensor-assignment", json={"EXX": "Säule"})
            assert answer.json() == {"EXX": "Säule"}
            reading = {"time": iso(START), "temperatures_c": dict.fromkeys(SENSORS, 25.0)}
            answer = await client.post("/v1/machines/vmc/readings", json=[reading])
            assert answer.status_code == 201, answer.text
            table = (await client.get("/v1/machines/vmc/compensation")).json()
            assert (table["complete"], table["components"][0]["sensor"]) == (True, "Säule")
            for path in ("/metrics", "/machines/vmc", "/v1/machines/vmc/history?sensor=Säule"):
                answer = await client.get(path)
                assert answer.status_code == 200
                assert "Säule" in answer.text


@pytest.mark.anyio
async def test_a_sensor_whose_accents_stand_apart_from_their_letters_is_refused(sqlite_url):
    apart = MACHINE | {"sensors": [{"name": normalize("NFD", "Säule")}]}
    with running(sqlite_url) as service:
        async with client_of(service) as client:
            answer = await client.post("/v1/machines", json=apart)
            (wrong,) = problem(answer, 422)["errors"]
            assert wrong["field"] == "sensors"


@pytest.mark.anyio
async def test_labels_are_stored_as_they_are_written(sqlite_url):
    """So any version knows again what an older one stored; a Mac writes accents apart."""
    label = normalize("NFD", "Lauf früh")
    check = f"time,component,position_mm,measured_um\n{iso(START)},EXX,250,4.3\n"
    with running(sqlite_url) as service:
        async with client_of(service) as client:
            assert (await client.post("/v1/machines", json=MACHINE)).status_code == 201
            for kind, file, stored_as in (
                ("map", map_file(label, 20), "error-maps"),
                ("check", check, "verifications"),
            ):
                for status in (201, 200):
                    answer = await client.post(
                        "/v1/machines/vmc/files",
                        params={"name": f"{label}.csv", "kind": kind},
                        content=file.encode(),
                        headers={"content-type": "text/csv"},
                    )
                    assert answer.status_code == status, answer.text
                (stored,) = (await client.get(f"/v1/machines/vmc/{stored_as}")).json()
                assert stored["label"] == label
