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
from live import PROGRAM, Server, passes, scenario
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

    def answer(self, acknowledge):
        """The next, and its number."""
        kind, body = self.read()
        name = text("soilvdb/site/answers/gateway")
        assert kind == 0x32 and body.startswith(name)
        number, content = body[len(name):len(name) + 2], body[len(name) + 2:]
        if acknowledge:
            self._send(0x40, number)
        return content.decode()


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


def node(broker, name="gateway", **more):
    return Node(broker.port, **more).subscribe(f"soilvdb/site/answers/{name}").subscribe("soilvdb/site/link")


def serve(path, address, folder, *more, **options):
    try:
        return Server(path, "--mqtt", address, "--out", folder / "out", *more, cwd=folder, **options)
    except AssertionError as refused:
        if str(refused).endswith(NO_MQTT):
            pytest.skip("built without libmosquitto")
        raise


def until(found):
    end = time.monotonic() + SECONDS
    while not (result := found()):
        assert time.monotonic() < end
        time.sleep(0.02)
    return result


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
        with Node(broker.port, will=("pit/7/feed/a", LOST)) as first, Node(broker.port) as second:
            for of, name in ((first, "a"), (second, "b")):
                of.subscribe(f"pit/7/answers/{name}")
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
        told(server, f"MQTT broker 127.0.0.1 port {broker.port}: ")
        assert "error" not in server.feed(STATES[1:2])[0], "other feeds go on"
        broker.start()
        told(server, "it is there again")
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
        assert "Connection refused; it is tried again and again" in told(server, "warning: MQTT")
        broker.start()
        told(server, "it is there again")
        with node(broker) as feed:
            assert "error" not in feed.feed(STATES[:1])[0]


def test_what_is_no_message_of_now_is_refused(tmp_path, broker):
    with serve(scenario(tmp_path), f"127.0.0.1:{broker.port}", tmp_path) as server, node(broker) as feed:
        feed.feed(STATES[:1])
        before = digest(server)
        line = json.dumps({**STATES[1], "position": [1, 0, -0.4]}) + "\n"
        answer, = feed.feed((line * 600)[:65537].ljust(65537).encode())
        assert answer == {"error": "the message is larger than 64 kB; send fewer lines at once"}
        for content, why in ((b"", "an empty message"), (b'{"link": "live"}', "machine"), (b"[]", "error")):
            answer, = feed.feed(content)
            assert why in json.dumps(answer)
        feed.publish("soilvdb/site/feed", line.encode())   # no name
        feed.publish("soilvdb/site/feed/a/b", line.encode())
        feed.publish("soilvdb/other/feed/gateway", line.encode())
        assert "error" in feed.feed(b"{}")[0] and digest(server) == before


def test_a_retained_message_is_not_of_now(tmp_path, broker):
    with node(broker, "late") as feed:
        feed.publish("soilvdb/site/feed/late", json.dumps(STATES[0]).encode(), retain=True)
        with serve(scenario(tmp_path), f"127.0.0.1:{broker.port}", tmp_path) as server:
            assert feed.answers("late") == [
                {"error": "a retained message is of some time before; publish states without 'retain'"}]
            assert server.json("/summary.json")["updates"] == 0


def test_a_message_has_so_few_lines_that_its_answer_is_short(tmp_path, broker):
    with serve(scenario(tmp_path), f"127.0.0.1:{broker.port}", tmp_path) as server, node(broker) as feed:
        for content, count in ((b"x\n" * 200, 200), (b"\n" * 199 + b"x", 1)):
            assert len(feed.feed(content)) == count
        states = [json.dumps(state) for state in passes("digger", 0.0, 0.3, 201)]
        for content in (b"x\n" * 32000, b"\n" * 200 + b"x", "\n".join(states).encode()):
            assert feed.feed(content) == [{"error": "the message has more than 200 lines; send fewer at once"}]
        assert server.json("/summary.json")["updates"] == 0
        refused = ({"machine": 100 * "\""}, {"machine": 130 * "\u00e9"}, {"machine": "digger", 250 * "x": 1},
                   {**STATES[0], "fix": 80 * "\\"})
        for lines in (states[:200], *(200 * [json.dumps(line, ensure_ascii=False)] for line in refused)):
            feed.publish("soilvdb/site/feed/gateway", "\n".join(lines).encode())
            answer = feed.next("soilvdb/site/answers/gateway")
            assert len(answer.splitlines()) == 200 and len(answer) < 80_000
        assert server.json("/summary.json")["updates"] == 200
        for name in (1000 * "\u00e9", "x" + 1000 * "\u00e9", 60_000 * "x"):
            answer, = feed.feed([json.dumps({"machine": name}, ensure_ascii=False)])
            assert answer["error"].endswith(name[-1] + "...") and 395 < len(answer["error"].encode()) < 405


def test_messages_that_come_faster_than_they_are_answered_are_refused_in_words(tmp_path):
    """Each has its answer, in order."""
    with peer(tmp_path) as (server, broker):
        assert broker.read()[1].endswith(b'{"link":"live"}')
        large = b"x" * 65000
        for content in [b"{}"] * 300 + [large] * 90:
            broker.send(content)
        answers = [broker.answer(acknowledge=False) for _ in range(255)]
        assert server.get("/height?x=0&y=0")[0] == 200
        for i in range(256):   # the first is of the link
            broker._send(0x40, struct.pack(">H", i + 1))
        answers += [broker.answer(acknowledge=True) for _ in range(135)]
        keep_up = [json.loads(answer)["error"].startswith("the site doesn't keep up; send it again, and wait")
                   for answer in answers]
        assert 0 < sum(keep_up) < 60 and keep_up == sorted(keep_up), "what came first is taken"
        broker.send(large)
        assert "keep up" not in broker.answer(acknowledge=True)
        broker.send(json.dumps(STATES[0]).encode())
        assert "error" not in broker.answer(acknowledge=True)


def test_the_goodbye_waits_for_no_acknowledgement(tmp_path):
    with peer(tmp_path) as (server, broker):
        kind, body = broker.read()
        assert (kind, body[-15:]) == (0x33, b'{"link":"live"}')
        for topic in ("a", "soilvdb/site/feed", "soilvdb/site/answers/gateway"):   # what it has not subscribed to
            broker.send(b"[]", topic)
        for _ in range(300):
            broker.send(b"{}")
        first = broker.answer(acknowledge=False)
        assert "machine" in first
        for _ in range(254):
            assert broker.answer(acknowledge=False) == first
        assert server.get("/height?x=0&y=0")[0] == 200
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


def test_names_are_limited(tmp_path, broker):
    with serve(scenario(tmp_path), f"127.0.0.1:{broker.port}", tmp_path) as server, node(broker, "#") as feed:
        assert "error" not in feed.feed(STATES[:1], "0")[0]
        for first in range(0, 1000, 100):   # quickly, or the first are silent
            for i in range(first, first + 100):
                feed._send(0x30, text(f"soilvdb/site/feed/{i}") + b"{}")
            feed.answers(str(first + 99))
        full = [{"error": "too many names feed this site; end some of them"}]
        assert feed.feed(b"{}", "1000") == full
        feed.publish("soilvdb/site/feed/0", LOST.encode())
        assert feed.feed(b"{}", "1000") == full, "a machine belongs to the lost one"
        assert link(server) == "lost"
        feed.publish("soilvdb/site/feed/7", LOST.encode())
        assert "error" not in feed.feed(STATES[1:2], "1000")[0] and link(server) == "live"
        feed.publish("soilvdb/site/feed/8", ENDED.encode())
        assert feed.feed(b"{}", "1001") != full


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
            tried = subprocess.run([PROGRAM, "serve", tmp_path / "site.yaml", "--port", "0", "--mqtt", address, "--out",
                                    tmp_path / "none", *wrong], cwd=tmp_path, capture_output=True, text=True, timeout=60)
            assert tried.returncode == 2 and "tried again" not in tried.stderr, tried.stderr
            assert tried.stderr.endswith("not authorised; give USER@ and a --mqtt-password-file\n")
            assert not (tmp_path / "none").exists()


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


def test_a_broker_that_refuses_ends_the_start(tmp_path):
    with pytest.raises(AssertionError) as refused, peer(tmp_path, code=3):
        pass
    assert re.search(r"soilvdb: MQTT broker 127.0.0.1 port \d+: Connection Refused: broker unavailable\n$",
                     str(refused.value))
    assert "tried again" not in str(refused.value) and not (tmp_path / "out").exists()


def test_a_broker_that_refuses_later_is_tried_again(tmp_path):
    port = free_port()
    with serve(scenario(tmp_path), f"127.0.0.1:{port}", tmp_path) as server:
        told(server, "Connection refused; it is tried again and again")
        with socket.create_server(("127.0.0.1", port)) as listener:
            listener.settimeout(SECONDS)
            with Peer(listener, code=3):
                told(server, "broker unavailable; it is tried again and again")
            with Peer(listener):
                told(server, "it is there again")


def test_a_site_that_may_not_read_its_topic_tells_so(tmp_path):
    """Mosquitto alone never refuses a subscription."""
    with peer(tmp_path, granted=0x80) as (server, _):
        told(server, "this site may not read soilvdb/site/feed/+")


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
