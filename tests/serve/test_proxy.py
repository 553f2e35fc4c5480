# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""A site behind a proxy: what is refused says what to set, and the guide's nginx works as it stands."""
import asyncio
import contextlib
import getpass
import os
import re
import shutil
import socket
import subprocess
from pathlib import Path

import pytest
from live import PROGRAM, Client, Server, passes, scenario, view, whole

GUIDE = (Path(__file__).parents[2] / "tools/guide/live.md").read_text()
NGINX = shutil.which("nginx", path=os.environ["PATH"] + ":/usr/sbin")
NAME = "site.example.com"


def ask(server, target, host, origin=None, upgrade=False):
    """Status and body of a request with such headers, whatever the address is."""
    lines = [f"GET {target} HTTP/1.1", f"Host: {host}", *([f"Origin: {origin}"] if origin is not None else [])]
    lines += ["Connection: Upgrade", "Upgrade: websocket", "Sec-WebSocket-Version: 13",
              "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA=="] if upgrade else ["Connection: close"]
    port = int(server.url.split(":")[2].split("/")[0])
    with socket.create_connection(("127.0.0.1", port), 30) as client:
        client.sendall(("\r\n".join(lines) + "\r\n\r\n").encode())
        stream = client.makefile("rb")
        status, length = int(stream.readline().split()[1]), 0
        while (line := stream.readline().strip()):
            name, _, value = line.partition(b":")
            length = int(value) if name.lower() == b"content-length" else length
        return status, stream.read(length).decode()


def test_a_page_is_of_its_own_host_whatever_way_a_proxy_writes_it(tmp_path):
    same = [(NAME, f"https://{NAME}"), (NAME, f"http://{NAME}"), (f"{NAME}:443", f"https://{NAME}"),
            (f"{NAME}:80", f"http://{NAME}"), (NAME, f"https://{NAME}:443"),
            (f"{NAME}:8443", f"https://{NAME}:8443"), ("Site.Example.COM:443", f"https://{NAME}"),
            ("[::1]", "http://[::1]"), ("[::1]:443", "https://[::1]")]
    other = [(f"{NAME}:80", f"https://{NAME}"), (f"{NAME}:443", f"http://{NAME}"),
             (f"{NAME}:8443", f"https://{NAME}"), (NAME, f"https://{NAME}:8443"),
             (NAME, "https://example.com"), (NAME, f"https://{NAME}.evil.example"), (NAME, "null"),
             (NAME, f"ftp://{NAME}"), (NAME, NAME), (NAME, ""), (f"{NAME}:443", f"https://{NAME}:80:443")]
    with Server(scenario(tmp_path), "--out", tmp_path / "out", "--token", "abc", cwd=tmp_path) as server:
        for stream in ("/view", "/feed"):
            for host, origin in same:
                assert ask(server, stream + "?token=abc", host, origin, True)[0] == 101, (host, origin)
                assert ask(server, stream, host, origin, True)[0] == 401, "the token is asked for"
            for host, origin in other:
                status, body = ask(server, stream + "?token=abc", host, origin, True)
                assert (status, "pages from elsewhere" in body) == (403, True), (host, origin)


def test_a_proxy_is_told_what_to_pass_on_and_that_it_takes_a_token(tmp_path):
    with Server(scenario(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        local = server.url.split("/")[2]
        # nginx without the header: the page comes, its stream doesn't.
        for origin in (None, f"https://{NAME}"):  # as browsers send it for a page's scripts
            assert ask(server, "/", local, origin)[0] == 200, "the page says why it has no more"
        status, body = ask(server, "/view", local, f"https://{NAME}", True)
        assert status == 403 and "have the proxy pass the Host header on" in body and "--token" in body
        assert f"https://{NAME}" in body and local in body
        # With it, without a token.
        for target, upgrade in (("/", False), ("/view", True)):
            status, body = ask(server, target, NAME, f"https://{NAME}", upgrade)
            assert status == 403 and "give --token-file" in body and NAME in body
            assert "proxy_set_header" not in body
    with Server(scenario(tmp_path), "--out", tmp_path / "out", "--token", "abc", cwd=tmp_path) as server:
        status, body = ask(server, "/view?token=abc", server.url.split("/")[2], f"https://{NAME}", True)
        assert status == 403 and "proxy_set_header Host" in body and "--token" not in body


def test_a_site_below_a_path_is_there_and_at_the_root(tmp_path):
    with Server(scenario(tmp_path), "--out", tmp_path / "out", "--base-path", "/a/dig",
                cwd=tmp_path) as server:
        assert server.url.endswith("/a/dig/")
        assert "error" not in server.feed([next(passes("digger", 0.0, 0.3, 60))])[0]
        for path in ("", "/view.css", "/height?x=0&y=0", "/summary.json"):
            assert server.get(path)[0] == 200, path
        host = server.url.split("/")[2]
        for target, status in (("/height?x=0&y=0", 200), ("/", 200), ("/a/dig", 301), ("/a/dig?x=1", 301),
                               ("/a/digger", 404), ("/a/dig/a/dig/height?x=0&y=0", 404), ("/a", 404)):
            assert ask(server, target, host)[0] == status, target
    for written in ("dig", "/dig/", "dig/"):
        with Server(scenario(tmp_path), "--out", tmp_path / "out", "--base-path", written,
                    cwd=tmp_path) as server:
            assert server.url.endswith("/dig/")
    for bad in ("https://x/dig", "/a//b", "/a?b", "/a b"):
        done = subprocess.run([PROGRAM, "serve", scenario(tmp_path), "--base-path", bad, "--out", "no"],
                              cwd=tmp_path, capture_output=True, text=True, timeout=60)
        assert done.returncode == 2 and "must be a path such as /dig" in done.stderr
        assert not (tmp_path / "no").exists()


def guide(language):
    return re.findall(rf"```{language}\n(.*?)```", GUIDE, re.DOTALL)


@contextlib.contextmanager
def nginx(folder, config, server):
    """nginx with a configuration of the guide's; its port. It takes over a socket that listens."""
    certificate, key = folder / "certificate.pem", folder / "key.pem"
    subprocess.run(["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1",
                    "-nodes", "-days", "2", "-subj", f"/CN={NAME}", "-addext", f"subjectAltName=DNS:{NAME}",
                    "-keyout", key, "-out", certificate], check=True, capture_output=True)
    with socket.create_server(("127.0.0.1", 0)) as listening:
        port = listening.getsockname()[1]
        for said, here in ((r"listen 443 ssl", f"listen 127.0.0.1:{port} ssl"),
                           (r"/etc/ssl/\S*/fullchain.pem", str(certificate)),
                           (r"/etc/ssl/\S*/privkey.pem", str(key)),
                           (r"127\.0\.0\.1:8470", server.url.split("/")[2])):
            config, count = re.subn(said, here, config)
            assert count >= 1, said
        places = "".join(f"{what}_temp_path {folder}/{what};\n"
                         for what in ("client_body", "proxy", "fastcgi", "uwsgi", "scgi"))
        (folder / "nginx.conf").write_text(
            f"daemon off;\nworker_processes 1;\nuser {getpass.getuser()};\npid {folder}/pid;\nevents {{}}\n"
            f"http {{\n{places}{config}\n}}\n")
        with open(folder / "nginx.log", "w") as log:
            process = subprocess.Popen(
                [NGINX, "-p", folder, "-e", "stderr", "-c", folder / "nginx.conf"], stderr=log,
                pass_fds=[listening.fileno()], env={**os.environ, "NGINX": f"{listening.fileno()};"})
    try:
        yield port, certificate
    finally:
        process.terminate()
        process.wait(30)
        said = (folder / "nginx.log").read_text()
    assert "[emerg]" not in said and "[error]" not in said, said


ROOT, BELOW = guide("nginx")
TAKEN_OFF = re.sub(r" *location / {.*?}\n", lambda _: BELOW, ROOT, flags=re.DOTALL)
WAYS = {"root": ("/", ROOT, []), "path, taken off": ("/dig/", TAKEN_OFF, []),
        "path, left on": ("/dig/", TAKEN_OFF.replace("8470/;", "8470;"), ["--base-path", "/dig"])}


@pytest.mark.skipif(not NGINX and not os.environ.get("CI"),
                    reason="nginx isn't installed; tools/install_packages nginx-light")
@pytest.mark.parametrize("way", WAYS)
def test_the_nginx_of_the_guide_passes_pages_feeds_views_and_files(tmp_path, monkeypatch, way):
    assert NGINX, "nginx isn't installed, and must be here"
    path, config, options = WAYS[way]
    assert f"location {path} {{" in config
    resolve = socket.getaddrinfo
    monkeypatch.setattr(socket, "getaddrinfo", lambda host, *rest, **more: resolve(
        "127.0.0.1" if host == NAME else host, *rest, **more))
    with Server(scenario(tmp_path), "--out", tmp_path / "out", "--token", "abc", *options,
                cwd=tmp_path) as server, nginx(tmp_path, config, server) as (port, certificate):
        monkeypatch.setenv("SSL_CERT_FILE", str(certificate))
        origin = f"https://{NAME}:{port}"
        site = Client(origin + path)
        status, page = site.get("/")
        assert status == 200 and b"<title>soilvdb</title>" in page
        states = list(passes("digger", 0.0, 0.3, 60))
        answers = site.feed(states, "/feed?token=abc")
        assert not [answer for answer in answers if "error" in answer]
        texts, blocks = asyncio.run(view(site, whole(), path="/view?token=abc", origin=origin))
        assert texts[0]["type"] == "site" and len(blocks) > 0
        assert texts[1]["machines"][0]["position"] == states[-1]["position"]
        assert site.json("/height?x=2&y=0&token=abc")["height_m"] < -0.2
        status, file = site.get("/soil.vdb", {"Authorization": "Bearer abc", "Origin": origin})
        assert status == 200 and len(file) > 1000
        assert site.get("/height?x=2&y=0")[0] == 401
        assert site.get("/height?x=2&y=0&token=abc", {"Origin": "https://evil.example"})[0] == 403
        if path != "/":
            assert Client(origin).get("/dig")[1] == page, "sent on to /dig/"
