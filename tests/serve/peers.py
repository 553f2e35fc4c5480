# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes as ROS 2 would have them, as programs of their own, and CDR that shares no code with others."""
import os
import queue
import socket
import struct
import subprocess
import sys
import threading
from pathlib import Path

from live import PROGRAM

sys.path.append(str(Path(__file__).parents[1] / "mcap"))
from make_mcap import Cdr, stamp_of  # noqa: E402

SECONDS = 60
CONFIG = ("<CycloneDDS><Domain><General><AllowMulticast>false</AllowMulticast><Interfaces>"
          "<NetworkInterface address='127.0.0.1'/></Interfaces></General><Discovery>"
          "<ParticipantIndex>auto</ParticipantIndex><Peers><Peer address='127.0.0.1'/></Peers>"
          "</Discovery></Domain></CycloneDDS>")


def path_of(kind):
    return Path(PROGRAM).parent / "tests" / f"{kind}_peer"


def free_domain():
    """A domain that nobody of this computer is in: the ports of its first participants are free."""
    for domain in range(1 + os.getpid() % 50, 100):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as first:
            try:
                first.bind(("127.0.0.1", 7400 + 250 * domain + 10))
                return domain
            except OSError:
                continue
    raise AssertionError("no domain is free")


class Peer:
    """A node; `kind` is "cyclone" or "fast"."""

    def __init__(self, kind, domain):
        # Only what it needs of the environment: others' settings of DDS are no part of the test.
        self.process = subprocess.Popen(
            [path_of(kind)], text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            env={"ROS_DOMAIN_ID": str(domain), "CYCLONEDDS_URI": CONFIG, "PATH": os.environ["PATH"]})
        self.lines, self.got = queue.Queue(), {}
        self.thread = threading.Thread(target=self._read, daemon=True)
        self.thread.start()

    def _read(self):
        for line in self.process.stdout:
            self.lines.put(line.rstrip("\n").split(" ", 2))
        self.lines.put(None)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.process.poll() is None:
            self.kill()
        self.process.wait()
        self.thread.join()
        for pipe in (self.process.stdin, self.process.stdout):
            pipe.close()

    def _until(self, found, seconds=SECONDS):
        while (result := found()) is None:
            line = self.lines.get(timeout=seconds)
            assert line is not None, "the node ended"
            kind, topic, *rest = line
            value = rest[0] if rest else ""
            self.got.setdefault((kind, topic), []).append(
                bytes.fromhex(value) if kind == "message" else value)
        return result

    def _send(self, *words):
        self.process.stdin.write(" ".join(words) + "\n")
        self.process.stdin.flush()

    def _make(self, what, topic, kind, reliability, durability):
        self._send(what, topic, kind, reliability, durability)
        return self._until(lambda: self.got.get(("matched", topic), []).pop(0)
                           if self.got.get(("matched", topic)) else None)

    def writer(self, topic, kind, reliability="reliable", durability="volatile"):
        """Publishes a topic. Waits for another side, whose user data are the result."""
        return self._make("writer", topic, kind, reliability, durability)

    def reader(self, topic, kind, reliability="reliable", durability="volatile"):
        return self._make("reader", topic, kind, reliability, durability)

    def write(self, topic, message):
        self._send("write", topic, message.hex())

    def until(self, topic, wanted, seconds=SECONDS):
        """The first message of a topic that is wanted."""
        def found():
            messages = self.got.setdefault(("message", topic), [])
            while messages:
                message = messages.pop(0)
                if wanted(message):
                    return message
            return None
        return self._until(found, seconds)

    def close(self, topic):
        """Publishes a topic no more."""
        self._send("close", topic)
        self._until(lambda: self.got.get(("closed", topic)))

    def end(self):
        self.process.stdin.close()
        assert self.process.wait(SECONDS) == 0

    def kill(self):
        self.process.kill()
        self.process.wait()


def cdr():
    return Cdr(big_endian=False)


def put_header(of, time, frame):
    """@param time s as text, whose decimals all count."""
    seconds, ns = stamp_of(time)
    of.put("i", seconds)
    of.put("I", ns)
    of.text(frame)


class Decoder:
    def __init__(self, message):
        assert message[:2] == b"\0\1"
        self.data, self.at = message[4:], 0

    def take(self, code, count=None):
        size = struct.calcsize("<" + code)
        self.at += -self.at % size if count != 0 else 0
        n = 1 if count is None else count
        values = struct.unpack_from(f"<{n}{code}", self.data, self.at)
        self.at += n * size
        return values[0] if count is None else list(values)

    def text(self):
        size = self.take("I")
        text = self.data[self.at:self.at + size]
        self.at += size
        assert text[-1:] == b"\0"
        return text[:-1].decode()

    def stamp_ns(self):
        return self.take("i") * 10**9 + self.take("I")


def joint_state(time, joints):
    of = cdr()
    put_header(of, time, "")
    of.put("I", len(joints))
    for name in joints:
        of.text(name)
    of.put("I", len(joints))
    of.put("d", *joints.values())
    of.put("I", 0, 0)
    return of.message()


def transforms(*items):
    """@param items (time, parent, child, seven numbers)."""
    of = cdr()
    of.put("I", len(items))
    for time, parent, child, numbers in items:
        put_header(of, time, parent)
        of.text(child)
        of.put("d", *numbers)
    return of.message()


def odometry(time, numbers, frame="odom"):
    of = cdr()
    put_header(of, time, frame)
    of.text("base_link")
    of.put("d", *numbers, *[0.5] * (36 + 6 + 36))
    return of.message()


def pose_stamped(time, numbers, frame="map"):
    of = cdr()
    put_header(of, time, frame)
    of.put("d", *numbers)
    return of.message()


def number(message):
    return Decoder(message).take("d")


def wrench(message):
    """Stamp in ns, frame, six numbers."""
    of = Decoder(message)
    return of.stamp_ns(), of.text(), of.take("d", 6)


def grid_map(message):
    of = Decoder(message)
    grid = {"stamp_ns": of.stamp_ns(), "frame": of.text(), "cell": of.take("d"),
            "length": of.take("d", 2), "pose": of.take("d", 7)}
    for key in ("layers", "basic_layers"):
        grid[key] = [of.text() for _ in range(of.take("I"))]
    assert of.take("I") == 1
    grid["dim"] = [(of.text(), of.take("I"), of.take("I")) for _ in range(of.take("I"))]
    assert of.take("I") == 0
    grid["data"] = of.take("f", of.take("I"))
    grid["starts"] = of.take("H", 2)
    return grid
