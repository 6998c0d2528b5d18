"""The data of the training: a degraded cloud of each object, and maps of that cloud's meshes.

A mesh takes about a second, so a cloud is degraded once, not anew in each step, and the maps are
kept in files.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from baselines.fused_net.renderer import OCCUPANCY, maps_of, reconstruct, reconstructors
from data_prep.datasets.objects import SceneObject
from data_prep.datasets.training_set import DATA_SEED, SurfaceSet, TrainingSet
from data_prep.failures import BadInput
from data_prep.randomness import generator
from data_prep.rendering.raycast import MAPS, MOST_NEARNESS
from data_prep.scene import IMAGE_SIZE, PointCloud, View
from learning.clouds import degrade
from learning.weights import FILES, read_safetensors, write_atomically

FORMAT = "fused-net-maps-2"
FOLDER = "maps"
TOGETHER = 50  # objects of a file: so many are computed again after an interruption
# A byte is value * scale + zero: quarters of coverage are exact, and so is nothing.
_SCALES = np.array([252, 255 / MOST_NEARNESS, 127, 127, 127], np.float32)
_ZEROS = np.array([0, 0, 128, 128, 128], np.float32)


@dataclass(frozen=True, eq=False)
class FusedSet:
    """N objects with their images, a cloud of each, and maps of its meshes in each view.

    surfaces  the objects; their clouds [N, M, 3] are degraded, and of an object with fewer than M
              points the last ones are zeros
    counts    int64 [N], points of each
    noise     float32 [N], standard deviation of the noise of each
    maps      uint8 [N, V, 5 * meshes, S, S], see `encode`
    """

    surfaces: SurfaceSet
    counts: NDArray[np.int64]
    noise: NDArray[np.float32]
    maps: NDArray[np.uint8]


def fused_set(
    surfaces: SurfaceSet,
    objects: Sequence[SceneObject],
    meshes: Sequence[str],
    out_dir: Path,
    *,
    augment: bool = True,
    on_progress: Callable[[], object] = lambda: None,
) -> FusedSet:
    """Return a set with one cloud of each object, degraded unless `augment` is off.

    Maps are kept in `out_dir`, and taken from there if they are of the same clouds, views, meshes
    and weights of occupancy-net; `on_progress` is called after each object.

    Raises BadInput where the files of `out_dir` are of others.
    """
    count, most, _ = surfaces.seen.clouds.shape
    clouds = np.zeros((count, most, 3), np.float32)
    counts, noise = np.full(count, most), np.zeros(count, np.float32)
    for i, obj in enumerate(objects):
        cloud = torch.from_numpy(surfaces.seen.clouds[i : i + 1])
        if augment:
            key = generator("fused cloud", DATA_SEED, obj.class_name, obj.object_id)
            random = torch.Generator().manual_seed(int(key.integers(2**62)))
            cloud, clean = degrade(cloud, random)
            counts[i], noise[i] = cloud.shape[1], (cloud - clean).std()
        clouds[i, : counts[i]] = cloud[0].numpy()
    seen = replace(surfaces.seen, clouds=clouds)
    maps = _all_maps(seen, counts, meshes, out_dir / FOLDER, on_progress)
    return FusedSet(replace(surfaces, seen=seen), counts, noise, maps)


def occupancy_weights(meshes: Sequence[str]) -> str:
    """Return the checksum of the weights of occupancy-net, "" if its mesh is not among these."""
    return FILES["baselines.occupancy_net"].bundled[OCCUPANCY] if "occupancy-net" in meshes else ""


def encode(maps: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return maps [..., 5 * meshes, S, S] as bytes."""
    repeats = maps.shape[-3] // len(MAPS)
    scales, zeros = (np.tile(values, repeats)[:, None, None] for values in (_SCALES, _ZEROS))
    return np.rint(maps * scales + zeros).astype(np.uint8)


def decode(maps: Tensor) -> Tensor:
    """Return the maps, float32, that `encode` has stored as bytes."""
    repeats = maps.shape[-3] // len(MAPS)
    scales, zeros = (
        torch.from_numpy(np.tile(values, repeats)).to(maps.device)[:, None, None]
        for values in (_SCALES, _ZEROS)
    )
    return (maps.float() - zeros) / scales


def mirror(maps: Tensor) -> Tensor:
    """Return the maps [..., 5 * meshes, S, S] of the mirrored meshes from the opposite azimuth."""
    flipped = maps.flip(-1)
    flipped[..., MAPS.index("normal x") :: len(MAPS), :, :] *= -1
    return flipped


def _all_maps(
    seen: TrainingSet,
    counts: NDArray[np.int64],
    meshes: Sequence[str],
    folder: Path,
    on_progress: Callable[[], object],
) -> NDArray[np.uint8]:
    """Return the maps of all objects, of files or computed and kept, TOGETHER a file."""
    objects, views = seen.azimuth_deg.shape
    shape = (objects, views, len(MAPS) * len(meshes), IMAGE_SIZE, IMAGE_SIZE)
    maps = np.empty(shape, np.uint8)
    methods = reconstructors(meshes)
    for start in range(0, objects, TOGETHER):
        some = range(start, min(start + TOGETHER, objects))
        path = folder / f"{start:06d}.safetensors"
        header = {"format": FORMAT, "of": _identity(seen, counts, meshes, some)}
        if path.exists():
            maps[start : some.stop] = _read(path, header, maps[start : some.stop].shape)
        for i in some:
            if not path.exists():
                angles = zip(seen.azimuth_deg[i], seen.elevation_deg[i], strict=True)
                cloud = PointCloud(seen.clouds[i, : counts[i]])
                reconstructed, _ = reconstruct(cloud, methods)
                maps[i] = encode(maps_of(reconstructed, [View(*pair) for pair in angles]))
            on_progress()
        if not path.exists():
            kept = torch.from_numpy(maps[start : some.stop])
            write_atomically(path, {"maps": kept}, header)
    return maps


def _identity(
    seen: TrainingSet, counts: NDArray[np.int64], meshes: Sequence[str], some: range
) -> str:
    """Return a checksum of all that the maps of some objects depend on."""
    digest = hashlib.sha256(repr((*meshes, occupancy_weights(meshes))).encode())
    for array in (seen.azimuth_deg, seen.elevation_deg, seen.clouds, counts):
        digest.update(np.ascontiguousarray(array[some.start : some.stop]).tobytes())
    return digest.hexdigest()


def _read(path: Path, header: dict[str, str], shape: tuple[int, ...]) -> NDArray[np.uint8]:
    tensors, kept_header = read_safetensors(path)
    maps = tensors.get("maps")
    if kept_header != header or maps is None or maps.shape != shape or maps.dtype != torch.uint8:
        raise BadInput(
            f"{path}: its maps are of other clouds, views, meshes or weights of occupancy-net; "
            f"use another output directory, or remove {path.parent}"
        )
    return maps.numpy()
