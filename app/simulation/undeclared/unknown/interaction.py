"""Position × temperature × load: u³·(T − T₀)·payload, what no single variable explains."""

from __future__ import annotations

from typing import Final

from app.simulation.undeclared.base_machine import normalised
from app.simulation.undeclared.components import COMPONENTS, TRANSLATIONS, FloatArray
from app.simulation.undeclared.duty_cycle import PAYLOADS_KG
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.observations import Circumstances
from app.simulation.undeclared.setting import Setting

VARIANTS: Final = ("cubic",)


def plant(setting: Setting, variant: str) -> Effect:
    """Let payload and the bed's temperature bend one component together."""
    code = setting.choose_component(TRANSLATIONS)
    axis = COMPONENTS[code].axis or 0
    cold = float(setting.machine.map_temperatures_c["bed"][0])

    def error(circumstances: Circumstances) -> FloatArray:
        u = normalised(code, circumstances.point_mm[:, axis])
        rise = circumstances.temperature("bed") - cold
        return u**3 * rise * circumstances.state("payload_kg") / PAYLOADS_KG[-1]

    return setting.scaled(
        Effect(
            "interaction",
            variant,
            (code,),
            {code: error},
            sensors=("bed",),
            parameters={"state": "payload_kg", "about_c": cold},
            strengths={"at_full_load_um_per_k": 1.0},
            in_library=False,
        )
    )
