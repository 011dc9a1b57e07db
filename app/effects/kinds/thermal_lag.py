"""The structure answers its sensor late."""

from __future__ import annotations

from functools import partial

from app.effects.campaign_view import CampaignView
from app.effects.conditions import Signal
from app.effects.driver import Behind
from app.effects.effect import Effect
from app.effects.hypothesis import Amplitudes, Hypothesis, Nonlinear
from app.effects.kind import EffectKind, Need, Proposed, together_and_each
from app.effects.shape import Sensitivity
from app.effects.term import Term
from app.effects.words import SURELY, components, is_whole, parameter, verb
from app.errors import list_names


class ThermalLag(EffectKind):
    """E at a low-passed temperature instead of the sensor's own, on one component or on all."""

    kind = "thermal-lag"
    text = "the structure follows its sensor late: a first-order low-pass"
    driver_note = "Late minus present: what the sensor read some time ago, less what it reads now."
    share_of = "of what the tables say that follows late: 1 for all of it, 0 for none"
    needs = Need.MOMENTS
    only_once = True
    of_the_type = True
    shown_by = (
        "measure {component} every 10 min through a quick warm-up and the cooling after it, and "
        "again once {sensor} has been steady for some hours"
    )
    against = {
        "other-sensor": (
            "heat {rival} but not {sensor}, or hold both steady at different temperatures for "
            "some hours, and measure {component}: a lagging structure is right again"
        ),
        "sensor-gradient": (
            "hold all temperatures steady at a high level for some hours and measure "
            "{component}: a lagging structure is right again, a bent one is not"
        ),
        "state-variable": (
            "warm the machine by heating the room with the spindle stopped, and measure "
            "{component} meanwhile"
        ),
    }

    def propose(self, view: CampaignView) -> Proposed:
        """One fingerprint for each sensor, and each of its components by itself."""
        for sensor, codes in view.components_by_sensor.items():
            signal = Signal("temperature", sensor)
            if sensor not in view.varying_sensors:
                yield self.refuse(sensor, f"{sensor} did not change")
            elif grid := view.time_constants_s(signal):
                for group in together_and_each(codes):
                    yield Hypothesis(
                        kind=self.kind,
                        components=group,
                        sensors=(sensor,),
                        unit_terms=partial(_terms, view, sensor, group),
                        nonlinear=Nonlinear.time_constant(grid),
                    )
            else:
                yield self.refuse(sensor, view.why_no_lag(signal))

    def explain(self, effect: Effect) -> str:
        """Say how late what follows what, and by which share where that is not the whole."""
        late = parameter(effect, "time_constant_min", "min")
        share = "" if is_whole(effect) else f" (share {parameter(effect, 'share')})"
        if effect.parameters.get("share", 1.0) <= 0.0:
            overshoot = verb(effect.components, "overshoots", "overshoot")
            settle = verb(effect.components, "settles", "settle")
            return (
                f"{components(effect)} {overshoot} while {effect.sensors[0]} changes, and "
                f"{settle} with a time constant of {late}{share}"
            )
        follow = verb(effect.components, "follows", "follow")
        return f"{components(effect)} {follow} {effect.sensors[0]} {late} late{share}"

    def doubt(self, effect: Effect) -> str:
        """A body that follows late follows as a whole at most; what is past that is not late."""
        share = effect.parameters.get("share", 1.0)
        if share - 1.0 <= SURELY * effect.standard_errors.get("share", 0.0):
            return ""
        return (
            f"with a share of {share:.2g}, more than 1, {list_names(effect.components, 3)} would "
            f"move backwards at first whenever {effect.sensors[0]} changes"
        )


def _terms(
    view: CampaignView, sensor: str, codes: tuple[str, ...], theta: float | None
) -> Amplitudes:
    """Read the maps at the late temperature, each where it was itself as late."""
    tau_s = float(theta or 0.0)
    behind = Behind(sensor, tau_s)
    shapes = {code: Sensitivity(False, view.behind_in_maps(code, sensor, tau_s)) for code in codes}
    return [
        [Term(code, behind, shape.readable(view.model, code)) for code, shape in shapes.items()]
    ]
