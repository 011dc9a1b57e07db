"""Bring the catalogues of the pages' languages up to date with the messages in the code.

    python -m scripts.update_catalogues

What is new stands in them without a text, and a test fails until it has one.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

from babel.messages.catalog import Catalog
from babel.messages.extract import extract_from_dir
from babel.messages.pofile import read_po, write_po

from scripts.sentences import sentences

ROOT = Path(__file__).parent.parent
LANGUAGES = ROOT / "app/languages"

SERVICE = (
    "compensation/table",
    "effects/**",
    "errors",
    "files/**",
    "identification/**",
    "pages/analysis_report/**",
    "pages/fleet_report",
    "pages/report_parts/**",
    "pages/residuals_page/**",
    "search/search",
    "services/**",
    "status/**",
    "storage/analyses",
    "storage/records",
    "thermal/**",
    "units",
    "api/error_responses",
    "api/routes/login",
    "api/uploads",
)
"""Where sentences stand that reach pages as text, and are recognised there."""

NOT_SHOWN = (
    "effects/claim",
    "effects/effect",
    "effects/shape",
    "effects/term",
    "effects/valid",
    "files/csv_writing",
    "files/recording",
    "identification/analysis/residual_curves",
    "identification/plan/plan",
    "pages/report_parts/drawing",
    "services/analysis_process",
    "services/ask_field",
    "services/bin_readings",
    "services/compute_grid",
    "services/doctor",
    "services/follow_database",
    "services/geometry",
    "services/handed_analyses",
    "services/keep_readings",
    "services/run_analyses",
    "services/thermal_drift",
    "services/together",
    "thermal/uncertainty",
)
"""Of these what no page of the dashboard asks for."""

METHODS: list[tuple[str, Any]] = [
    ("app/pages/assets/**.js", "javascript"),
    ("app/pages/templates/**.html", "jinja2"),
    *((f"app/{place}.py", "ignore") for place in NOT_SHOWN),
    *((f"app/{place}.py", sentences) for place in SERVICE),
    ("app/pages/**.py", "python"),
    ("app/api/methods/**.py", "python"),
]
OPTIONS = {
    "app/pages/templates/**.html": {"trim_blocks": "true", "lstrip_blocks": "true"},
    "app/pages/assets/**.js": {"parse_template_string": "true"},
}
KEYWORDS: dict[str, Any] = {
    "_": None,
    "t": None,
    "gettext": None,
    "ngettext": (1, 2),
    "counted": (2, 3),
    "said_in": (2,),
    "message": None,
}
"""The functions that say a message, and which of what they are given are English."""


def messages_in_code() -> Catalog:
    """Collect every message that pages may say."""
    catalogue = Catalog(charset="utf-8")
    found = extract_from_dir(
        ROOT, METHODS, OPTIONS, KEYWORDS, directory_filter=lambda path: "__pycache__" not in path
    )
    for file, line, message, _comments, _context in sorted(found, key=lambda one: one[:2]):
        catalogue.add(message, None, [(file, line)])
    return catalogue


def main() -> None:
    """Write each catalogue anew: its texts stay, what nothing says any more goes."""
    template = messages_in_code()
    for path in sorted(LANGUAGES.glob("*.po")):
        catalogue = read_po(path.read_bytes().splitlines(True), locale=path.stem)
        catalogue.update(template, no_fuzzy_matching=True)
        catalogue.obsolete.clear()
        for message in catalogue:
            # Files alone: lines change with every commit.
            message.locations = sorted({(file, None) for file, _ in message.locations})
        written = io.BytesIO()
        write_po(written, catalogue, width=100, sort_output=True, omit_header=True)
        path.write_text(head_of(catalogue) + written.getvalue().decode(), encoding="utf-8")


def head_of(catalogue: Catalog) -> str:
    """Write what a catalogue has to say of itself, and no dates: those change by themselves."""
    entries = (
        f"Language: {catalogue.locale}",
        f"Plural-Forms: {catalogue.plural_forms}",
        "MIME-Version: 1.0",
        "Content-Type: text/plain; charset=utf-8",
        "Content-Transfer-Encoding: 8bit",
    )
    lines = "".join(f'"{entry}\\n"\n' for entry in entries)
    return f'# The pages of thermap in another language.\nmsgid ""\nmsgstr ""\n{lines}\n'


if __name__ == "__main__":
    main()
