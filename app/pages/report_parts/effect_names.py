"""Names in words: verdicts, statuses, components, kinds of effects, their parameters and rivals."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Final

from app.effects.claim import Named
from app.effects.kind import NotTested
from app.effects.registry import kind_of
from app.effects.valid import LearntIn
from app.errors import list_names
from app.identification.analysis import advice
from app.identification.analysis.found_effect import Evidence, FoundEffect
from app.pages.wording import message
from app.units import date_text, duration_text, plus_minus, true_minus, unit_of_field

VERDICTS: Final = {
    "effects-found": message("Effects found"),
    "nothing-found": message("Nothing found"),
    "unexplained": message("Something unexplained"),
    "not-judged": message("Not judged"),
}
STATUSES: Final = {
    "confirmed": "confirmed on held-out visits",
    "suspected": (
        "suspected: held-out visits, an unexplained remainder or a tie leave its name open"
    ),
    "not-confirmable": "not confirmable: the held-out visits cannot show it",
}
MARKS: Final = {
    **{"effects-found": "✓", "nothing-found": "–", "unexplained": "?", "not-judged": "?"},
    **{"confirmed": "✓", "suspected": "?", "not-confirmable": "–"},
}
"""So that neither a verdict nor a status is told by colour alone."""

TESTS: Final = {
    "generic": "it varies smoothly with something that was recorded",
    "lack-of-fit": "residuals at one place differ more than repeats made there",
    "held-out": "held-out residuals are well above the floor",
    "many-of-one-family": (
        "several effects of one kind on one component: they imitate something else"
    ),
    "alike-outliers": "values that were left out are off by the same, in several visits",
    "far-off": "further from the model than set-ups scatter, in too few visits to say why",
    "many-at-one-place": "several effects in one place: each fits only partly",
    "flexible": "a found effect whose course differs from the library's",
}
"""Which test says that structure is left."""

PARAMETERS: Final = (
    *(message("amplitude"), message("assumed"), message("bias"), message("bow")),
    *(message("changed at"), message("curvature"), message("drift"), message("lasted")),
    *(message("length"), message("pitch"), message("reversal"), message("shift")),
    *(message("share"), message("slope"), message("time constant"), message("within")),
)
"""What most parameters are called, for the catalogues."""

_UNIX_TIME: Final = "_unix_s"
_PARAMETER: Final = re.compile(
    r"(?=\w+\Z)(?P<stem>\w+?)_(?P<unit>um_per_m|urad_per_m|um|urad|mm|deg|min|h|k|c)(_per_(?P<per>\w+))?"
)
_SYMBOLS: Final = {"min": "min", "h": "h", "k": "K", "c": "°C", "k2": "K²", "day": "day"}


def parameter_name(name: str) -> str:
    """Name a parameter in words, without its unit.

    Parameters
    ----------
    name
        As the effect has it; it ends in its unit.

    Examples
    --------
    >>> parameter_name("time_constant_min"), parameter_name("slope_rise_um_per_k")
    ('time constant', 'slope, rise from mid-travel to the end')
    >>> parameter_name("changed_at_unix_s"), parameter_name("profile_at_50_mm_um")
    ('changed at', 'profile at 50 mm')
    """
    found = _PARAMETER.fullmatch(name)
    stem = found["stem"] if found else name.removesuffix(_UNIX_TIME)
    rise = stem.removesuffix("_rise")
    words = rise.replace("_", " ")
    return words if rise == stem else f"{words}, rise from mid-travel to the end"


def parameter_unit(name: str) -> str:
    """Read a parameter's unit off its name; empty for a pure number.

    Examples
    --------
    >>> parameter_unit("slope_um_per_k"), parameter_unit("drift_um_per_m_per_day")
    ('µm/K', 'µm/m/day')
    >>> parameter_unit("slope_um_per_payload_kg"), parameter_unit("share")
    ('µm/payload_kg', '')
    >>> parameter_unit("length_um_per_m_per_k"), parameter_unit("assumed_c")
    ('µm/m/K', '°C')
    """
    found = _PARAMETER.fullmatch(name)
    if found is None:
        return ""
    symbol = unit_of_field(f"_{found['unit']}") or _SYMBOLS[found["unit"]]
    per = found["per"]
    return f"{symbol}/{_SYMBOLS.get(per, per)}" if per else symbol


def parameter_text(name: str, value: float, error: float | None) -> str:
    """Write a parameter's value with its standard error and unit.

    Parameters
    ----------
    value
        In the unit that the name ends in.
    error
        One standard deviation, where one is known.

    Examples
    --------
    >>> parameter_text("slope_um_per_k", -0.2137, 0.0114)
    '−0.214 ± 0.011 µm/K'
    >>> parameter_text("lasted_h", 5.0, None)
    '5 h'
    >>> parameter_text("changed_at_unix_s", 1.7e9, 43200.0)
    '2023-11-14 22:13 UTC ± 12 h'
    """
    if name.endswith(_UNIX_TIME):
        return date_text(value) + (f" ± {duration_text(error)}" if error else "")
    return true_minus(plus_minus(value, error, parameter_unit(name)).strip())


def kind_name(kind: str) -> str:
    """Write an effect's kind as words.

    Examples
    --------
    >>> kind_name("thermal-lag")
    'thermal lag'
    """
    return kind.replace("-", " ")


def adoption_text(effect: FoundEffect) -> str:
    """Say in sentences whether an effect is adopted, and what to do about one that never is."""
    if reason := kind_of(effect.kind).not_adopted:
        what_to_do = advice.what_to_do(effect)
        if not what_to_do:
            return f"It is never adopted: {reason}."
        if kind_of(effect.kind).never_sure:
            return f"It is never adopted: {reason}. {what_to_do}"
        return f"It is never adopted; correct it at its source: {reason}. {what_to_do}"
    if effect.helps:
        if effect.evidence.seen_in_readings:
            return "It is adopted by default."
        return "It helps on held-out visits, and is adopted by default."
    return f"It is not adopted by default, only if you name it: {effect.why_not}."


def learnt_text(effect: FoundEffect) -> str:
    """Say in which ranges an effect was learnt; empty where nothing is ever held at their edge.

    That is so of what is never adopted, and of a sensor whose readings themselves show its fault.
    """
    if kind_of(effect.kind).not_adopted or effect.evidence.seen_in_readings:
        return ""
    return learnt_words(effect.valid)


def learnt_words(valid: LearntIn | None) -> str:
    """Say in which ranges an effect was learnt: beyond them it is held at the edge.

    Returns
    -------
    str
        Empty where it is not known.

    Examples
    --------
    >>> from datetime import datetime
    >>> learnt_words(LearntIn(datetime(2026, 3, 1), datetime(2026, 3, 31),
    ...     {"z-column": (21.43, 29.8)}, {"rpm": (0, 12000)}, {"EZZ": (2.5, 497.5)}, {}, None))
    '2026-03-01 to 2026-03-31; z-column 21.4 to 29.8 °C; rpm 0 to 12000; EZZ 2.5 to 497.5 mm'
    """
    if valid is None:
        return ""
    parts = [f"{valid.from_:%Y-%m-%d} to {valid.to:%Y-%m-%d}"]
    for ranges, form, unit in (
        (valid.temperatures_c, ".1f", " °C"),
        (valid.state, "g", ""),
        (valid.made_of, ".3g", ""),
        (valid.positions_mm, "g", " mm"),
    ):
        for name, ends in ranges.items():
            low, high = (true_minus(format(end, form)) for end in ends)
            parts.append(f"{name} {low} to {high}{unit}")
    return "; ".join(parts)


def untested_together(
    not_testable: Iterable[NotTested],
) -> list[tuple[str, str, str]]:
    """Say each reason once for all kinds of effects that could not be tested for it.

    Returns
    -------
    list of tuple of str
        Names of the kinds, what they act on (empty where no one thing), the reason.

    Examples
    --------
    >>> few = ("EBX", "needs 8 visits, got 6")
    >>> untested_together([NotTested("drift", *few), NotTested("thermal-lag", *few)])
    [('drift, thermal lag', 'EBX', 'needs 8 visits, got 6')]
    """
    together: dict[tuple[str, str], list[str]] = {}
    for one in not_testable:
        together.setdefault((one.on, one.reason), []).append(kind_name(one.kind))
    return [(list_names(kinds), on, reason) for (on, reason), kinds in together.items()]


def explanation_name(explanation: Named) -> str:
    """Name an explanation: its kind, what it acts on, what drives it.

    Examples
    --------
    >>> from app.effects.effect import Effect
    >>> explanation_name(Effect("other-sensor", components=("EXX",), sensors=("bed",)))
    'other sensor: EXX with bed'
    """
    drivers = [*explanation.sensors, *explanation.states]
    acts = f"{kind_name(explanation.kind)}: {list_names(explanation.components, 3)}"
    return f"{acts} with {list_names(drivers, 3)}" if drivers else acts


def status_words(status: str, evidence: Evidence) -> str:
    """Say in words how far an effect is confirmed.

    Examples
    --------
    >>> status_words("confirmed", Evidence())
    'confirmed on held-out visits'
    >>> status_words("confirmed", Evidence(seen_in_readings="stuck for 9 h"))
    'seen in the readings themselves'
    """
    if evidence.seen_in_readings:
        return "seen in the readings themselves"
    return STATUSES[status]


def rival_name(effect: Named, rival: Named) -> str:
    """Name a rival of an effect; a kind may have several forms with the same drivers.

    Examples
    --------
    >>> from app.effects.effect import Effect
    >>> one = Effect("backlash", components=("EXX",))
    >>> rival_name(one, one), rival_name(one, Effect("drift", components=("EXX",)))
    ('another form of backlash: EXX', 'drift: EXX')
    """
    name = explanation_name(rival)
    return f"another form of {name}" if name == explanation_name(effect) else name
