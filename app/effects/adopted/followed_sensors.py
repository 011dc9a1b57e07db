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
    found: list[ReadMaps] = []
    for effect in effects:
        held = moment if effect.valid is None else effect.valid.held(moment)
        for term in effect.terms:
            if term.component == code and isinstance(term.shape, Exchange):
                share = term.coefficient * float(term.driver.at(held)[0])
                found += _exchanged(model, code, term.shape, held, share)
    return _summed([ReadMaps(1.0, origin), *found]) if found else []


def basis_of_maps(read: Sequence[ReadMaps]) -> Basis:
    """Say what a row rests on that reads its maps by several sensors.

    Returns
    -------
    Basis
        Sensor and temperature are those of the largest share; the maps and the weight are None
        where the numbers are not on one line between two maps.
    """
    shares: dict[str, float] = {}
    for one in read:  # held, the assigned sensor is read at two temperatures
        shares[one.state.sensor] = shares.get(one.state.sensor, 0.0) + one.share
    read = sorted(read, key=lambda one: (-shares[one.state.sensor], -one.share))
    main = read[0].state
    lower, upper, weight = _between(read, main)
    status = max((one.state.status for one in read), key=GRAVITY.index)
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
            Follows(one.state.sensor, one.state.temperature_c, one.share) for one in read
        ),
    )


def _exchanged(
    model: CompiledModel, code: str, shape: Exchange, held: Conditions, share: float
) -> Iterator[ReadMaps]:
    other, found = shape.by_other(model, code), model.find(code)
    if other is None or found is None:
        return
    for part, group in ((share, other), (-share, found[0])):
        scale = group.scales[0]
        temperature_c = float(held.temperature(scale.sensor)[0])
        yield ReadMaps(part, model.group_at(group, scale, temperature_c))


def _summed(read: Iterable[ReadMaps]) -> list[ReadMaps]:
    """Put together what was read by one sensor at one temperature; what cancels is left out.

    On another scale the same temperature of the same sensor means other maps.
    """
    found: dict[tuple[str, float, Scale], ReadMaps] = {}
    for one in read:
        scale = one.state.group.scales[0]
        key = (one.state.sensor, one.state.temperature_c, scale)
        before = found.get(key)
        found[key] = one if before is None else before._replace(share=before.share + one.share)
    return [one for one in found.values() if abs(one.share) > ROUNDING]


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
