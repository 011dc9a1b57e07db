"""Receivers of messages on this computer: a webhook and a mail server, which can be away."""

import json
import threading
from contextlib import contextmanager
from email import message_from_bytes, policy
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from aiosmtpd.controller import Controller

from tests.connections.opcua_server_example import free_port


class Webhook:
    """Takes messages as JSON; what came is in `came`, title first."""

    def __init__(self):
        self.port = free_port()
        self.came = []
        self.answer = 200

    @property
    def url(self):
        return f"json://127.0.0.1:{self.port}/hook-t0ken-secret"

    @contextmanager
    def open(self):
        hook = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self):
                content = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
                if hook.answer == 200:
                    hook.came.append((content["title"], content["message"]))
                self.send_response(hook.answer)
                self.end_headers()

            def log_message(self, *_said):
                pass

        server = ThreadingHTTPServer(("127.0.0.1", self.port), Handler)
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        try:
            yield self
        finally:
            server.shutdown()
            thread.join()
            server.server_close()


@contextmanager
def mail_server():
    """Take e-mails; give its port and the list of those that came."""
    came = []

    class Handler:
        async def handle_DATA(self, _server, _session, envelope):  # noqa: N802 - aiosmtpd's name
            came.append(message_from_bytes(envelope.content, policy=policy.default))
            return "250 taken"

    controller = Controller(Handler(), hostname="127.0.0.1", port=free_port())
    controller.start()
    try:
        yield controller.port, came
    finally:
        controller.stop()
