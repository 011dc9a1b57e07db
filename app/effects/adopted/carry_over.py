"""Which adopted effects still hold when a model's maps or its sensors change.

An effect is what the maps lacked. A new map of its component has measured some effects
along: they would be corrected twice. Others rest on what the maps' temperatures were, or on the
sensor that the component followed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from app.effects.campaign_view import beyond_maps
from app.effects.driver import BeyondMaps, Curvature, Driver, ShareOfMap
from app.effects.effect import Effect
from app.effects.kinds.response import Response
from app.effects.kinds.sensor_fault import BIAS, SensorFault
from app.effects.kinds.step import is_after_change
from app.effects.map_tables import maps_of_label, temperatures_of_maps
from app.effects.registry import kind_of
from app.effects.shape import Exchange, Sensitivity
from app.effects.term import Term
from app.errors import list_names
from app.thermal.compiled_model import CompiledModel
from app.thermal.error_map import ErrorMap


@dataclass(frozen=True, eq=False)
class Change:
    """What changes from one model version to the next."""

    before: CompiledModel
    after: CompiledModel
    maps: Sequence[ErrorMap]
    new_maps: Sequence[ErrorMap]

    def measured_again(self, code: str) -> list[ErrorMap]:
        """List the new maps that have a component."""
        return [m for m in self.new_maps if code in m.tables]


def carry_over(effects: Sequence[Effect], change: Change) -> tuple[list[Effect], list[str]]:
    """Keep the effects that still hold, brought up to date with the maps.

    Returns
    -------
    kept, notes : list of Effect, list of str
        What the next version has, and what was left out with the reason.
    """
    carried, notes = [], []
    for effect in effects:
        terms: list[Term] = []
        mixed: list[str] = []
        for code in effect.components:
            updates = [_updated(term, change) for term in effect.terms if term.component == code]
            still = [term for term in updates if term is not None]
            why = _why_over(effect, code, change)
            if not why and len(still) < len(updates):
                why = kind_of(effect.kind).gone
            why = why or next(filter(None, (_why_unread(term, change) for term in still)), "")
            if why:
                notes.append(f"{effect.kind} of {code} left out: {why}")
            else:
                terms += still
                mixed += [code] if _is_mixed(effect, code, change) else []
        if mixed:
            notes.append(
                f"{effect.kind} of {list_names(mixed)} kept, though only some of their maps were "
                f"measured after it and state what {effect.sensors[0]} wrongly read: measure the "
                "others again too"
            )
        if not effect.terms:  # what the readings show: it is known, and adds nothing
            carried.append(effect)
        elif terms:
            codes = tuple(dict.fromkeys(term.component for term in terms))
            carried.append(replace(effect, components=codes, terms=tuple(terms)))
    return carried, notes


def without_replaced(effects: Sequence[Effect], adopted: Sequence[Effect]) -> list[Effect]:
    """Leave out of a model's effects the responses that newly adopted ones take the place of."""
    anew = {code for e in adopted if e.kind == Response.kind for code in e.components}
    return [e for e in effects if e.kind != Response.kind or not anew.intersection(e.components)]


def _why_over(effect: Effect, code: str, change: Change) -> str:
    """Say why an effect no longer holds for a component, empty where it does."""
    before, after, kind = change.before.find(code), change.after.find(code), kind_of(effect.kind)
    if before and after and effect.sensors and before[0].sensor != after[0].sensor:
        return f"{code} follows {after[0].sensor} now"
    if all(_from_after_fault(effect, code, change)):
        return f"all maps were measured after it, and state what {effect.sensors[0]} read"
    if kind.lacked_by_maps and after and not before:
        return f"the maps have {code} now"
    again = any(kind.is_measured_along(table, effect) for table in change.measured_again(code))
    if again or (kind.zero_in_maps and _is_inside(effect, code, change)):
        labels = list_names(repr(m.label) for m in change.measured_again(code))
        return f"it was measured again in map {labels}"
    return ""


def _from_after_fault(effect: Effect, code: str, change: Change) -> list[bool]:
    """Say of each map of a component whether a sensor's bias was there; one no without a bias."""
    after = change.after.find(code)
    if effect.kind != SensorFault.kind or effect.variant != BIAS or after is None:
        return [False]
    maps = (m for label in after[0].labels for m in maps_of_label(change.maps, label))
    return [is_after_change(m, effect) for m in maps]


def _is_mixed(effect: Effect, code: str, change: Change) -> bool:
    """Whether a new map states a biased temperature beside older ones that do not."""
    return any(_from_after_fault(effect, code, change)) and any(
        is_after_change(m, effect) for m in change.measured_again(code)
    )


def _why_unread(term: Term, change: Change) -> str:
    """Say why the maps cannot be read at other temperatures, empty where they can."""
    if change.after.find(term.component) is None:
        return ""
    return term.shape.why_missing(change.after, term.component)


def _is_inside(effect: Effect, code: str, change: Change) -> bool:
    """Whether a new map has measured the effect along, and it cannot know of it."""
    terms = [term for term in effect.terms if term.component == code]
    knows = all(_knows_maps(term.driver, code, change.before) for term in terms)
    return bool(change.measured_again(code)) and not knows


def _knows_maps(driver: Driver, code: str, before: CompiledModel) -> bool:
    if isinstance(driver, Curvature):
        located = before.find(code)
        return located is not None and driver.temperatures_c == located[0].scales[0].temperatures_c
    return isinstance(driver, BeyondMaps)


def _updated(term: Term, change: Change) -> Term | None:
    """Tell a term of the maps as they are now; None where they do not say enough."""
    located = change.after.find(term.component)
    if located is None:
        return term
    driver, shape = term.driver, term.shape
    if isinstance(shape, Exchange) and shape.sensor == located[0].sensor:
        put_right = _still_wrong(shape, term.component, change)
        if put_right is None:
            return None
        shape = put_right
    elif isinstance(shape, Exchange):
        temperatures = temperatures_of_maps(change.after, change.maps, shape.sensor)
        in_maps_c = {
            label: temperatures[label] for label in located[0].labels if label in temperatures
        }
        shape = Exchange.of(shape.sensor, in_maps_c)
        if len(in_maps_c) < len(located[0].labels):
            return None
    elif isinstance(shape, Sensitivity):
        # Of a new map it is not known here: it counts as measured when all had settled.
        stay = set(located[0].labels) - {m.label for m in change.new_maps}
        in_maps_k = tuple((label, k) for label, k in shape.in_maps_k if label in stay)
        shape = replace(shape, in_maps_k=in_maps_k)
    if isinstance(driver, BeyondMaps):
        of_maps = beyond_maps(
            change.after, change.maps, term.component, driver.sensor, driver.minus
        )
        if of_maps is None:
            return None
        of_maps = _as_late(of_maps, driver)
        if term.learnt is not None:
            term = replace(term, learnt=driver.moved(term.learnt, of_maps))
        driver = of_maps
    elif isinstance(driver, Curvature) and _knows_maps(driver, term.component, change.before):
        driver = replace(driver, temperatures_c=located[0].scales[0].temperatures_c)
        term = replace(term, learnt=None)  # the temperature's own range holds it
    elif isinstance(driver, ShareOfMap) and driver.sensor == located[0].sensor:
        now_c = located[0].scales[0].temperatures_c
        if driver.map_c not in now_c:
            return None
        driver = replace(driver, temperatures_c=now_c)
    return replace(term, driver=driver, shape=shape)


def _as_late(of_maps: BeyondMaps, before: BeyondMaps) -> BeyondMaps:
    """Make a driver as late as it was before, with what is known of the past at older maps.

    Of a new map it is not known here: it counts as measured when all had settled.
    """
    if before.time_constant_s is None:
        return of_maps
    before_c = dict(before.in_maps_c)
    points = tuple(
        (measured_c, before_c.get(measured_c, there)) for measured_c, there in of_maps.in_maps_c
    )
    return replace(of_maps, in_maps_c=points, time_constant_s=before.time_constant_s)


def _still_wrong(shape: Exchange, code: str, change: Change) -> Exchange | None:
    """Put the maps as they are now on a scale with the same temperatures put right.

    Returns
    -------
    Exchange, or None
        None where none of these temperatures is noted as it was before.
    """
    before, now = (_noted(model, code) for model in (change.before, change.after))
    if now == before:
        return shape
    right = {
        label: t
        for label, t in shape.map_temperatures_c
        if t != before.get(label) and label in now and now[label] == before.get(label)
    }
    return Exchange.of(shape.sensor, {**now, **right}) if right else None


def _noted(model: CompiledModel, code: str) -> dict[str, float]:
    """Say at which temperature of the assigned sensor each map of a component was noted [°C]."""
    located = model.find(code)
    if located is None:
        return {}
    group, scale = located[0], located[0].scales[0]
    temperatures = zip(scale.rows, scale.temperatures_c, strict=True)
    return {group.labels[row]: t for row, t in temperatures}
