# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Covariance of values fitted to rows whose errors go on from row to row.

Kernels over the rows' misfits (Newey and West 1987, also prewhitened) give sigmas that are much too
small here: some hundred rows with errors that last hold too few independent ones. A model of the
errors needs fewer. Of each error, a share fades as exp(-distance / range) and the rest is new in
each row. Ranges and shares of a grid count by their restricted likelihood (Patterson and Thompson
1971), which knows that the fit has taken part of the errors; so the doubt about both is in the
covariance, too. Axes may err by other sizes and together, but fade alike.
"""

from __future__ import annotations

import numpy as np

from .noise import Floats

_SHARES = (0.25, 0.5, 0.75, 0.9, 1.0)  # of what fades
_SHORTEST, _STEP = 0.35, 1.5  # range, rows, at which neighbours correlate by 0.06; ratio of ranges
_LONGEST = 1 / 4              # of all rows; what lasts longer is seen too seldom


def covariance(rows: Floats, by: Floats, misfit: Floats) -> Floats:
    """Covariance (P, P) of the least squares of misfits on derivatives.

    rows: (N,) increasing; misfit: (N, 3) after the fit, and by: (N, 3, P), N * 3 > P. Rows that
    correlate do so by their difference.
    """
    count, _, values = by.shape
    together = misfit.T @ misfit / count
    sizes = np.sqrt(np.diag(together))
    told = np.sqrt((by**2).sum(axis=(0, 2)))
    axes = np.flatnonzero((told > 1e-6 * told.max()) & (sizes > 1e-6 * sizes.max()))
    if not len(axes):  # nothing errs
        return np.zeros((values, values))
    spans = [_SHORTEST]
    while spans[-1] * _STEP <= _LONGEST * (rows[-1] - rows[0]):
        spans.append(spans[-1] * _STEP)
    # The first of the grid: all is new in each row.
    span = np.concatenate([[1e-3], np.repeat(spans, len(_SHARES))])
    share = np.concatenate([[1.0], np.tile(_SHARES, len(spans))])
    prior = np.concatenate([[1.0], np.full(len(share) - 1, 1 / len(_SHARES))])

    scaled = np.concatenate([misfit[:, axes, None], by[:, axes]], axis=2) / sizes[axes, None]
    root = np.linalg.cholesky(together + 1e-12 * np.trace(together) * np.eye(3))
    pushed = np.einsum("ji,njp->nip", root, by)
    kept = np.exp(-np.diff(rows, prepend=rows[0])[:, None] / span)
    # A filter (Kalman) for all of the grid at once: what fades, as the rows before tell it.
    known = np.zeros((len(span), *scaled.shape[1:]))
    doubt = share.copy()
    logs = np.zeros(len(span))
    squares = np.zeros((len(span), 1 + values, 1 + values))
    before = np.zeros((len(span), 3, values))  # sum of the rows before, each as it has faded
    crossed = np.zeros((len(span), values, values))
    for row in range(count):
        keep = kept[row]
        before *= keep[:, None, None]
        crossed += np.einsum("ip,giq->gpq", pushed[row], before)
        before += pushed[row]
        known *= keep[:, None, None]
        doubt = keep**2 * doubt + (1 - keep**2) * share
        variance = doubt + 1 - share
        new = scaled[row] - known
        known += (doubt / variance)[:, None, None] * new
        doubt = doubt * (1 - share) / variance
        logs += np.log(variance)
        squares += np.einsum("gic,gid,g->gcd", new, new, 1 / variance)

    normal, right = squares[:, 1:, 1:], squares[:, 1:, 0]
    normal += 1e-12 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(values)
    fitted = np.einsum("gp,gpq,gq->g", right, np.linalg.inv(normal), right)
    free = len(axes) * count - values
    left = np.maximum(squares[:, 0, 0] - fitted, 1e-12 * squares[:, 0, 0]) / free
    likelihood = (np.log(prior) - 0.5 * (free * np.log(left) + len(axes) * logs
                                         + np.linalg.slogdet(normal)[1]))
    weight = np.exp(likelihood - likelihood.max())
    weight *= left / weight.sum()
    alone = np.einsum("nip,niq->pq", pushed, pushed)
    summed = weight.sum() * alone + np.einsum("g,gpq->pq", weight * share,
                                              crossed + crossed.transpose(0, 2, 1))
    inverse = np.linalg.pinv(np.einsum("nip,niq->pq", by, by))
    return np.asarray(inverse @ summed @ inverse)
