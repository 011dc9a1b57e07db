"""An OPC UA server in a process of its own, to be killed, stopped, and told what to say.

    python -m tests.connections.opcua_server_example PORT [FOLDER]

serves without security, or with FOLDER's server.der, to clients whose certificates are in
FOLDER/trusted, and for a user. It takes a command a line and answers each with a line.
"""

import asyncio
import json
import signal
import socket
import subprocess
import sys
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

ROOT = Path(__file__).parents[2]
URI = "urn:example:cell"
PASSWORD = "only for tests"


def free_port():
    """A port that nobody listens at."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return taken.getsockname()[1]


class ExampleServer:
    """The process, and its commands."""

    def __init__(self, port, folder=None):
        self.port, self.folder = port, folder
        self.url = f"opc.tcp://127.0.0.1:{port}/cell"
        self.process = None

    def start(self):
        command = [sys.executable, "-m", "tests.connections.opcua_server_example", str(self.port)]
        self.process = subprocess.Popen(
            command + ([str(self.folder)] if self.folder else []),
            cwd=ROOT,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        assert self.process.stdout.readline() == "ready\n"

    def say(self, command, *asked, **named):
        """Let it do something; returns its answer."""
        self.process.stdin.write(json.dumps([command, asked, named]) + "\n")
        self.process.stdin.flush()
        answer = json.loads(self.process.stdout.readline())
        assert answer != "failed", command
        return answer

    def kill(self):
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            self.process.stdin.close()
            self.process.stdout.close()
        self.process = None

    def hang(self):
        self.process.send_signal(signal.SIGSTOP)

    def go_on(self):
        self.process.send_signal(signal.SIGCONT)


@contextmanager
def example_server(port, folder=None):
    """A server that answers; killed at the end."""
    server = ExampleServer(port, folder)
    try:
        server.start()
        yield server
    finally:
        server.kill()


class _Served:
    """What the process does."""

    def __init__(self, server, index):
        from asyncua import ua

        self.ua, self.server, self.index = ua, server, index
        self.subscriptions = server.iserver.subscription_service.subscriptions
        self.added = []

    def node(self, name):
        return self.server.get_node(self.ua.NodeId(name, self.index))

    async def add(self, name, value, kind="Double", unit=None):
        ua = self.ua
        node = await self.server.nodes.objects.add_variable(
            ua.NodeId(name, self.index), name, value, ua.VariantType[kind]
        )
        self.added.append(node)
        if unit is not None:
            number, shown = unit
            stated = ua.EUInformation(UnitId=number, DisplayName=ua.LocalizedText(shown))
            # Of the standard's namespace, whatever the node's own is.
            await node.add_property(
                ua.NodeId(f"{name}.Units", self.index),
                ua.QualifiedName("EngineeringUnits", 0),
                stated,
            )

    async def set(self, name, value, kind="Double", status="Good", ago_s=0.0):
        ua = self.ua
        time = datetime.now(UTC).timestamp() - ago_s
        said = ua.DataValue(
            Value=None if value is None else ua.Variant(value, ua.VariantType[kind]),
            StatusCode=ua.StatusCode(getattr(ua.StatusCodes, status)),
            SourceTimestamp=datetime.fromtimestamp(time, UTC),
        )
        await self.server.write_attribute_value(self.node(name).nodeid, said)

    async def delete(self, name):
        await self.server.delete_nodes([self.node(name)])

    async def clear(self):
        await self.server.delete_nodes(self.added)
        self.added = []

    async def delete_subscriptions(self):
        """Forget them without a word."""
        ids = list(self.subscriptions)
        await self.server.iserver.subscription_service.delete_subscriptions(ids)
        return len(ids)

    async def deafen(self):
        """Let subscriptions live, and look at no node any more."""
        for one in self.subscriptions.values():
            one.monitored_item_srv.delete_all_monitored_items()


async def _serve(port, folder):
    from asyncua import Server, ua
    from asyncua.common.utils import ServiceError
    from asyncua.crypto.permission_rules import User, UserRole
    from cryptography.hazmat.primitives import serialization

    class OneUser:
        def get_user(self, iserver, username=None, password=None, certificate=None):
            is_known = (username, password) == ("thermap", PASSWORD)
            return User(role=UserRole.User) if is_known or folder is None else None

    server = Server(user_manager=OneUser())
    await server.init()
    server.set_endpoint(f"opc.tcp://127.0.0.1:{port}/cell")
    if folder is None:
        server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
    else:
        names = ("Basic256Sha256", "Aes128Sha256RsaOaep", "Aes256Sha256RsaPss")
        modes = ("Sign", "SignAndEncrypt")
        server.set_security_policy(
            [ua.SecurityPolicyType[f"{name}_{mode}"] for name in names for mode in modes]
        )
        server.set_identity_tokens([ua.UserNameIdentityToken])
        await server.set_application_uri("urn:cell:server")
        await server.load_certificate(str(folder / "server.der"))
        await server.load_private_key(str(folder / "server.pem"))

        async def validate(certificate, _description):
            sent = certificate.public_bytes(serialization.Encoding.DER)
            if all(sent != one.read_bytes() for one in (folder / "trusted").iterdir()):
                raise ServiceError(ua.StatusCodes.BadCertificateUntrusted)

        server.set_certificate_validator(validate)
    index = await server.register_namespace(URI)
    served = _Served(server, index)
    async with server:
        print("ready", flush=True)
        while line := await asyncio.to_thread(sys.stdin.readline):
            command, asked, named = json.loads(line)
            try:
                answer = await getattr(served, command)(*asked, **named)
            except Exception as why:
                print(repr(why), file=sys.stderr)
                answer = "failed"
            print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    asyncio.run(_serve(int(sys.argv[1]), Path(sys.argv[2]) if len(sys.argv) > 2 else None))
