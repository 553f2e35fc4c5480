# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Many sites of one model in one call, for learning."""

from __future__ import annotations

import contextlib
import dataclasses
import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Union

import numpy as np
import numpy.typing as npt

from ._arrays import view_of
from ._errors import NoGroundError, StateError
from ._soilvdb import (
    Site,
    Soil,
    Terrain,
    _array,
    _step_sites,
    height_maps,
    plane,
    raster,
    resistances,
)

if TYPE_CHECKING:
    from ._soilvdb import _Bases, _Layer, _Numbers, _Out, _Poses, _Rows

Floats = npt.NDArray[np.float64]
_State = Union[Site, bytes]  # read by Python 3.9


@dataclasses.dataclass(frozen=True)
class Steps:
    """Results of VectorSite.step(), arrays (count,) with an item for each site.

    cut_m3, float64: cut from the ground, in place, m3. bucket_m3: load afterwards, loose, m3; that
    of a refused site is its load before. spilled_m3: left the bucket, loose, m3. slid_m3: moved by
    slopes that failed, loose, m3. status, int8: 0 done, 1 refused, 2 refused because the bucket
    would reach ground without a height, 3 failed, as where a site is closed. errors: for each site,
    by number, whose status is not 0, the error that Site.update() would raise.
    """

    cut_m3: Floats
    bucket_m3: Floats
    spilled_m3: Floats
    slid_m3: Floats
    status: npt.NDArray[np.int8]
    errors: dict[int, StateError | NoGroundError | RuntimeError]


class VectorSite:
    """Many sites of one model, as learners want them: arrays in, arrays out, on all cores.

        env = soilvdb.VectorSite(site, 64)
        steps = env.step("digger", positions=positions, rotations=rotations)
        maps = env.height_map(machine="digger", shape=(16, 16), cell=0.2)
        env.reset(steps.bucket_m3 > 0.8)

    site: what all begin as; it is cloned. threads: default: all cores. Results do not depend on the
    number of threads, and a site's results not on the others. Arrays belong to Python; other
    libraries take them over without a copy by DLPack or the buffer protocol.
    """

    def __init__(self, site: Site, count: int, *, threads: int | None = None) -> None:
        """count sites, clones of site. Raises ValueError for a count or threads of less than 1,
        RuntimeError for a site that is closed or whose memory is limited.
        """
        if not isinstance(site, Site):
            raise TypeError(f"site must be soilvdb.Site, not {type(site).__name__}")
        number = _whole(count)
        if number is None or number < 1:
            raise ValueError(f"count is {count!r}; it must be a whole number, 1 or more")
        self._threads = None if threads is None else _whole(threads)
        if threads is not None and self._threads is None:
            raise TypeError(f"threads must be int or None, not {type(threads).__name__}")
        if self._threads is not None and not 1 <= self._threads <= 1024:
            raise ValueError(f"threads is {threads}; it must be 1 to 1024")
        self._starts = [site.clone()] * number
        self._sites = tuple(start.clone() for start in self._starts)
        self._told: set[str] = set()  # warnings of steps

    @property
    def count(self) -> int:
        """Number of sites."""
        return len(self._sites)

    @property
    def sites(self) -> tuple[Site, ...]:
        """The sites as they are now; reset() and randomise() put others in their place."""
        return self._sites

    def step(self, machine: int | str, *, positions: _Rows | None = None,
             rotations: _Rows | None = None, poses: _Poses | None = None,
             joints: _Rows | Mapping[str, _Numbers] | None = None, base: _Bases | None = None,
             times: float | _Numbers | None = None) -> Steps:
        """One update of a machine in each site. A site whose state is refused stays as it is and
        says why; the others move. Warnings of sites come once, with the number of the first.

        One of: positions (count, 3) with or without rotations (count, 4); poses (count, 4, 4);
        joints (count, joints), or by name, with or without base: (positions, rotations) of the
        machine's base, or (count, 4, 4). times: (count,), or one for all, s. Raises TypeError for
        what is not numbers, and ValueError for a machine that is unknown or arrays of another shape;
        then none has moved. A dict that is not of the machine's joints is a StateError for all.
        After KeyboardInterrupt the first sites may have moved.
        """
        if times is not None:
            times = _per_site("times", times, (self.count,))
        columns, errors = _step_sites(self._sites, machine, positions, rotations, poses, joints,
                                      base, times, self._threads, self._told)
        return Steps(**columns, errors=errors)

    def height_map(self, *, machine: int | str | None = None, origin: _Numbers | None = None,
                   pose: _Rows | _Poses | None = None, shape: tuple[int, int], cell: float,
                   turned: bool = True, layer: _Layer = "height", ceiling: float | None = None,
                   design: Terrain | None = None, out: _Out | None = None) -> npt.NDArray[Any]:
        """Site.height_map() of each site: (count, ny, nx) float64, or `out`, filled. One of: machine,
        origin (x, y), pose, (4, 4) for all or (count, 4, 4). A site whose machine has no place yet,
        as after randomise(), has a map of NaN. Raises the errors of soilvdb.height_maps().
        """
        return height_maps(self._sites, machine=machine, origin=origin, pose=pose, shape=shape,
                           cell=cell, turned=turned, layer=layer, ceiling=ceiling, design=design,
                           out=out, threads=self._threads)

    def resistance(self, machine: int | str = 0, *, soil: Soil | None = None,
                   crescents: bool = True) -> tuple[Floats, Floats]:
        """Site.resistance() of each site: forces, N, and moments, N m, each (count, 3), on the
        bucket in its frame; NaN before the machine's first state. Not in them: rate, water, rock,
        the shape of teeth.
        """
        return resistances(self._sites, machine, soil=soil, crescents=crescents,
                           threads=self._threads)

    def loads(self, machine: int | str) -> Floats:
        """Load of a machine's bucket in each site, loose, m3: (count,)."""
        loads = np.empty(self.count)
        for i, site in enumerate(self._sites):
            with _of_site(i):
                loads[i] = site.ledger(machine)["bucket_m3"]
        return loads

    def reset(self, mask: Any = None,
              states: _State | Sequence[_State] | None = None) -> None:
        """Sites begin anew.

        mask: (count,) of bool, or numbers of sites; default: all. states: what they begin as, each a
        Site of the same machines, which is cloned in some microseconds, or bytes of Site.save(): one
        for all, or one per site that begins anew. A machine that has a place there digs its way to
        its next state; Site.place() lifts it off. Default: what the site began as, or what randomise() made of it.
        Raises ValueError for a state of another model; then nothing has changed.
        """
        which = self._numbers(mask)
        if states is None:
            given: Sequence[_State] = [self._starts[i] for i in which]
        elif isinstance(states, (Site, bytes)):
            given = [states] * len(which)
        elif isinstance(states, (bytearray, memoryview, str)):
            raise TypeError(f"states must be soilvdb.Site or bytes, not {type(states).__name__}")
        else:
            given = list(states)
        if len(given) != len(which):
            raise ValueError(f"there are {len(given)} states for {len(which)} sites")
        changed = {}
        for i, state in zip(which, given):
            with _of_site(i):
                changed[i] = self._begun(i, state)
        self._put(changed)

    def randomise(self, mask: Any = None, *, repose_angle: Any = None, swell: Any = None,
                  density: Any = None, cohesion: Any = None, friction_angle: Any = None,
                  tool_friction: Any = None, adhesion: Any = None, z: Any = None,
                  slope: Any = None, heights: Any = None, origin: Any = None,
                  cell: float | None = None) -> None:
        """Sites begin anew on untouched ground, each in its own soil and on its own terrain; no
        machine has a place yet. reset() then begins from there.

        mask: as for reset(). repose_angle to adhesion: properties of Soil, each one for all or
        (n,) for the n sites that begin anew. One that is left out keeps its value, nan sets it to
        its default; repose_angle makes rigid soil move. z, (n,), and slope, (n, 2): planes, with 0
        for the one that is left out. heights: (n, ny, nx) in place of these, with origin and cell as
        in raster(). Without any the terrain stays. Raises ValueError for impossible values, or if the sites come from Site.open();
        then nothing has changed.
        """
        which = self._numbers(mask)
        soils = {name: _per_site(name, values, (len(which),)) for name, values in (
            ("repose_angle", repose_angle), ("swell", swell), ("density", density),
            ("cohesion", cohesion), ("friction_angle", friction_angle),
            ("tool_friction", tool_friction), ("adhesion", adhesion)) if values is not None}
        terrain_of = _terrains(len(which), z, slope, heights, origin, cell)
        starts: dict[int, Site] = {}
        for n, i in enumerate(which):
            parts = self._starts[i]._made_from
            if len(parts) == 1:
                raise ValueError("sites of Site.open() can't be randomised; make one by Site()")
            voxel_size, _, machines, soil, pours, hoppers, near = parts
            with _of_site(i):
                if soils:
                    soil = _soil(soil, {name: float(values[n]) for name, values in soils.items()})
                if terrain_of is None:
                    starts[i] = self._starts[i]._anew(soil)
                else:
                    starts[i] = Site(voxel_size, terrain_of(n), machines, soil=soil, pours=pours,
                                     hoppers=hoppers, near=near, limits=self._starts[i].limits)
        for i, start in starts.items():
            self._starts[i] = start
        self._put({i: start.clone() for i, start in starts.items()})

    def _numbers(self, mask: Any) -> list[int]:
        if mask is None:
            return list(range(self.count))
        given = np.asarray(mask)
        if given.dtype == object and hasattr(mask, "__dlpack__"):
            given = np.asarray(view_of(mask))
        if given.dtype == bool:
            if given.shape != (self.count,):
                raise ValueError(f"mask has the shape {given.shape}; it must be ({self.count},)")
            return [int(i) for i in np.flatnonzero(given)]
        if given.size == 0:
            return []
        if given.ndim != 1 or given.dtype.kind not in "iu":
            raise ValueError("mask must be an array of bool, or of numbers of sites")
        numbers = [int(i) for i in given]
        if min(numbers) < 0 or max(numbers) >= self.count or len(set(numbers)) < len(numbers):
            raise ValueError(f"mask must name sites from 0 to {self.count - 1}, each once")
        return numbers

    def _begun(self, number: int, state: _State) -> Site:
        start = self._starts[number]
        if isinstance(state, bytes):
            site = start.clone()
            site.restore(state)
            return site
        if not isinstance(state, Site):
            raise TypeError(f"states must be soilvdb.Site or bytes, not {type(state).__name__}")
        site = state.clone()
        if site.voxel_size != start.voxel_size or not start._has_machines_of(site):
            raise ValueError("the state is of other machines or another voxel size")
        site.limits = start.limits
        return site

    def _put(self, changed: Mapping[int, Site]) -> None:
        self._sites = tuple(changed.get(i, site) for i, site in enumerate(self._sites))


@contextlib.contextmanager
def _of_site(number: int) -> Iterator[None]:
    """Errors say of which site they are."""
    try:
        yield
    except (ValueError, RuntimeError) as error:
        raise type(error)(f"site {number}: {error}") from None


def _whole(given: Any) -> int | None:
    """A whole number, also one of NumPy; None if it is no number, or a bool."""
    if isinstance(given, (bool, np.bool_)):
        return None
    try:
        return operator.index(given)
    except TypeError:
        return None


def _per_site(name: str, values: Any, shape: tuple[int, ...]) -> Floats:
    given = _array(values, name)
    try:
        return np.broadcast_to(given, shape)
    except ValueError:
        raise ValueError(f"{name} has the shape {given.shape}; it must be {shape}") from None


def _soil(soil: Soil | None, changed: Mapping[str, float]) -> Soil:
    names = ("repose_angle", "swell", "density", "cohesion", "friction_angle", "tool_friction",
             "adhesion")
    values = {} if soil is None else {name: getattr(soil, name) for name in names}
    values.update(changed)
    if "repose_angle" not in values:
        raise ValueError("the soil is rigid; it needs a repose_angle")
    if np.isnan(values["repose_angle"]):
        raise ValueError("repose_angle is nan; it has no default")
    return Soil(**{name: value for name, value in values.items()
                   if value is not None and not np.isnan(value)})


def _terrains(count: int, z: Any, slope: Any, heights: Any, origin: Any,
              cell: float | None) -> Callable[[int], Terrain] | None:
    """Makes the terrain of each; None: it stays."""
    if heights is not None:
        if z is not None or slope is not None:
            raise TypeError("give either heights or z and slope")
        given = _array(heights, "heights")
        if given.ndim != 3 or given.shape[0] != count:
            raise ValueError(f"heights has the shape {given.shape}; it must be ({count}, ny, nx)")
        return lambda n: raster(given[n], origin=origin, cell=cell)
    if origin is not None or cell is not None:
        raise TypeError("origin and cell are for heights")
    if z is None and slope is None:
        return None
    rises = _per_site("z", 0.0 if z is None else z, (count,))
    slopes = _per_site("slope", (0.0, 0.0) if slope is None else slope, (count, 2))
    return lambda n: plane(float(rises[n]), slopes[n])
