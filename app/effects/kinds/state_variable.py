"""Spindle speed, payload, feed, or anything else that the shop records."""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np

from app.effects.campaign_view import CampaignView
from app.effects.conditions import Signal
from app.effects.driver import State
from app.effects.effect import Effect
from app.effects.hypothesis import Hypothesis, Nonlinear
from app.effects.kind import EffectKind, Need, Proposed, additive, not_late
from app.effects.words import MOST_NAMED, parameter, size_along, symbol_of
from app.errors import list_names

AT_ONCE, SQUARED = "at once", "squared at once"
LATE, SQUARED_LATE = "late", "squared, late"
POWERS: Final = {AT_ONCE: 1, SQUARED: 2, LATE: 1, SQUARED_LATE: 2}


class StateVariable(EffectKind):
    """A component moves with a state, or its square, at once or through a low-pass."""

    kind = "state-variable"
    text = "spindle speed, payload, feed …, at once or with a time constant"
    needs = Need.STATE
    of_the_type = True
    shown_by = (
        "measure {component} at three values of {state} in quick succession, before any "
        "temperature has changed, and every 10 min after {state} has gone back"
    )
    against = {
        "state-variable": "measure {component} at three values of {state}, at once and every 10 "
        "min for an hour after each change, each value with and without the other state",
        "thermal-lag": (
            "change {state} while the temperatures are steady, and measure {component} at once"
        ),
        "additional-sensor": (
            "measure {component} while the spindle coasts down after a run: the temperature of "
            "{rival} outlasts {state}"
        ),
        "sensor-gradient": (
            "measure {component} while the spindle coasts down after a run: the temperature "
            "difference outlasts {state}"
        ),
    }

    def propose(self, view: CampaignView) -> Proposed:
        """Every component with every state that varied, in four forms.

        At once only where it varied while that component was observed.
        """
        for state, values in sorted(view.conditions.states.items()):
            if state not in view.varying_states:
                yield self.refuse(state, f"{state} did not change, or was not always recorded")
                continue
            # With two values, the square is the same as the state itself.
            two_values = np.unique(values[~np.isnan(values)]).size < 3
            signal = Signal("state", state)
            grids = {
                LATE: view.time_constants_s(signal),
                SQUARED_LATE: view.time_constants_s(Signal("state", state, 2)),
            }
            yield from not_late(self, view, {signal: grids[LATE]}, LATE)
            changing = [c for c in view.components if view.changes_where(c, values)]
            if steady := [code for code in view.components if code not in changing]:
                where = f"{state}, at once, on {list_names(steady, MOST_NAMED)}"
                why = f"{state} did not change while this was observed, or hardly"
                yield self.refuse(where, why)
            for variant, power in POWERS.items():
                if not (power == 2 and two_values) and grids.get(variant, (0.0,)):
                    grid = grids.get(variant, ())
                    for code in view.components if grid else changing:
                        yield _hypothesis(view, code, state, variant, grid)

    def explain(self, effect: Effect) -> str:
        """Say with which state what moves, how much, and how late."""
        code, state = effect.components[0], effect.states[0]
        squared = POWERS[effect.variant] == 2
        how = size_along(effect, "slope", symbol_of(code, f"{state}²" if squared else state))
        late = ""
        if "time_constant_min" in effect.parameters:
            late = f", {parameter(effect, 'time_constant_min', 'min')} late"
        what = f"the square of {state}" if squared else state
        return f"{code} moves with {what}{late}, by {how}"


def _hypothesis(
    view: CampaignView, code: str, state: str, variant: str, grid: tuple[float, ...]
) -> Hypothesis:
    per = f"{state}_squared" if POWERS[variant] == 2 else state
    return additive(
        *(StateVariable.kind, code, partial(State, state, POWERS[variant]), view.shapes(code)),
        sizes=f"slope_{{unit}}_per_{per}",
        variant=variant,
        states=(state,),
        nonlinear=Nonlinear.time_constant(grid) if grid else None,
        within_visit=not grid,
    )
