# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""fleet uncertainty: uncertainty of loads and ground, by digging realisations of a scenario."""

from __future__ import annotations

import argparse
import contextlib
import csv
import dataclasses
import hashlib
import importlib
import json
import os
import pickle
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import soilvdb
from soilvdb import noise as noises
from soilvdb.noise import Draw, Floats

from . import InputError, cluster
from .cycles import Cycle, cycles_of, nearest_cycles
from .forces import FORCES, kept_rows, largest_n, sizes_n, write_forces
from .plots import plot_loads
from .progress import Progress
from .spread import spread
from .study import Dug, Scene, Study, scene_of

LEAST_DRAWS, MOST_DRAWS = 2, 100_000
TASK_DRAWS = 8  # of one task
MOST_CELLS = 250_000  # of the raster of heights
INSTANTS = 400  # of the band over time
MOST_CYCLES = 12  # that are printed
GRAINS_M = 2.0**-20  # heights are summed in whole numbers of it, so no order matters
FILES = ("uncertainty.json", "draws.csv", "load.png", "height_sigma.tif", FORCES)
PARTS = "draws.part"  # folder of what was drawn by now

Ints = npt.NDArray[np.int64]
Singles = npt.NDArray[np.float32]


@dataclasses.dataclass(frozen=True)
class Grid:
    """Posts of a raster of heights: first (x, y), spacing, number (nx, ny)."""

    first: tuple[float, float]
    spacing_m: float
    shape: tuple[int, int]

    def places(self) -> Floats:
        """(ny * nx, 2), row by row."""
        x, y = (self.first[axis] + self.spacing_m * np.arange(self.shape[axis]) for axis in (0, 1))
        return np.asarray(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))


@dataclasses.dataclass(frozen=True)
class Task:
    """Some draws of a study."""

    study: Study
    draws: tuple[tuple[tuple[str, int], ...], ...]  # of each: number of the realisation by source
    grid: Grid | None


@dataclasses.dataclass
class Figures:
    """Results of a draw, by machine."""

    load_m3: dict[str, float]
    cut_m3: dict[str, float]
    fill_m3: float
    loads_m3: dict[str, Floats]  # at the instants
    cycles: dict[str, list[tuple[float, ...]]]  # Cycle.figures() of each of the recorded ones; NaN
    waited: int = 0  # rows at ground without a height
    # Of machines whose forces are asked for: the largest, and those of kept_rows(), as Dug.force.
    force_n: dict[str, float] = dataclasses.field(default_factory=dict)
    forces: dict[str, Singles] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass
class Drawn:
    """Results of some draws. Heights are differences from the recorded ones, in whole grains."""

    figures: list[Figures]
    count: Ints
    sum: Ints
    squares: Ints


@dataclasses.dataclass
class Recorded:
    """The scenario as recorded, the reference of the draws."""

    figures: Figures
    cycles: dict[str, list[Cycle]]
    heights: Floats


def add_parser(subparsers: Any) -> None:
    parser = subparsers.add_parser(
        "uncertainty", help="uncertainty of a scenario's loads and ground", allow_abbrev=False,
        description="Digs a scenario many times with random errors of its recorded data, and "
                    "writes the results to DIR: uncertainty.json, draws.csv, load.png, "
                    "height_sigma.tif, and force.csv if the scenario asks for forces.")
    parser.add_argument("scenario", metavar="SCENARIO", type=Path)
    parser.add_argument("--noise", metavar="NOISE.yaml", type=Path, required=True)
    parser.add_argument("--draws", metavar="N", type=_draws, required=True,
                        help=f"{LEAST_DRAWS} or more; relative error of sigmas: 1 / sqrt(2 N)")
    parser.add_argument("--out", metavar="DIR", type=Path, required=True)
    parser.add_argument("--seed", metavar="S", type=_seed, default=0,
                        help="the same seed gives the same bits on any cluster; default 0")
    cluster.add_options(parser)
    parser.set_defaults(main=main)


def _draws(text: str) -> int:
    if not text.isdecimal() or not LEAST_DRAWS <= int(text) <= MOST_DRAWS:
        raise argparse.ArgumentTypeError(
            f"'{text}' is not a whole number from {LEAST_DRAWS} to {MOST_DRAWS}")
    return int(text)


def _seed(text: str) -> int:
    if not text.isdecimal() or len(text) > 18:
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number of at most 18 digits")
    return int(text)


def main(arguments: argparse.Namespace) -> int:
    try:
        noise = noises.read(arguments.noise)
    except noises.NoiseError as error:
        raise InputError(str(error)) from error
    except OSError as error:
        raise InputError(f"{arguments.noise}: {error.strerror}; name a noise file") from error
    if not arguments.scenario.is_file():
        raise InputError(f"{arguments.scenario}: there is no such scenario")
    study = Study(os.path.abspath(arguments.scenario), noise, arguments.seed,
                  str(arguments.noise))
    scene = scene_of(study)
    compiled: Any = importlib.import_module("soilvdb._soilvdb")
    for why in compiled._bad_rows(arguments.scenario):  # pylint: disable=protected-access
        print(f"soilvdb: warning: {why}; what is drawn ends before this row, as a run does",
              file=sys.stderr)
    try:
        (arguments.out / PARTS).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{arguments.out}: can't be made a folder: {error.strerror}; name "
                         "another") from error
    dug = scene.dig(None)
    grid = _grid(scene, dug)
    recorded = _recorded(scene, dug, grid)
    first, second = designs(study, arguments.draws)
    drawn = _all(study, recorded, first, second, grid, arguments)
    report = {"scenario": str(arguments.scenario), "draws": arguments.draws,
              "seed": arguments.seed, "sources": noise.sources(),
              **_report(scene, recorded, drawn.figures, arguments.draws, first, second)}
    _write(arguments.out, scene, recorded, drawn, report, grid)
    shutil.rmtree(arguments.out / PARTS)
    _print(report, arguments.out)
    if waited := sum(figures.waited > 0 for figures in drawn.figures[:arguments.draws]):
        print(f"soilvdb: warning: {waited} of {arguments.draws} draws come to ground without a "
              "height, and wait there; a terrain that has heights there would do", file=sys.stderr)
    return 0


def designs(study: Study, count: int) -> tuple[list[Draw], list[Draw]]:
    """The draws for the statistics, and a second design of the same realisations with each source
    in another order, for first-order indices (McKay's replicated design). The second is empty if
    there is only one source."""
    sources = study.noise.sources()
    first = [study.noise.draw(study.seed, number) for number in range(count)]
    if len(sources) < 2:
        return first, []
    random = np.random.default_rng(np.random.SeedSequence(study.seed, spawn_key=(count,)))
    orders = {source: random.permutation(count) for source in sources}
    return first, [study.noise.draw(study.seed, {s: int(orders[s][i]) for s in sources})
                   for i in range(count)]


class _Kept:
    """Finished draws in a folder, from which the same command continues."""

    def __init__(self, out: Path, made_of: object) -> None:
        digest = hashlib.sha256(pickle.dumps((soilvdb.__version__, made_of))).hexdigest()
        self.folder = out / PARTS
        self._name = digest[:16]

    def _file(self, index: int) -> Path:
        return self.folder / f"{self._name}.{index}"

    def parts(self, count: int) -> dict[int, Drawn]:
        """The existing parts of the tasks."""
        parts = {}
        for index in range(count):
            # Parts that a power cut damaged are dug again.
            with contextlib.suppress(OSError, EOFError, pickle.UnpicklingError):
                parts[index] = pickle.loads(self._file(index).read_bytes())
        return parts

    def add(self, index: int, drawn: Drawn) -> None:
        beside = self.folder / "next"
        beside.write_bytes(pickle.dumps(drawn))
        os.replace(beside, self._file(index))


def _all(study: Study, recorded: Recorded, first: Sequence[Draw], second: Sequence[Draw],
         grid: Grid, arguments: argparse.Namespace) -> Drawn:
    """Digs both designs; heights are those of the first."""
    tasks = [Task(study, tuple(tuple(draw.numbers.items()) for draw in design[i:i + TASK_DRAWS]),
                  on_grid)
             for design, on_grid in ((first, grid), (second, None))
             for i in range(0, len(design), TASK_DRAWS)]
    kept = _Kept(arguments.out, (study, recorded.figures, tasks))
    parts = kept.parts(len(tasks))
    left = [i for i in range(len(tasks)) if i not in parts]
    done = sum(len(tasks[i].draws) for i in parts)
    with (cluster.open_cluster(arguments.workers, arguments.scheduler) as workers,
          Progress("uncertainty", len(first) + len(second), "draws") as progress):
        for outcome in cluster.run_tasks(workers, draw_task, [tasks[i] for i in left]):
            if outcome.value is None:
                raise RuntimeError(str(outcome.error)) from outcome.error
            index = left[outcome.index]
            parts[index] = outcome.value
            kept.add(index, outcome.value)
            done += len(tasks[index].draws)
            progress.update(done)
    with_heights = [parts[i] for i, task in enumerate(tasks) if task.grid]
    sums = [np.sum([getattr(part, name) for part in with_heights], axis=0, dtype=np.int64)
            for name in ("count", "sum", "squares")]
    return Drawn([figures for i in range(len(tasks)) for figures in parts[i].figures], *sums)


def draw_task(task: Task) -> Drawn:
    """Digs some draws on a worker."""
    scene = scene_of(task.study)
    recorded = recorded_of(scene, task.grid)
    cells = len(recorded.heights)
    drawn = Drawn([], *(np.zeros(cells, dtype=np.int64) for _ in range(3)))
    for numbers in task.draws:
        dug = scene.dig(Draw(task.study.noise, task.study.seed, dict(numbers)))
        drawn.figures.append(_figures(scene, dug, recorded.cycles))
        if task.grid is None:
            drawn.figures[-1].forces = {}  # those of the first design are written
            continue
        rise = dug.site.mesh_heights(task.grid.places()) - recorded.heights
        known = np.isfinite(rise)
        grains = np.where(known, np.rint(np.where(known, rise, 0.0) / GRAINS_M), 0).astype(np.int64)
        drawn.count += known
        drawn.sum += grains
        drawn.squares += grains**2
    return drawn


_LAST: dict[str, Any] = {}


def recorded_of(scene: Scene, grid: Grid | None) -> Recorded:
    """The recorded scenario's results, cached in this process."""
    if _LAST.get("scene") is not scene or _LAST.get("grid") != grid:
        _LAST.update(scene=scene, grid=grid, recorded=_recorded(scene, scene.dig(None), grid))
    recorded: Recorded = _LAST["recorded"]
    return recorded


def _recorded(scene: Scene, dug: Dug, grid: Grid | None) -> Recorded:
    cycles = {name: _cycles(scene, dug, name) for name in scene.names}
    heights = dug.site.mesh_heights(grid.places()) if grid else np.empty(0)
    return Recorded(_figures(scene, dug, cycles), cycles, heights)


def instants(scene: Scene) -> Floats:
    """Times of the band, s."""
    begin = min(float(scene.motions[name]["times"][0]) for name in scene.names)
    return np.asarray(np.linspace(begin, scene.end_s, INSTANTS))


def _cycles(scene: Scene, dug: Dug, name: str) -> list[Cycle]:
    return cycles_of(dug.load_m3[name], dug.cut_m3[name], scene.motions[name]["times"],
                     sizes_n(dug.force[name]) if name in dug.force else None)


def _figures(scene: Scene, dug: Dug, cycles: dict[str, list[Cycle]]) -> Figures:
    at = instants(scene)
    loads, of_cycles = {}, {}
    for name in scene.names:
        times = scene.motions[name]["times"]
        loads[name] = np.interp(at, times, dug.load_m3[name], left=0.0)
        of_cycles[name] = nearest_cycles(cycles[name], _cycles(scene, dug, name))
    return Figures({name: float(load[-1]) for name, load in dug.load_m3.items()},
                   {name: float(cut[-1]) for name, cut in dug.cut_m3.items()},
                   dug.fill_m3, loads, of_cycles, dug.waited,
                   {name: largest_n(force) for name, force in dug.force.items()},
                   {name: force[kept_rows(len(force))].astype(np.float32)
                    for name, force in dug.force.items()})


def _grid(scene: Scene, dug: Dug) -> Grid:
    """The area of changed ground with a margin, or all ground without changes, as draws may dig
    there. Posts have the voxels' spacing, or a larger one on large sites."""
    box = scene.box()
    coarse = _grid_of(box, scene.nominal.voxel_size)
    places = coarse.places()
    before, after = (site.mesh_heights(places) for site in (scene.nominal, dug.site))
    changed = places[np.abs(after - before) > 1e-9]
    if not len(changed):
        return coarse
    margin = 2 * coarse.spacing_m + 0.5 + scene.spare_m()
    low, high = changed.min(axis=0) - margin, changed.max(axis=0) + margin
    return _grid_of((float(low[0]), float(low[1]), float(high[0]), float(high[1])),
                    scene.nominal.voxel_size)


def _grid_of(box: tuple[float, float, float, float], least_m: float) -> Grid:
    size = box[2] - box[0], box[3] - box[1]
    cell = max(least_m, float(np.sqrt(size[0] * size[1] / MOST_CELLS)))
    first = [cell * (np.floor(box[axis] / cell) + 0.5) for axis in (0, 1)]
    shape = [max(2, int(np.ceil(size[axis] / cell)) + 1) for axis in (0, 1)]
    return Grid((float(first[0]), float(first[1])), cell, (shape[0], shape[1]))


def sigma_of(drawn: Drawn, draws: int) -> Floats:
    """Sigma of heights, m; NaN where fewer than half of the draws have a height."""
    known = np.maximum(drawn.count, 2)
    mean = drawn.sum / known
    variance = np.maximum(0.0, drawn.squares / known - mean**2) * known / (known - 1)
    return np.where(2 * drawn.count > draws, GRAINS_M * np.sqrt(variance), np.nan)


def first_order(first: Floats, second: Floats) -> tuple[float, float]:
    """A first-order Sobol index from pairs with one common source, and its standard error (Janon et
    al. 2014). 0 without variance."""
    both = np.concatenate([first, second])
    if not np.ptp(both) > 0:
        return 0.0, 0.0
    variance = float(both.var())
    middle = float(both.mean())
    products = (first - middle) * (second - middle) / variance
    squares = ((first - middle)**2 + (second - middle)**2) / (2 * variance)
    index = float(products.mean())
    return index, float(np.std(products - index * squares) / np.sqrt(len(first)))


def _indices(first: Sequence[Draw], second: Sequence[Draw], values: Floats) -> dict[str, Any]:
    """The indices of each source. values: of the draws of both designs, in sequence."""
    count = len(first)
    indices = {}
    for source in first[0].numbers:
        if not second:
            indices[source] = (1.0 if np.ptp(values) > 0 else 0.0, 0.0)
            continue
        where = [draw.numbers[source] for draw in second]
        indices[source] = first_order(values[:count][where], values[count:])
    ordered = sorted(indices, key=lambda source: -indices[source][0])
    return {source: {"first_order": indices[source][0], "error": indices[source][1]}
            for source in ordered}


def _report(scene: Scene, recorded: Recorded, drawn: Sequence[Figures], count: int,
            first: Sequence[Draw], second: Sequence[Draw]) -> dict[str, Any]:
    own = recorded.figures
    machines = []
    for name in scene.names:
        one: dict[str, Any] = {"name": name}
        for key in ("bucket_m3", "cut_m3"):
            of_all = np.array([(f.load_m3 if key == "bucket_m3" else f.cut_m3)[name]
                               for f in drawn])
            recorded_value = (own.load_m3 if key == "bucket_m3" else own.cut_m3)[name]
            one[key] = {"recorded": recorded_value, **spread(of_all[:count]),
                        "sobol": _indices(first, second, of_all)}
        one["cycles"] = [
            {"begin_s": cycle.begin_s, "end_s": cycle.end_s,
             "draws": int(np.isfinite([f.cycles[name][i][0] for f in drawn[:count]]).sum()),
             "load_m3": {"recorded": cycle.load_m3,
                         **spread([f.cycles[name][i][0] for f in drawn[:count]])},
             "cut_m3": {"recorded": cycle.cut_m3,
                        **spread([f.cycles[name][i][1] for f in drawn[:count]])}}
            for i, cycle in enumerate(recorded.cycles[name])]
        if name in own.force_n:
            for i, cycle in enumerate(recorded.cycles[name]):
                one["cycles"][i]["force_n"] = {
                    "recorded": cycle.force_n,
                    **spread([f.cycles[name][i][2] for f in drawn[:count]])}
            of_all = np.array([f.force_n[name] for f in drawn])
            one["force_n"] = {"recorded": own.force_n[name], **spread(of_all[:count]),
                              "sobol": _indices(first, second, of_all)}
        machines.append(one)
    cuts = np.array([sum(f.cut_m3.values()) for f in drawn])
    fills = np.array([f.fill_m3 for f in drawn])
    return {"machines": machines,
            "cut_m3": {"recorded": sum(own.cut_m3.values()), **spread(cuts[:count]),
                       "sobol": _indices(first, second, cuts)},
            "fill_m3": {"recorded": own.fill_m3, **spread(fills[:count]),
                        "sobol": _indices(first, second, fills)}}


def _write(out: Path, scene: Scene, recorded: Recorded, drawn: Drawn, report: dict[str, Any],
           grid: Grid) -> None:
    count = report["draws"]
    soilvdb.write_raster(out / "height_sigma.tif",
                         sigma_of(drawn, count).reshape(grid.shape[1], grid.shape[0]), grid.first,
                         (grid.spacing_m, grid.spacing_m), scene.crs(), "height_sigma")
    plot_loads(out / "load.png", instants(scene),
               {name: np.array([f.loads_m3[name] for f in drawn.figures[:count]])
                for name in scene.names},
               {name: recorded.figures.loads_m3[name] for name in scene.names})
    with open(out / ".draws.tmp", "w", newline="", encoding="utf-8") as text:
        table = csv.writer(text, lineterminator="\n")
        table.writerow(["draw", "machine", "bucket_m3", "cut_m3", *["force_n"] * bool(scene.blades)])
        for number, figures in enumerate(drawn.figures[:count]):
            for name in scene.names:
                force = [figures.force_n.get(name, "")] if scene.blades else []
                table.writerow([number, name, figures.load_m3[name], figures.cut_m3[name], *force])
    os.replace(out / ".draws.tmp", out / "draws.csv")
    write_forces(out, {name: scene.motions[name]["times"] for name in scene.blades},
                 recorded.figures.forces, [figures.forces for figures in drawn.figures[:count]])
    (out / ".uncertainty.tmp").write_text(json.dumps(_without_nan(report), indent=2) + "\n",
                                          encoding="utf-8")
    os.replace(out / ".uncertainty.tmp", out / "uncertainty.json")


def _without_nan(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_nan(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_without_nan(each) for each in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value


def _print(report: dict[str, Any], out: Path) -> None:
    print(f"{report['scenario']}: {report['draws']} draws, seed {report['seed']}")
    for machine in report["machines"]:
        for number, cycle in enumerate(machine["cycles"][:MOST_CYCLES], 1):
            _print_figure(f"{machine['name']}: load {number}", cycle["load_m3"])
        if more := len(machine["cycles"][MOST_CYCLES:]):
            print(f"  and {more} more")
        for key, title in (("bucket_m3", "load at the end"), ("cut_m3", "cut")):
            _print_figure(f"{machine['name']}: {title}", machine[key])
        if "force_n" in machine:
            _print_figure(f"{machine['name']}: largest force", machine["force_n"], "kN", 1e-3)
    if report["fill_m3"]["sigma"] > 0:
        _print_figure("fill", report["fill_m3"])
    print(f"in {out}: {', '.join(name for name in FILES if (out / name).exists())}")


def _print_figure(title: str, figure: dict[str, Any], unit: str = "m3",
                  scale: float = 1.0) -> None:
    mean, sigma, p05, p95 = (scale * figure[key] for key in ("mean", "sigma", "p05", "p95"))
    of_mean = f" ({100 * sigma / abs(mean):.1f} %)" if mean else ""
    print(f"  {title:24} {mean:.4g} +- {sigma:.2g} {unit}{of_mean}, 5..95 %: {p05:.4g} .. "
          f"{p95:.4g}{_shares(figure.get('sobol', {})) if sigma > 0 else ''}")


def _shares(sobol: dict[str, dict[str, float]]) -> str:
    """The sources with the largest shares of a variance, by their 95 % intervals; those that may be
    none are not named."""
    shares = []
    for name, index in list(sobol.items())[:3]:
        low, high = (100 * (index["first_order"] + sign * 1.96 * index["error"]) for sign in (-1, 1))
        if low > 1:
            digits = f"{low:.0f}", f"{min(high, 100):.0f}"
            shares.append(f"{name} {'..'.join(dict.fromkeys(digits))} %")
    if not shares:
        return "; more draws would tell of what" if sobol else ""
    return f"; of {', '.join(shares)}"
