"""An OPC UA client in a process of its own, as a PLC has one.

    python -m tests.connections.opcua_reader_example URL NODE [FOLDER NAME MODE POLICY [USER WORD]]

reads a node of thermap's namespace and prints its value as JSON, or what it was refused with.
"""

import asyncio
import json
import sys
from pathlib import Path


async def _read(url, node, folder=None, name="", mode="", policy="", user="", password=""):
    from asyncua import Client, ua
    from asyncua.crypto import security_policies

    client = Client(url, timeout=30)
    if folder is not None:
        client.application_uri = "urn:client"
        await client.set_security(
            getattr(security_policies, f"SecurityPolicy{policy}"),
            str(Path(folder) / f"{name}.der"),
            str(Path(folder) / f"{name}.pem"),
            server_certificate=str(Path(folder) / "thermap.der"),
            mode=ua.MessageSecurityMode[mode],
        )
    if user:
        client.set_user(user)
        client.set_password(password)
    async with client:
        index = await client.get_namespace_index("urn:thermap:machines")
        return await client.get_node(ua.NodeId(node, index)).read_value()


async def _print(*asked):
    try:
        print(json.dumps({"value": await _read(*asked)}))
    except Exception as why:
        print(json.dumps({"refused": f"{type(why).__name__}: {why}"}))


if __name__ == "__main__":
    asyncio.run(_print(*sys.argv[1:]))
