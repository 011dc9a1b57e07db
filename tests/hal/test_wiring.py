"""The HAL file: one line a thing, in the order in which the servo thread needs it."""

import pytest

from app.hal.curves import CURVES
from app.hal.wiring import NotWired, sensor_pin, wiring

NODES = {"x": (0.0, 254.0), "y": (0.0, 100.0, 200.0), "z": (-50.0, 0.0)}
JOINTS = {"x": [0], "y": [2], "z": [1]}


def lines_of(*beginning, per_mm=1.0, joints=JOINTS):
    written = wiring(NODES, joints, per_mm, ["python", "-m", "app"]).splitlines()
    return [line.split() for line in written if line.split()[: len(beginning)] == list(beginning)]


def test_every_curve_reads_its_axis_and_moves_its_axis():
    (_, _, source, _, *readers) = lines_of("net", "thermap-y-nominal")[0]
    assert source == "joint.2.pos-cmd"
    assert readers == ["thermap-exy.in", "thermap-eyy.in", "thermap-ezy.in"]
    moved = [line[-1] for line in lines_of("net") if line[2] in ("thermap-eyx.out",)]
    assert moved == ["thermap-sum-ya.in0"]


def test_each_joint_of_a_gantry_is_moved_alike():
    joints = {"x": [0], "y": [1, 2], "z": [3]}
    (offset,) = lines_of("net", "thermap-y-offset", joints=joints)
    assert offset[4:] == ["thermap-y.offset", "thermap-y2.offset"]
    for name, joint in (("thermap-y", 1), ("thermap-y2", 2)):
        (commanded,) = lines_of("net", f"{name}-commanded", joints=joints)
        assert commanded[2:] == [f"joint.{joint}.motor-pos-cmd", "=>", f"{name}.in"]
        (actual,) = lines_of("net", f"{name}-actual", joints=joints)
        assert actual[2:] == [f"{name}.fb-out", "=>", f"joint.{joint}.motor-pos-fb"]
        for half in ("update-feedback", "update-output"):
            assert lines_of("addf", f"{name}.{half}", joints=joints)
    assert "thermap-y2" in lines_of("loadrt", "offset", joints=joints)[0][2]
    assert [line[2] for line in lines_of("net", "thermap-y-nominal", joints=joints)] == [
        "joint.1.pos-cmd"
    ]


def test_feedback_comes_before_motion_and_the_offsets_after_their_sums():
    order = [line[1] for line in lines_of("addf")]
    assert all(line[3] == "1" for line in lines_of("addf") if line[1].endswith("feedback"))
    assert order.index("thermap-sum-xa") < order.index("thermap-sum-xb")
    assert max(order.index(f"thermap-{c.lower()}") for c in CURVES) < order.index("thermap-sum-xa")
    assert [name for name in order if name.endswith("output")] == order[-4:-1]
    assert order[-1] == "thermap-clock"


def test_points_are_in_the_machine_s_units():
    assert lines_of("setp", "thermap-exx.x-val-01") == [["setp", "thermap-exx.x-val-01", "254"]]
    inch = lines_of("setp", "thermap-exx.x-val-01", per_mm=1 / 25.4)
    assert inch == [["setp", "thermap-exx.x-val-01", "10"]]
    assert "personality=2,2,2,3,3,3,2,2,2" in lines_of("loadrt", "lincurve")[0]


@pytest.mark.parametrize("name", ["Säule 1", "", "a" * 30, "a,b"])
def test_a_sensor_that_hal_cannot_name_is_refused(name):
    with pytest.raises(NotWired, match="expected a sensor's name of at most 27 letters"):
        sensor_pin(name)


def test_a_line_that_hal_would_cut_is_refused():
    with pytest.raises(NotWired, match="expected a line of at most 1000 characters"):
        wiring(NODES, JOINTS, 1.0, ["a" * 1000])
