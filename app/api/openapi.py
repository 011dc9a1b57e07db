"""The words around the documented routes, and the page that shows them."""

from __future__ import annotations

from fastapi.openapi.docs import get_swagger_ui_html
from starlette.responses import HTMLResponse

DESCRIPTION = """
Stores error maps measured in several thermal states, with the temperatures of their
sensors, and answers with the **compensation table** for live temperatures: each error
component interpolated linearly with the sensor assigned to it (C. Wang, 8.105-8.107).

* An *error* is actual minus nominal; the *compensation* is minus the error: what is to be
  added to the command.
* Units are in the fields' names: `position_mm`, `errors_um`, `temperatures_c`. Times are UTC.
* What is refused is refused whole, as `application/problem+json` with one entry for each
  field that is to blame.
"""

TAGS = [
    {"name": "live", "description": "The compensation table now, and predictions."},
    {"name": "machines", "description": "Axes, sensors, and what happens outside the maps."},
    {"name": "error maps", "description": "What was measured in one thermal state."},
    {"name": "models", "description": "Which sensor each component follows; model versions."},
    {"name": "readings", "description": "Recorded temperatures."},
    {"name": "health", "description": "Whether the service is well."},
]


def swagger_page(title: str) -> HTMLResponse:
    """Make the page that lets people read and try the routes, without the internet."""
    return get_swagger_ui_html(
        openapi_url="/openapi.json",
        title=f"{title} · HTTP",
        swagger_js_url="/docs-assets/swagger-ui-bundle.js",
        swagger_css_url="/docs-assets/swagger-ui.css",
        swagger_favicon_url="/docs-assets/favicon-32x32.png",
        swagger_ui_parameters={"defaultModelsExpandDepth": 0, "displayRequestDuration": True},
    )
