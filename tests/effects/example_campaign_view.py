"""A machine, maps, readings and observations, chosen so that effects can be computed by hand.

x-middle follows a slow wave, z-column a slower one that lags it, the spindle moves fastest;
the spindle's speed comes and goes. Everything is linear between the maps at 20, 24 and
30 °C of x-middle (z-column reads 2 °C more there, y-front 1 °C less, the spindle twice as
much above 10).
"""

from datetime import UTC, datetime

import numpy as np

from app.effects.adopted.live_effects import CorrectedTable
from app.effects.campaign_view import CampaignView
from app.effects.conditions import recorded_conditions
from app.effects.observations import Observation, Verification, observation_rows
from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS, ORDER
from app.thermal.compile_model import compile_model
from app.thermal.error_map import ComponentTable, ErrorMap
from app.thermal.machine import Machine, Sensor, Travel, sensors_by_name
from app.thermal.temperature_history import TemperatureHistory

START_S = 1_772_323_200.0
"""2026-03-01, 0 h UTC."""

DAYS = 4
ASSIGNMENT = dict.fromkeys(("EXX", "EYX", "EYY"), "x-middle")
POSITIONS = [0.0, 125.0, 250.0, 375.0, 500.0]


def machine(**policies):
    names = ("x-middle", "y-front", "z-column", "spindle")
    travel = Travel(0.0, 500.0)
    return Machine(
        id="mcfv5050",
        name="MCFV5050LN",
        chain=Chain.parse("XYFZ"),
        axes={"x": travel, "y": travel, "z": travel},
        sensors=sensors_by_name(
            [Sensor(name, max_age_s=600.0, resolution_c=0.05) for name in names]
        ),
        **policies,
    )


def maps(with_rotations=False):
    """Errors per K of x-middle: EXX 1 µm at the end of travel, EZZ 2 then 4 µm, SXY 3 µm/m."""
    along = np.array(POSITIONS) / 500.0
    found = []
    for label, t in {"Run #1": 20.0, "Run #3": 24.0, "Run #6": 30.0}.items():
        above = t - 20.0
        z = 2.0 * min(above, 4.0) + 4.0 * max(above - 4.0, 0.0)
        tables = {
            "EXX": (along * above, POSITIONS),
            "EYX": (0.2 * above * along**2, POSITIONS),
            "EYY": (0.5 * along * above, POSITIONS),
            "EZZ": (z * along, POSITIONS),
            "SXY": ([3.0 * above], ()),
        }
        if with_rotations:
            tables["EBX"] = (2.0 * above * along, POSITIONS)
        found.append(
            ErrorMap(
                label=label,
                measured_at=datetime(2026, 2, 1, tzinfo=UTC),
                temperatures_c={
                    "x-middle": t,
                    "y-front": t - 1.0,
                    "z-column": t + 2.0,
                    "spindle": 2.0 * t - 10.0,
                },
                tables={
                    code: ComponentTable.make(COMPONENTS[code], errors, positions)
                    for code, (errors, positions) in tables.items()
                },
            )
        )
    return found


def temperatures(times_s):
    """What the sensors read: smooth, inside the maps."""
    h = (np.asarray(times_s) - START_S) / 3600.0
    x = 25.0 + 3.5 * np.sin(2 * np.pi * h / 5.0)
    return {
        "x-middle": x,
        "y-front": 24.0 + 3.0 * np.sin(2 * np.pi * h / 5.0 - 0.5),
        "z-column": 27.0 + 3.5 * np.sin(2 * np.pi * h / 7.0 - 1.0),
        "spindle": 40.0 + 8.0 * np.sin(2 * np.pi * h / 3.1 + 0.7),
    }


def speed_rpm(time_s):
    """The spindle's speed: three values, a change every 20 min."""
    return (0.0, 4000.0, 9000.0)[int((time_s - START_S) // 1200) % 3]


def readings():
    times = START_S + np.arange(0.0, (DAYS + 1) * 86400.0, 120.0)
    history = TemperatureHistory(times, temperatures(times))
    states = [(t, {"spindle_rpm": speed_rpm(t), "payload_kg": 50.0}) for t in times.tolist()]
    return history, states


def observations(with_points=True, seed=3, visits_a_day=3, measured=None):
    """Component lines from both sides, and points with two tools; `measured` is 0 at first."""
    rng = np.random.default_rng(seed)
    verifications = []
    for number in range(DAYS * visits_a_day):
        begin = START_S + 86400.0 + number * 86400.0 / visits_a_day
        found, t = [], begin
        for code in ("EXX", "EZZ", "EYY"):
            axis = "xyz".index(COMPONENTS[code].axis)
            for at in np.round(np.sort(rng.uniform(5.0, 495.0, 4)), 3):
                for direction in (1, -1):
                    t += 120.0
                    directions = [0, 0, 0]
                    directions[axis] = direction
                    found.append(
                        Observation(t, (0.0,), code, float(at), directions=tuple(directions))
                    )
        t += 120.0
        found.append(Observation(t, (0.0,), "SXY"))
        for point in np.round(rng.uniform(5.0, 495.0, (4, 3)), 3) if with_points else ():
            for tool in ((0.0, 0.0, 100.0), (0.0, 0.0, 250.0)):
                t += 120.0
                found.append(
                    Observation(
                        t,
                        (0.0, 0.0, 0.0),
                        point_mm=tuple(point.tolist()),
                        tool_offset_mm=tool,
                        directions=(1, -1, 1),
                    )
                )
        verifications.append(Verification(f"visit {number}", found))
    return verifications


def example_view(with_points=True, with_rotations=False, verifications=None, **policies):
    """The whole campaign as the kinds of effects see it."""
    own = maps(with_rotations)
    model = compile_model(machine(**policies), own, ASSIGNMENT)
    rows = observation_rows(verifications or observations(with_points))
    history, states = readings()
    conditions = recorded_conditions(
        model.machine.sensors, history, states, rows.times_s, rows.states
    )
    return CampaignView(model, own, rows, conditions)


def all_rows(states, found):
    """The rows of all components: with effects where they have some."""
    plain = [
        CorrectedTable(
            member.component,
            member.positions_mm,
            state.values[member.forward],
            None if member.backward is None else state.values[member.backward],
            (),
            state,
        )
        for state in states
        for member in state.members
    ]
    rows = {row.component.code: row for row in (*plain, *found.tables)}
    return {code: rows[code] for code in sorted(rows, key=ORDER.__getitem__)}
