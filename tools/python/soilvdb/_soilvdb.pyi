# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
import os
from collections.abc import Iterable, Mapping, Sequence
from types import TracebackType
from typing import Any, Final, Literal, overload

import numpy as np
import numpy.typing as npt

from ._arrays import DLPack
from ._force import Wrench
from ._scan import ByMachine

__version__: str

_Array = npt.NDArray[np.floating[Any]] | npt.NDArray[np.integer[Any]] | DLPack
_Out = npt.NDArray[Any] | DLPack | memoryview
_Numbers = Sequence[float] | _Array
_Path = str | os.PathLike[str]
_Layer = Literal["height", "loose", "dug", "design"]
_Joints = _Numbers | Mapping[str, float]
_Rows = Sequence[_Numbers] | _Array
_Base = tuple[_Numbers, _Numbers] | _Rows
_Poses = Sequence[_Rows] | _Array
_Bases = tuple[_Rows, _Rows] | _Poses

class Bucket:
    def __init__(
        self,
        width: float,
        height: float,
        profile: _Rows | None = ...,
        dump_angle: float | None = ...,
        *,
        edge: float = ...,
        plate: float = ...,
    ) -> None: ...
    @staticmethod
    def from_mesh(
        file: _Path,
        *,
        lip: _Rows,
        upper: _Numbers | None = ...,
        unit: float = ...,
        dump_angle: float | None = ...,
    ) -> Bucket: ...
    @staticmethod
    def pose_in_mesh(
        file: _Path, *, lip: _Rows, upper: _Numbers | None = ..., unit: float = ...
    ) -> npt.NDArray[np.float64]: ...
    width: Final[float]
    height: Final[float]
    profile: Final[list[tuple[float, float]]]
    dump_angle: Final[float | None]
    edge: Final[float]
    plate: Final[float]
    capacity: Final[tuple[float, float] | None]

class Machine:
    def __init__(
        self,
        bucket: Bucket,
        name: str = ...,
        *,
        urdf: _Path | None = ...,
        link: str = ...,
        base: _Rows | None = ...,
        lip: _Rows | None = ...,
    ) -> None: ...
    name: Final[str]
    bucket: Final[Bucket]
    joints: Final[list[str]]

class Terrain: ...

def plane(z: float = ..., slope: _Numbers | None = ...) -> Terrain: ...
def raster(
    source: _Path | _Rows, *, origin: _Numbers | None = ..., cell: float | None = ...
) -> Terrain: ...
def snapshot(file: _Path) -> Terrain: ...
def tool(mesh: _Path, voxel: float) -> Bucket: ...
def motions(scenario: _Path) -> dict[str, dict[str, Any]]: ...
def points(file: _Path) -> npt.NDArray[np.float64]: ...
def read_raster(
    file: _Path, box: _Numbers | None = ...
) -> tuple[npt.NDArray[np.float32], tuple[float, float], tuple[float, float], str]: ...
def write_raster(
    file: _Path,
    heights: _Rows,
    first: _Numbers,
    spacing: _Numbers,
    crs: str = ...,
    band: str = ...,
) -> None: ...

class Soil:
    def __init__(
        self,
        repose_angle: float | None = ...,
        swell: float = ...,
        density: float = ...,
        cohesion: float | None = ...,
        friction_angle: float | None = ...,
        *,
        tool_friction: float | None = ...,
        adhesion: float = ...,
    ) -> None: ...
    repose_angle: Final[float | None]
    swell: Final[float]
    density: Final[float]
    cohesion: Final[float | None]
    friction_angle: Final[float | None]
    tool_friction: Final[float | None]
    adhesion: Final[float]

class Pour:
    def __init__(self, at: _Numbers, volume: float, time: _Numbers, name: str = ...) -> None: ...

class Hopper:
    def __init__(
        self, box: _Numbers, top: float, time: _Numbers | None = ..., name: str = ...
    ) -> None: ...

class Update:
    cut_m3: Final[float]
    bucket_m3: Final[float]
    spilled_m3: Final[float]
    slid_m3: Final[float]
    us: Final[float]

class Patch:
    block: Final[tuple[int, int, int]]
    points: Final[npt.NDArray[np.float64]]
    triangles: Final[npt.NDArray[np.uint32]]

class Volume:
    cut_m3: Final[float]
    fill_m3: Final[float]
    net_m3: Final[float]
    error_m3: Final[float]
    area_m2: Final[float]
    design_area_m2: Final[float | None]
    to_cut_m3: Final[float | None]
    to_fill_m3: Final[float | None]
    sigma_m3: Final[float | None]

class Site:
    def __init__(
        self,
        voxel_size: float,
        terrain: Terrain,
        machines: Iterable[Bucket | Machine],
        *,
        soil: Soil | None = ...,
        pours: Iterable[Pour] = ...,
        hoppers: Iterable[Hopper] = ...,
        near: _Numbers | None = ...,
        limits: bool = ...,
    ) -> None: ...
    @staticmethod
    def open(scenario: _Path, *, limits: bool = ...) -> Site: ...
    limits: bool
    _made_from: Final[tuple[Any, ...]]
    def _anew(self, soil: Soil | None) -> Site: ...
    def _has_machines_of(self, other: Site) -> bool: ...
    def update(
        self,
        machine: int | str,
        *,
        position: _Numbers | None = ...,
        rotation: _Numbers | None = ...,
        pose: _Rows | None = ...,
        joints: _Joints | None = ...,
        base: _Base | None = ...,
        time: float | None = ...,
    ) -> Update: ...
    def place(
        self,
        machine: int | str,
        *,
        position: _Numbers | None = ...,
        rotation: _Numbers | None = ...,
        pose: _Rows | None = ...,
        joints: _Joints | None = ...,
        base: _Base | None = ...,
        time: float | None = ...,
    ) -> Update: ...
    def update_path(
        self,
        machine: int | str,
        *,
        positions: _Rows | None = ...,
        rotations: _Rows | None = ...,
        poses: _Poses | None = ...,
        joints: _Rows | Mapping[str, _Numbers] | None = ...,
        base: _Bases | None = ...,
        times: _Numbers | None = ...,
    ) -> dict[str, npt.NDArray[np.float64]]: ...
    def joints(self, machine: int | str) -> list[str]: ...
    def base(
        self, machine: int | str
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]: ...
    def pose(
        self,
        machine: int | str,
        joints: _Joints | _Rows | Mapping[str, _Numbers] | None = ...,
        base: _Base | _Bases | None = ...,
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]: ...
    def pour(self, until: float) -> None: ...
    def reset_clock(self, machine: int | str) -> None: ...
    def come_to_rest(self) -> None: ...
    @overload
    def heights(
        self, xy: _Rows, *, sigma: Literal[False] = ..., ceiling: float | None = ...
    ) -> npt.NDArray[np.float64]: ...
    @overload
    def heights(
        self, xy: _Rows, *, sigma: Literal[True], ceiling: float | None = ...
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]: ...
    def scan(
        self,
        sensor: Sensor,
        points: _Rows | None = ...,
        *,
        depth: _Rows | None = ...,
        intrinsics: _Numbers | None = ...,
        world: bool = ...,
    ) -> None: ...
    def apply_scans(self) -> Survey: ...
    def heap(self, boundary: _Rows) -> Heap: ...
    def cut_m3(self, machine: int | str = ...) -> tuple[float, float]: ...
    def survey(
        self,
        terrain: Terrain,
        *,
        boundary: _Rows | None = ...,
        trust_heights: bool = ...,
    ) -> SurveyedGround: ...
    def mesh_heights(self, xy: _Rows) -> npt.NDArray[np.float64]: ...
    def height_map(
        self,
        *,
        machine: int | str | None = ...,
        origin: _Numbers | None = ...,
        pose: _Rows | None = ...,
        shape: tuple[int, int],
        cell: float,
        turned: bool = ...,
        layer: _Layer = ...,
        ceiling: float | None = ...,
        design: Terrain | None = ...,
        out: _Out | None = ...,
    ) -> npt.NDArray[Any]: ...
    def cast(
        self, origins: _Rows | _Numbers, directions: _Numbers | _Rows
    ) -> npt.NDArray[np.float64]: ...
    def resistance(
        self, machine: int | str = ..., *, soil: Soil | None = ..., crescents: bool = ...
    ) -> Resistance: ...
    def cut_geometry(self, machine: int | str = ...) -> CutGeometry: ...
    def torques(
        self, machine: int | str = ..., *, soil: Soil | None = ..., crescents: bool = ...
    ) -> npt.NDArray[np.float64]: ...
    def volume(
        self, boundary: _Rows, *, design: Terrain | None = ..., sigma: bool = ...
    ) -> Volume: ...
    def mesh(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.uint32]]: ...
    def changed_patches(self) -> list[Patch]: ...
    def ledger(self, machine: int | str | None = ...) -> dict[str, float]: ...
    def change_m3(self) -> float: ...
    def ground_hash(self) -> int: ...
    voxel_size: Final[float]
    machines: Final[list[str]]
    soil: Final[Soil | None]
    def write(self, file: _Path) -> None: ...
    def save(self) -> bytes: ...
    def restore(self, state: bytes) -> None: ...
    def clone(self) -> Site: ...
    def record(
        self,
        folder: _Path,
        *,
        sync: float | None = ...,
        snapshot_every: float | None = ...,
        incremental: bool | None = ...,
        keep: int | None = ...,
    ) -> tuple[int, float]: ...
    @property
    def acknowledged(self) -> tuple[int, float]: ...
    def flush(self) -> None: ...
    def stop_recording(self) -> None: ...
    def limit_memory(self, megabytes: float, folder: _Path) -> None: ...
    def close(self) -> None: ...
    def __enter__(self) -> Site: ...
    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...

class Sensor:
    def __init__(
        self,
        *,
        position: _Numbers | None = ...,
        rotation: _Numbers | None = ...,
        pose: _Rows | None = ...,
        name: str = ...,
        range_sigma: float | None = ...,
        range_squared_sigma: float | None = ...,
        mount_height_sigma: float = ...,
        mount_tilt_sigma: float = ...,
        mount_scale_sigma: float = ...,
        noise: str | None = ...,
        pose_shift_sigma: float = ...,
        pose_turn_sigma: float = ...,
        max_range: float | None = ...,
    ) -> None: ...
    name: Final[str]
    position: Final[npt.NDArray[np.float64]]
    rotation: Final[npt.NDArray[np.float64]]
    range_sigma: Final[float]
    range_squared_sigma: Final[float]
    mount_height_sigma: Final[float]
    mount_tilt_sigma: Final[float]
    mount_scale_sigma: Final[float]
    pose_shift_sigma: Final[float]
    pose_turn_sigma: Final[float]
    max_range: Final[float]

class Survey:
    removed_m3: Final[float]
    added_m3: Final[float]
    sigma_m3: Final[float]
    lip_error: Final[ByMachine]
    rays: Final[dict[str, int]]

class Heap:
    swell: Final[tuple[float, float]]
    repose_angle: Final[tuple[float, float]]
    loose_m3: Final[tuple[float, float]]
    bank_m3: Final[tuple[float, float]]

class SurveyedGround:
    area_m2: Final[float]
    removed_m3: Final[float]
    added_m3: Final[float]
    voids: Final[float]
    outside: Final[float]

class Resistance:
    force: Final[npt.NDArray[np.float64]]
    moment: Final[npt.NDArray[np.float64]]
    world: Final[Wrench]
    parts: Final[dict[str, Wrench]]
    jacobian: Final[npt.NDArray[np.float64]]
    angle: Final[float]
    depth_m: Final[float]
    limited: Final[str]

class CutGeometry:
    def resistance(self, soil: Soil, *, crescents: bool = ...) -> Resistance: ...

def resistances(
    sites: Iterable[Site],
    machine: int | str = ...,
    *,
    soil: Soil | Iterable[Soil] | None = ...,
    crescents: bool = ...,
    threads: int | None = ...,
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]: ...
def height_maps(
    sites: Iterable[Site],
    *,
    machine: int | str | None = ...,
    origin: _Numbers | None = ...,
    pose: _Rows | _Poses | None = ...,
    shape: tuple[int, int],
    cell: float,
    turned: bool = ...,
    layer: _Layer = ...,
    ceiling: float | None = ...,
    design: Terrain | None = ...,
    out: _Out | None = ...,
    threads: int | None = ...,
) -> npt.NDArray[Any]: ...
def _array(given: Any, name: str) -> npt.NDArray[np.float64]: ...
def _step_sites(
    sites: tuple[Site, ...],
    machine: int | str,
    positions: Any,
    rotations: Any,
    poses: Any,
    joints: Any,
    base: Any,
    times: Any,
    threads: int | None,
    told: set[str],
) -> tuple[dict[str, npt.NDArray[Any]], dict[int, Any]]: ...
def update_many(
    sites: Iterable[Site],
    machine: int | str,
    *,
    positions: _Rows | None = ...,
    rotations: _Rows | None = ...,
    poses: _Poses | None = ...,
    joints: _Rows | Mapping[str, _Numbers] | None = ...,
    base: _Bases | None = ...,
    times: _Numbers | None = ...,
    time: float | None = ...,
) -> list[Update]: ...
