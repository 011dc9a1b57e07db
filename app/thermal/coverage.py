"""What a model covers: at which temperatures, and there at which positions."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

from app.thermal.compiled_model import CompiledModel
from app.thermal.group import Group, Member
from app.thermal.machine import Machine, OutOfRange


@dataclass(frozen=True, slots=True)
class CoveredInterval:
    """The positions that one component's table has over an interval of temperature.

    Parameters
    ----------
    from_c, to_c
        The interval of the assigned sensor's temperature [°C]; −∞ or ∞ where the last map
        is held however far.
    from_mm, to_mm
        The range of positions; −∞ to ∞ where the errors do not depend on position.
    lower_map, upper_map
        Labels of the maps in use: the same twice where one map is held.
    """

    from_c: float
    to_c: float
    from_mm: float
    to_mm: float
    lower_map: str
    upper_map: str


@dataclass(frozen=True, slots=True)
class Coverage:
    """What a model covers of one component: intervals in the order of its sensor's temperature."""

    sensor: str
    intervals: tuple[CoveredInterval, ...]


def coverage(model: CompiledModel) -> dict[str, Coverage]:
    """Say of each component where a model gives it, in temperature and position.

    Parameters
    ----------
    model
        The compiled model. What another sensor would give that stands in does not count.

    Returns
    -------
    dict of component code to Coverage
        Components that no two maps have are not in it. Between two neighbouring maps their
        common range; below the first and above the last map what the machine's policy
        gives: held at that map without end (`clamp`), the line through the last two as far
        as the margin (`extrapolate`), nothing (`reject`). At the very temperature of a map
        its own range holds, which can be longer than on either side: that is no interval.

    Examples
    --------
    What a version B loses against a version A of the same sensor are the intervals of A in
    which an interval of B that meets them reaches less far, or that none of B meets.
    """
    return {
        member.component.code: Coverage(
            group.sensor, tuple(_intervals(model.machine, group, member))
        )
        for group in model.groups
        for member in group.members
    }


def _intervals(machine: Machine, group: Group, member: Member) -> list[CoveredInterval]:
    scale = group.scales[0]
    temperatures, rows = scale.temperatures_c, scale.rows

    def interval(from_c: float, to_c: float, lower: int, upper: int) -> CoveredInterval:
        low, high = member.common_range((lower, upper))
        labels = (group.labels[lower], group.labels[upper])
        return CoveredInterval(from_c, to_c, low, high, *labels)

    between = [
        interval(*here, *maps)
        for here, maps in zip(pairwise(temperatures), pairwise(rows), strict=True)
    ]
    first, last = temperatures[0], temperatures[-1]
    if machine.out_of_range is OutOfRange.CLAMP:
        below = [interval(-math.inf, first, rows[0], rows[0])]
        above = [interval(last, math.inf, rows[-1], rows[-1])]
    elif machine.out_of_range is OutOfRange.EXTRAPOLATE:
        margin = machine.extrapolation_margin_c
        below = [interval(first - margin, first, rows[0], rows[1])]
        above = [interval(last, last + margin, rows[-2], rows[-1])]
    else:
        below = above = []
    return [*below, *between, *above]
