"""A second sensor acts too, at once or late."""

from __future__ import annotations

from app.effects.campaign_view import CampaignView
from app.effects.conditions import Signal
from app.effects.driver import AboveReference
from app.effects.effect import Effect
from app.effects.kind import (
    EffectKind,
    Need,
    Proposed,
    constant_sensors,
    not_late,
)
from app.effects.kinds.at_once_or_late import (
    BEYOND,
    LATE,
    SINCE,
    at_once_and_late,
    how_late,
    since_maps_clause,
)
from app.effects.words import size_along, symbol_of


class AdditionalSensor(EffectKind):
    """A component moves with a second sensor as well, evenly or rising along its axis."""

    kind = "additional-sensor"
    text = "a component also moves with a second sensor, at once or late"
    zero_in_maps = True
    needs = Need.MOMENTS
    of_the_type = True
    shown_by = (
        "measure {component} every 10 min while {sensor} changes and for some hours afterwards, "
        "with the assigned sensor held steady"
    )
    against = {
        "additional-sensor": (
            "create a temperature difference between {sensor} and {rival}, and measure "
            "{component} in that state"
        ),
        "sensor-gradient": (
            "warm the whole machine evenly by heating the room, so that {sensor} changes but the "
            "differences between sensors do not, and measure {component}"
        ),
        "state-variable": (
            "warm {sensor} by heating the room with the spindle stopped, and measure {component} "
            "meanwhile"
        ),
    }

    def propose(self, view: CampaignView) -> Proposed:
        """Every component with every sensor that is not its own, in two forms, at once and late."""
        yield from constant_sensors(self, view)
        signals = [Signal("temperature", sensor) for sensor in view.varying_sensors]
        grids_s = {signal: view.time_constants_s(signal) for signal in signals}
        yield from not_late(self, view, grids_s, LATE)
        for code in view.components:
            for (_, sensor, _), grid_s in grids_s.items():
                if sensor != view.sensor_of(code):
                    drivers = {
                        SINCE: AboveReference(sensor, view.reference_c(sensor)),
                        BEYOND: view.beyond_maps(code, sensor),
                    }
                    yield from at_once_and_late(self.kind, view, code, drivers, grid_s)

    def explain(self, effect: Effect) -> str:
        """Say with which sensor what moves, how late, and how much."""
        how = size_along(effect, "slope", symbol_of(effect.components[0], "K"))
        late, clause = how_late(effect), since_maps_clause(effect)
        return f"{effect.components[0]} also moves with {effect.sensors[0]}{late}, by {how}{clause}"
