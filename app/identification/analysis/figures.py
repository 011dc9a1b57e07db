"""How large residuals are, before effects and after, as an analysis says it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final, Literal, TypeAlias

from pydantic import Field

from app.answer import IN_ITS_UNIT, Answer, Range, UnitSymbol

Zero: TypeAlias = Literal["absolute", "first", "removed"]
"""What figures are relative to."""

ROUNDING: Final = 1e-9
"""Share of a size: less is rounding."""


@dataclass(frozen=True, slots=True)
class Figures(Answer, published_as="FiguresAnswer"):
    """Size of residuals over all lengths, or over all values where none is a length."""

    rms: Annotated[float, Field(alias="rms_um")]
    """Root mean square of all visits together [µm]"""

    p95: Annotated[float, Field(alias="p95_um")]
    """95th percentile of the size [µm]"""

    holdout_rms: Annotated[float | None, Field(alias="holdout_rms_um")]
    """Root mean square on held-out visits: each is predicted by what was learnt without it [µm];
    null where nothing could be held out"""

    holdout_rms_ci95: Annotated[Range | None, Field(alias="holdout_rms_ci95_um")]
    """Its 95 % confidence interval, over visits [µm]; null where fewer than two were held out"""

    zero: Zero | None = None
    """What they are relative to. `absolute`: the model's zero. `first`: the first observation of
    each set-up, at which the instrument was zeroed. `removed`: the zero is not known, and the mean
    of the values that share it is taken off. Null in older results"""

    @property
    def shown_rms(self) -> float:
        """The root mean square that is shown: on held-out visits where there are any."""
        return self.rms if self.holdout_rms is None else self.holdout_rms


@dataclass(frozen=True, slots=True)
class ComponentFigures(Answer, published_as="ComponentFiguresAnswer"):
    """One component, or one direction at points, before and after, in its own unit."""

    component: Annotated[str, Field(examples=["EZZ"])]
    """Component code, or `points x`"""

    unit: UnitSymbol
    """Its unit"""

    count: int
    """Values that took part"""

    before_rms: Annotated[float, Field(description=f"Root mean square before {IN_ITS_UNIT}")]
    after_rms: Annotated[float, Field(description=f"Root mean square after {IN_ITS_UNIT}")]
    before_p95: Annotated[
        float, Field(description=f"95th percentile of the size before {IN_ITS_UNIT}")
    ]
    after_p95: Annotated[
        float, Field(description=f"95th percentile of the size after {IN_ITS_UNIT}")
    ]
    holdout_before_rms: Annotated[
        float | None,
        Field(description=f"Root mean square before, on held-out visits {IN_ITS_UNIT}"),
    ]
    holdout_after_rms: Annotated[
        float | None,
        Field(description=f"Root mean square after, on held-out visits {IN_ITS_UNIT}"),
    ]
    noise: Annotated[
        float, Field(description=f"Standard deviation of one observation {IN_ITS_UNIT}")
    ]
    noise_origin: str
    """`declared`, `common` (what nearly all lengths show, where that contradicts what is declared),
    `replicates`, `residuals` or `rounding`"""

    floor: Annotated[
        float | None,
        Field(
            description="What noise alone would leave, judged by repeats within two minutes and "
            f"the scatter of set-ups {IN_ITS_UNIT}; null where too little was repeated"
        ),
    ]
    floor_unknown: str | None = None
    """Why there is no floor; null where there is one"""

    setup_scatter: Annotated[
        float | None,
        Field(
            description="Standard deviation between set-ups, as fitted to these residuals "
            f"{IN_ITS_UNIT}; null where nothing could be held out"
        ),
    ] = None
    zero: Zero | None = None
    """What its figures are relative to; see the overall figures"""

    before_max: Annotated[
        float | None,
        Field(
            description="Largest size before, on held-out visits where there are any "
            f"{IN_ITS_UNIT}; null in older results"
        ),
    ] = None
    after_max: Annotated[
        float | None,
        Field(
            description="Largest size after, on held-out visits where there are any "
            f"{IN_ITS_UNIT}; null in older results"
        ),
    ] = None

    @property
    def is_held_out(self) -> bool:
        """Whether there are figures of held-out visits."""
        return self.holdout_before_rms is not None

    @property
    def shown_rms(self) -> tuple[float, float]:
        """Root mean square before and after that are shown: held out where that is possible."""
        if self.holdout_before_rms is None or self.holdout_after_rms is None:
            return self.before_rms, self.after_rms
        return self.holdout_before_rms, self.holdout_after_rms

    @property
    def is_changed(self) -> bool:
        """Whether effects change it by more than rounding does."""
        return abs(self.after_rms - self.before_rms) > ROUNDING * self.before_rms
