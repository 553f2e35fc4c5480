# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Links that fall silent, newcomers beside connections that never ask, and goodbyes."""
import asyncio
import contextlib
import json
import os
import resource
import socket
import struct
import time
from urllib.parse import urlsplit

import pytest
import websockets
from live import Server, passes, scenario

STATES = list(passes("digger", 0.0, 0.3, 60))


class BareFeed:
    """A feed that answers no ping unless it is told to."""

    def __init__(self, server):
        address = urlsplit(server.url)
        self.socket = socket.create_connection((address.hostname, address.port), 10)
        self.socket.sendall((
            f"GET /feed HTTP/1.1\r\nHost: {address.netloc}\r\nConnection: Upgrade\r\n"
            "Upgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n").encode())
        self.stream = self.socket.makefile("rb")
        while self.stream.readline().strip():
            pass

    def send(self, content, opcode=1):
        """A frame under a mask of zeros."""
        assert len(content) < 65536
        size = bytes([128 | len(content)]) if len(content) < 126 else b"\xfe" + struct.pack(">H", len(content))
        self.socket.sendall(bytes([128 | opcode]) + size + bytes(4) + content)

    def frame(self):
        """Opcode and content of the next frame."""
        opcode, size = self.stream.read(2)
        if size >= 126:
            size, = struct.unpack(">H", self.stream.read(2))
        return opcode & 15, self.stream.read(size)

    def feed(self, state):
        self.send(json.dumps(state).encode())
        while (frame := self.frame())[0] != 1:
            pass
        return json.loads(frame[1])

    def close(self):
        self.stream.close()
        self.socket.close()

    def break_off(self):
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self.close()


async def links(viewer, until, seconds, machine=0):
    """How long it took until the machine's link is as expected, and the links on the way."""
    begin, seen = time.monotonic(), []
    async with asyncio.timeout(seconds):
        while True:
            message = await viewer.recv()
            if isinstance(message, str) and (json_ := json.loads(message))["type"] == "state":
                seen.append(json_["machines"][machine]["link"])
                if until(seen[-1]):
                    return time.monotonic() - begin, seen


def test_a_feed_of_which_nothing_is_heard_is_lost_within_5_s_and_another_is_not(tmp_path):
    async def work(server):
        async with server.connect("/view") as viewer, server.connect("/feed", ping_interval=None) as busy:
            await links(viewer, lambda link: link == "none", 2)
            bare = BareFeed(server)
            assert "error" not in bare.feed(STATES[0])
            # One that has nothing to send answers pings, and lives.
            await busy.send(json.dumps({**STATES[0], "machine": "plate"}))
            await busy.recv()
            await links(viewer, lambda link: link == "live", 2)
            for _ in range(2):
                took_s, _ = await links(viewer, lambda link: link == "lost", 5)
                assert took_s > 2, "a short silence is none"
                # It is heard again, by an answer to a ping or by data.
                bare.send(b"", opcode=10)
                took_s, _ = await links(viewer, lambda link: link == "live", 1)
            await links(viewer, lambda link: link == "lost", 5)
            assert "error" not in bare.feed(STATES[1])
            await links(viewer, lambda link: link == "live", 1)
            _, others = await links(viewer, lambda link: True, 2, machine=1)
            assert others == ["live"]
            bare.close()
    with Server(scenario(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        asyncio.run(work(server))


@pytest.mark.skipif("SOILVDB_LONG" not in os.environ, reason="takes more than a minute")
def test_a_feed_that_has_nothing_to_send_stays_and_a_dead_one_is_closed(tmp_path):
    async def work(server):
        async with server.connect("/feed", ping_interval=None) as idle:
            bare = BareFeed(server)
            await asyncio.sleep(66)
            await idle.send(json.dumps(STATES[0]))
            assert "error" not in json.loads(await idle.recv())
            bare.socket.settimeout(1)
            while bare.stream.read(1):   # pings that it has not answered
                pass
            bare.close()
    with Server(scenario(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        asyncio.run(work(server))


def test_a_message_that_takes_long_to_come_is_heard(tmp_path):
    async def work(server):
        async with server.connect("/view") as viewer:
            bare = BareFeed(server)
            assert "error" not in bare.feed(STATES[0])
            await links(viewer, lambda link: link == "live", 2)
            message = json.dumps(STATES[1]).encode()
            bare.socket.sendall(bytes([129, 128 | 126]) + struct.pack(">H", len(message)) + bytes(4))
            for i in range(0, len(message), 16):
                bare.socket.sendall(message[i:i + 16])
                _, seen = await links(viewer, lambda link: True, 2)
                assert seen == ["live"]
                await asyncio.sleep(0.9)
            while (frame := bare.frame())[0] != 1:
                pass
            assert "cut_m3" in json.loads(frame[1])
            bare.close()
    with Server(scenario(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        asyncio.run(work(server))


def test_a_link_that_breaks_off_is_lost_and_one_that_says_goodbye_is_none(tmp_path):
    async def work(server):
        async with server.connect("/view") as viewer:
            bare = BareFeed(server)
            bare.feed(STATES[0])
            await links(viewer, lambda link: link == "live", 2)
            bare.break_off()
            await links(viewer, lambda link: link == "lost", 2)
            async with server.connect("/feed") as feed:
                await feed.send(json.dumps(STATES[1]))
                await feed.recv()
                await links(viewer, lambda link: link == "live", 2)
            await links(viewer, lambda link: link == "none", 2)
    with Server(scenario(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        asyncio.run(work(server))


@contextlib.contextmanager
def sockets(server, count, content=b""):
    """Connections that send this and no more."""
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(4096, hard), hard))
    address = urlsplit(server.url)
    with contextlib.ExitStack() as stack:
        def connection():
            client = stack.enter_context(socket.create_connection((address.hostname, address.port), 10))
            with contextlib.suppress(OSError):  # it may be dropped already
                client.sendall(content)
            return client
        yield [connection() for _ in range(count)]


@pytest.mark.parametrize("content, until_closed_s", [
    (b"", 5), (b"GET /height?x=0&y=0 HTTP/1.1\r\nHost: local", 5),
    (b"GET /view.js HTTP/1.1\r\nHost: localhost\r\n\r\n", 120)], ids=["nothing", "part", "page"])
def test_connections_that_never_ask_keep_no_newcomer_out(tmp_path, content, until_closed_s):
    (tmp_path / "token").write_text("d1g")
    with Server(scenario(tmp_path), "--token-file", "token", "--out", tmp_path / "out",
                cwd=tmp_path) as server:
        async def fed_before():
            async with server.connect("/feed?token=d1g") as feed:
                with sockets(server, 700, content):
                    for state in STATES[:10]:
                        await feed.send(json.dumps(state))
                        assert "error" not in json.loads(await feed.recv()), "it stays"
                    begin = time.monotonic()
                    assert server.get("/height?x=0&y=0&token=d1g")[0] == 200
                    async with server.connect("/feed?token=d1g") as other:
                        await other.send("{}")
                        assert "error" in json.loads(await other.recv())
                    assert time.monotonic() - begin < 0.8 * until_closed_s
        asyncio.run(fed_before())
        assert len(os.listdir(f"/proc/{server.process.pid}/fd")) < 600


def test_a_connection_that_does_not_ask_is_closed_soon(tmp_path):
    with Server(scenario(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        with sockets(server, 3, b"GET / HTTP/1.1\r\n") as clients:
            begin = time.monotonic()
            for client in clients:
                client.settimeout(10)
                with contextlib.suppress(ConnectionResetError):
                    assert client.recv(10) == b""
            assert 3 < time.monotonic() - begin < 7


def test_all_clients_are_told_that_the_site_ends(tmp_path):
    async def work(server):
        async with server.connect("/feed") as feed, server.connect("/view") as viewer:
            await feed.send(json.dumps(STATES[0]))
            await feed.recv()
            silent = BareFeed(server)  # never answers the goodbye
            loop = asyncio.get_running_loop()
            begin = time.monotonic()
            stopping = loop.run_in_executor(None, server.stop)
            for client in (feed, viewer):
                with pytest.raises(websockets.ConnectionClosed):
                    while True:
                        await client.recv()
                assert (client.close_code, client.close_reason) == (1001, "the site has ended")
            assert "1 state" in await stopping
            assert time.monotonic() - begin < 5
            while (frame := silent.frame())[0] != 8:
                pass
            assert frame[1][2:] == b"the site has ended"
            silent.close()
    with Server(scenario(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        asyncio.run(work(server))


def test_a_message_of_junk_holds_up_no_other_feed(tmp_path):
    async def work(server):
        async with server.connect("/feed") as feed, server.connect("/feed") as junk:
            async def send_junk():
                for _ in range(3):
                    await junk.send("x\n" * 32_000)
                    await junk.recv()
                return time.monotonic() - begin
            begin, slowest = time.monotonic(), 0.0
            sending = asyncio.create_task(send_junk())
            for state in passes("digger", 0.0, -0.3, 200):
                sent = time.monotonic()
                await feed.send(json.dumps(state))
                assert "error" not in json.loads(await feed.recv())
                slowest = max(slowest, time.monotonic() - sent)
                if sending.done():
                    break
                await asyncio.sleep(0.002)
            return slowest, await sending
    with Server(scenario(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        slowest_s, junk_s = asyncio.run(work(server))
        assert slowest_s < 0.1 and junk_s > slowest_s, (slowest_s, junk_s)
