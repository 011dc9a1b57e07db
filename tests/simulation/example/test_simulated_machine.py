"""The example machine has the chapter's configuration and sensors, and says it is simulated."""

import app.simulation.example
from app.geometry.needed_components import needed_components
from app.simulation.example import error_maps, machine, true_errors, warm_up
from app.simulation.example.error_maps import run_map
from app.simulation.example.machine import SENSORS, example_machine, positions_mm
from app.thermal.compile_model import compile_model


def test_it_is_the_chapters_configuration_with_its_four_sensors():
    # C. Wang, 8.2.6 (XYFZ) and 8.2.7 (the four places).
    example = example_machine()
    assert example.id == "mcfv5050"
    assert example.chain.text == "XYFZ"
    assert tuple(example.sensors) == ("spindle", "z-column", "x-middle", "y-front") == SENSORS
    assert example.sensor("x-middle").stand_in == "y-front"
    assert {s.max_age_s for s in example.sensors.values()} == {120.0}


def test_nobody_can_take_it_for_a_real_machine():
    assert "simulated" in example_machine().name
    assert "simulated" in str(run_map(1).instrument)
    for module in (app.simulation.example, machine, warm_up, true_errors, error_maps):
        assert "simulated" in str(module.__doc__)


def test_tables_cover_the_travel():
    for axis, travel in example_machine().axes.items():
        positions = positions_mm(axis)
        assert positions.size == 21
        assert (positions[0], positions[-1]) == (travel.min_mm, travel.max_mm)


def test_a_map_has_all_that_the_volumetric_error_consists_of():
    needed = needed_components(example_machine().chain, tool_offset_mm=(10.0, 20.0, 160.0))
    assert len(needed) == 21
    assert all(set(run_map(n).tables) == set(needed) for n in warm_up.RUNS)


def test_all_components_follow_the_chapters_sensors_without_an_assignment():
    # 8.2.9: x-middle for the errors of x, y and S_xy; z-column for those of z, S_yz and S_zx.
    model = compile_model(example_machine(), [run_map(n) for n in (1, 3, 6)], assignment={})
    assert model.omitted == {}
    assert model.notes == ()
    assert {group.sensor: set(group.codes) for group in model.groups} == {
        "x-middle": {f"E{way}{axis}" for way in "XYZABC" for axis in "XY"} | {"SXY"},
        "z-column": {f"E{way}Z" for way in "XYZABC"} | {"SYZ", "SZX"},
    }


def test_y_front_can_stand_in_for_x_middle():
    model = compile_model(example_machine(), [run_map(n) for n in (1, 3, 6)], assignment={})
    temperatures = warm_up.run_temperatures(4)
    del temperatures["x-middle"]
    assert {state.sensor for state in model.errors_at(temperatures)} == {"y-front", "z-column"}
