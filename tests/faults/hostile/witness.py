"""A client that behaves, in a process of its own: reads all the time, signs in anew now and then, and reports both."""

import asyncio
import json
import logging
import sys
import time
from pathlib import Path

from asyncua import Client, ua
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256

from tests.opcua_skill.stack.small_server import CLIENT_URI, PASSWORD

READ_EVERY, SIGN_IN_EVERY, GIVE_UP = 0.01, 1.0, 20.0


async def client_of(url: str, folder: Path) -> Client:
    client = Client(url, timeout=GIVE_UP)
    client.application_uri = CLIENT_URI
    client.set_user("engineer")
    client.set_password(PASSWORD)
    files = (str(folder / "client" / "client.der"), str(folder / "client" / "client.pem"))
    certificate = folder / "server" / "server.der"
    await client.set_security(
        SecurityPolicyBasic256Sha256,
        *files,
        server_certificate=str(certificate),
        mode=ua.MessageSecurityMode.SignAndEncrypt,
    )
    return client


def say(**what) -> None:
    print(json.dumps(what), flush=True)


async def reads(client: Client) -> None:
    node = client.nodes.server_state
    while True:
        begun = time.perf_counter()
        await node.read_value()
        say(read=time.perf_counter() - begun)
        await asyncio.sleep(READ_EVERY)


async def sign_ins(url: str, folder: Path) -> None:
    while True:
        begun = time.perf_counter()
        while True:
            try:
                async with await client_of(url, folder):
                    break
            except (ua.UaError, OSError, TimeoutError):
                if time.perf_counter() - begun > GIVE_UP:
                    break
        say(sign_in=time.perf_counter() - begun)
        await asyncio.sleep(SIGN_IN_EVERY)


async def main(url: str, folder: Path) -> None:
    logging.disable(logging.WARNING)
    async with await client_of(url, folder) as client:
        say(ready=True)
        await asyncio.gather(reads(client), sign_ins(url, folder))


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1], Path(sys.argv[2])))
