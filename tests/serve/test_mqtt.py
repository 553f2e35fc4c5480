# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Feeds by MQTT, through a broker that others wrote; clients are sockets that share no code with either."""
import concurrent.futures
import contextlib
import json
import os
import re
import shutil
import socket
import ssl
import struct
import subprocess
import textwrap
import threading
import time
from pathlib import Path

import pytest
from live import PROGRAM, Server, passes, scenario, until
from test_machines import digest, machines
from test_posts import BAD, without_time

BROKER = shutil.which("mosquitto", path=os.environ["PATH"] + ":/usr/sbin")
SOIL = "soil: {repose_angle: 0.6, swell: 0.2}\noutput: {journal: {sync: always}}\n"
STATES = list(passes("digger", 0.0, 0.3, 60))
LOST, ENDED = '{"link": "lost"}', '{"link": "ended"}'
SECONDS = 30
GUIDE = Path(__file__).parents[2] / "tools/guide/live.md"
NO_MQTT = "soilvdb: --mqtt: this build has no MQTT: install libmosquitto-dev, and then build soilvdb again\n"


def text(words):
    data = words if isinstance(words, bytes) else words.encode()
    return struct.pack(">H", len(data)) + data


class Node:
    """A client of MQTT 3.1.1."""

    def __init__(self, port, will=None, user=None, context=None):
        self.socket = socket.create_connection(("127.0.0.1", port), SECONDS)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if context:
            self.socket = context.wrap_socket(self.socket, server_hostname="127.0.0.1")
        self.stream, self.number, self.got, self.acknowledged = self.socket.makefile("rb"), 0, {}, set()
        flags, body = 2, text("")
        if will:
            flags |= 4 | 1 << 3
            body += text(will[0]) + text(will[1])
        if user:
            flags |= 128 | 64
            body += text(user[0]) + text(user[1])
        self._send(0x10, text("MQTT") + bytes([4, flags]) + struct.pack(">H", 60) + body)
        kind, said = self._packet()
        assert (kind, said) == (0x20, b"\0\0"), "the broker takes it"

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.cut()

    def cut(self):
        with contextlib.suppress(OSError):
            self.socket.shutdown(socket.SHUT_RDWR)
        self.socket.close()

    def _send(self, kind, body):
        size, head = len(body), b""
        while True:
            head += bytes([size % 128 | (128 if size > 127 else 0)])
            size //= 128
            if not size:
                break
        self.socket.sendall(bytes([kind]) + head + body)

    def _packet(self):
        kind, size, shift = self.stream.read(1)[0], 0, 0
        while True:
            byte, = self.stream.read(1)
            size |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return kind, self.stream.read(size)

    def _until(self, found):
        while (result := found()) is None:
            kind, body = self._packet()
            if kind & 0xf0 == 0x30:
                size, = struct.unpack_from(">H", body)
                topic, rest = body[2:2 + size].decode(), body[2 + size:]
                if kind & 6:
                    self._send(0x40, rest[:2])
                    rest = rest[2:]
                self.got.setdefault(topic, []).append(rest)
            else:   # a publication or subscription is acknowledged
                self.acknowledged.add(*struct.unpack_from(">H", body))
        return result

    def _acknowledge(self, number):
        self._until(lambda: number in self.acknowledged or None)

    def subscribe(self, topic):
        self.number += 1
        self._send(0x82, struct.pack(">H", self.number) + text(topic) + b"\1")
        self._acknowledge(self.number)
        return self

    def publish(self, topic, content, retain=False, again=False):
        """At least once; returns when the broker has it."""
        self.number += not again
        self._send(0x32 | retain | again << 3, text(topic) + struct.pack(">H", self.number) + content)
        self._acknowledge(self.number)

    def next(self, topic):
        return self._until(lambda: self.got[topic].pop(0) if self.got.get(topic) else None)

    def feed(self, lines, name="gateway", site="soilvdb/site"):
        """Publishes lines as one message; the answers."""
        if not isinstance(lines, bytes):
            lines = "\n".join(line if isinstance(line, str) else json.dumps(line) for line in lines).encode()
        self.publish(f"{site}/feed/{name}", lines)
        return self.answers(name, site)

    def answers(self, name="gateway", site="soilvdb/site"):
        return [json.loads(line) for line in self.next(f"{site}/answers/{name}").decode().splitlines()]


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as of:
        return of.getsockname()[1]


class Broker:
    def __init__(self, folder, *lines):
        if not BROKER:
            pytest.skip("there is no mosquitto")
        self.port = free_port()
        self.config = folder / "mosquitto.conf"
        self.config.write_text("\n".join(["user root", "persistence false", "set_tcp_nodelay true",
                                          f"listener {self.port} 127.0.0.1",
                                          *(lines or ["allow_anonymous true"])]) + "\n")
        self.start()

    def start(self):
        self.process = subprocess.Popen([BROKER, "-c", self.config], stdout=subprocess.DEVNULL,
                                        stderr=subprocess.DEVNULL)
        end = time.monotonic() + SECONDS
        while True:
            try:
                return socket.create_connection(("127.0.0.1", self.port), 1).close()
            except OSError:
                assert time.monotonic() < end and self.process.poll() is None
                time.sleep(0.02)

    def kill(self):
        self.process.kill()
        self.process.wait()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.kill()


class Peer(Node):
    """A broker of one client that does what a test wants; mosquitto acknowledges all."""

    def __init__(self, listener, code=0, granted=1):
        self.socket = listener.accept()[0]
        self.socket.settimeout(SECONDS)
        self.stream = self.socket.makefile("rb")
        assert self.read()[0] == 0x10
        self._send(0x20, bytes([0, code]))
        if code == 0:
            kind, asked = self.read()
            assert kind == 0x82
            self._send(0x90, asked[:2] + bytes([granted]))

    def read(self):
        while (packet := self._packet())[0] == 0xc0:   # is somebody there?
            self._send(0xd0, b"")
        return packet

    def send(self, content, topic="soilvdb/site/feed/gateway"):
        self._send(0x30, text(topic) + content)

    def answer(self):
        name = text("soilvdb/site/answers/gateway")
        kind, body = self.read()
        assert kind == 0x30 and body.startswith(name)
        return body[len(name):].decode()


def lasting_peer(listener):
    """Not one that the site gave up meanwhile."""
    while True:
        with contextlib.suppress(IndexError, ConnectionError):
            return Peer(listener)


@contextlib.contextmanager
def peer(folder, **options):
    """A site, and its broker."""
    with socket.create_server(("127.0.0.1", 0)) as listener, concurrent.futures.ThreadPoolExecutor(1) as thread:
        listener.settimeout(SECONDS)
        came = thread.submit(Peer, listener, **options)
        try:
            with serve(scenario(folder), f"127.0.0.1:{listener.getsockname()[1]}", folder) as server, \
                    came.result(SECONDS) as broker:
                yield server, broker
        finally:
            listener.shutdown(socket.SHUT_RDWR)   # or its thread waits, where no site came


@pytest.fixture
def broker(tmp_path):
    with Broker(tmp_path) as of:
        yield of


def node(broker, site="soilvdb/site", name="gateway", **more):
    """A client, once the site is there: a broker keeps messages for nobody who comes later."""
    client = Node(broker.port, **more).subscribe(f"{site}/answers/{name}").subscribe(f"{site}/link")
    client._until(lambda: b'{"link":"live"}' in client.got.get(f"{site}/link", []) or None)
    return client


def serve(path, address, folder, *more, **options):
    try:
        return Server(path, "--mqtt", address, "--out", folder / "out", *more, cwd=folder, **options)
    except AssertionError as refused:
        if str(refused).endswith(NO_MQTT):
            pytest.skip("built without libmosquitto")
        raise


def told(server, words):
    """The next line on standard error that has these words."""
    while words not in (line := server.process.stderr.readline()):
        assert line, words
    return line


def link(server, name="digger"):
    return machines(server)[name]["link"]


def test_messages_dig_as_posts_do_and_are_kept(tmp_path, broker):
    path = scenario(tmp_path, SOIL)
    parts = [STATES[:20], [BAD[2], *passes("plate", 3.0, 0.2, 20)], STATES[20:50], [STATES[50]], STATES[51:],
             [{"machine": "digger", "clock": "reset"}, {**STATES[0], "sequence": 5}], [BAD[8]], [" "],
             b"\xff\0{", b"{}\n\n[]\r\n"]
    with Server(path, "--out", tmp_path / "posts", cwd=tmp_path) as server:
        wanted = [server.post("/feed", part)[1] for part in parts]
        dug = digest(server)
    with serve(path, f"127.0.0.1:{broker.port}", tmp_path) as server, node(broker) as feed:
        assert feed.next("soilvdb/site/link") == b'{"link":"live"}'
        for part, answers in zip(parts, wanted):
            assert without_time(feed.feed(part)) == without_time(answers)
        assert digest(server) == dug
        now = machines(server)["digger"]
        assert (now["link"], now["owner"]) == ("live", "MQTT topic soilvdb/site/feed/gateway")
        # The broker may bring a message twice, and who lost the answer asks again.
        number = {**STATES[1], "sequence": 6}
        first, = feed.feed([number])
        for again in (True, False):
            feed.publish("soilvdb/site/feed/gateway", json.dumps(number).encode(), again=again)
            assert feed.answers() == [{**first, "repeated": True}]
        dug = digest(server)
        assert "whoever it lets publish below soilvdb/site/feed may feed" in told(server, "MQTT")
        said = server.stop()
        assert f"--mqtt 127.0.0.1:{broker.port}" in said, "how to go on"
        assert feed.next("soilvdb/site/link") == b'{"link":"ended"}'
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        assert digest(server) == dug


def test_a_machine_belongs_to_its_topic(tmp_path, broker):
    with serve(scenario(tmp_path), f"127.0.0.1:{broker.port}/pit/7", tmp_path) as server:
        with node(broker, "pit/7", "a", will=("pit/7/feed/a", LOST)) as first, \
                node(broker, "pit/7", "b") as second:
            assert "error" not in first.feed(STATES[:1], "a", "pit/7")[0]
            before = digest(server)
            for refused in (second.feed(STATES[1:2], "b", "pit/7"), server.feed(STATES[1:2])):
                assert "machine 'digger' is fed by MQTT topic pit/7/feed/a, heard" in refused[0]["error"]
            assert digest(server) == before
            first.cut()   # so the broker publishes its last will
            until(lambda: link(server) != "live")
            assert link(server) == "lost"
            assert ("feed_lost", "digger") in {(a["kind"], a["machine"]) for a in server.json("/alarms")}
            assert "error" not in second.feed(STATES[1:2], "b", "pit/7")[0], "another takes over"
            assert link(server) == "live"
            second.publish("pit/7/feed/b", ENDED.encode())
            until(lambda: link(server) == "none")
            assert "error" not in server.feed(STATES[2:3])[0]
            assert "error" not in second.feed(STATES[3:4], "b", "pit/7")[0], "it may come again"
            begin = time.monotonic()   # and then falls silent
            until(lambda: link(server) == "lost")
            assert 3 < time.monotonic() - begin < 6
            assert "error" not in second.feed(STATES[4:5], "b", "pit/7")[0] and link(server) == "live"
            assert not second.got.get("pit/7/answers/a"), "answers are of each name alone"


def test_a_broker_that_goes_and_comes_again(tmp_path, broker):
    with serve(scenario(tmp_path), f"127.0.0.1:{broker.port}", tmp_path) as server:
        with node(broker) as feed:
            assert "error" not in feed.feed(STATES[:1])[0]
        broker.kill()
        until(lambda: link(server) == "lost")
        assert machines(server)["digger"]["heard_s_ago"] < 3.8, "nobody waits for silence"
        told(server, f"MQTT broker 127.0.0.1 port {broker.port} is tried again and again: The connection was lost")
        assert "error" not in server.feed(STATES[1:2])[0], "other feeds go on"
        broker.start()
        told(server, f"port {broker.port} is there again")
        with node(broker) as feed:
            assert "error" not in feed.feed(STATES[2:3])[0] and link(server) == "live"
            feed.subscribe("soilvdb/site/link")
            server.kill()
            seen = []
            while seen[-1:] != [b'{"link":"lost"}']:   # the site's own last will
                seen.append(feed.next("soilvdb/site/link"))


def test_a_broker_may_come_after_the_site(tmp_path, broker):
    broker.kill()
    with serve(scenario(tmp_path), f"mqtt://127.0.0.1:{broker.port}", tmp_path) as server:
        assert "is tried again and again: Connection refused" in told(server, "warning: MQTT")
        broker.start()
        told(server, "is there again")
        with node(broker) as feed:
            assert "error" not in feed.feed(STATES[:1])[0]


def test_what_is_no_message_of_now_is_refused(tmp_path, broker):
    with serve(scenario(tmp_path), f"127.0.0.1:{broker.port}", tmp_path) as server, node(broker) as feed:
        feed.feed(STATES[:1])
        before = digest(server)
        line = json.dumps({**STATES[1], "position": [1, 0, -0.4]}) + "\n"
        for size in (65537, 5 << 20):   # the larger is more than all that may wait
            answer, = feed.feed((line * 600)[:65537].ljust(size).encode())
            assert answer == {"error": "the message is larger than 64 kB; send fewer lines at once"}
        for content, why in ((b"", "an empty message"), (b'{"link": "live"}', "machine"), (b"[]", "error")):
            answer, = feed.feed(content)
            assert why in json.dumps(answer)
        feed.publish("soilvdb/site/feed", line.encode())   # no name
        feed.publish("soilvdb/site/feed/a/b", line.encode())
        feed.publish("soilvdb/other/feed/gateway", line.encode())
        assert "error" in feed.feed(b"{}")[0] and digest(server) == before


def test_a_retained_message_is_not_of_now(tmp_path, broker):
    with Node(broker.port).subscribe("soilvdb/site/answers/late").subscribe("soilvdb/site/link") as feed:
        feed.publish("soilvdb/site/feed/late", json.dumps(STATES[0]).encode(), retain=True)
        with serve(scenario(tmp_path), f"127.0.0.1:{broker.port}", tmp_path) as server:
            assert feed.next("soilvdb/site/link") == b'{"link":"live"}'
            assert "error" not in feed.feed(STATES[1:2], "late")[0]
            assert server.json("/summary.json")["updates"] == 1


def test_answers_are_below_128_kB(tmp_path, broker):
    """Some brokers end the connection otherwise."""
    with serve(scenario(tmp_path, SOIL), f"127.0.0.1:{broker.port}", tmp_path) as server, node(broker) as feed:
        long = [{"error": "it was fed, but its answers exceed 128 kB; send fewer lines at once"}]
        feed.publish("soilvdb/site/feed/gateway", b"x")
        most = ((128 << 10) + 1) // (len(feed.next("soilvdb/site/answers/gateway")) + 1)
        assert len(feed.feed(b"x\n" * most)) == most
        assert feed.feed(b"x\n" * (most + 1)) == long
        state = json.dumps({"machine": "digger", "position": [0, 0, -0.1], "rotation": [0, 0, 0, 1], "force": True})
        assert feed.feed([state] * 600) == long
        assert server.json("/summary.json")["updates"] == 600


def test_messages_that_come_faster_than_they_are_fed_are_told_and_lost(tmp_path):
    """Those that are taken have their answers, in order."""
    with peer(tmp_path) as (server, broker):
        assert broker.read()[1].endswith(b'{"link":"live"}')
        for i in range(2000):   # 64 kB a time, whose answers nobody reads
            broker.send(b'{"machine": "%d"}' % i + b"\nx" * 1000 + b" " * 60000)
        assert "brings messages faster than they can be fed; some are lost" in told(server, "warning: MQTT")
        assert server.get("/height?x=0&y=0")[0] == 200
        seen = [int(re.match(r'{"error":".*\'(\d+)\'', broker.answer())[1])]
        while seen[-1] < 60:
            seen.append(int(re.match(r'{"error":".*\'(\d+)\'', broker.answer())[1]))
        assert seen == list(range(61)), "what came first is taken"
        broker.send(b"last" + b" " * 60000)
        while "last" not in (answer := broker.answer()):
            assert answer.count("error") == 1001
        broker.send(json.dumps(STATES[0]).encode())
        assert "error" not in broker.answer()


def test_an_answer_for_which_a_broker_ends_the_connection_is_not_sent_again(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(SECONDS)
        port = listener.getsockname()[1]
        with serve(scenario(tmp_path), f"127.0.0.1:{port}", tmp_path) as server:
            for i in range(3):
                with Peer(listener) as broker:
                    assert broker.read()[1].endswith(b'{"link":"live"}'), "and no answer of before"
                    for state in STATES[10 * i:10 * i + 10]:
                        broker.send(json.dumps(state).encode())
                    assert "cut_m3" in broker.answer()
                    until(lambda done=10 * (i + 1): server.json("/summary.json")["updates"] == done)
            with Peer(listener) as broker:
                assert broker.read()[1].endswith(b'{"link":"live"}')
                said = [told(server, "MQTT broker 127.0.0.1") for _ in range(2)]
                assert said[0].endswith("is tried again and again: The connection was lost; "
                                        "if it is after long answers, send fewer lines at once\n")
                assert said[1].endswith(f"port {port} is there again\n"), "and nothing in between"
                assert server.json("/summary.json")["updates"] == 30


def test_a_link_stays_lost_while_messages_wait_and_the_broker_is_gone(tmp_path):
    count = 1000
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(SECONDS)
        address = listener.getsockname()
        with serve(scenario(tmp_path, SOIL), f"127.0.0.1:{address[1]}", tmp_path) as server:
            with Peer(listener) as broker:
                listener.close()
                for state in passes("digger", 0.0, 0.3, count):
                    broker.send(json.dumps(state).encode())
                broker._send(0x32, text("soilvdb/site/feed/gateway") + b"\0\1{}")
                while broker.read()[0] != 0x40:   # the site has them all
                    pass
            told(server, "is tried again and again")
            until(lambda: link(server) == "lost")
            with socket.create_server(address) as listener:   # which answers nothing yet
                listener.settimeout(SECONDS)
                links, updates = set(), server.json("/summary.json")["updates"]
                assert updates < count, "they wait"
                while updates < count:
                    links.add(link(server))
                    updates = server.json("/summary.json")["updates"]
                assert links == {"lost"}
                with lasting_peer(listener) as broker:
                    assert broker.read()[1].endswith(b'{"link":"live"}')
                    broker.send(json.dumps({**STATES[0], "time": 1000}).encode())
                    assert "error" not in broker.answer() and link(server) == "live"


def test_the_goodbye_waits_for_nothing(tmp_path):
    with peer(tmp_path) as (server, broker):
        assert broker.read() == (0x31, text("soilvdb/site/link") + b'{"link":"live"}')
        for topic in ("a", "soilvdb/site/feed", "soilvdb/site/answers/gateway"):   # what it has not subscribed to
            broker.send(b"[]", topic)
        for _ in range(300):
            broker.send(b"{}")
        for _ in range(300):
            assert "machine" in broker.answer()
        server.stop()
        assert broker.read() == (0x31, text("soilvdb/site/link") + b'{"link":"ended"}')
        assert broker.read() == (0xe0, b"")


def test_states_wait_while_others_are_taken_back(tmp_path, broker):
    states = list(passes("digger", 0.0, 0.3, 400))
    with serve(scenario(tmp_path, SOIL), f"127.0.0.1:{broker.port}", tmp_path) as server, node(broker) as feed:
        assert not any("error" in answer for answer in feed.feed(passes("plate", 3.0, 0.2, 30)))
        assert not any("error" in answer for answer in feed.feed(states[:200]))
        undo = threading.Thread(target=server.post, args=["/undo?machine=plate&time=-1"])
        undo.start()
        for state in states[200:]:
            assert "error" not in feed.feed([state])[0]
        undo.join()
        assert server.json("/summary.json")["updates"] == 400, "none is lost"
        dug = digest(server)
    with Server(scenario(tmp_path, SOIL), "--out", tmp_path / "alone", cwd=tmp_path) as server:
        server.feed(states)
        assert digest(server) == dug


def test_made_up_names_take_no_memory(tmp_path, broker):
    with serve(scenario(tmp_path), f"127.0.0.1:{broker.port}", tmp_path) as server, node(broker) as feed:
        assert "error" not in feed.feed(STATES[:1])[0]
        def publish(names):
            for i in names:
                feed._send(0x30, text(f"soilvdb/site/feed/{i}" + "x" * 60000) + b"{}")
                if i % 20 == 0:   # before too many wait
                    feed.feed(b"{}")
        publish(range(100))
        before = server.rss_kb()
        publish(range(100, 700))
        assert server.rss_kb() - before < 18_000, "of 36 MB"
        assert link(server) == "live", "the machine's is kept"


def secured(folder, *more):
    (folder / "users").write_text("")
    for user, password in (("site", "s3cret word"), ("digger", "d1g")):
        subprocess.run([shutil.which("mosquitto_passwd"), "-b", folder / "users", user, password], check=True,
                       capture_output=True)
    return Broker(folder, "allow_anonymous false", f"password_file {folder / 'users'}", *more)


def test_passwords_come_from_a_file_or_the_environment_and_are_shown_nowhere(tmp_path):
    (tmp_path / "password").write_text("s3cret word\n")
    (tmp_path / "wrong").write_text("d1g")
    with secured(tmp_path) as broker:
        address = f"site@127.0.0.1:{broker.port}"
        idle = {"machine": "plate", "position": [0, 0, 2], "rotation": [0, 0, 0, 1]}
        for more, env in ((("--mqtt-password-file", "password"), {}),
                          ((), {"SOILVDB_MQTT_PASSWORD": "s3cret word"})):
            with serve(scenario(tmp_path), address, tmp_path, *more, env=env) as server, \
                    node(broker, user=("digger", "d1g")) as feed:
                assert "error" not in feed.feed([idle])[0]
                with open(f"/proc/{server.process.pid}/cmdline", "rb") as arguments:
                    assert b"s3cret" not in arguments.read()
                said = server.stop()
                assert "s3cret" not in said and ("--mqtt-password-file password" in said) == bool(more)
        for wrong in (("--mqtt-password-file", "wrong"), ()):
            with serve(scenario(tmp_path), address, tmp_path, *wrong) as server:
                assert told(server, "warning: MQTT").endswith(
                    "again: Connection Refused: not authorised. Are USER@ and the --mqtt-password-file right?\n")


def test_the_access_list_of_the_guide(tmp_path):
    """The site has what it needs, and each user a feed of its name."""
    listed = re.search(r"^    user site\n(    .+\n)+", GUIDE.read_text(encoding="utf-8"), re.M).group()
    (tmp_path / "access").write_text(textwrap.dedent(listed))
    with secured(tmp_path, f"acl_file {tmp_path / 'access'}") as broker:
        with serve(scenario(tmp_path), f"site@127.0.0.1:{broker.port}/soilvdb/live", tmp_path,
                   env={"SOILVDB_MQTT_PASSWORD": "s3cret word"}) as server, \
                Node(broker.port, user=("digger", "d1g")) as feed:
            feed.subscribe("soilvdb/live/answers/digger").subscribe("soilvdb/live/link")
            assert feed.next("soilvdb/live/link") == b'{"link":"live"}'
            feed.publish("soilvdb/live/feed/plate", json.dumps(STATES[0]).encode())
            assert "error" not in feed.feed(STATES[1:2], "digger", "soilvdb/live")[0]
            assert server.json("/summary.json")["updates"] == 1
            server.stop()
            assert feed.next("soilvdb/live/link") == b'{"link":"ended"}'


def test_a_broker_that_refuses_is_tried_again(tmp_path):
    port = free_port()
    with serve(scenario(tmp_path), f"127.0.0.1:{port}", tmp_path) as server:
        told(server, "is tried again and again: Connection refused")
        with socket.create_server(("127.0.0.1", port)) as listener:
            listener.settimeout(SECONDS)
            for _ in range(2):
                with Peer(listener, code=3):
                    pass
            with Peer(listener):
                assert "again: Connection Refused: broker unavailable.\n" in told(server, "warning: MQTT")
                assert "is there again" in told(server, "MQTT")
        told(server, "is tried again and again: Connection refused")   # and no reason of before


def test_a_site_that_may_not_read_its_topic_tells_so(tmp_path):
    """Mosquitto alone never refuses a subscription."""
    with peer(tmp_path, granted=0x80) as (server, _):
        told(server, "does not let this site read soilvdb/site/feed/+")


def certificates(folder, names):
    def run(*arguments):
        subprocess.run(["openssl", *arguments], cwd=folder, check=True, capture_output=True)
    for name in ("ca", "other"):
        run("req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", f"/CN={name}", "-keyout",
            f"{name}.key", "-out", f"{name}.pem")
    run("req", "-newkey", "rsa:2048", "-nodes", "-subj", "/CN=broker", "-keyout", "broker.key", "-out", "broker.csr")
    (folder / "names").write_text(f"subjectAltName={names}\n")
    run("x509", "-req", "-in", "broker.csr", "-CA", "ca.pem", "-CAkey", "ca.key", "-CAcreateserial", "-days", "2",
        "-extfile", "names", "-out", "broker.pem")


@pytest.mark.parametrize("ca, names, why", [
    ("ca.pem", "IP:127.0.0.1", None), ("other.pem", "IP:127.0.0.1", "certificate verify failed"),
    ("ca.pem", "DNS:localhost", "certificate verify failed")], ids=["known", "unknown", "another name"])
def test_tls_holds_only_with_whom_the_certificate_names(tmp_path, ca, names, why):
    certificates(tmp_path, names)
    with Broker(tmp_path, "allow_anonymous true", *(f"{key} {tmp_path / file}" for key, file in (
            ("cafile", "ca.pem"), ("certfile", "broker.pem"), ("keyfile", "broker.key")))) as broker:
        with serve(scenario(tmp_path), f"mqtts://127.0.0.1:{broker.port}", tmp_path,
                   env={"SSL_CERT_FILE": str(tmp_path / ca)}) as server:
            if why:
                assert why in told(server, "warning: MQTT")
                return
            context = ssl.create_default_context(cafile=str(tmp_path / "ca.pem"))
            with node(broker, context=context) as feed:
                assert "error" not in feed.feed(STATES[:1])[0]
            assert " by TLS; whoever" in told(server, "MQTT")


@pytest.mark.parametrize("arguments, env, why", [
    (["--mqtt", "me:s3cret@host"], {}, "--mqtt host must be a HOST, or of the form mqtts://USER@HOST:PORT/TOPIC"),
    (["--mqtt", "http://host"], {}, "must be a HOST, or of the form"),
    (["--mqtt", "host/a/#"], {}, "TOPIC has no + or #"), (["--mqtt", "host:"], {}, "must be a HOST"),
    (["--mqtt", "host:99999"], {}, "the port is 99999; it must be 1 to 65535"),
    (["--mqtt", ""], {}, "must be a HOST"),
    (["--mqtt", "host/\udcff"], {}, "its topic must be UTF-8 without control characters; give another, HOST/TOPIC"),
    (["--mqtt", "host/a\tb"], {}, "its topic must be UTF-8"),
    (["--mqtt", "host"], {"SOILVDB_MQTT_PASSWORD": "s3cret"}, "has a password, but of whom? Write USER@"),
    (["--mqtt", "me@host", "--mqtt-password-file", "none"], {}, "none"),
    (["--mqtt", "me@host", "--mqtt-password-file", "empty"], {}, "empty: is empty"),
    (["--mqtt-password-file", "empty"], {}, "--mqtt-password-file needs --mqtt"),
])
def test_what_cannot_work_is_refused_before_anything_is_written(tmp_path, arguments, env, why):
    (tmp_path / "empty").write_text("\n")
    tried = subprocess.run([PROGRAM, "serve", scenario(tmp_path), "--port", "0", "--out", tmp_path / "out", *arguments],
                           cwd=tmp_path, text=True, capture_output=True, timeout=60, env={**os.environ, **env})
    said = [line for line in tried.stderr.splitlines() if "the page isn't built" not in line]
    assert tried.returncode == 2 and len(said) == 1 and why in said[0] and "s3cret" not in said[0], tried.stderr
    assert not (tmp_path / "out").exists()


def test_a_build_without_mqtt_tells_how_to_get_it(tmp_path):
    try:
        with Server(scenario(tmp_path), "--mqtt", f"127.0.0.1:{free_port()}", "--out", tmp_path / "out", cwd=tmp_path):
            pytest.skip("built with libmosquitto")
    except AssertionError as refused:
        assert str(refused).endswith(NO_MQTT)
    assert not (tmp_path / "out").exists()


def test_the_program_starts_without_libmosquitto():
    linked = subprocess.run(["ldd", PROGRAM], text=True, capture_output=True, check=True).stdout
    assert "libc.so" in linked and "mosquitto" not in linked
