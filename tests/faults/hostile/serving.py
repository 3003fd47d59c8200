"""The server under attack: the whole product, with the methods of the stack's tests beside its own.

It runs in a process of its own, prints one line of JSON when it serves, and stops when stdin closes.
"""

import asyncio
import json
import logging
import shutil
import sys
from pathlib import Path

from asyncua import ua

from opcua_skill.commands.arms import Arms
from opcua_skill.configuration.settings import Settings
from opcua_skill.security import TrustList
from opcua_skill.security.access import Role
from opcua_skill.server.app import SkillServerApp
from tests.opcua_skill.stack.small_server import CLIENT_URI, PASSWORD_HASH, add_cell, keys


async def main(folder: Path) -> None:
    logging.basicConfig(
        filename=folder / "server.log", level=logging.INFO, format="%(asctime)s %(levelname)s %(name)s %(message)s"
    )
    logging.getLogger("asyncua").setLevel(logging.ERROR)
    data = folder / "data"
    shutil.copytree(keys(), folder, dirs_exist_ok=True)
    shutil.copytree(keys() / "server", data / "certificates")
    TrustList(data / "certificates").trust(folder / "client" / "client.der")
    station = {"name": "ws1", "arm": "panda", "driver": "kinematic"}
    settings = Settings.load(data=data, endpoint="opc.tcp://127.0.0.1:0", workstations=[station])
    async with SkillServerApp(settings, Arms(settings)) as app:
        for role in Role:
            await app.library.add_user(role.value, role.value, PASSWORD_HASH)
        index, _ = await add_cell(app.server)
        product = await app.server.get_namespace_index("urn:opcua-skill:instances")
        library = ua.NodeId("SkillLibrary", product)
        assert library in app.server.iserver.aspace
        told = {"url": app.endpoint, "index": index, "product": product, "uri": CLIENT_URI}
        print(json.dumps(told), flush=True)
        await asyncio.to_thread(sys.stdin.read)


if __name__ == "__main__":
    asyncio.run(main(Path(sys.argv[1])))
