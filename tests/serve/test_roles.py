# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Who may feed a site and who may only look, and where their secrets are."""
import asyncio
import json
import subprocess
from pathlib import Path

import pytest
from live import PROGRAM, Server, passes, scenario, view, whole

STATE = next(passes("digger", 0.0, 0.3, 60))
LOOKS = ("/summary.json", "/height?x=0&y=0", "/machines.csv")


def refused(path, *arguments, env=None):
    """What a start says that fails."""
    done = subprocess.run([PROGRAM, "serve", path, "--port", "0", *map(str, arguments)], env=env,
                          cwd=path.parent, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2 and not (path.parent / "out").exists(), done
    return done.stderr


def may(server, token):
    """Whether one may look, feed and set clocks, by each way to send a token."""
    headers = {"Authorization": f"Bearer {token}"} if token else {}
    query = f"?token={token}" if token else ""
    looks = {server.get(path, headers)[0] for path in LOOKS}
    assert len(looks) == 1
    assert server.get(f"/summary.json{query}")[0] in looks

    def streams(path, work):
        try:
            return asyncio.run(work(path))
        except Exception as error:  # the library's classes differ by version
            return next(int(word.strip(".")) for word in str(error).split() if word.strip(".").isdigit())

    async def feed(path):
        async with server.connect(path) as socket:
            await socket.send(json.dumps(STATE))
            return json.loads(await socket.recv())
    fed = streams("/feed" + query, feed)
    try:
        texts, _ = asyncio.run(view(server, whole(), path="/view" + query))
        seen = bool(texts)
    except Exception:
        seen = False
    assert seen == (looks == {200})
    status, body = server.get("/clock?machine=digger", headers, "POST")
    if looks == {200} and status == 403:
        assert "may look, but not feed" in json.loads(body)["error"]
    return looks.pop(), fed if isinstance(fed, int) else "error" not in fed, status


def test_who_looks_can_not_feed_and_who_feeds_may_look(tmp_path):
    (tmp_path / "feeds").write_text("d1g\n")
    (tmp_path / "looks").write_text("l00k\n")
    with Server(scenario(tmp_path), "--token-file", "feeds", "--view-token-file", "looks", "--out",
                tmp_path / "out", cwd=tmp_path) as server:
        assert server.printed.endswith("/#token=l00k"), "an address that is passed on lets others look"
        assert may(server, "l00k") == (200, 403, 403)
        assert may(server, "") == (401, 401, 401)
        assert may(server, "l00") == (401, 401, 401)
        assert server.json("/summary.json?token=l00k")["updates"] == 0
        assert may(server, "d1g") == (200, True, 200)
        for scheme, status in (("bearer", 200), ("BEARER", 200), ("Bearer ", 200), ("Bearer", 200),
                               ("Basic", 401), ("", 401)):
            assert server.get("/summary.json", {"Authorization": f"{scheme} l00k"})[0] == status
        assert server.get("/summary.json", {"Authorization": "Bearerl00k"})[0] == 401
        command = Path(f"/proc/{server.process.pid}/cmdline").read_bytes()
        assert b"d1g" not in command and b"l00k" not in command
        said = " ".join(server.stop().split())
        assert "other users" not in said
        assert "--token-file feeds --view-token-file looks --port 0` goes on" in said


def test_tokens_may_be_in_the_environment_and_looking_free(tmp_path):
    with Server(scenario(tmp_path), "--public-view", "--out", tmp_path / "out", cwd=tmp_path,
                env={"SOILVDB_TOKEN": "d1g"}) as server:
        assert server.printed == server.url
        assert may(server, "") == (200, 403, 403)
        assert may(server, "d1g") == (200, True, 200)
    with Server(scenario(tmp_path), "--out", tmp_path / "both", cwd=tmp_path,
                env={"SOILVDB_TOKEN": "d1g", "SOILVDB_VIEW_TOKEN": "l00k"}) as server:
        assert may(server, "l00k") == (200, 403, 403)
        assert may(server, "d1g") == (200, True, 200)


def test_a_token_on_the_command_line_is_warned_of(tmp_path):
    with Server(scenario(tmp_path), "--token", "d1g", "--out", tmp_path / "out", cwd=tmp_path) as server:
        assert may(server, "d1g") == (200, True, 200), "one token is for all, as before"
        said = " ".join(server.stop().split())
        assert "other users of this computer can read --token" in said
        assert "use --token-file or the variable SOILVDB_TOKEN" in said


@pytest.mark.parametrize("arguments, env, why", [
    (["--token-file", "none"], {}, "none"),
    (["--token-file", "blank"], {}, "blank"),
    (["--token-file", "odd"], {}, "odd must consist of letters"),
    ([], {"SOILVDB_TOKEN": ""}, "SOILVDB_TOKEN holds no token"),
    (["--token", ""], {}, "--token holds no token"),
    (["--token", "a", "--token-file", "good"], {}, "either --token or --token-file"),
    (["--view-token-file", "good"], {}, "give a --token-file, too"),
    (["--public-view"], {}, "give a --token-file, too"),
    (["--token-file", "good", "--view-token-file", "good"], {}, "different tokens"),
    (["--token-file", "good", "--public-view", "--view-token", "b"], {}, "leave theirs out"),
    (["--listen", "0.0.0.0"], {}, "give a --token-file"),
])
def test_tokens_that_protect_nothing_are_refused(tmp_path, arguments, env, why):
    for name, text in (("good", "abc"), ("blank", " \n"), ("odd", "a b\n")):
        (tmp_path / name).write_text(text)
    assert why in refused(scenario(tmp_path), *arguments, env=env)
