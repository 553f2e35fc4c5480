# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""What README says in Python runs as it stands."""

import re
import subprocess
import sys
from pathlib import Path

README = (Path(__file__).parents[2] / "README.md").read_text()


def test_its_python_runs(tmp_path):
    blocks = re.findall(r"^```python\n(.*?)^```$", README, flags=re.S | re.M)
    assert blocks
    for block in blocks:
        done = subprocess.run([sys.executable, "-c", block], cwd=tmp_path, text=True,
                              capture_output=True, check=False)
        assert done.returncode == 0, done.stderr
    load = float(re.match(r"([0-9.]+) m3 in the bucket", done.stdout).group(1))
    assert 0.3 < load < 0.9
    assert (tmp_path / "dug.vdb").stat().st_size > 10_000
