"""thermap replay: recorded temperatures become readings, stamped so that they are believed."""

from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pytest

from app.cli.replay import Stamps, plan_replay
from app.files.delimited_text import UnreadableFile
from app.files.recording import Recording, read_recording
from tests.effect_examples import SPEED, adopt
from thermap.answers import SensorSchema

SENSORS = ["x-middle", "y-front", "z-column", "spindle"]
NOW = datetime(2026, 3, 1, 12, 0, tzinfo=UTC)


@pytest.fixture
def write(tmp_path):
    def write_file(text):
        file = tmp_path / "warm-up.csv"
        file.write_text(text)
        return file

    return write_file


def warm_up(minutes=60, rise_c=3.0):
    """A file of readings once a minute: every sensor warms up by as much."""
    lines = ["time_min,x-middle,y-front_c,Z-Column [°C],spindle,load"]
    for minute in range(minutes + 1):
        t_c = 20.0 + rise_c * minute / minutes
        lines.append(f"{minute},{t_c:.3f},{t_c:.3f},{t_c + 2:.3f},{t_c:.3f},17")
    return "\n".join(lines)


# -- the command ---------------------------------------------------------------------------


@pytest.mark.slow
def test_all_at_once_shows_how_the_table_changed(thermap, client, write):
    found = thermap("replay", "mcfv5050", write(warm_up()), "--speed", 0)
    assert found.exit_code == 0, found.output
    assert "columns that are not read: load" in found.stderr
    assert "61 readings with their recorded spacing, the last one as it is sent" in found.stderr
    assert "61 readings stored, 0 there already" in found.stdout
    # EXX at 500 mm grows by 5 µm/°C from 20 °C on, so over 3 °C by 15 µm.
    row = next(line.split() for line in found.stdout.splitlines() if line.startswith("EXX"))
    assert row == ["EXX", "D_x(x)", "µm", "500", "0.00", "-15.00", "-15.00", "15.00"]
    assert "live table: the last reading" in found.stdout
    stored = client.readings("mcfv5050")
    assert stored[-1].time - stored[0].time == timedelta(hours=1)
    assert abs(datetime.now(UTC) - stored[-1].time) < timedelta(seconds=20)


@pytest.mark.slow
def test_states_are_sent_and_effects_of_them_are_in_the_tables(
    thermap, client, service_and_url, write
):
    adopt(service_and_url[0], SPEED)
    file = write("time_min,x-middle,z-column,state spindle_rpm,rpm\n0,20,22,0,7\n1,20,22,8000,7\n")
    found = thermap("replay", "mcfv5050", file, "--speed", 0, "--column", "rpm=state other_rpm")
    assert found.exit_code == 0, found.output
    assert [r.state for r in client.readings("mcfv5050")] == [
        {"spindle_rpm": 0.0, "other_rpm": 7.0}, {"spindle_rpm": 8000.0, "other_rpm": 7.0}
    ]  # fmt: skip
    # 0.001 µm for each 1/min.
    row = next(line.split() for line in found.stdout.splitlines() if line.startswith("EXX"))
    assert row[-3:] == ["-8.00", "-8.00", "8.00"]


@pytest.mark.slow
def test_at_speed_readings_are_stamped_as_they_are_sent(thermap, client, write):
    before = datetime.now(UTC)
    found = thermap("replay", "mcfv5050", write(warm_up(rise_c=0.9)), "--speed", "3600")
    assert found.exit_code == 0, found.output
    assert "stamped as they are sent" in found.stderr
    stored = client.readings("mcfv5050")
    assert len(stored) == 61
    assert stored[-1].time - stored[0].time == timedelta(seconds=1)
    assert before < stored[0].time < stored[-1].time <= datetime.now(UTC)
    table = client.current_table("mcfv5050").table
    assert {s.health for s in table.sensors} == {"ok"}


@pytest.mark.slow
def test_where_sensors_would_seem_to_jump_the_recorded_spacing_stays(thermap, client, write):
    found = thermap("replay", "mcfv5050", write(warm_up(rise_c=15)), "--speed", "3600")
    assert found.exit_code == 0, found.output
    assert (
        "with their recorded spacing, the last one as it is sent: at 3600 times the recorded speed "
        "x-middle would seem to jump (more than 5 °C/min)"
    ) in found.stderr.replace("\n", " ")
    assert client.readings("mcfv5050")[-1].time <= datetime.now(UTC)
    assert {s.health for s in client.current_table("mcfv5050").table.sensors} == {"ok"}


@pytest.mark.slow
def test_recorded_dates_are_kept_and_a_repetition_adds_nothing(thermap, client, write):
    file = write("time,x-middle,z-column\n2026-03-01T06:00:00Z,20,22\n2026-03-01 07:05+01:00,21,23")
    for stored in ("2 readings stored, 0", "0 readings stored, 2"):
        found = thermap("replay", "mcfv5050", file, "--speed", 0)
        assert found.exit_code == 0, found.output
        assert stored in found.stdout
    assert [r.time.minute for r in client.readings("mcfv5050")] == [0, 5]


@pytest.mark.slow
def test_other_readings_about_that_time_are_told(thermap, write):
    file = write(warm_up())
    assert "other readings" not in thermap("replay", "mcfv5050", file, "--speed", 0).stderr
    assert "other readings" in thermap("replay", "mcfv5050", file, "--speed", 0).stderr


@pytest.mark.slow
def test_readings_without_a_table_are_stored_all_the_same(thermap, write):
    found = thermap("replay", "mcfv5050", write("time_s,spindle\n0,20\n10,21\n"), "--speed", 0)
    assert found.exit_code == 0
    assert "no reading of these has a compensation table" in found.stdout
    assert "no live table: expected a temperature of x-middle" in found.stdout


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--column", "load"), "expected NAME=SENSOR"),
        (("--column", "load=bed"), "has no sensor bed; it has x-middle"),
        (("--start", "2026-03-01T06:00"), "with its zone"),
        (("--start", "noon"), "with its zone"),
        (("--utc-offset", "CET"), "expected an offset such as +01:00"),
    ],
)
def test_options_that_cannot_be_right(thermap, write, options, words):
    found = thermap("replay", "mcfv5050", write(warm_up()), *options, columns=200)
    assert (found.exit_code, found.stdout) == (2, "")
    assert words in found.stderr


def test_a_column_that_the_file_lacks(thermap, write):
    found = thermap("replay", "mcfv5050", write(warm_up()), "--column", "lead=spindle")
    assert (found.exit_code, found.stdout) == (1, "")
    assert "the file has no column lead" in " ".join(found.stderr.split())


@pytest.mark.slow
def test_times_in_the_future_are_the_services_to_refuse(thermap, write):
    start = (datetime.now(UTC) + timedelta(days=2)).isoformat()
    found = thermap("replay", "mcfv5050", write(warm_up()), "--speed", 0, "--start", start)
    assert found.exit_code == 1
    assert "expected a time not in the future" in found.stderr


@pytest.mark.slow
def test_ctrl_c_says_how_far_it_came(thermap, write, monkeypatch):
    def interrupt(_seconds):
        raise KeyboardInterrupt

    monkeypatch.setattr("app.cli.replay.time.sleep", interrupt)
    found = thermap("replay", "mcfv5050", write(warm_up()), "--speed", "1")
    assert found.exit_code == 130
    assert found.stderr.endswith("stopped after 1 of 61 readings\n")


# -- reading files -------------------------------------------------------------------------


def test_columns_are_found_by_their_names(write):
    found = read_recording(write(warm_up(minutes=2)), SENSORS, {}, None)
    assert list(found.times_s) == [0.0, 60.0, 120.0]
    assert found.temperatures_c[1] == {
        "x-middle": 21.5, "y-front": 21.5, "z-column": 23.5, "spindle": 21.5,
    }  # fmt: skip
    assert (found.is_dated, found.unread) == (False, ["load"])


def test_columns_can_be_named(write):
    text = "Zeit;T1;T2\n0;20,5;21\n1;20,6;NaN\n2;;\n"
    columns = {"zeit": "time_h", "T1": "spindle", "T2": "x-middle"}
    found = read_recording(write(text), SENSORS, columns, None)
    assert list(found.times_s) == [0.0, 3600.0]
    assert found.temperatures_c == [{"spindle": 20.5, "x-middle": 21.0}, {"spindle": 20.6}]


def test_a_sensor_whose_name_begins_as_anothers_keeps_its_own_column(write):
    found = read_recording(write("Time [min],x_c,x\n1,20,30\n"), ["x", "x_c"], {}, None)
    assert list(found.times_s) == [60.0]
    assert found.temperatures_c == [{"x_c": 20.0, "x": 30.0}]


def test_states_are_read_beside_the_temperatures_of_their_line(write):
    text = "time_s,spindle,state spindle_rpm,State: coolant,rpm\n0,20,2000,1,5\n60,21,,nan,6\n"
    found = read_recording(write(text), SENSORS, {"rpm": "state x_rpm"}, None)
    assert found.temperatures_c == [{"spindle": 20.0}, {"spindle": 21.0}]
    assert found.states == [{"spindle_rpm": 2000.0, "coolant": 1.0, "x_rpm": 5.0}, {"x_rpm": 6.0}]
    assert found.unread == []


def test_a_sensors_column_holds_no_state_though_it_begins_with_the_word(write):
    found = read_recording(write("time_s,state a\n0,20\n"), ["state a"], {}, None)
    assert (found.temperatures_c, found.states) == ([{"state a": 20.0}], [{}])


def test_a_zone_for_times_that_state_none(write):
    text = "time,spindle\n2026-03-01 07:00:00,20\n"
    zone = timezone(timedelta(hours=1))
    found = read_recording(write(text), SENSORS, {}, zone)
    assert found.times_s[0] == datetime(2026, 3, 1, 6, tzinfo=UTC).timestamp()


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("time,spindle\n2026-03-01 07:00:00,20\n", "line 2, column 1 (time): expected a time with "
         "its zone, such as 2026-03-01 07:00:00Z"),
        ("time,spindle\n1.5,20\n", "line 2, column 1 (time): expected a time such as "
         "2026-03-01T06:00:00Z, got '1.5'; where it counts seconds or minutes from the beginn"),
        ("time,spindle\n2026-13-01T00:00Z,20\n", "line 2, column 1 (time): expected a time such"),
        ("time_s,spindle\n0,warm\n", "line 2, column 2 (spindle): expected a number in °C, got"),
        ("time_s,spindle\n,20\n", "line 2, column 1 (time_s): expected a time in s, got none"),
        ("time_s,spindle\n0,20\n0,21\n", "line 3, column 1 (time_s): expected each time once, "
         "got the time of line 2"),
        ("time_s,spindle,state rpm\n0,20,1\n0,20,2\n", "line 3, column 1 (time_s): expected each "
         "time once, got the time of line 2"),
        ("time_s,spindle,state rpm\n0,20,fast\n", "(state rpm): expected a number, got 'fast'"),
        ("time_s,spindle,state rpm,State: rpm\n0,20,1,1\n", "line 1: expected each state in one "
         "column, got rpm again"),
        ("spindle\n20\n", "line 1: expected one column of times (time, time_s, time_min, time_h), "
         "got none"),
        ("time,time_s,spindle\n", "line 1: expected one column of times"),
        ("time_s,bed\n0,20\n", "line 1: expected columns named as the sensors x-middle, y-front"),
        ("time_s,spindle,Spindle [°C]\n0,20,21\n", "line 1: expected spindle in one column, got "
         "spindle and Spindle [°C]"),
        ("time_s,spindle [K]\n0,293\n", "column 2 (spindle [K]): expected spindle in °C, got "
         "the unit 'k'"),
        ("time_s,spindle\n", "expected lines with a time and temperatures, got none"),
    ],
)  # fmt: skip
def test_recordings_that_cannot_be_right(write, text, complaint):
    with pytest.raises(UnreadableFile) as caught:
        read_recording(write(text), SENSORS, {}, None)
    assert complaint in caught.value.detail


# -- stamps --------------------------------------------------------------------------------

SENSOR = SensorSchema(name="spindle")


def recording(rise_c_per_min, minutes=30, is_dated=False):
    times_s = np.arange(0.0, 60.0 * minutes + 1.0)
    zero_s = NOW.timestamp() - 86400.0 if is_dated else 0.0
    values = [{"spindle": 20.0 + rise_c_per_min * t / 60.0} for t in times_s]
    states = [{"spindle_rpm": 1000.0 * (t // 600.0)} for t in times_s]
    return Recording((zero_s + times_s).tolist(), values, states, is_dated)


def plan(recorded, speed=60.0, start=None, recorded_times=False):
    return plan_replay(
        recorded, [SENSOR], now=NOW, speed=speed, start=start, recorded_times=recorded_times
    )


@pytest.mark.parametrize(
    ("options", "stamps"),
    [
        ({}, Stamps.AS_SENT),
        ({"speed": 0.0}, Stamps.MOVED),
        ({"recorded_times": True}, Stamps.MOVED),
        ({"start": NOW - timedelta(hours=5)}, Stamps.RECORDED),
    ],
)
def test_which_times_readings_are_given(options, stamps):
    assert plan(recording(0.1), **options).stamps is stamps


@pytest.mark.parametrize("options", [{"speed": 0.0}, {"recorded_times": True}])
def test_dates_are_kept(options):
    found = plan(recording(0.1, is_dated=True), **options)
    assert (found.stamps, found.readings[0].time) == (Stamps.RECORDED, NOW - timedelta(days=1))


def test_states_go_with_their_temperatures():
    sent = plan(recording(0.1)).readings
    assert [sent[i].state for i in (0, 599, 600, -1)] == [
        {"spindle_rpm": 0.0}, {"spindle_rpm": 0.0}, {"spindle_rpm": 1000.0}, {"spindle_rpm": 3000.0}
    ]  # fmt: skip


@pytest.mark.parametrize(("rise_c_per_min", "jumps"), [(0.1, False), (0.16, False), (0.5, True)])
def test_a_rate_is_what_counts_not_a_step(rise_c_per_min, jumps):
    # Sixty times as fast: 0.16 °C/min becomes 9.6, below the 10 °C/min that is allowed.
    found = plan(recording(rise_c_per_min))
    assert (found.stamps is Stamps.MOVED) == jumps
    assert bool(found.reason) == jumps


def test_moved_readings_end_when_the_last_one_is_sent():
    # Half an hour, sixty times as fast: 30 s.
    found = plan(recording(0.5))
    assert found.readings[-1].time == NOW + timedelta(seconds=30)
    assert found.readings[-1].time - found.readings[0].time == timedelta(minutes=30)


def test_no_reading_is_later_than_it_is_sent():
    for recorded, options in ((recording(0.1), {}), (recording(0.5), {}), (recording(0.1),
                              {"speed": 0.5, "recorded_times": True})):  # fmt: skip
        found = plan(recorded, **options)
        for due_s, sent in zip(found.due_s, found.readings, strict=True):
            assert sent.time <= NOW + timedelta(seconds=due_s)
