# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Statistics of a figure over draws."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from soilvdb.noise import Floats


def spread(values: Sequence[float] | Floats) -> dict[str, float]:
    """Mean, sigma, and percentiles 5 and 95 of the finite values."""
    finite = np.array(values, dtype=float)
    finite = finite[np.isfinite(finite)]
    if len(finite) < 2:
        return {"mean": float("nan"), "sigma": float("nan"), "p05": float("nan"),
                "p95": float("nan")}
    if np.ptp(finite) == 0:  # whose mean may be off by a bit, and then so is sigma
        same = float(finite[0])
        return {"mean": same, "sigma": 0.0, "p05": same, "p95": same}
    p05, p95 = np.percentile(finite, (5, 95))
    return {"mean": float(finite.mean()), "sigma": float(finite.std(ddof=1)), "p05": float(p05),
            "p95": float(p95)}
