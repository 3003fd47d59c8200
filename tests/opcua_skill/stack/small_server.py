"""A small server of ours with a few methods, its users, and clients that sign in to it: shared by the stack's tests."""

import asyncio
import atexit
import functools
import logging
import shutil
import tempfile
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path

from asyncua import Client, ua
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256

from opcua_skill.security import (
    Authenticator,
    SecuritySettings,
    TrustList,
    ensure_client_certificate,
    ensure_server_certificate,
    hash_password,
)
from opcua_skill.security.access import Role, caller
from opcua_skill.stack.limits import Limits
from opcua_skill.stack.server import SkillServer
from opcua_skill.stack.services.calls import Argument, CallRecord, MethodSpec, Refused, add_method
from opcua_skill.stack.transport import decoding
from opcua_skill.stack.transport.decoding import install

PASSWORD = "correct horse battery"
PASSWORD_HASH = hash_password(PASSWORD)
CLIENT_URI = "urn:opcua-skill:test-client"
DOUBLE, STRING, INT32 = (ua.NodeId(i) for i in (ua.ObjectIds.Double, ua.ObjectIds.String, ua.ObjectIds.Int32))


@functools.cache
def keys() -> Path:
    """Return a folder with a server's and a client's key: made once, copied for every server of a test run."""
    folder = Path(tempfile.mkdtemp(prefix="opcua-skill-keys-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    settings = SecuritySettings(folder)
    ensure_server_certificate(folder / "server", settings.application_uri, settings.application_name)
    ensure_client_certificate(folder / "client", CLIENT_URI)
    return folder


async def until(condition: Callable[[], bool], seconds: float = 10) -> None:
    """Wait until something holds; fail when it does not within the limit."""
    end = asyncio.get_running_loop().time() + seconds
    while not condition():
        assert asyncio.get_running_loop().time() < end, "waited in vain"
        await asyncio.sleep(0.02)


@dataclass(frozen=True)
class Row:
    name: str
    role: str
    password_hash: str = PASSWORD_HASH
    certificate: bytes = b""


@dataclass
class Users:
    """A user store in memory: one user a role, named like it."""

    rows: list[Row] = field(default_factory=lambda: [Row(role.value, role.value) for role in Role])

    async def users(self) -> list[Row]:
        return self.rows

    async def set_password_hash(self, name: str, password_hash: str) -> None:
        self.rows = [Row(r.name, r.role, password_hash if r.name == name else r.password_hash) for r in self.rows]


PATIENT = Limits(hello_timeout=60.0)
"""A loaded machine may let server and client, one process here, wait for each other longer than for a stranger."""


@dataclass
class Bench:
    """A running server, its records of calls, and what a client needs to connect."""

    server: SkillServer
    folder: Path
    index: int
    cell: ua.NodeId
    records: list[CallRecord]
    users: Users

    @asynccontextmanager
    async def client(
        self, user: str = "operator", password: str = PASSWORD, *, certificate: Path | None = None
    ) -> AsyncIterator[Client]:
        client = await self.new_client(user, password, certificate=certificate)
        async with client:
            yield client

    async def new_client(
        self, user: str = "operator", password: str = PASSWORD, *, certificate: Path | None = None
    ) -> Client:
        own = await asyncio.to_thread(ensure_client_certificate, certificate or self.folder / "client", CLIENT_URI)
        client = Client(self.server.url, timeout=10)
        client.application_uri = CLIENT_URI
        if user:
            client.set_user(user)
            client.set_password(password)
        await client.set_security(
            SecurityPolicyBasic256Sha256,
            str(own.certificate_file),
            str(own.key_file),
            mode=ua.MessageSecurityMode.SignAndEncrypt,
        )
        return client


async def _add(a: float, b: float) -> tuple[float]:
    return (a + b,)


async def _length(values: list[float]) -> tuple[int]:
    return (len(values),)


async def _whoami() -> tuple[str]:
    return (f"{caller().name}/{caller().role}",)


async def _refuse(name: str) -> tuple[()]:
    raise Refused(ua.StatusCodes.BadInvalidArgument, "no such name", arguments={"Name": ua.StatusCodes.BadOutOfRange})


async def _fault() -> tuple[()]:
    raise RuntimeError("the secret reason")


async def _slow() -> tuple[()]:
    await asyncio.sleep(60)
    return ()


def specs() -> list[MethodSpec]:
    everybody, writers = Role.OBSERVER.and_above, Role.ENGINEER.and_above
    result = Argument("Result", DOUBLE)
    return [
        MethodSpec("Add", (Argument("A", DOUBLE), Argument("B", DOUBLE)), (result,), _add, everybody, changes=False),
        MethodSpec(
            "Length", (Argument("Values", DOUBLE, 1),), (Argument("Count", INT32),), _length, everybody, changes=False
        ),
        MethodSpec("WhoAmI", (), (Argument("Who", STRING),), _whoami, everybody, changes=True),
        MethodSpec("Refuse", (Argument("Name", STRING),), (), _refuse, everybody, changes=True),
        MethodSpec("Fault", (), (), _fault, everybody, changes=False),
        MethodSpec("Slow", (), (), _slow, everybody, changes=False, time_limit=0.2),
        MethodSpec("Engineer", (), (Argument("Who", STRING),), _whoami, writers, changes=True),
        MethodSpec(
            "Secret",
            (Argument("Password", STRING, secret=True),),
            (),
            lambda password: _nothing(),
            everybody,
            changes=True,
        ),
    ]


async def _nothing() -> tuple[()]:
    return ()


async def add_cell(server: SkillServer) -> tuple[int, ua.NodeId]:
    """Add an object with the methods above and a few variables; return its namespace and its id."""
    index = await server.register_namespace("urn:test")
    cell = await server.nodes.objects.add_object(ua.NodeId("Cell", index), ua.QualifiedName("Cell", index))
    for spec in specs():
        await add_method(server, cell, spec, ua.NodeId(f"Cell/{spec.name}", index), ua.QualifiedName(spec.name, index))
    for name, value in (("Speed", 1.5), ("Locked", 2.5)):
        node = await cell.add_variable(ua.NodeId(f"Cell/{name}", index), ua.QualifiedName(name, index), value)
        await node.set_writable()
        if name == "Locked":
            server.restrict_writes(node, Role.ENGINEER.and_above)
    await cell.add_variable(ua.NodeId("Cell/ReadOnly", index), ua.QualifiedName("ReadOnly", index), 3.5)
    return index, cell.nodeid


@asynccontextmanager
async def small_server(
    folder: Path, *, trust_client: bool = True, limits: Limits | None = None, **settings
) -> AsyncIterator[Bench]:
    logging.getLogger("asyncua").setLevel(logging.ERROR)
    shutil.copytree(keys(), folder, dirs_exist_ok=True)
    users, records, before = Users(), [], decoding._limits

    async def on_call(record: CallRecord) -> None:
        records.append(record)

    security = SecuritySettings(folder / "server", endpoint="opc.tcp://127.0.0.1:0/test", **settings)
    authenticator = Authenticator(users)
    server = SkillServer(authenticator, security, on_call=on_call, limits=limits or PATIENT)
    await server.init()
    index, cell = await add_cell(server)
    if trust_client:
        own = await asyncio.to_thread(ensure_client_certificate, folder / "client", CLIENT_URI)
        TrustList(security.folder).trust(own.certificate_file)
    async with server:
        yield Bench(server, folder, index, cell, records, users)
    authenticator.close()
    install(before)  # the decoders' limits are those of the process: another test's server may still run
