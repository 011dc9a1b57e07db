"""Templates: every text in them is escaped, and a name that nobody gave is an error."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any, Final

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from app.access.authorization import key_asking, may_make_machines, may_write
from app.errors import counted
from app.languages import decimal_mark, messages_of_scripts, names, translations
from app.pages.dashboard.navigation import MACHINE_PAGES, Shown
from app.pages.dashboard.numbers import (
    age,
    degrees,
    difference,
    difference_unit,
    number,
    place_of,
    signed,
    temperature,
    typed_position,
    with_unit,
)
from app.pages.glossary import entries, named, verdict_words
from app.pages.plotly_script import plotly_script
from app.pages.reader import local, reader, zone_key, zone_name
from app.pages.report_parts.component_names import chapter_name, component_name
from app.pages.report_parts.drawing import figures_json
from app.pages.report_parts.effect_names import TESTS, kind_name, parameter_name
from app.pages.report_parts.words import (
    chance_text,
    decimals_for,
    figure_text,
    origins_text,
    percent_text,
    sentence,
    zeros_text,
)
from app.pages.wording import all_said, said, said_plainly
from app.pages.wording import counted as counted_in_words

_ENVIRONMENT: Final = Environment(
    loader=PackageLoader("app.pages"),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)
_ENVIRONMENT.add_extension("jinja2.ext.i18n")
_ENVIRONMENT.install_gettext_callables(  # type: ignore[attr-defined]
    lambda message: translations(reader().language).gettext(message),
    lambda one, more, count: translations(reader().language).ngettext(one, more, count),
    newstyle=True,
)
_ENVIRONMENT.filters |= {
    "figure": figure_text,
    "decimals_for": decimals_for,
    "chance": chance_text,
    "percent": percent_text,
    "sentence": sentence,
    "origins": origins_text,
    "zeros": zeros_text,
    "counted": counted,
    "component_name": component_name,
    "chapter_name": chapter_name,
    "kind_name": kind_name,
    "parameter_name": parameter_name,
    "words_of_test": lambda test: TESTS.get(test, test),
    "as_number_heading": lambda unit: (f"[{unit}]", "number"),
    "figures_json": lambda drawings: Markup(figures_json(drawings)),
}


_ENVIRONMENT.globals |= {
    "machine_pages": MACHINE_PAGES,
    "key": key_asking,
    "may_write": may_write,
    "may_make_machines": may_make_machines,
    "zone_key": zone_key,
    "counted": counted_in_words,
    "glossary": entries,
    "script_messages": lambda: messages_of_scripts(reader().language),
    "reader": reader,
    "decimal_mark": lambda: decimal_mark(reader().language),
    "difference_unit": difference_unit,
    "languages": names,
}
_ENVIRONMENT.filters |= {
    "signed": signed,
    "number": number,
    "with_unit": with_unit,
    "temperature": temperature,
    "degrees": degrees,
    "difference": difference,
    "place_of": place_of,
    "typed_position": typed_position,
    "age": age,
    "day_and_time": lambda time: f"{local(time):%Y-%m-%d %H:%M:%S}",
    "iso": lambda time: f"{time.astimezone(UTC):%Y-%m-%dT%H:%M:%SZ}",
    "day": lambda time: f"{local(time):%Y-%m-%d}",
    "time_of_day": lambda time: f"{local(time):%H:%M:%S} {zone_name(time)}",
    "zone_name": zone_name,
    "said": said,
    "said_plainly": said_plainly,
    "all_said": all_said,
    "named": named,
    "verdict_words": verdict_words,
}


CONFIG: Final = {"displayModeBar": False, "responsive": True, "displaylogo": False}
"""How plotly behaves in a report: its figures are read, not worked with."""


def render(
    template: str, *, plotly_js: str, config: Mapping[str, Any] = CONFIG, **shown: Any
) -> str:
    """Write a page.

    Parameters
    ----------
    plotly_js
        `inline`: plotly's JavaScript, some 5 MB, becomes part of the page, which then needs
        nothing else; or the address from which the page is to load it.

    Returns
    -------
    str
        HTML. The same answer gives the same page. What users wrote is shown letter by letter.

    Raises
    ------
    InvalidContent
        If the address is none of a file over HTTP.
    """
    script = plotly_script(plotly_js)
    if not shown.get("drawings", True):
        # What draws nothing needs nothing to draw with; a page has as many scripts as ever.
        script = Markup("<script></script>")
    page = _ENVIRONMENT.get_template(template)
    written: str = page.render(plotly_script=script, config=config, **shown)
    return written


def render_live(template: str, **shown: Any) -> str:
    """Write a page of the dashboard, which asks for itself again when something changes."""
    written: str = _ENVIRONMENT.get_template(template).render(**shown)
    return written


def render_machine(
    template: str, page: str, machine_id: str, name: str, now: datetime, **shown: Any
) -> str:
    """Write a page about a machine, in the frame that all of them have."""
    stream = f"/v1/machines/{machine_id}/compensation/stream"
    machine = Shown(machine_id, name)
    return render_live(
        f"dashboard/{template}.html", page=page, machine=machine, stream=stream, now=now, **shown
    )
