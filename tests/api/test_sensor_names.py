"""A shop names its sensors in its own language: they go through every door."""

from unicodedata import normalize

import pytest

from tests.service_examples import START, client_of, iso, running

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
async def test_letters_and_their_accents_are_one_name_however_they_are_written(sqlite_url):
    """As a Mac writes them, and with blanks that nobody sees: no second map under the same name."""
    apart = MACHINE | {"sensors": [{"name": f" {normalize('NFD', name)} "} for name in SENSORS]}
    with running(sqlite_url) as service:
        async with client_of(service) as client:
            made = (await client.post("/v1/machines", json=apart)).json()
            assert [sensor["name"] for sensor in made["sensors"]] == SENSORS
            content = map_file("Lauf früh", 20)
            for form, status in (("NFC", 201), ("NFD", 200)):
                answer = await client.post(
                    "/v1/machines/vmc/files",
                    params={"name": "map.csv"},
                    content=normalize(form, content).encode(),
                    headers={"content-type": "text/csv"},
                )
                assert answer.status_code == status, answer.text
            (stored,) = (await client.get("/v1/machines/vmc/error-maps")).json()
            assert stored["label"] == "Lauf früh"
