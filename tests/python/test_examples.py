# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""The examples do what they say."""

import re
import subprocess
import sys
from pathlib import Path

EXAMPLES = Path(__file__).parents[2] / "tools/python/examples"


def run(name, *arguments, cwd):
    done = subprocess.run([sys.executable, EXAMPLES / name, *arguments], cwd=cwd, text=True,
                          capture_output=True, check=True)
    return done.stdout


def test_the_controller_stops_at_the_load_it_was_given(tmp_path):
    for wanted in (0.4, 0.7):
        out = run("dig_controller.py", str(wanted), cwd=tmp_path)
        loads = [float(v) for v in re.findall(r": ([0-9.]+) m3 of", out)]
        assert len(loads) == 3
        assert all(abs(load - wanted) < 0.1 * wanted for load in loads), out


def test_examples_say_what_their_looks_cost():
    looks = 0
    for file in EXAMPLES.glob("*.py"):
        lines = file.read_text().splitlines()
        for before, line in zip(lines, lines[1:]):
            if re.search(r"\.(heights|height_map|height_maps|mesh_heights|cast)\(", line):
                assert re.search("# Takes .*(us|microseconds)", before), f"{file.name}: {line}"
                looks += 1
    assert looks >= 4


def test_the_environment_pays_what_the_buckets_hold(tmp_path):
    out = run("dig_env.py", cwd=tmp_path)
    loads = [float(v) for v in re.search(r"\[(.*)\]", out).group(1).split()]
    assert len(loads) == 8 and all(load > 0.3 for load in loads)


def test_the_dig_by_force_gives_way(tmp_path):
    largest = []
    for limit in (8, 12, 100):
        out = run("force_dig.py", str(limit), "dig.csv", cwd=tmp_path)
        largest.append(float(re.search(r"largest force ([0-9.]+) kN", out).group(1)))
        over_s = float(re.search(r"for ([0-9.]+) s", out).group(1))
        assert over_s < 1.8, out  # of eight seconds
    assert largest[0] < largest[1] < largest[2], largest
    assert len((tmp_path / "dig.csv").read_text().splitlines()) > 800


def test_the_plot_is_a_picture(tmp_path):
    out = run("plot_dig.py", "dig.png", cwd=tmp_path)
    assert (tmp_path / "dig.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert float(re.search(r"bucket ([0-9.]+)", out).group(1)) > 0.4
