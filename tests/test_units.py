"""The units that names of fields promise, and the only factor between lengths."""

import pytest

from app.geometry.components import COMPONENTS
from app.units import Unit, um_from_urad_mm, unit_of_field


@pytest.mark.parametrize(
    ("field", "unit"),
    [
        ("positions_mm", "mm"),
        ("errors_um", "µm"),
        ("errors_urad", "µrad"),
        ("slopes_um_per_m", "µm/m"),
        ("slopes_urad_per_m", "µrad/m"),
        ("temperatures_c", "°C"),
        ("max_rate_c_per_min", "°C/min"),
        ("max_age_s", "s"),
        ("spindle_rpm", "1/min"),
        ("label", None),
        ("um", None),
        ("sensors", None),
        ("spectrum", None),
    ],
)
def test_a_fields_name_ends_in_its_unit(field, unit):
    assert unit_of_field(field) == unit


@pytest.mark.parametrize("component", COMPONENTS.values(), ids=lambda c: c.code)
def test_each_components_fields_promise_its_unit(component):
    for field in (
        component.input_field,
        component.error_field,
        component.standard_error_field,
        component.compensation_field,
    ):
        assert unit_of_field(field) == component.unit.symbol


def test_every_unit_has_a_sign():
    assert [unit.symbol for unit in Unit] == ["µm", "µrad", "µm/m", "µrad/m"]


def test_a_microradian_over_a_metre_is_a_micrometre():
    assert um_from_urad_mm(1.0 * 1000.0) == 1.0
