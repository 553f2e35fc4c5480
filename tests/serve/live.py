# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""A server to test, and clients of it that share no code with it."""
import asyncio
import json
import os
import signal
import struct
import subprocess
import time
import urllib.error
import urllib.request
import zlib
from pathlib import Path

import numpy as np
import websockets

PROGRAM = os.environ["SOILVDB_PROGRAM"]

SCENARIO = """\
soilvdb: 1
voxel_size: 0.05
terrain: {{plane: {{z: 0.0, slope: [0.02, 0.0]}}}}
machines:
  - name: digger
    bucket: {{width: 1.2, height: 0.9, profile: [[0, 0], [-0.5, 0.1], [-0.6, 0.6], [0, 0.9]]}}
  - name: plate
    bucket: {{width: 1.0, height: 0.6}}
{more}"""


def scenario(folder, more=""):
    path = folder / "site.yaml"
    path.write_text(SCENARIO.format(more=more))
    return path


def passes(machine, y, depth, states, begin=0.0):
    """States of a flat pass along x, the mouth ahead."""
    for i in range(states):
        x = 4.0 * i / (states - 1)
        yield {"machine": machine, "time": begin + 0.01 * i,
               "position": [x, y, 0.02 * x - depth], "rotation": [0.0, 0.0, 0.0, 1.0]}


def until(found, seconds=60):
    """What is found, once it is true."""
    end = time.monotonic() + seconds
    while not (result := found()):
        assert time.monotonic() < end
        time.sleep(0.005)
    return result


class Client:
    """Of what is at an address."""

    def __init__(self, url):
        self.url = url

    def get(self, path, headers=None, method="GET", data=None):
        """Status and body."""
        request = urllib.request.Request(self.url.rstrip("/") + path, headers=headers or {},
                                         method=method, data=data)
        try:
            with urllib.request.urlopen(request, timeout=60) as response:
                body = response.read()
                if response.headers.get("Content-Encoding") == "deflate":
                    body = zlib.decompress(body)
                return response.status, body
        except urllib.error.HTTPError as error:
            with error:
                return error.code, error.read()

    def post(self, path, data=b"", headers=None):
        """Status, and what the body's lines say."""
        if not isinstance(data, (str, bytes)):
            data = "\n".join(state if isinstance(state, str) else json.dumps(state) for state in data)
        status, body = self.get(path, headers, "POST", data if isinstance(data, bytes) else data.encode())
        return status, [json.loads(line) for line in body.decode().splitlines()]

    def json(self, path):
        status, body = self.get(path)
        assert status == 200, body
        return json.loads(body)

    def connect(self, path, **options):
        return websockets.connect(self.url.replace("http", "ws").rstrip("/") + path,
                                  max_size=None, **options)

    def feed(self, states, path="/feed"):
        """Feeds states one after another; the answers."""
        async def work():
            answers = []
            async with self.connect(path) as feed:
                for state in states:
                    await feed.send(state if isinstance(state, str) else json.dumps(state))
                    answers.append(json.loads(await feed.recv()))
            return answers
        return asyncio.run(work())


class Server(Client):
    def __init__(self, *arguments, cwd, stdin=None, env=None):
        self.process = subprocess.Popen(
            [PROGRAM, "serve", *map(str, arguments), "--port", "0"], cwd=cwd, text=True,
            stdin=stdin, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            env={**os.environ, **(env or {})})
        line = self.process.stdout.readline()
        if not line:
            raise AssertionError(self.process.stderr.read())
        self.printed = line.strip()
        super().__init__(self.printed.split("#")[0])

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        self.process.stdout.close()
        self.process.stderr.close()

    def stop(self):
        self.process.send_signal(signal.SIGINT)
        assert self.process.wait(30) == 0
        return self.process.stderr.read()

    def kill(self):
        self.process.kill()
        self.process.wait()

    def rss_kb(self, which="VmRSS"):
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        return int(next(line for line in status.splitlines() if line.startswith(which)).split()[1])


class Block:
    """A block of surface, decoded as tools/guide/live.md says."""

    def __init__(self, message, voxel, origin):
        data = zlib.decompress(message)
        *block, self.view, low, high, n, m, flags = struct.unpack_from("<iii6I", data)
        self.block, self.resident, self.size = tuple(block), low | high << 32, len(message)
        at = 36

        def numbers(count, dtype):
            nonlocal at
            width = np.dtype(dtype).itemsize
            planes = np.frombuffer(data, np.uint8, count * width, at).reshape(width, count)
            at += count * width
            return np.ascontiguousarray(planes.T).view(dtype).reshape(count)

        def array(count, dtype):
            return np.cumsum(numbers(count, dtype), dtype=dtype)
        self.lattice = np.stack([array(n, "<u2") for _ in range(3)], axis=1) if n else np.zeros((0, 3))
        self.lattice = self.lattice.astype(np.int64) - 8192 + 1024 * np.array(block)
        self.points = np.array(origin) + voxel * self.lattice / 1024
        if n:
            self.change = array(n, "<u2").view("<i2") / 1000
            if flags & 1:
                self.design = array(n, "<u2").view("<i2") / 1000
            self.loose = array(n, "<u2") / 65535
            back = numbers(3 * m, "<u4" if n > 65535 else "<u2").astype(np.int64)
            new = back == 0
            self.triangles = (np.cumsum(new) - new - back).reshape(m, 3)
            assert self.triangles.min() >= 0 and new.sum() == n
        assert not n or at == len(data)


async def view(server, until, requests=(), seconds=120, path="/view", **options):
    """What a viewer gets until `until(texts, blocks)`: texts, and the newest of each block by view."""
    texts, blocks = [], {}
    async with server.connect(path, **options) as socket:
        for request in requests:
            await socket.send(json.dumps(request))
        async def work():
            while not until(texts, blocks):
                message = await socket.recv()
                if isinstance(message, str):
                    texts.append(json.loads(message))
                else:
                    site = texts[0]
                    block = Block(message, site["voxel_size_m"], site["origin"])
                    blocks[block.view, block.block] = block
        await asyncio.wait_for(work(), seconds)
    return texts, blocks


def state_told(server):
    """The state of the live ground that a viewer is told first."""
    texts, _ = asyncio.run(view(server, lambda texts, _: texts and texts[-1]["type"] == "state"))
    return texts[-1]


def whole(id=0):
    return lambda texts, blocks: any(t["type"] == "whole" and t["id"] == id for t in texts)


