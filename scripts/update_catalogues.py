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

ROOT = Path(__file__).parent.parent
LANGUAGES = ROOT / "app/pages/languages"

PLACES = (
    "errors",
    "thermal/**",
    "status/**",
    "pages/**",
    "api/error_responses",
    "api/methods/**",
    "api/routes/login",
)

METHODS = [
    ("app/pages/assets/**.js", "javascript"),
    ("app/pages/templates/**.html", "jinja2"),
    ("app/status/alarm_message.py", "ignore"),
    *((f"app/{place}.py", "python") for place in PLACES),
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
    "Message": None,
    "several": (1, 2),
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
