"""By which sensors a component's maps are read where an adopted effect exchanges its sensor.

The effect adds share × (E by the other sensor − E by the assigned one) to what the maps say by
the assigned one. All of it are the same maps, so the row can say what its numbers really are:
which sensor has the largest share, and between which two maps they lie.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from app.compensation.table import Basis, Follows
from app.effects.conditions import Conditions
from app.effects.effect import Effect
from app.effects.shape import Exchange
from app.thermal.bracket import Status
from app.thermal.compiled_model import CompiledModel
from app.thermal.group import Scale
from app.thermal.group_state import GroupState
from app.thermal.map_weights import ROUNDING
from app.thermal.prediction import GRAVITY


class ReadMaps(NamedTuple):
    """One component's maps read at one sensor's temperature, and the share of it in a row."""

    share: float
    state: GroupState


def read_maps(
    model: CompiledModel,
    origin: GroupState,
    code: str,
    effects: Iterable[Effect],
    moment: Conditions,
) -> list[ReadMaps]:
    """Take apart by which sensors a component's maps are read.

    Returns
    -------
    list of ReadMaps
        Shares sum to 1; none where no sensor is exchanged.

    Raises
    ------
    OutsideMaps
        If the machine's policy does not allow another sensor's temperature.
    """
    maps_read: list[ReadMaps] = []
    for effect in effects:
        limited = moment if effect.valid is None else effect.valid.held(moment)
        for term in effect.terms:
            if term.component == code and isinstance(term.shape, Exchange):
                share = term.coefficient * float(term.driver.at(limited)[0])
                maps_read += _exchanged(model, code, term.shape, limited, share)
    return _summed([ReadMaps(1.0, origin), *maps_read]) if maps_read else []


def basis_of_maps(read: Sequence[ReadMaps]) -> Basis:
    """Say what a row rests on that reads its maps by several sensors.

    Returns
    -------
    Basis
        Sensor and temperature are those of the largest share; the maps and the weight are None
        where the numbers are not on one line between two maps.
    """
    shares: dict[str, float] = {}
    for map_read in read:  # held, the assigned sensor is read at two temperatures
        shares[map_read.state.sensor] = shares.get(map_read.state.sensor, 0.0) + map_read.share
    read = sorted(read, key=lambda item: (-shares[item.state.sensor], -item.share))
    main = read[0].state
    lower, upper, weight = _between(read, main)
    status = max((map_read.state.status for map_read in read), key=GRAVITY.index)
    if status is Status.AT_MAP and weight not in (0.0, 1.0):
        status = Status.INTERPOLATED
    return Basis(
        sensor=main.sensor,
        temperature_c=main.temperature_c,
        lower_map=lower,
        upper_map=upper,
        weight=weight,
        status=status,
        stand_in_for=main.stand_in_for,
        follows=tuple(
            Follows(map_read.state.sensor, map_read.state.temperature_c, map_read.share)
            for map_read in read
        ),
    )


def _exchanged(
    model: CompiledModel, code: str, shape: Exchange, limited: Conditions, share: float
) -> Iterator[ReadMaps]:
    other, located = shape.by_other(model, code), model.find(code)
    if other is None or located is None:
        return
    for part, group in ((share, other), (-share, located[0])):
        scale = group.scales[0]
        temperature_c = float(limited.temperature(scale.sensor)[0])
        yield ReadMaps(part, model.group_at(group, scale, temperature_c))


def _summed(read: Iterable[ReadMaps]) -> list[ReadMaps]:
    """Put together what was read by one sensor at one temperature; what cancels is left out.

    On another scale the same temperature of the same sensor means other maps.
    """
    by_state: dict[tuple[str, float, Scale], ReadMaps] = {}
    for map_read in read:
        scale = map_read.state.group.scales[0]
        key = (map_read.state.sensor, map_read.state.temperature_c, scale)
        before = by_state.get(key)
        by_state[key] = (
            map_read if before is None else before._replace(share=before.share + map_read.share)
        )
    return [map_read for map_read in by_state.values() if abs(map_read.share) > ROUNDING]


def _between(
    read: Sequence[ReadMaps], main: GroupState
) -> tuple[str | None, str | None, float | None]:
    """Find the two maps and the weight that give the numbers, None where they are more."""
    if len(read) == 1:
        return main.lower_map, main.upper_map, main.weight
    weights: dict[str, float] = {}
    for share, state in read:
        for label, part in (
            (state.lower_map, 1.0 - state.weight),
            (state.upper_map, state.weight),
        ):
            weights[label] = weights.get(label, 0.0) + share * part
    labels = {label for label, weight in weights.items() if abs(weight) > ROUNDING}
    scale = main.group.scales[0]
    in_order = [main.group.labels[row] for row in scale.rows if main.group.labels[row] in labels]
    if len(in_order) == 1 and in_order[0] in (main.lower_map, main.upper_map):
        return main.lower_map, main.upper_map, float(in_order[0] == main.upper_map)
    if len(in_order) != 2:
        return None, None, None
    return in_order[0], in_order[1], weights[in_order[1]]
