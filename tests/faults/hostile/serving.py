"""The server under attack, in a process of its own: prints one line of JSON when it serves, stops when stdin closes."""

import asyncio
import json
import logging
import sys
from pathlib import Path

from tests.opcua_skill.stack.small_server import CLIENT_URI, small_server


async def main(folder: Path) -> None:
    logging.basicConfig(
        filename=folder / "server.log", level=logging.INFO, format="%(asctime)s %(levelname)s %(name)s %(message)s"
    )
    async with small_server(folder) as bench:
        print(json.dumps({"url": bench.server.url, "index": bench.index, "uri": CLIENT_URI}), flush=True)
        await asyncio.to_thread(sys.stdin.read)


if __name__ == "__main__":
    asyncio.run(main(Path(sys.argv[1])))
