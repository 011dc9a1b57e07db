"""A wire between the service and its database that can be cut, or go silent."""

import contextlib
import socket
import threading
from enum import Enum


class Deaf(Enum):
    """What becomes of connections on which PostgreSQL tells news."""

    CUT = "cut"
    SILENT = "silent"


class TcpProxy:
    """Passes bytes on to a server until it is cut; can be mended on the same port."""

    def __init__(self, host, port):
        self._target = (host, port)
        self._listener = self._listen(0)
        self.port = self._listener.getsockname()[1]
        self._ends = set()
        self._listening = set()
        self._deaf = None
        self._lock = threading.Lock()
        self._passing = threading.Event()
        self._passing.set()
        self._accept_in_background()

    def cut(self):
        """Refuse new connections and break off those that there are."""
        self.thaw()
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        with self._lock:
            ends, self._ends = self._ends, set()
        for end in ends:
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            end.close()

    def freeze(self):
        """Take connections and bytes, and pass nothing on."""
        self._passing.clear()

    def thaw(self):
        """Pass on what has come, and what comes."""
        self._passing.set()

    @property
    def is_listened_through(self):
        """Whether somebody has asked for news; to be seen, without TLS."""
        return bool(self._listening)

    def deafen(self, deaf):
        """Let no news through, and nothing else on their connections, old and new ones."""
        with self._lock:
            self._deaf, listening = deaf, set(self._listening)
        if deaf is Deaf.CUT:
            for end in listening:
                with contextlib.suppress(OSError):
                    end.shutdown(socket.SHUT_RDWR)

    def mend(self):
        """Take connections again, on the same port."""
        self._listener = self._listen(self.port)
        self._accept_in_background()

    def _listen(self, port):
        listener = socket.socket()
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(("127.0.0.1", port))
        listener.listen()
        return listener

    def _accept_in_background(self):
        threading.Thread(target=self._accept, args=(self._listener,), daemon=True).start()

    def _accept(self, listener):
        while True:
            try:
                near, _ = listener.accept()
                far = socket.create_connection(self._target)
            except OSError:
                return
            with self._lock:
                self._ends |= {near, far}
            for source, sink in ((near, far), (far, near)):
                threading.Thread(target=self._pass_on, args=(source, sink), daemon=True).start()

    def _pass_on(self, source, sink):
        with contextlib.suppress(OSError):
            while data := source.recv(65536):
                self._passing.wait()
                if self._is_deaf(source, sink, data):
                    if self._deaf is Deaf.CUT:
                        break
                    continue
                sink.sendall(data)
        for end in (source, sink):
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            with self._lock:
                self._ends.discard(end)
                self._listening.discard(end)
            end.close()

    def _is_deaf(self, source, sink, data):
        with self._lock:
            if b"LISTEN " in data:
                self._listening |= {source, sink}
            return self._deaf is not None and source in self._listening
