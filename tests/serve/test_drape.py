# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Orthophotos and maps on the page: colours lie where the file has them, in any CRS and format."""
import asyncio
import io
import os
import random
import signal
import subprocess
import urllib.request
from pathlib import Path

import numpy as np
import pytest
from osgeo import gdal, osr
from PIL import Image

from live import PROGRAM, Server, view

gdal.UseExceptions()
FIRST, SIDE, POSTS = (512300.0, 5403600.0), 80.0, 81   # of the site, in EPSG:25832
LOSSY = 12   # of 255: WebP of quality 80 on smooth colours
BLOCK = 16   # pixels that it codes as one: with an edge of the photo in it, they are up to 15 off


def write(path, bands, corner, cell, epsg, kind=gdal.GDT_Byte, driver="GTiff"):
    """Bands with rows from the north."""
    rows, columns = bands[0].shape
    data = gdal.GetDriverByName(driver).Create(str(path), columns, rows, len(bands), kind)
    if corner:
        data.SetGeoTransform((corner[0], cell, 0, corner[1], 0, -cell))
    if epsg:
        srs = osr.SpatialReference()
        srs.ImportFromEPSG(epsg)
        data.SetProjection(srs.ExportToWkt())
    for i, band in enumerate(bands):
        data.GetRasterBand(i + 1).WriteArray(band)
    return path


@pytest.fixture(name="site")
def _site(tmp_path):
    heights = np.full((POSTS, POSTS), 10.0, np.float32)
    write(tmp_path / "ground.tif", [heights], (FIRST[0] - 0.5, FIRST[1] + SIDE + 0.5), 1.0, 25832, gdal.GDT_Float32)
    path = tmp_path / "site.yaml"
    path.write_text("soilvdb: 1\nvoxel_size: 0.25\nterrain: {raster: ground.tif}\n"
                    "machines: [{name: d, bucket: {width: 2.0, height: 1.0}}]\n")
    return path


def served(site, drape, *more):
    return Server(site, "--drape", drape, "--out", site.with_suffix(".out"), *more, cwd=site.parent)


def picture(server):
    texts, _ = asyncio.run(view(server, lambda texts, _: bool(texts)))
    status, body = server.get("/drape")
    assert status == 200
    return np.asarray(Image.open(io.BytesIO(body)).convert("RGBA")), texts[0]["drape"]["bounds"]


def colour(x, y):
    """Smooth over the site."""
    u, v = (x - FIRST[0]) / SIDE, (y - FIRST[1]) / SIDE
    return np.stack([90 + 100 * u, 60 + 120 * v, 200 - 80 * u * v])


def photo(path, rng, epsg):
    """A photo of a part of the site in another CRS. Returns its function "is this place in it"."""
    size = rng.uniform(40, 90)
    x0, y0 = FIRST[0] + rng.uniform(-20, 20), FIRST[1] + SIDE - rng.uniform(-20, 20)
    cell = rng.uniform(0.15, 0.4)
    n = int(size / cell)
    x, y = np.meshgrid(x0 + cell * (np.arange(n) + 0.5), y0 - cell * (np.arange(n) + 0.5))
    bands = [np.clip(np.round(band), 0, 255).astype(np.uint8) for band in colour(x, y)]
    plain = write(path.with_name("plain.tif"), bands, (x0, y0), cell, 25832)
    if epsg == 25832:
        plain.rename(path)
    else:   # by gdalwarp, of which the server shares the library, but places by PROJ alone below
        subprocess.run(["gdalwarp", "-q", "-r", "bilinear", "-dstalpha", "-t_srs", f"EPSG:{epsg}", plain, path], check=True)
    return lambda px, py, edge: x0 + edge < px < x0 + n * cell - edge and y0 - n * cell + edge < py < y0 - edge


@pytest.mark.parametrize("epsg", [25832, 4326, 25833, 3857])
def test_colours_lie_where_the_file_has_them(site, epsg):
    rng = random.Random(epsg)
    inside = photo(site.parent / "photo.tif", rng, epsg)
    with served(site, "photo.tif") as server:
        pixels, (xmin, ymin, xmax, ymax) = picture(server)
        rows, columns = pixels.shape[:2]
        assert FIRST[0] <= xmin < xmax <= FIRST[0] + SIDE and FIRST[1] <= ymin < ymax <= FIRST[1] + SIDE
        hits = 0
        for _ in range(2000):
            x, y = rng.uniform(xmin, xmax), rng.uniform(ymin, ymax)
            r, g, b, alpha = pixels[min(rows - 1, int((ymax - y) / (ymax - ymin) * rows)),
                                    min(columns - 1, int((x - xmin) / (xmax - xmin) * columns))]
            if inside(x, y, 1):
                assert alpha == 255
                most = LOSSY if inside(x, y, 1.5 * BLOCK * (xmax - xmin) / columns) else 3 * LOSSY
                assert np.abs(np.array([r, g, b], float) - colour(x, y)).max() < most, (x, y)
                hits += 1
            elif not inside(x, y, -1):
                assert alpha == 0
        assert hits > 200


def test_palettes_greys_and_world_files_are_colours_too(site):
    rng = np.random.default_rng(8)
    n = 160
    corner, cell = (FIRST[0], FIRST[1] + SIDE), SIDE / n
    blocks = np.kron(rng.integers(0, 3, (8, 8)), np.ones((20, 20))).astype(np.uint8)
    palette = [(200, 30, 40), (20, 180, 60), (30, 60, 220)]
    mapped = write(site.parent / "map.tif", [blocks], corner, cell, 25832)
    data = gdal.Open(str(mapped), gdal.GA_Update)
    table = gdal.ColorTable()
    for i, entry in enumerate(palette):
        table.SetColorEntry(i, (*entry, 255))
    data.GetRasterBand(1).SetColorTable(table)
    data = None
    grey = write(site.parent / "grey.tif", [(40 + 60 * blocks).astype(np.uint8)], corner, cell, 25832)
    for file, colours in ((mapped, palette), (grey, [(40,) * 3, (100,) * 3, (160,) * 3])):
        with served(site, file.name) as server:
            pixels, _ = picture(server)
            assert pixels.shape[:2] == (n, n)
            for j in range(8):
                for i in range(8):
                    wanted = colours[blocks[20 * j, 20 * i]]
                    assert np.abs(pixels[20 * j + 10, 20 * i + 10, :3].astype(float) - wanted).max() < LOSSY
    table.SetColorEntry(1, (*palette[1], 128))
    table.SetColorEntry(2, (*palette[2], 0))
    data = gdal.GetDriverByName("MEM").CreateCopy("", gdal.Open(str(mapped)))
    data.GetRasterBand(1).SetColorTable(table)
    gdal.GetDriverByName("PNG").CreateCopy(str(site.parent / "map.png"), data)
    dark = gdal.GetDriverByName("GTiff").CreateCopy(str(site.parent / "dark.tif"), gdal.Open(str(grey)), 0, ["NBITS=4"])
    dark.GetRasterBand(1).WriteArray(4 + 5 * blocks)   # of 15
    dark = None
    for file, channel, wanted in (("map.png", 3, (255, 128, 0)), ("dark.tif", 0, (68, 153, 238))):
        with served(site, file) as server:
            pixels, _ = picture(server)
            for block, value in np.ndenumerate(blocks[::20, ::20]):
                got = pixels[20 * block[0] + 10, 20 * block[1] + 10, channel]
                assert abs(float(got) - wanted[value]) < LOSSY
    plane = site.with_name("plane.yaml")   # whose terrain cannot name a CRS
    plane.write_text(site.read_text().replace("{raster: ground.tif}", "{plane: {z: 2.0}}"))
    Image.fromarray(np.full((40, 60, 3), (10, 200, 30), np.uint8)).save(site.parent / "photo.png")
    (site.parent / "photo.pgw").write_text("0.5\n0\n0\n-0.5\n-9.75\n12.25\n")
    with served(plane, "photo.png") as server:
        pixels, bounds = picture(server)
        assert bounds == [-10, -7.5, 20, 12.5] and pixels.shape[:2] == (40, 60)
        assert np.abs(pixels[20, 30, :3].astype(float) - (10, 200, 30)).max() < LOSSY


def test_a_large_photo_is_kept_within_a_browsers_means_and_what_is_kept_is_told(site):
    n = 2200
    noise = np.random.default_rng(9).integers(0, 256, (3, n, n), np.uint8)   # the worst to compress
    write(site.parent / "large.tif", list(noise), (FIRST[0], FIRST[1] + SIDE), SIDE / n, 25832)
    with served(site, "large.tif", "--token", "feeds") as server:
        assert server.get("/drape")[0] == 401
        allowed = {"Authorization": "Bearer feeds"}
        request = urllib.request.Request(server.url.rstrip("/") + "/drape", headers=allowed)
        with urllib.request.urlopen(request) as reply:
            body, tag = reply.read(), reply.headers["ETag"]
            assert reply.headers["Content-Type"] == "image/webp"
        assert len(body) <= 4 << 20
        columns, rows = Image.open(io.BytesIO(body)).size
        assert columns == rows and 500 < columns <= 2048
        assert server.get("/drape", {**allowed, "If-None-Match": tag}) == (304, b"")
    with Server(site, "--out", site.with_suffix(".out"), cwd=site.parent) as server:
        status, body = server.get("/drape")
        assert status == 404 and b"--drape" in body


def test_a_file_that_is_no_drape_of_the_site_is_refused_in_one_line_with_advice(site):
    folder, corner = site.parent, (FIRST[0], FIRST[1] + SIDE)
    rgb = [np.full((20, 20), value, np.uint8) for value in (10, 20, 30)]
    (folder / "text.tif").write_text("no picture")
    write(folder / "nowhere.tif", rgb, None, 1, 25832)
    write(folder / "no_crs.tif", rgb, corner, 1, None)
    write(folder / "elsewhere.tif", rgb, (FIRST[0] + 5000, corner[1]), 1, 25832)
    write(folder / "empty.tif", [*rgb, 0 * rgb[0]], corner, 1, 25832)
    data = gdal.Open(str(folder / "empty.tif"), gdal.GA_Update)
    data.GetRasterBand(4).SetColorInterpretation(gdal.GCI_AlphaBand)
    data = None
    write(folder / "deep.tif", [band.astype(np.uint16) for band in rgb], corner, 1, 25832, gdal.GDT_UInt16)
    write(folder / "whole.tif", [np.random.default_rng(1).integers(0, 255, (400, 400), np.uint8)] * 3, corner, 0.2, 25832)
    (folder / "cut.tif").write_bytes((folder / "whole.tif").read_bytes()[:200_000])
    gdal.GetDriverByName("JPEG").CreateCopy(str(folder / "cut.jpg"), gdal.Open(str(folder / "whole.tif")))
    with open(folder / "cut.jpg", "r+b") as file:
        file.truncate(file.seek(0, 2) // 2)
    for file, words in (("none.tif", "none.tif"), ("text.tif", "convert it with: gdal_translate"),
                        ("ground.tif", "holds heights or other numbers (Float32), not colours"),
                        ("nowhere.tif", "no georeference; set the coordinates"),
                        ("no_crs.tif", "names no CRS, and the site is in EPSG:25832"),
                        ("elsewhere.tif", "is not on the site: it goes from 517300, 5403660"),
                        ("empty.tif", "is not on the site"),
                        ("deep.tif", "-ot Byte -scale"), ("cut.tif", "damaged"),
                        ("cut.jpg", "damaged")):
        refused = subprocess.run([PROGRAM, "serve", site, "--drape", file, "--out", "refused", "--port", "0"], cwd=folder,
                                 capture_output=True, text=True, timeout=60, check=False)
        assert refused.returncode == 2 and words in refused.stderr, (file, refused.stderr)
        assert len(refused.stderr.strip().splitlines()) == 1, refused.stderr
        assert not (folder / "refused").exists(), "nothing is written"


def test_a_signal_while_a_large_picture_is_read_ends_the_program(site):
    large = site.parent / "large.tif"
    n = 30_000   # without any tile on the disk, but each is resampled
    data = gdal.GetDriverByName("GTiff").Create(str(large), n, n, 3, gdal.GDT_Byte, ["TILED=YES", "SPARSE_OK=TRUE"])
    data.SetGeoTransform((FIRST[0], SIDE / n, 0, FIRST[1] + SIDE, 0, -SIDE / n))
    data.SetProjection(osr.SpatialReference(gdal.Open(str(site.parent / "ground.tif")).GetProjection()).ExportToWkt())
    data = None
    with subprocess.Popen([PROGRAM, "serve", site, "--drape", large, "--out", "stopped", "--port", "0"], cwd=site.parent,
                          stderr=subprocess.PIPE) as reader:
        def is_open():
            try:
                return any(os.readlink(file) == str(large) for file in Path(f"/proc/{reader.pid}/fd").iterdir())
            except FileNotFoundError:   # closed meanwhile
                return False
        while not is_open():
            assert reader.poll() is None
        reader.terminate()
        assert reader.wait(timeout=60) == -signal.SIGTERM, "it read on, and then stopped as a server does"
    assert not (site.parent / "stopped").exists()
