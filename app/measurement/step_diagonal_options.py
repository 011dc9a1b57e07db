"""Refuse options of a sequential step diagonal that cannot be right."""

from __future__ import annotations

import math
from collections.abc import Iterable

from app.errors import InvalidContent, list_names
from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS, Kind
from app.measurement.reference_line import expect_line
from app.measurement.stated_numbers import as_standard_deviation
from app.measurement.step_diagonal_readings import expect_target


def expect_options(chain: Chain, line: str, target: str) -> None:
    """Refuse a machine without three axes, and lines and targets that nobody knows.

    Parameters
    ----------
    chain
        Order of the axes.
    line
        From which line straightness counts.
    target
        What the beam meets.

    Raises
    ------
    InvalidContent
        If an axis is missing, or a name is unknown.
    """
    if len(chain.axes) < 3:
        raise InvalidContent.of_field(
            "configuration", f"expected a machine with axes x, y and z, came {chain.text}"
        )
    expect_line("line", line)
    expect_target(target)


def expect_uncertainties(repeatability_um: float | None, mirror_angle_urad: float | None) -> None:
    """Refuse stated uncertainties that cannot be right.

    Parameters
    ----------
    repeatability_um
        Standard deviation of one reading [µm]; above 0.
    mirror_angle_urad
        Standard uncertainty of each of a mirror's two tilts [µrad]; 0 says that the mirror
        is no source of uncertainty.

    Raises
    ------
    InvalidContent
        If one is negative or not finite, or no reading varies.
    """
    as_standard_deviation("repeatability_um", repeatability_um, "µm", largest=math.inf, zero=False)
    as_standard_deviation("mirror_angle_urad", mirror_angle_urad, "µrad", largest=math.inf)


def expect_angular(codes: Iterable[str]) -> None:
    """Refuse known errors that are not angular errors of an axis.

    Parameters
    ----------
    codes
        Codes of the errors that are stated as known.

    Raises
    ------
    InvalidContent
        If one is another component, or unknown.
    """
    for code in codes:
        component = COMPONENTS.get(code)
        if component is None or component.axis is None or not component.is_rotation:
            known = [c.code for c in COMPONENTS.values() if c.kind is Kind.ANGULAR]
            raise InvalidContent.of_field(
                "angular", f"expected angular errors ({list_names(known)}), came {code!r}"
            )
