"""thermap hal: the HAL file of a stored machine, and what the component asks the service."""

import sys

import pytest

from app.access.keys import Role
from app.cli.listening import listening, serving, url_of
from app.hal.component import KEY_VARIABLE, Service, main
from app.hal.curves import table_of
from app.main import create_app
from app.services.access_keys import create_key
from app.settings import Settings
from tests.service_examples import START, furnish_database

AT = {"x-middle": 24.0, "y-front": 23.0, "z-column": 26.0, "spindle": 29.0}


def words_of(text, beginning):
    (line,) = [line for line in text.splitlines() if line.startswith(beginning)]
    return line.split()


def test_the_hal_file_has_the_machine_s_positions_and_sensors(thermap, service_url, tmp_path):
    found = thermap("hal", "wiring", "mcfv5050", "--joints", "2,1,0", "--rate", "2.5")
    assert found.exit_code == 0
    assert found.stderr == "note: not in HAL's curves: EBX\n"
    positions = [
        float(line.split()[2])
        for line in found.stdout.splitlines()
        if line.startswith("setp thermap-eyx.x-val-")
    ]
    assert positions == [0.0, 100.0, 500.0]
    assert words_of(found.stdout, "net thermap-x-nominal")[2] == "joint.2.pos-cmd"
    start = words_of(found.stdout, "loadusr")
    assert start[:8] == ["loadusr", "-Wn", "thermap", sys.executable, "-m", "app", "hal", "follow"]
    assert start[start.index("--url") + 1] == service_url
    assert start[start.index("--rate") + 1] == "2.5"
    assert start[start.index("--sensors") + 1] == "x-middle,y-front,z-column,spindle"
    # halcmd takes no more words in a line.
    assert max(len(line.split()) for line in found.stdout.splitlines()) <= 32
    file = tmp_path / "thermap.hal"
    again = thermap(
        *("hal", "wiring", "mcfv5050", "--joints", "2,1,0", "--rate", "2.5", "--output", file)
    )
    assert again.exit_code == 0
    assert file.read_text() == found.stdout


def test_what_the_motors_will_not_follow_is_said_beforehand(thermap, client):
    client.create_machine(
        {
            "id": "both",
            "name": "measured in both directions",
            "configuration": "XYFZ",
            "axes": {axis: {"min_mm": 0, "max_mm": 100} for axis in "xyz"},
            "sensors": [{"name": "x-middle"}],
        }
    )
    client.store_error_map(
        "both",
        {
            "label": "cold",
            "measured_at": "2026-03-01T06:00:00Z",
            "temperatures_c": {"x-middle": 20.0},
            "components": [
                {
                    "component": "EXX",
                    "positions_mm": [0, 100],
                    "errors_um": [0.0, 5.0],
                    "backward_errors_um": [-4.0, 2.0],
                },
                {
                    "component": "EYY",
                    "positions_mm": [0, 100],
                    "errors_um": [0.0, 5.0],
                    "backward_errors_um": [0.001, 5.0],
                },
                {"component": "EBX", "positions_mm": [0, 100], "errors_urad": [0.0, 9.0]},
                {"component": "SXY", "value_um_per_m": 3.0},
            ],
        },
    )
    found = thermap("hal", "wiring", "both")
    assert found.exit_code == 0
    assert found.stderr == (
        "note: not in HAL's curves: half of the reversal of EXX, up to 2.00 µm, EBX\n"
    )
    assert "note" not in found.stdout


@pytest.mark.parametrize("joints", ["0,1,1", "0,1,16", "x,y,z"])
def test_joints_are_different_numbers(thermap, joints):
    found = thermap("hal", "wiring", "mcfv5050", "--joints", joints)
    assert found.exit_code == 2
    assert "expected different joints" in found.stderr.replace("\n", " ")


@pytest.mark.parametrize("joints", ["0,1", "0,1,2,3"])
def test_each_axis_has_a_joint(thermap, joints):
    found = thermap("hal", "wiring", "mcfv5050", "--joints", joints)
    assert found.exit_code == 2
    assert "a joint for each of X, Y, Z" in " ".join(found.stderr.replace("│", "").split())


def test_joints_of_a_gantry_are_joined(thermap):
    found = thermap("hal", "wiring", "mcfv5050", "--joints", "0,1+2,3")
    assert found.exit_code == 0
    assert words_of(found.stdout, "net thermap-y2-commanded")[2] == "joint.2.motor-pos-cmd"
    assert words_of(found.stdout, "net thermap-z-nominal")[2] == "joint.3.pos-cmd"
    start = words_of(found.stdout, "loadusr")
    assert start[start.index("--joints") + 1] == "0,1+2,3"
    refused = thermap("hal", "wiring", "mcfv5050", "--joints", "0,1,2,3")
    assert "joined by + (0,1+2,3)" in " ".join(refused.stderr.replace("│", "").split())


def test_a_lathe_has_the_curves_of_its_two_axes(thermap, client):
    lathe = {
        "id": "lathe",
        "name": "two axes",
        "configuration": "FZX",
        "axes": {axis: {"min_mm": 0, "max_mm": 100} for axis in "xz"},
        "sensors": [{"name": "bed"}],
    }
    client.create_machine(lathe)
    found = thermap("hal", "wiring", "lathe")
    assert found.exit_code == 0
    assert words_of(found.stdout, "loadrt lincurve")[2] == (
        "names=thermap-exx,thermap-ezx,thermap-exz,thermap-ezz"
    )
    assert words_of(found.stdout, "loadrt sum2")[2] == "names=thermap-sum-xa,thermap-sum-za"
    assert words_of(found.stdout, "net thermap-x-nominal")[2] == "joint.0.pos-cmd"
    assert words_of(found.stdout, "net thermap-z-nominal")[2] == "joint.1.pos-cmd"
    start = words_of(found.stdout, "loadusr")
    assert start[start.index("--joints") + 1] == "0,1"
    client.create_machine(lathe | {"id": "unstated", "axes": {"x": {"min_mm": 0, "max_mm": 100}}})
    refused = thermap("hal", "wiring", "unstated")
    assert refused.exit_code == 1
    assert "expected the travel of all axes of FZX, got none of Z" in refused.stderr


def test_a_python_that_is_not_there_is_named(run, tmp_path):
    found = run("hal", "follow", "mcfv5050", "--python", tmp_path / "python")
    assert found.exit_code == 1
    assert "cannot run" in found.stderr
    refused = run("hal", "follow", "mcfv5050", "--sensors", "Säule")
    assert refused.exit_code == 2


def test_a_python_without_hal_is_told_so(monkeypatch):
    monkeypatch.setitem(sys.modules, "hal", None)
    stated = ["--url", "http://127.0.0.1", "--every-s", "1", "--period-s", "1"]
    with pytest.raises(SystemExit, match="expected LinuxCNC's own Python"):
        main(["mcfv5050", *stated, "--rate-um-per-s", "1", "--limit-um", "1"])


def test_the_component_sends_readings_and_has_the_service_s_table(service_url, client):
    service = Service(service_url, "mcfv5050", 5.0)
    service.store_reading(AT, {"spindle_rpm": 0.0})
    nodes = dict.fromkeys("xyz", (0.0, 100.0, 500.0))
    found = table_of(service.table(), nodes, 500.0)
    table = {row.component: row for row in client.compensation("mcfv5050", AT).components}
    assert found.curves["EXX"] == pytest.approx(table["EXX"].compensation_um)
    assert found.curves["EXX"][-1] == pytest.approx(-20.0)
    slope = table["SXY"].compensation_um_per_m
    assert found.curves["EXY"] == pytest.approx([0.0, 0.1 * slope, 0.5 * slope])
    assert "EBX" in found.not_held
    assert not found.stale
    # Unchanged, it is not sent again; forgotten, it is.
    assert service.table() is None
    service.forget()
    assert service.table() is not None


def test_the_component_states_its_key(databases, monkeypatch):
    database_url = databases.prepared("sqlite", furnish_database)
    service = create_app(Settings(database_url=database_url, require_keys=True))
    database = service.state.context.database
    made = create_key(database, "mill", Role.METROLOGIST, ["mcfv5050"], lambda: START)
    with listening("127.0.0.1", 0, "serve") as opened, serving(service, opened, "warning"):
        url = url_of(opened)
        monkeypatch.delenv(KEY_VARIABLE, raising=False)
        with pytest.raises(ValueError, match="expected a key"):
            Service(url, "mcfv5050", 5.0).table()
        monkeypatch.setenv(KEY_VARIABLE, made.secret)
        with_key = Service(url, "mcfv5050", 5.0)
        with_key.store_reading(AT, {})
        assert with_key.table() is not None
    databases.give_back(database_url)


def test_a_refusal_has_the_service_s_sentence(service_url):
    with pytest.raises(ValueError, match="nobody"):
        Service(service_url, "nobody", 5.0).table()
    with pytest.raises(ValueError, match="has no sensor 'elsewhere'"):
        Service(service_url, "mcfv5050", 5.0).store_reading({"elsewhere": 20.0}, {})
    with pytest.raises(ValueError, match="expected a URL"):
        Service("ftp://here", "mcfv5050", 5.0)


def test_nobody_there_is_a_failure_of_the_connection(no_service_url):
    with pytest.raises(OSError, match="refused"):
        Service(no_service_url, "mcfv5050", 5.0).table()
