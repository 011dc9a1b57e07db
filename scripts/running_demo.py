"""`thermap demo` in a process of its own, for the README's pictures and the documents' commands."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from app.cli.listening import listening, url_of
from thermap import ThermapClient, ThermapClientError

WEEK: Final = "mcfv5050-week"
_ROOT: Final = Path(__file__).parent.parent
_WAIT_S: Final = 600.0


@contextmanager
def running_demo(folder: Path) -> Iterator[str]:
    """Run the demo with its database in a folder; give its URL once its week is loaded.

    Raises
    ------
    TimeoutError
        If it is not ready within ten minutes.
    """
    with listening("127.0.0.1", 0, "demo") as opened:
        url = url_of(opened)
    port, database = url.rpartition(":")[2], f"sqlite:///{folder}/demo.db"
    demo = subprocess.Popen(
        [sys.executable, "-m", "app", "demo", "--port", port, "--database-url", database],
        cwd=_ROOT,
        stdout=subprocess.DEVNULL,
    )
    try:
        end = time.monotonic() + _WAIT_S
        while not _is_ready(url):
            if demo.poll() is not None or time.monotonic() > end:
                raise TimeoutError(f"expected the demo's week at {url} within {_WAIT_S:.0f} s")
            time.sleep(0.5)
        yield url
    finally:
        demo.terminate()
        demo.wait()


def _is_ready(url: str) -> bool:
    try:
        with ThermapClient(url) as client:
            return bool(client.verifications(WEEK))
    except ThermapClientError:
        return False
