"""Take the README's pictures: start a demo, analyse its week, and photograph three pages.

Needs Chromium (Debian: `chromium`) and the extra `test`; takes some minutes.

    python -m scripts.take_pictures
"""

from __future__ import annotations

import base64
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final

from playwright.sync_api import sync_playwright

from scripts.running_demo import WEEK, running_demo

PICTURES: Final = Path(__file__).parent.parent / "docs" / "pictures"
LARGEST_BYTES: Final = 150_000

PAGES: Final = {
    "now": ("/machines/mcfv5050", "#row-EXX", 715),
    "analysis": (f"/v1/machines/{WEEK}/analyses/1/report", "svg", 920),
    "volume": ("/machines/mcfv5050/volume", "#slices svg", 740),
}
"""Name of each picture: the page, what has to be there, and its height [px]."""


def take_pictures(folder: Path) -> None:
    """Write the pictures into a folder; ValueError where one is too large."""
    folder.mkdir(exist_ok=True)
    with (
        tempfile.TemporaryDirectory() as database_folder,
        running_demo(Path(database_folder)) as url,
        sync_playwright() as driver,
    ):
        analyse = [sys.executable, "-m", "app", "analyse", WEEK, "--url", url]
        subprocess.run(analyse, check=True)
        browser = driver.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox", "--disable-lcd-text"]
        )
        for name, (path, awaited, height_px) in PAGES.items():
            page = browser.new_page(viewport={"width": 1200, "height": height_px})
            page.goto(url + path)
            page.locator(awaited).first.wait_for()
            page.wait_for_timeout(5_000)
            # PNG would be three times as large; Playwright itself writes no WebP.
            taken = page.context.new_cdp_session(page).send(
                "Page.captureScreenshot", {"format": "webp", "quality": 90}
            )
            picture = base64.b64decode(taken["data"])
            if len(picture) > LARGEST_BYTES:
                raise ValueError(f"{name}: expected at most {LARGEST_BYTES} bytes")
            (folder / f"{name}.webp").write_bytes(picture)
        browser.close()


if __name__ == "__main__":
    take_pictures(PICTURES)
