"""Signed and encrypted OPC UA: read from others, and read by others, with real certificates."""

import asyncio
import json
import logging
import re
import shutil
import sys
from contextlib import suppress

import pytest

pytest.importorskip("asyncua", reason="the extra opcua is not installed")

from asyncua import Client, ua
from asyncua.crypto import security_policies
from typer.testing import CliRunner

from app.cli.application import application
from app.connections.config import read_connections
from app.connections.follower import Followed
from app.connections.opcua_certificates import read_certificate
from app.connections.opcua_security import SecurityTable
from app.connections.opcua_server import NAMESPACE
from app.connections.opcua_session import Access, _usable_certificates
from app.connections.serving_tables import expect_servable
from app.errors import InvalidContent
from tests.connections.certificates import write_application
from tests.connections.opcua_server_example import PASSWORD, ROOT, ExampleServer, free_port
from tests.connections.test_opcua_client import following, hurried  # noqa: F401
from tests.connections.test_opcua_server import table_server
from tests.service_examples import MACHINE, ROOM, client_of, furnish_database

pytestmark = pytest.mark.anyio

POLICIES = ("Basic256Sha256", "Aes128Sha256RsaOaep", "Aes256Sha256RsaPss")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Certificates of a server and of clients: of these `client` is trusted."""
    made = tmp_path_factory.mktemp("pki")
    write_application(made, "server", "urn:cell:server")
    write_application(made, "other-server", "urn:cell:server")
    write_application(made, "client", "urn:client")
    write_application(made, "stranger", "urn:client")
    write_application(made, "expired", "urn:client", days=(-10, -3))
    (made / "trusted").mkdir()
    shutil.copy(made / "client.der", made / "trusted")
    return made


@pytest.fixture(scope="module")
def server(folder):
    running = ExampleServer(free_port(), folder)
    running.start()
    running.say("add", "X", 21.5)
    yield running
    running.kill()


def access(
    server,
    folder,
    *,
    client="client",
    pinned="server",
    mode="SignAndEncrypt",
    policy="Basic256Sha256",
    password=PASSWORD,
):
    security = SecurityTable(
        mode=mode,
        policy=policy,
        certificate=folder / f"{client}.der",
        private_key=folder / f"{client}.pem",
        server_certificate=folder / f"{pinned}.der",
    )
    return Access(server.url, security, "thermap", password)


FOLLOWED = {"x-middle": Followed("ns=2;s=X")}


@pytest.mark.slow
@pytest.mark.parametrize("policy", POLICIES)
@pytest.mark.parametrize("mode", ["Sign", "SignAndEncrypt"])
async def test_each_policy_that_is_offered_here_reads_from_a_server(server, folder, policy, mode):
    asked = access(server, folder, mode=mode, policy=policy)
    async with following(asked, FOLLOWED) as seen:
        await seen.until(lambda: seen.known == {"x-middle": 21.5})
        assert seen.follower.trouble == ""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"pinned": "other-server"}, "expected the server with the certificate 'CN=other-server'"),
        ({"client": "stranger"}, "BadCertificateUntrusted"),
        ({"client": "stranger"}, "the server has to trust our certificate"),
        ({"client": "expired"}, "expired.der: expected a certificate that is valid now, got one"),
        ({"password": "wrong"}, "the server does not take this user and password"),
    ],
)
async def test_who_is_not_trusted_reads_nothing_and_is_told_why(server, folder, wrong, words):
    async with following(access(server, folder, **wrong), FOLLOWED) as seen:
        await seen.until(lambda: seen.follower.trouble != "")
        assert words in seen.follower.trouble
        assert PASSWORD not in seen.follower.trouble
        assert seen.taken == []


@pytest.mark.slow
async def test_a_server_without_security_is_not_taken_for_one_with_it(folder):
    plain = ExampleServer(free_port())
    plain.start()
    try:
        async with following(access(plain, folder), FOLLOWED) as seen:
            await seen.until(lambda: "got one that offers" in seen.follower.trouble)
            assert "got one that offers None with None" in seen.follower.trouble
            assert seen.taken == []
    finally:
        plain.kill()


def test_an_expired_certificate_of_the_server_is_named(folder):
    security = access(ExampleServer(free_port()), folder, pinned="expired").security
    with pytest.raises(ua.UaError, match=r"expired\.der: expected a certificate that is valid now"):
        _usable_certificates(security)


def config_with(folder, text):
    file = folder / "thermap.toml"
    file.write_text(text)
    return file


CLIENT = """
[[opcua]]
name = "press"
machine = "press"
endpoint = "opc.tcp://127.0.0.1:4840"
sensors = { ram = "ns=2;s=Ram" }
[opcua.security]
mode = "Sign"
certificate = "CERTIFICATE"
private_key = "KEY"
server_certificate = "SERVER"
"""


def test_files_that_are_no_pair_of_an_application_are_refused_at_start(folder):
    write_application(folder, "nameless", None)
    write_application(folder, "short", "urn:client", bits=1024)
    (folder / "text.der").write_text("no certificate")

    def config(certificate="client", key="client", server="server"):
        names = {"CERTIFICATE": certificate, "KEY": key, "SERVER": server}
        text = CLIENT
        for name, file in names.items():
            text = text.replace(name, f"{file}.{'pem' if name == 'KEY' else 'der'}")
        return read_connections(config_with(folder, text))

    assert config().opcua[0].security.policy == "Basic256Sha256"
    for wrong, words in (
        ({"key": "stranger"}, "client.der: expected the certificate of the key .*stranger.pem"),
        ({"certificate": "text"}, "text.der: expected a certificate in DER or PEM"),
        ({"server": "text"}, "text.der: expected a certificate in DER or PEM"),
        ({"server": "gone"}, "expected a file, got .*gone.der': No such file"),
        ({"certificate": "nameless", "key": "nameless"}, "with the application's URI"),
        ({"certificate": "short", "key": "short"}, "expected a key of 2048 bits, got 1024"),
    ):
        with pytest.raises(InvalidContent, match=f"'press': .*{words}|{words}"):
            config(**wrong)


SERVER = """
[opcua_server]
certificate = "thermap.der"
private_key = "thermap.pem"
trusted_clients = "trusted"
"""


@pytest.fixture(scope="module")
def own(folder):
    """The folder with the service's own certificate, made as the documentation says."""
    asked = ["connections", "certificate", "thermap.der", "thermap.pem", "--host", "127.0.0.1"]
    asked[2:4] = [str(folder / name) for name in asked[2:4]]
    made = CliRunner().invoke(application, asked, prog_name="thermap")
    assert made.exit_code == 0, made.output
    assert (folder / "thermap.pem").stat().st_mode & 0o077 == 0
    assert read_certificate(folder / "thermap.der").application_uri == "urn:127.0.0.1:thermap"
    again = CliRunner().invoke(application, asked, prog_name="thermap")
    assert again.exit_code != 0  # who trusts the first trusts no other
    return folder


def server_table(own, more=""):
    return read_connections(config_with(own, SERVER + more)).opcua_server


@pytest.fixture
def password(monkeypatch):
    monkeypatch.setenv("THERMAP_TEST_PLC", PASSWORD)


USERS = 'users = [{ name = "plc", password_env = "THERMAP_TEST_PLC" }]'


@pytest.fixture
def service(new_app, databases):
    """The service with the example machine."""
    url = databases.prepared("sqlite", furnish_database)
    yield new_app(url)
    databases.give_back(url)


async def read_elsewhere(url, *asked):
    """Read by a client in another process."""
    node = f"{ROOM.rpartition('/')[2]}/Configuration"
    command = [sys.executable, "-m", "tests.connections.opcua_reader_example", url, node]
    process = await asyncio.create_subprocess_exec(
        *command, *map(str, asked), cwd=ROOT, stdout=asyncio.subprocess.PIPE
    )
    said, _ = await process.communicate()
    return json.loads(said)


@pytest.mark.slow
async def test_who_is_trusted_reads_and_others_are_told_why_not(service, own, password, caplog):
    caplog.set_level(logging.WARNING, "thermap")
    async with client_of(service) as http:
        await http.get(f"{ROOM}/status")
        async with table_server(service, server_table(own, USERS)) as url:
            plc = ("plc", PASSWORD)
            for policy in POLICIES:
                for mode in ("Sign", "SignAndEncrypt"):
                    found = await read_elsewhere(url, own, "client", mode, policy, *plc)
                    assert found == {"value": MACHINE["configuration"]}
            sign = ("SignAndEncrypt", "Basic256Sha256")
            for asked, words in (
                ((own, "stranger", *sign, *plc), "BadCertificateUntrusted"),
                ((own, "client", *sign, "plc", "wrong"), "BadUserAccessDenied"),
                ((own, "client", *sign, "admin", "admin"), "BadUserAccessDenied"),
                ((own, "client", *sign), "Identity"),
                ((), "NoMatchingEndpoint|Policy|Security|Identity|endpoint"),
            ):
                found = await read_elsewhere(url, *asked)
                assert re.search(words, found["refused"]), found
    assert "came with the certificate 'CN=stranger'" in caplog.text
    assert PASSWORD not in caplog.text


@pytest.mark.slow
async def test_a_client_is_trusted_from_its_next_session_on_and_not_when_it_has_ended(
    service, own, tmp_path
):
    trusted = tmp_path / "trusted"
    trusted.mkdir()
    table = server_table(own).model_copy(update={"trusted_clients": trusted})
    asked = (own, "stranger", "Sign", "Basic256Sha256")
    async with client_of(service) as http:
        await http.get(f"{ROOM}/status")
        async with table_server(service, table) as url:
            assert "BadCertificateUntrusted" in (await read_elsewhere(url, *asked))["refused"]
            (trusted / "broken.der").write_text("no certificate")
            shutil.copy(own / "stranger.der", trusted)
            assert (await read_elsewhere(url, *asked)) == {"value": MACHINE["configuration"]}
            shutil.copy(own / "expired.der", trusted)
            expired = (own, "expired", "Sign", "Basic256Sha256")
            assert "BadCertificateTimeInvalid" in (await read_elsewhere(url, *expired))["refused"]


@pytest.mark.slow
async def test_no_way_round_the_certificate(service, own):
    """No security, no activation, another's session, no channel at all."""
    node = ROOM.rpartition("/")[2] + "/Configuration"
    async with client_of(service) as http:
        await http.get(f"{ROOM}/status")
        async with table_server(service, server_table(own)) as url:
            honest = Client(url)
            honest.application_uri = "urn:client"
            await honest.set_security(
                security_policies.SecurityPolicyBasic256Sha256,
                str(own / "client.der"),
                str(own / "client.pem"),
                server_certificate=str(own / "thermap.der"),
            )
            async with honest:
                index = await honest.get_namespace_index(NAMESPACE)
                asked = ua.NodeId(node, index)
                assert await honest.get_node(asked).read_value() == MACHINE["configuration"]
                offered = await honest.get_endpoints()
                assert {one.SecurityMode.name for one in offered} == {"Sign", "SignAndEncrypt"}

                # A channel without security, which is not offered, and a session in it.
                plain = Client(url)
                await plain.connect_socket()
                await plain.send_hello()
                await plain.open_secure_channel()
                await created(plain)
                with pytest.raises(ua.UaError, match="BadSessionNotActivated"):
                    await plain.get_node(asked).read_value()
                with pytest.raises(ua.UaError, match="BadSecurityModeInsufficient"):
                    await activated(plain)
                with pytest.raises(ua.UaError, match="BadSessionNotActivated"):
                    await plain.get_node(asked).read_value()
                await gone(plain)

                # The trusted client's session, by its token.
                thief = Client(url)
                await thief.connect_socket()
                await thief.send_hello()
                await thief.open_secure_channel()
                thief.uaclient.protocol.authentication_token = (
                    honest.uaclient.protocol.authentication_token
                )
                with pytest.raises(ua.UaError, match="BadSessionIdInvalid"):
                    await activated(thief)
                with pytest.raises(ua.UaError, match="BadUserAccessDenied"):
                    await thief.get_node(asked).read_value()
                await gone(thief)
                assert await honest.get_node(asked).read_value() == MACHINE["configuration"]

                # Messages without any channel.
                outside = Client(url)
                await outside.connect_socket()
                await outside.send_hello()
                outside.uaclient.protocol._connection._open = True
                await created(outside)
                with pytest.raises(ua.UaError, match="BadSessionNotActivated"):
                    await outside.get_node(asked).read_value()
                await gone(outside)


async def created(client):
    """Create a session as asyncua does, with no certificate."""
    asked = ua.CreateSessionParameters()
    asked.ClientNonce = b"0" * 32
    asked.EndpointUrl = client.server_url.geturl()
    asked.SessionName = "guest"
    asked.RequestedSessionTimeout = 60000.0
    asked.ClientDescription.ApplicationUri = "urn:client"
    return await client.uaclient.create_session(asked)


async def activated(client):
    asked = ua.ActivateSessionParameters()
    asked.ClientSignature = ua.SignatureData(Algorithm="", Signature=b"")
    asked.UserIdentityToken = ua.AnonymousIdentityToken(PolicyId="anonymous")
    return await client.uaclient.activate_session(asked)


async def gone(client):
    with suppress(Exception):
        client.uaclient.protocol.transport.abort()


def test_who_may_be_reached_by_others(own, password):
    elsewhere = "opc.tcp://0.0.0.0:4840/thermap"
    expect_servable(elsewhere, server_table(own))
    expect_servable(elsewhere, insecure=True)
    expect_servable("opc.tcp://127.0.0.1:4840/thermap")
    for open_to_all in (None, server_table(own, "without_security = true")):
        with pytest.raises(InvalidContent, match="expected this computer's own address"):
            expect_servable(elsewhere, open_to_all)
    for more, words in (
        (f"{USERS}\nwithout_security = true", "expected without_security = false where there are"),
        ('policies = ["Basic256"]', "Basic256Sha256"),
        ("modes = []", "at least 1"),
        ('users = [{ name = "plc", password_env = "THERMAP_UNSET" }]', "it is unset"),
    ):
        with pytest.raises(InvalidContent, match=words):
            server_table(own, more)
    with pytest.raises(InvalidContent, match="expected a folder of certificates"):
        read_connections(config_with(own, SERVER.replace('"trusted"', '"nowhere"')))
