"""What anybody may send who can reach the port: refused in bounds, while a client that behaves is served."""

import asyncio
import random
import struct

import pytest
from asyncua import ua

from tests.faults.hostile.peer import Stranger, chunk, header, hello, open_channel, service, stranger, string
from tests.faults.hostile.scene import Scene

pytestmark = [pytest.mark.asyncio(loop_scope="module"), pytest.mark.slow]

GET_ENDPOINTS = ua.ObjectIds.GetEndpointsRequest_Encoding_DefaultBinary
CREATE_SESSION = ua.ObjectIds.CreateSessionRequest_Encoding_DefaultBinary
REGISTER_SERVER = ua.ObjectIds.RegisterServerRequest_Encoding_DefaultBinary
FAULT = ua.ObjectIds.ServiceFault_Encoding_DefaultBinary
MOST = 2**31 - 1


def endpoints(tail: bytes) -> bytes:
    return service(GET_ENDPOINTS) + header() + string(b"opc.tcp://127.0.0.1/") + tail


def additional(variant: bytes) -> bytes:
    """Return a header whose additional header is a structure that holds a Variant."""
    kind = struct.pack("<BBH", 1, 0, ua.ObjectIds.LiteralOperand_Encoding_DefaultBinary)
    return service(GET_ENDPOINTS) + header(kind + b"\x01" + string(variant))


BOMBS = {
    "array of 2^31-1 strings of length -4": endpoints(struct.pack("<i", MOST) + struct.pack("<i", -4) * 8),
    "string of length -4": service(GET_ENDPOINTS) + header() + struct.pack("<i", -4),
    "string of length 2^31-1": service(GET_ENDPOINTS) + header() + struct.pack("<i", MOST),
    "null array of 2^31-1": additional(struct.pack("<Bi", 0x80, MOST)),
    "double array of 2^31-1": additional(struct.pack("<Bi", 0x80 | 11, MOST)),
    "variant array of 100000 in 100000 bytes": additional(struct.pack("<Bi", 0x80 | 24, 100_000) + b"\0" * 100_000),
    "variants nested 500 deep": additional((b"\x98" + struct.pack("<i", 1)) * 500),
    "variants nested 20000 deep": additional((b"\x98" + struct.pack("<i", 1)) * 20_000),
    "diagnostics nested 20000 deep": additional(b"\x19" + b"\x40" * 20_000),
    "text that is not UTF-8": service(GET_ENDPOINTS) + header() + string(b"\xff\xfe\xfd"),
    "enumeration nobody knows": service(GET_ENDPOINTS) + b"\xff" * 50,
    "nothing at all": b"",
    "unknown service": service(12_345) + header(),
}


@pytest.mark.parametrize("bomb", BOMBS.values(), ids=BOMBS)
async def test_a_message_that_is_not_what_it_claims_is_answered_at_once(scene: Scene, bomb: bytes):
    async with scene.attack(), stranger(scene, opened=True) as peer:
        await peer.request(bomb)
        answer = await peer.answer()
        assert answer[:3] in {b"MSG", b"ERR", b""}


TOO_EARLY = chunk(service(GET_ENDPOINTS) + header(), channel=0, token=0, sequence=1, request=1)
STARTS = {
    "random bytes": random.Random(7).randbytes(5000),
    "another protocol": b"GET / HTTP/1.1\r\nHost: plant\r\n\r\n",
    "message before hello": TOO_EARLY,
    "channel before hello": open_channel(),
    "acknowledge as first message": b"ACKF" + hello()[4:],
    "unknown chunk type": b"HELX" + hello()[4:],
    "header of no size": b"HELF" + struct.pack("<I", 0),
    "hello of 4 GB": b"HELF" + struct.pack("<I", 2**32 - 1) + b"x" * 100,
    "message of 4 GB": hello() + b"MSGF" + struct.pack("<I", 2**32 - 1) + b"x" * 100,
    "message without a channel": hello()
    + chunk(service(GET_ENDPOINTS) + header(), channel=0, token=0, sequence=1, request=1),
    "second hello": hello() + hello(),
    "buffers of 0 bytes": hello(receive=0, send=0),
    "buffers of 1 byte": hello(receive=1, send=1),
    "buffers of 8191 bytes": hello(receive=8191),
    "renewal of a channel that is not open": hello() + open_channel(renew=True),
    "second channel": hello() + open_channel() + open_channel(sequence=2),
}


@pytest.mark.parametrize("start", STARTS.values(), ids=STARTS)
async def test_a_connection_that_begins_wrong_is_closed(scene: Scene, start: bytes):
    async with scene.attack(), stranger(scene) as peer:
        await peer.send(start)
        assert await peer.closed()


@pytest.mark.parametrize("wrong", ["channel", "token", "sequence", "chunk type"])
async def test_a_chunk_that_does_not_belong_closes_the_connection(scene: Scene, wrong: str):
    async with scene.attack(), stranger(scene, opened=True) as peer:
        body = service(GET_ENDPOINTS) + header()
        places = {"channel": peer.channel, "token": peer.token, "sequence": 2}
        if wrong in places:
            places[wrong] += 1000
        final = b"Z" if wrong == "chunk type" else b"F"
        await peer.send(chunk(body, request=1, final=final, **places))
        assert await peer.closed()


async def test_a_hundred_thousand_bytes_announced_and_never_sent_hold_nothing(scene: Scene):
    async with scene.attack():
        peers = [await _start(scene) for _ in range(10)]
        for peer in peers:
            await peer.send(b"MSGF" + struct.pack("<I", 65_000) + b"x" * 30_000)
        assert all(await asyncio.gather(*(peer.closed(20) for peer in peers)))
        for peer in peers:
            peer.close()


async def _start(scene: Scene) -> Stranger:
    peer = Stranger(*await asyncio.open_connection(*scene.address))
    await peer.open()
    return peer


async def test_a_flood_of_chunks_that_never_ends_is_cut_off(scene: Scene):
    async def flood() -> bool:
        async with stranger(scene, opened=True) as peer:
            for _ in range(200):
                await peer.request(b"x" * 60_000, final=b"C")
            return await peer.closed()

    async with scene.attack():
        assert all(await asyncio.gather(*(flood() for _ in range(8))))


async def test_a_request_of_many_megabytes_is_cut_off(scene: Scene):
    async with scene.attack(), stranger(scene, opened=True) as peer:
        await peer.request(service(GET_ENDPOINTS) + header() + b"\0" * 60_000, final=b"C")
        for _ in range(20):
            await peer.request(b"\0" * 60_000, final=b"C")
        assert await peer.closed()


async def test_hundreds_of_half_open_connections_do_not_keep_anybody_out(scene: Scene):
    async with scene.attack():
        peers: list[Stranger] = []
        for number in range(400):
            peer = Stranger(*await asyncio.open_connection(*scene.address))
            peers.append(peer)
            if number % 2:
                await peer.send(hello()[:20])
        await scene.witnessed(reads=20, sign_ins=2)
        for peer in peers:
            peer.close()


async def test_one_connection_gets_one_session_and_few_tries(scene: Scene):
    request = ua.CreateSessionParameters()
    body = service(CREATE_SESSION) + header() + ua.ua_binary.struct_to_binary(request)
    async with scene.attack(), stranger(scene, opened=True) as peer:
        for _ in range(300):
            await peer.request(body)
            answer = await peer.answer()
            assert not answer or struct.pack("<BBH", 1, 0, FAULT) in answer[:40]


async def test_a_session_needs_an_encrypted_channel(scene: Scene):
    request = ua.CreateSessionParameters(EndpointUrl=scene.url, RequestedSessionTimeout=60_000)
    async with scene.attack(), stranger(scene, opened=True) as peer:
        await peer.request(service(CREATE_SESSION) + header() + ua.ua_binary.struct_to_binary(request))
        assert struct.pack("<I", ua.StatusCodes.BadSecurityModeRejected) in await peer.answer()


async def test_nobody_registers_a_server_here(scene: Scene):
    async with scene.attack(), stranger(scene, opened=True) as peer:
        for _ in range(50):
            await peer.request(service(REGISTER_SERVER) + header() + b"\0" * 60)
            assert struct.pack("<BBH", 1, 0, FAULT) in (await peer.answer())[:40]


async def test_three_thousand_requests_at_once_are_answered_in_turn(scene: Scene):
    async with scene.attack(), stranger(scene, opened=True) as peer:
        body = endpoints(struct.pack("<ii", -1, -1))

        async def ask() -> None:
            for _ in range(1000):
                await peer.request(body)

        async def listen() -> int:
            answers = 0
            while answers < 1000 and await peer.answer(20):
                answers += 1
            return answers

        _, answers = await asyncio.gather(ask(), listen())
        assert answers == 1000


async def test_a_peer_that_never_reads_its_answers_is_cut_off(scene: Scene):
    async with scene.attack(), stranger(scene, opened=True) as peer:
        peer.writer.transport.pause_reading()
        body = endpoints(struct.pack("<ii", -1, -1))
        closed = asyncio.get_running_loop().time() + 40
        while not peer.writer.transport.is_closing() and asyncio.get_running_loop().time() < closed:
            peer.writer.write(b"".join(_many(peer, body)))
            try:
                async with asyncio.timeout(2):
                    await peer.writer.drain()
            except (TimeoutError, ConnectionError):
                break


def _many(peer: Stranger, body: bytes) -> list[bytes]:
    requests = []
    for _ in range(500):
        peer.sequence += 1
        requests.append(
            chunk(body, channel=peer.channel, token=peer.token, sequence=peer.sequence, request=peer.sequence)
        )
    return requests
