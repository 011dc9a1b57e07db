"""A broker of one's own: Mosquitto on a free port, killed, stopped and started again at will."""

import os
import shutil
import signal
import socket
import subprocess
import time

import pytest

PROGRAM = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin:/usr/local/sbin")


def expect_mosquitto():
    """Skip, or fail where services are required."""
    if PROGRAM is None:
        assert not os.environ.get("THERMAP_REQUIRE_SERVICES"), "mosquitto is not installed"
        pytest.skip("mosquitto is not installed")


def free_port():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return taken.getsockname()[1]


class Mosquitto:
    """A broker that keeps what it has when it ends."""

    def __init__(self, folder, more=""):
        self.port = free_port()
        self._folder = folder
        folder.mkdir(exist_ok=True)
        self._file = folder / "mosquitto.conf"
        self._file.write_text(
            f"listener {self.port} 127.0.0.1\n"
            + (more if "allow_anonymous" in more else f"allow_anonymous true\n{more}")
            + f"\npersistence true\npersistence_location {folder}/\nautosave_interval 1\n"
            "max_queued_messages 0\n" + ("user root\n" if os.geteuid() == 0 else "")
        )
        self.process = None

    def start(self):
        """Start it, and wait until it listens."""
        with (self._folder / "mosquitto.log").open("ab") as log:
            self.process = subprocess.Popen(
                [PROGRAM, "-c", str(self._file)], stdout=log, stderr=subprocess.STDOUT
            )
        deadline = time.monotonic() + 60
        while True:
            try:
                socket.create_connection(("127.0.0.1", self.port), timeout=1).close()
                return self
            except OSError:
                assert time.monotonic() < deadline, "mosquitto does not listen"
                assert self.process.poll() is None, (self._folder / "mosquitto.log").read_text()
                time.sleep(0.02)

    def end(self, how=signal.SIGTERM):
        """End it; on SIGTERM it writes what it keeps."""
        if self.process is not None:
            self.process.send_signal(signal.SIGCONT)
            self.process.send_signal(how)
            self.process.wait(60)
            self.process = None

    def pause(self):
        """Let it hang."""
        self.process.send_signal(signal.SIGSTOP)

    def go_on(self):
        self.process.send_signal(signal.SIGCONT)
