"""The pages of the project's documents."""

from pathlib import Path

ROOT = Path(__file__).parent.parent
METHODS = sorted((ROOT / "docs" / "methods").glob("*.md"))
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.md")), *METHODS]
