"""Limits of connections, in front of a protocol of which they know no more than asyncio does."""

import asyncio
from typing import Any

import pytest

from fieldkit.page import protocol
from fieldkit.page.protocol import CarefulProtocol

START, END = b"GET / HTTP/1.1\r\nHost: a\r\n", b"\r\n"
POST = b"POST / HTTP/1.1\r\nHost: a\r\nContent-Length: 4\r\n\r\n"


class Silent(asyncio.Protocol):
    """Reads whatever comes, in place of uvicorn's protocol."""

    def __init__(self, **options: Any) -> None: ...


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    # uvicorn's own answers would end connections too; the page's tests have both together
    monkeypatch.setattr(protocol, "H11Protocol", Silent)
    monkeypatch.setattr(protocol, "HEADERS_WITHIN_S", 0.2)  # a shorter wait


async def is_closed_after(*parts: bytes) -> bool:
    """Whether the server closes a connection on which these bytes come one after the other."""
    connections: set[CarefulProtocol] = set()
    loop = asyncio.get_running_loop()
    server = await loop.create_server(lambda: CarefulProtocol(connections), "127.0.0.1", 0)
    async with server:
        reader, writer = await asyncio.open_connection(*server.sockets[0].getsockname())
        for part in parts:
            writer.write(part)
            await asyncio.sleep(0.02)  # so that the server reads one part after the other
        try:
            await asyncio.wait_for(reader.read(), 1.0)
        except TimeoutError:
            return False
        except ConnectionResetError:
            return True
        finally:
            writer.close()
        return True


@pytest.mark.parametrize(
    ("parts", "closed"),
    [
        ((), True),
        ((START,), True),
        ((START, END), False),
        ((POST, b"ab"), True),  # two of four bytes
        ((POST, b"ab", b"cd"), False),
        ((START + END, START), True),  # another request on the same connection
        ((START + END + START,), True),  # in one piece with the first
        ((START + END + START + END,), False),
        ((b"no request\r\n\r\n",), False),  # refused by the protocol behind
    ],
)
@pytest.mark.usefixtures("quick")
def test_a_request_that_does_not_become_complete_ends_its_connection(
    parts: tuple[bytes, ...], closed: bool
) -> None:
    assert asyncio.run(is_closed_after(*parts)) == closed


@pytest.mark.usefixtures("quick")
def test_of_too_many_connections_of_an_address_the_oldest_that_waits_is_closed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(protocol, "HEADERS_WITHIN_S", 60.0)  # none is too late here
    monkeypatch.setattr(protocol, "MOST_OF_ONE", 3)  # four are opened one after the other

    async def closed() -> list[bool]:
        connections: set[CarefulProtocol] = set()
        loop = asyncio.get_running_loop()
        server = await loop.create_server(lambda: CarefulProtocol(connections), "127.0.0.1", 0)
        async with server:
            streams = []
            for part in (START + END, START, START, START):  # the first one is complete
                streams.append(await asyncio.open_connection(*server.sockets[0].getsockname()))
                streams[-1][1].write(part)
                await asyncio.sleep(0.05)  # so that the server takes one after the other
            found = [reader.at_eof() or reader.exception() is not None for reader, _ in streams]
            for _, writer in streams:
                writer.close()
            return found

    assert asyncio.run(closed()) == [False, True, False, False]
