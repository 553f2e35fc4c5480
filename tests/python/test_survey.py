# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Site.survey(): a new surface becomes the ground."""
import pickle
import warnings

import numpy as np
import pytest
import soilvdb

CELL = 0.5
SOIL = soilvdb.Soil(repose_angle=0.6, swell=0.25)
BUCKET = soilvdb.Bucket(1.2, 0.9, [(0, 0), (-0.5, 0.1), (-0.85, 0.4), (-0.6, 0.9), (0, 0.9)])


def surface(seed, side=41, level=0.0):
    """Rough posts about the world's origin."""
    heights = 0.4 * np.random.default_rng(seed).random((side, side))
    heights[[0, 1, -2, -1]] = heights[:, [0, 1, -2, -1]] = 0  # only whole columns of voxels are taken
    heights += level
    return soilvdb.raster(heights, origin=(-CELL * (side // 2),) * 2, cell=CELL), heights


def dug(soil=SOIL, origin=(0, 0, 0)):
    site = soilvdb.Site(0.1, soilvdb.plane(0.0), [BUCKET], soil=soil)
    for x in np.linspace(-3, 3, 40):
        site.update(0, position=np.add(origin, (x, 0, 0.2 * abs(x) - 0.5)), rotation=(0, 0, 0, 1))
    return site


@pytest.mark.parametrize("soil", [None, SOIL])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_volume_is_that_between_the_surfaces(seed, soil):
    site = dug(soil)
    cut, held = site.ledger()["cut_m3"], site.ledger(0)["bucket_m3"]
    terrain, heights = surface(seed)
    made = site.survey(terrain)
    assert made.area_m2 == pytest.approx(19.9 ** 2) and made.voids == made.outside == 0
    # Bilinear between posts: the trapezoid rule is exact. Ground beside the survey was not dug.
    wanted = CELL ** 2 * (heights[:-1, :-1] + heights[1:, :-1] + heights[:-1, 1:] + heights[1:, 1:]).sum() / 4
    # Errors of counts, 0.022 of a cell each, in some two cells of a column, of four sigmas.
    assert site.change_m3() == pytest.approx(wanted, abs=4 * 0.022 * 0.1 ** 3 * np.sqrt(2 * 2 * 200 ** 2))
    assert site.ledger()["cut_m3"] == cut and site.ledger(0)["bucket_m3"] == held
    hashed = site.ground_hash()
    again = site.survey(terrain)
    assert again.removed_m3 == again.added_m3 == 0 and site.ground_hash() == hashed
    assert pickle.loads(pickle.dumps(made)).area_m2 == made.area_m2 and "area_m2" in repr(made)


def test_a_boundary_and_voids_leave_the_ground():
    site = dug()
    _, heights = surface(4, level=1)
    heights[:, 30:] = np.nan
    terrain = soilvdb.raster(heights, origin=(-10, -10), cell=CELL)
    made = site.survey(terrain, boundary=[(-8, -8), (8, -8), (8, 8), (-8, 8)])
    assert made.voids == pytest.approx((8 - 4.5) / 16, abs=0.03)
    z = site.heights([(-7.5, 7.5), (-8.5, 7.5), (6, 7.5)])
    assert z[0] > 0.9 and z[1] == pytest.approx(0, abs=1e-9) and z[2] == pytest.approx(0, abs=1e-9)


def test_it_is_recorded_saved_and_cloned(tmp_path):
    terrain, _ = surface(5)
    site = dug()
    with dug() as recorded:
        pass
    with soilvdb.Site(0.1, soilvdb.plane(0.0), [BUCKET], soil=SOIL) as recorded:
        recorded.record(tmp_path / "site")
        recorded.update(0, position=(0, 0, -0.2), rotation=(0, 0, 0, 1))
        recorded.survey(terrain)
        recorded.update(0, position=(2, 0, -0.2), rotation=(0, 0, 0, 1))
        state = recorded.save()
    with soilvdb.Site(0.1, soilvdb.plane(0.0), [BUCKET], soil=SOIL) as again:
        again.record(tmp_path / "site")
        assert again.save() == state
    clone = site.clone()
    for one in (site, clone):
        one.survey(terrain)
    assert site.save() == clone.save()


def test_on_an_endless_plane_it_may_be_anywhere():
    origin = (500_000.0, 4_000_000.0)
    site = soilvdb.Site(0.1, soilvdb.plane(0.0), [BUCKET])
    site.survey(soilvdb.raster(np.full((11, 11), 0.35), origin=origin, cell=1.0))
    z = site.heights([np.add(origin, 5), np.add(origin, -3)])
    assert z == pytest.approx([0.35, 0], abs=1e-3)


@pytest.mark.parametrize("make, said", [
    (lambda: surface(1, level=20)[0], "above the same zero"),
    (lambda: soilvdb.plane(0.1), "give a boundary"),
])
def test_what_can_not_be_the_ground_is_refused(make, said):
    site = dug()
    state = site.save()
    with pytest.raises(ValueError, match=said):
        site.survey(make())
    for boundary in ([(0, 0), (1, 1)], [(0, 0), (1, 1), (1, 0), (0, 1)], [(0, 0), (1, np.nan), (1, 0)]):
        with pytest.raises(ValueError):
            site.survey(surface(1)[0], boundary=boundary)
    assert site.save() == state
    ground = soilvdb.Site(0.1, soilvdb.raster(np.zeros((11, 11)), origin=(0, 0), cell=1.0), [BUCKET])
    with pytest.raises(ValueError, match="^the boundary misses the survey: it goes from 30, 0 to 40, 9, and the "
                                         "survey on this site from -10, -10 to 10, 10$"):
        site.survey(surface(1)[0], boundary=[(30, 0), (40, 0), (40, 9)])
    with pytest.raises(ValueError, match="misses the site"):
        ground.survey(soilvdb.raster(np.zeros((11, 11)), origin=(50, 0), cell=1.0), boundary=[(50, 0), (55, 0), (55, 5)])
    with pytest.raises(ValueError, match="misses the site"):
        ground.survey(soilvdb.raster(np.zeros((11, 11)), origin=(50, 0), cell=1.0))


def test_one_that_is_refused_gives_a_site_no_place():
    site, other = (soilvdb.Site(0.1, soilvdb.plane(0.0), [BUCKET]) for _ in range(2))
    with pytest.raises(ValueError, match="above the same zero"):
        site.survey(soilvdb.raster(np.full((11, 11), 20.0), origin=(500_000.0, 4_000_000.0), cell=1.0))
    assert site.save() == other.save()
    for one in (site, other):
        one.update(0, position=(40, 0, -0.2), rotation=(0, 0, 0, 1))
    assert site.save() == other.save()


def test_heights_that_are_trusted_are_taken_and_told():
    site = dug()
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        made = site.survey(surface(1, level=20)[0], trust_heights=True)
    assert made.added_m3 > 7900 and any("above the ground" in str(w.message) for w in told)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        site.survey(surface(1, level=18)[0])
    assert any("about alike" in str(w.message) for w in told)
