# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""What is drawn of a noise: moments and correlations, rotations, and who shares what with whom."""

import math

import numpy as np
import pytest

from soilvdb import noise as noises
from soilvdb.noise import (correlated_field, gauss_markov, of, product, rotation_of, turned,
                           turned_about)


def rng(*seed):
    return np.random.default_rng(seed)


def test_gauss_markov_forgets_to_1_over_e_in_tau():
    """Also over gaps, and where it is made in pieces: every 20 tau."""
    tau, count = 3.0, 4000
    times = np.concatenate([np.arange(0, 200, 0.5), [300, 300.9, 303.9], [1000]])
    draws = np.hstack([gauss_markov(rng(7, i), times, tau, 4) for i in range(count // 4)])
    error = 4 / math.sqrt(count)
    assert np.abs(draws.mean(axis=1)).max() < error * 1.2
    assert np.abs(draws.var(axis=1) - 1).max() < error * math.sqrt(2) * 1.2
    lags = [(i, i + 1) for i in range(len(times) - 1)] + [(0, 6), (110, 130), (115, 121)]
    for a, b in lags:
        right = math.exp(-(times[b] - times[a]) / tau)
        assert abs(np.mean(draws[a] * draws[b]) - right) < error * 1.3, (times[a], times[b])


def test_gauss_markov_at_one_time_twice_is_the_same():
    value = gauss_markov(rng(1), np.array([0.0, 1.0, 1.0, 2.0]), 5.0, 2)
    assert (value[1] == value[2]).all() and (value[0] != value[1]).all()


def test_correlated_field_has_a_spherical_variogram():
    shape, spacing, length, count = (24, 40), (0.5, 0.25), 3.0, 3000
    fields = np.stack([correlated_field(rng(3, i), shape, spacing, length) for i in range(count)])
    assert fields.shape == (count, *shape)
    error = 4.5 / math.sqrt(count)
    assert abs(fields.var(axis=0) - 1).max() < error * math.sqrt(2)
    middle = fields[:, 0, 0]
    for j, i in ((0, 1), (0, 3), (2, 0), (6, 0), (4, 2)):  # of all pairs so far apart
        h = math.hypot(j * spacing[1], i * spacing[0]) / length
        found = np.mean(fields[:, j:, i:] * fields[:, :24 - j, :40 - i])
        assert found == pytest.approx(1 - 1.5 * h + 0.5 * h**3, abs=0.02), (j, i)
    for j, i in ((0, 1), (0, 4), (1, 0), (4, 0), (8, 3), (0, 6), (12, 0), (0, 39), (23, 0), (23, 39)):
        h = min(1.0, math.hypot(j * spacing[1], i * spacing[0]) / length)
        right = 1 - 1.5 * h + 0.5 * h**3
        assert abs(np.mean(middle * fields[:, j, i]) - right) < error, (j, i)


def test_correlated_field_of_a_range_longer_than_the_field():
    random = rng(3)
    fields = np.stack([correlated_field(random, (2, 2), (1, 1), 20.0) for _ in range(12_000)])
    assert fields.var(axis=0) == pytest.approx(np.ones((2, 2)), abs=0.025)
    rises = (fields[:, 0, 0] - fields[:, 0, 1])**2 / 2
    assert rises.mean() == pytest.approx(1.5 / 20, rel=0.05)


def test_correlated_field_of_a_long_range_costs_little():
    field = correlated_field(rng(3), (31, 43), (1.0, 2.0), 1e4)  # 20 m, or 10, are straight
    assert field.shape == (31, 43) and np.ptp(field) > 0
    for line in (field[:11, 0], field[20:, 42], field[7, :21], field[30, 20:41], field[25, 40:]):
        assert np.diff(line, 2) == pytest.approx(np.zeros(len(line) - 2), abs=1e-12)
    whole = correlated_field(rng(3), (4, 4), (20.0, 20.0), 1e4)
    assert field[::10, ::20] == pytest.approx(whole[:, :3], abs=1e-12)


def matrix(q):
    x, y, z, w = q
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])


def exponential(v):
    """Of a rotation vector, by the series of the matrix."""
    k = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    total, term = np.eye(3), np.eye(3)
    for i in range(1, 30):
        term = term @ k / i
        total = total + term
    return total


def test_rotations_are_those_of_matrices():
    random = rng(2)
    q = random.normal(size=(6, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    v = random.normal(size=(6, 3)) * np.array([[1e-9], [0.01], [0.5], [1], [2], [0]])
    base = (random.normal(size=3), q[5])
    p = random.normal(size=(6, 3))
    places, rotations = turned_about(base, v, p, q)
    for i in range(6):
        assert matrix(rotation_of(v[i:i + 1])[0]) == pytest.approx(exponential(v[i]), abs=1e-12)
        assert matrix(product(q[:1], q[i:i + 1])[0]) == pytest.approx(matrix(q[0]) @ matrix(q[i]))
        assert matrix(turned(q, v)[i]) == pytest.approx(matrix(q[i]) @ exponential(v[i]))
        assert matrix(turned(q[1], v)[i]) == pytest.approx(matrix(q[1]) @ exponential(v[i]))
        b = matrix(base[1])
        error = b @ exponential(v[i]) @ b.T
        assert places[i] == pytest.approx(base[0] + error @ (p[i] - base[0]))
        assert matrix(rotations[i]) == pytest.approx(error @ matrix(q[i]))


def test_who_shares_errors_with_whom():
    noise = of({"position": {"bias": 1, "white": 1}, "joints": {"bias": 0.1, "a": {"bias": 0.2}},
                "bucket": {"width": 0.1}})
    assert noise.sources() == ["position.bias", "position.white", "joints.bias", "joints.a.bias",
                               "bucket.width"]
    times = np.arange(5.0)
    draw = noise.draw(4, 0)
    one, other = draw.base("one", times)[0], draw.base("other", times)[0]
    assert not np.any(one == other) and not np.any(one[:, 0] == one[:, 1])
    joints = draw.joints("one", times, ["a", "b", "c"])
    assert np.ptp(joints, axis=0).max() == 0
    assert len({*joints[0], *draw.joints("other", times, ["a", "b", "c"])[0]}) == 6
    assert (draw.base("one", times)[0] == noise.draw(4, 0).base("one", times)[0]).all()
    for elsewhere in (noise.draw(4, 1), noise.draw(5, 0)):
        assert not np.any(elsewhere.base("one", times)[0] == one)
    # A draw of some realisations has theirs, and of what isn't named nothing.
    mixed = noise.draw(4, {"position.bias": 0, "position.white": 1})
    alone = noise.draw(4, {"position.bias": 0}).base("one", times)[0]
    assert np.ptp(alone, axis=0).max() == 0
    white = noise.draw(4, {"position.white": 1}).base("one", times)[0]
    assert mixed.base("one", times)[0] == pytest.approx(alone + white, abs=1e-15)
    assert (mixed.joints("one", times, ["a", "b"]) == 0).all()
    assert mixed.scalar("bucket.width", 0.1, -1, 1) == 0


def test_a_joint_of_its_own_errs_by_that_alone():
    noise = of({"joints": {"bias": 0.1, "a": {"bias": 0.2}, "b": {"white": 0.01}}})
    draws = np.array([noise.draw(1, i).joints("m", np.arange(2.0), ["a", "b", "c"])
                      for i in range(2000)])
    assert draws[:, 0].std(axis=0) == pytest.approx([0.2, 0.01, 0.1], rel=0.08)
    assert (draws[:, 0] == draws[:, 1]).all(axis=0).tolist() == [True, False, True]


def test_scalars_stay_within_what_can_be():
    noise = of({"soil": {"repose": 0.3}})
    draws = [noise.draw(1, i).scalar("soil.repose", 0.3, -0.1, 0.2) for i in range(500)]
    assert -0.1 <= min(draws) < -0.05 and 0.15 < max(draws) <= 0.2


def test_strength_of_soil_is_what_its_sigmas_say():
    """Mean and sigma are kept, also where sigma is as large as the value; all draws are valid."""
    sigmas = {"density": 100.0, "cohesion": 4000.0, "friction_angle": 0.06, "tool_friction": 0.05,
              "adhesion": 500.0}
    soil = {"density": 1800.0, "cohesion": 4000.0, "friction_angle": 0.5, "tool_friction": 0.3,
            "adhesion": 900.0}
    noise = of({"soil": sigmas | {"swell": 0}})
    assert noise.strength() == list(sigmas) and noise.sources() == [f"soil.{key}" for key in sigmas]
    noise.check_strength(soil)
    count = 4000
    for key, sigma in sigmas.items():
        draws = np.array([noise.draw(3, i).soil(key, soil[key]) for i in range(count)])
        # Of a lognormal of that sigma: fourth moment over sigma^4, less 1, by w = 1 + (sigma / mean)^2.
        w = 1 + (sigma / soil[key])**2 if key not in ("friction_angle", "tool_friction") else 1
        fourth = w**4 + 2 * w**3 + 3 * w**2 - 3
        assert draws.mean() == pytest.approx(soil[key], abs=4 * sigma / math.sqrt(count)), key
        assert draws.var() == pytest.approx(sigma**2, rel=4 * math.sqrt((fourth - 1) / count)), key
        assert draws.min() > 0
    assert noise.draw(3, {}).soil("cohesion", 4000.0) == 4000
    assert noise.draw(3, 0).soil("swell", 0.2) == 0.2


@pytest.mark.parametrize("sigmas, why", [
    ({"cohesion": 4001}, "soil.cohesion is 4001; it must be at most the soil's cohesion, 4000"),
    ({"adhesion": 1}, "soil.adhesion is 1; it must be at most the soil's adhesion, 0"),
    ({"friction_angle": 0.2}, "soil.friction_angle is 0.2; it must be at most a third of what the"),
    ({"tool_friction": 0.1}, "soil.tool_friction: the soil's tool_friction isn't given; an error")])
def test_strength_that_can_not_err_so_is_refused(sigmas, why):
    with pytest.raises(noises.NoiseError) as error:
        of({"soil": sigmas}).check_strength({"density": 1800, "cohesion": 4000, "adhesion": 0,
                                             "friction_angle": 0.5, "tool_friction": None})
    assert str(error.value).startswith(why)


def test_a_file_says_what_a_dict_does(tmp_path):
    (tmp_path / "n.yaml").write_text(
        "position: {bias: [1, 2, 3], drift: {sigma: 0.5, tau: 30}}\n"
        "joints: {white: 0.1, boom: {bias: 0.2}}\nterrain: {correlated: {sigma: 1, length: 2}}\n")
    given = {"position": {"bias": [1, 2, 3], "drift": {"sigma": 0.5, "tau": 30}},
             "joints": {"white": 0.1, "boom": {"bias": 0.2}},
             "terrain": {"correlated": {"sigma": 1, "length": 2}}}
    assert noises.read(tmp_path / "n.yaml") == of(given)
    assert of(given).position.bias == (1, 2, 3) and of(given).position.drift == (0.5, 0.5, 0.5)
    (tmp_path / "n.yaml").write_text("position: {bias: 1e-2, white: [+.5, 2., 1E0]}\n"
                                     "joints: {on: {bias: 5e-1}}\n")
    assert noises.read(tmp_path / "n.yaml") == of({"position": {"bias": 0.01, "white": [0.5, 2, 1]},
                                                   "joints": {"on": {"bias": 0.5}}})
    assert of({"position": {"bias": np.array([1, 2, 3]), "white": np.float32(0.5)}}) == of(
        {"position": {"bias": [1, 2, 3], "white": 0.5}})
    assert of({"position": {"bias": 0}}).sources() == [] and not of({"joints": {"bias": 0.1}}).moves_base()
