"""A PostgreSQL server of the tests' own: a cluster in a folder in /tmp, a Unix socket in it, and no port."""

import os
import pwd
import re
import secrets
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

TOOL = "pg_createcluster"
SUPERUSER, OWNER, SERVER, SECRET = "root_of_tests", "library_owner", "library_server", "ein Geheimnis"
# fsync is for a machine that loses its power, which no test takes away; a killed process loses nothing without it.
SETTINGS = {"listen_addresses": "", "fsync": "off", "shared_buffers": "32MB", "max_connections": "100"}


def available() -> bool:
    """Return whether this machine has PostgreSQL, as Debian has it."""
    return shutil.which(TOOL) is not None


@dataclass
class Cluster:
    """A server with its folder. It can be stopped and started; nothing stays of it in the end."""

    folder: Path
    programs: Path

    def run(self, program: str, *arguments: str) -> str:
        """Run one of PostgreSQL's programs, as somebody who is not root: its server refuses to be."""
        who: dict[str, Any] = {}
        if os.geteuid() == 0:
            account = pwd.getpwnam("postgres")
            who = {"user": account.pw_uid, "group": account.pw_gid, "extra_groups": []}
        command = [str(self.programs / program), *arguments]
        with tempfile.TemporaryFile() as said:  # no pipe: the server that pg_ctl leaves behind would hold it open
            done = subprocess.run(command, stdout=said, stderr=said, cwd="/", timeout=120, check=False, **who)
            said.seek(0)
            text = said.read().decode()
        assert done.returncode == 0, f"{program}: {text}"
        return text

    @property
    def data(self) -> str:
        """The folder of the cluster's files."""
        return str(self.folder / "data")

    def make(self) -> None:
        """Make the cluster: everybody has to say a password."""
        (self.folder / "secret").write_text(SECRET)
        (self.folder / "secret").chmod(0o644)
        access = ("--auth=scram-sha-256", f"--pwfile={self.folder / 'secret'}", f"--username={SUPERUSER}")
        self.run("initdb", "--no-sync", "--encoding=UTF8", "--locale=C.UTF-8", *access, "--pgdata", self.data)
        settings = {**SETTINGS, "unix_socket_directories": str(self.folder)}
        with (self.folder / "data" / "postgresql.conf").open("a") as file:
            file.writelines(f"{name} = '{value}'\n" for name, value in settings.items())

    def start(self) -> None:
        """Start the server and wait until it can be asked."""
        self.run("pg_ctl", "start", "-w", "-t", "90", "--pgdata", self.data, "-l", str(self.folder / "log"))

    def stop(self, mode: str = "fast") -> None:
        """Stop the server: ``fast`` closes all connections, ``immediate`` is a crash."""
        self.run("pg_ctl", "stop", "-w", "-t", "90", "-m", mode, "--pgdata", self.data)

    def url(self, database: str, role: str = SERVER, secret: str = SECRET) -> str:
        """Return the address of a database for a role."""
        return f"postgresql+asyncpg://{role}:{quote(secret)}@/{database}?host={quote(str(self.folder))}"

    async def new_database(self) -> str:
        """Make a prepared, empty database and return its name."""
        name = f"library_{secrets.token_hex(4)}"
        await self.empty("template_library")  # tests that came before have used it
        await self.execute("postgres", f"CREATE DATABASE {name} TEMPLATE template_library OWNER {OWNER}")
        return name

    async def empty(self, database: str) -> None:
        """Empty all tables of a library, as only somebody can whom no trigger binds."""
        from library.tables import metadata

        tables = ", ".join(metadata.tables)
        await self.execute(
            database,
            "SET session_replication_role = replica",
            f"TRUNCATE {tables} RESTART IDENTITY CASCADE",
        )

    async def execute(self, database: str, *statements: str, role: str = SUPERUSER) -> list[Any]:
        """Run statements one by one, each on its own, and return the rows of the last."""
        import asyncpg

        connection = await asyncpg.connect(
            user=role, password=SECRET, host=str(self.folder), database=database, timeout=60
        )
        try:
            found: list[Any] = []
            for statement in statements:
                found = await connection.fetch(statement)
            return found
        finally:
            await connection.close()


@contextmanager
def cluster() -> Iterator[Cluster]:
    """A running cluster with the two roles; the folder's name is short, as that of a socket has to be."""
    found = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"), key=lambda one: int(re.sub(r"\D", "", str(one))))
    folder = Path(tempfile.mkdtemp(prefix="pg-", dir="/tmp"))
    try:
        folder.chmod(0o755)
        if os.geteuid() == 0:
            account = pwd.getpwnam("postgres")
            os.chown(folder, account.pw_uid, account.pw_gid)
        made = Cluster(folder, found[-1].parent)
        made.make()
        made.start()
        try:
            yield made
        finally:
            made.stop("immediate")
    finally:
        shutil.rmtree(folder)


async def prepare_template(server: Cluster) -> None:
    """Make both roles, and the database `template_library` that others are made from: prepared, and empty."""
    from library.preparing import prepare

    await server.execute(
        "postgres",
        *(f"CREATE ROLE {role} LOGIN PASSWORD '{SECRET}'" for role in (OWNER, SERVER)),
        f"CREATE DATABASE template_library OWNER {OWNER}",
    )
    await prepare(server.url("template_library", OWNER), SERVER)
