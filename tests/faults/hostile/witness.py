"""A client that behaves, in a process of its own: reads all the time, signs in anew now and then, and reports both.

With each read it reports how late the machine woke it before: what everybody waits here, whoever is attacked. A line
on stdin asks for a sign-in at once.
"""

import asyncio
import contextlib
import json
import logging
import os
import sys
import time
from pathlib import Path

from asyncua import Client, ua
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256

from tests.opcua_skill.stack.small_server import CLIENT_URI, PASSWORD

READ_EVERY, SIGN_IN_EVERY, GIVE_UP = 0.005, 1.0, 20.0


async def client_of(url: str, folder: Path) -> Client:
    client = Client(url, timeout=GIVE_UP, watchdog_intervall=60.0)
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
        asleep = time.perf_counter()
        await asyncio.sleep(READ_EVERY)
        begun = time.perf_counter()
        await node.read_value()
        say(read=time.perf_counter() - begun, late=begun - asleep - READ_EVERY)


async def sign_ins(url: str, folder: Path) -> None:
    asked = asyncio.Event()
    asyncio.get_running_loop().add_reader(sys.stdin, lambda: (os.read(0, 4096), asked.set()))
    while True:
        begun, wanted = time.perf_counter(), asked.is_set()
        asked.clear()
        while True:
            try:
                async with await client_of(url, folder):
                    break
            except (ua.UaError, OSError, TimeoutError):
                if time.perf_counter() - begun > GIVE_UP:
                    break
        say(sign_in=time.perf_counter() - begun, asked=wanted)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(SIGN_IN_EVERY):
                await asked.wait()


async def main(url: str, folder: Path) -> None:
    logging.disable(logging.WARNING)
    async with await client_of(url, folder) as client:
        say(ready=True)
        await asyncio.gather(reads(client), sign_ins(url, folder))


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1], Path(sys.argv[2])))
