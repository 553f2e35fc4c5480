# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Random arguments raise or do what they say, and nothing else. For longer: fuzz_arguments.py."""

import subprocess
import sys
from pathlib import Path


def test_random_arguments():
    fuzz = Path(__file__).with_name("fuzz_arguments.py")
    for seed in ("1", "2"):
        done = subprocess.run([sys.executable, "-W", "error", fuzz, "4", seed], text=True,
                              capture_output=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
