# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""A cluster that tests share."""

import pytest
from processes import Processes, call

from soilvdb.fleet import cluster


@pytest.fixture(scope="session", name="shared")
def _shared(tmp_path_factory):
    """Two workers that no test kills. @return the scheduler's address"""
    with Processes(tmp_path_factory.mktemp("cluster")) as processes:
        processes.wait_for_workers(2)
        yield processes.address


@pytest.fixture(name="fleet")
def _fleet(shared, monkeypatch):
    """call() on the shared cluster; what failed is tried again at once."""
    monkeypatch.setattr(cluster, "PAUSE_S", 0.0)
    return lambda *words: call(*words, "--scheduler", shared)
