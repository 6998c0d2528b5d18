"""The training data of fused-net: a degraded cloud of each object, and maps of the cloud's meshes.

A map is what a camera sees of a mesh (`data_prep.rendering.raycast.surface_maps`). Reconstructing a
mesh takes about a second. So each object has one degraded cloud for the whole training, and maps
are kept in files.
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

from baselines.fused_net.renderer import OCCUPANCY, UPSAMPLER, maps_of, reconstruct, reconstructors
from baselines.fused_net.weights import MESHES
from data_prep.datasets.objects import SceneObject
from data_prep.datasets.training_set import DATA_SEED, SurfaceSet, TrainingSet
from data_prep.failures import BadInput
from data_prep.randomness import generator
from data_prep.rendering.raycast import MAPS, MOST_NEARNESS
from data_prep.scene import IMAGE_SIZE, PointCloud, View
from learning.clouds import degrade
from learning.tensor_files import read_safetensors, write_atomically
from learning.weights import FILES

FORMAT = "fused-net-maps-2"  # of the files of maps, in their headers
FOLDER = "maps"  # where they are, below the output directory of the training
TOGETHER = 50  # objects in a file: at most so many are computed again after an interruption
# A map is stored as the byte value * scale + zero, one pair of numbers for each of the five MAPS.
# The scales make 0, and the quarters that coverages are multiples of, whole numbers.
_SCALES = np.array([252, 255 / MOST_NEARNESS, 127, 127, 127], np.float32)
_ZEROS = np.array([0, 0, 128, 128, 128], np.float32)


@dataclass(frozen=True, eq=False)
class FusedSet:
    """N objects with V images each, a degraded cloud of each, and maps of its meshes in each view.

    surfaces  the objects with their images. Their clouds [N, M, 3] are degraded; where a cloud has
              fewer than M points, zeros follow
    counts    int64 [N], number of points of each cloud
    noise     float32 [N], standard deviation of the noise of each cloud, in unit-sphere units
    maps      uint8 [N, V, 5 * meshes, S, S], as `encode` returns them
    """

    surfaces: SurfaceSet
    counts: NDArray[np.int64]
    noise: NDArray[np.float32]
    maps: NDArray[np.uint8]


def fused_set(
    surfaces: SurfaceSet,
    objects: Sequence[SceneObject],
    out_dir: Path,
    *,
    augment: bool = True,
    on_progress: Callable[[], object] = lambda: None,
) -> FusedSet:
    """Return the training set of objects, each with one cloud and the maps of its meshes.

    surfaces     the objects' images and whole clouds
    out_dir      where maps are kept. Maps that are there already are used, if they are of the same
                 clouds and views, and of the same weights of the networks that make meshes
    augment      whether clouds are degraded: fewer points, and noise
    on_progress  called after each object

    Raises BadInput where maps in `out_dir` are of other clouds, views or weights.
    """
    count, most, _ = surfaces.seen.clouds.shape
    clouds = np.zeros((count, most, 3), np.float32)
    counts = np.full(count, most)
    noise = np.zeros(count, np.float32)
    for i, obj in enumerate(objects):
        cloud = torch.from_numpy(surfaces.seen.clouds[i : i + 1])
        if augment:
            key = generator("fused cloud", DATA_SEED, obj.class_name, obj.object_id)
            random = torch.Generator().manual_seed(int(key.integers(2**62)))
            cloud, clean = degrade(cloud, random)
            counts[i], noise[i] = cloud.shape[1], (cloud - clean).std()
        clouds[i, : counts[i]] = cloud[0].numpy()
    seen = replace(surfaces.seen, clouds=clouds)
    maps = _all_maps(seen, counts, out_dir / FOLDER, on_progress)
    return FusedSet(replace(surfaces, seen=seen), counts, noise, maps)


def mesh_weights() -> str:
    """Return the sha256 of the weights of each network that makes meshes, with a space between."""
    occupancy = FILES["baselines.occupancy_net"].bundled[OCCUPANCY]
    return f"{occupancy} {FILES['baselines.upsampler'].bundled[UPSAMPLER]}"


def encode(maps: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return maps [..., 5 * meshes, S, S] as bytes."""
    scales, zeros = _scales_and_zeros(maps.shape[-3])
    return np.rint(maps * scales + zeros).astype(np.uint8)


def decode(maps: Tensor) -> Tensor:
    """Return the maps, float32 [..., 5 * meshes, S, S], that `encode` has stored as bytes."""
    scales, zeros = _scales_and_zeros(maps.shape[-3])
    scale = torch.from_numpy(scales).to(maps.device)
    zero = torch.from_numpy(zeros).to(maps.device)
    return (maps.float() - zero) / scale


def _scales_and_zeros(planes: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return scales and zeros of the planes of maps, both [planes, 1, 1]."""
    meshes = planes // len(MAPS)
    scales, zeros = np.tile(_SCALES, meshes), np.tile(_ZEROS, meshes)
    return scales[:, None, None], zeros[:, None, None]


def mirror(maps: Tensor) -> Tensor:
    """Return the maps of the mirrored meshes, seen from the opposite azimuth.

    Both are [..., 5 * meshes, S, S].
    """
    flipped = maps.flip(-1)
    flipped[..., MAPS.index("normal x") :: len(MAPS), :, :] *= -1
    return flipped


def _all_maps(
    seen: TrainingSet,
    counts: NDArray[np.int64],
    folder: Path,
    on_progress: Callable[[], object],
) -> NDArray[np.uint8]:
    """Return the maps of all objects, uint8 [N, V, 5 * meshes, S, S].

    Maps that a file in `folder` has are read. Others are computed, and written when those of
    TOGETHER objects are complete.
    """
    objects, views = seen.azimuth_deg.shape
    shape = (objects, views, len(MAPS) * len(MESHES), IMAGE_SIZE, IMAGE_SIZE)
    maps = np.empty(shape, np.uint8)
    methods = reconstructors()
    for start in range(0, objects, TOGETHER):
        some = range(start, min(start + TOGETHER, objects))
        path = folder / f"{start:06d}.safetensors"
        header = {"format": FORMAT, "of": _identity(seen, counts, some)}
        if path.exists():
            maps[start : some.stop] = _read(path, header, maps[start : some.stop].shape)
        for i in some:
            if not path.exists():
                angles = zip(seen.azimuth_deg[i], seen.elevation_deg[i], strict=True)
                looks = [View(azimuth, elevation) for azimuth, elevation in angles]
                cloud = PointCloud(seen.clouds[i, : counts[i]])
                reconstructed, _ = reconstruct(cloud, methods)
                maps[i] = encode(maps_of(reconstructed, looks))
            on_progress()
        if not path.exists():
            kept = torch.from_numpy(maps[start : some.stop])
            write_atomically(path, {"maps": kept}, header)
    return maps


def _identity(seen: TrainingSet, counts: NDArray[np.int64], some: range) -> str:
    """Return a sha256 of everything that the maps of the objects `some` depend on."""
    digest = hashlib.sha256(repr((*MESHES, mesh_weights())).encode())
    for array in (seen.azimuth_deg, seen.elevation_deg, seen.clouds, counts):
        digest.update(np.ascontiguousarray(array[some.start : some.stop]).tobytes())
    return digest.hexdigest()


def _read(path: Path, header: dict[str, str], shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """Return the maps of a file; raise BadInput where they have another header or shape."""
    tensors, kept_header = read_safetensors(path)
    maps = tensors.get("maps")
    if kept_header != header or maps is None or maps.shape != shape or maps.dtype != torch.uint8:
        raise BadInput(
            f"{path}: its maps are of other clouds or views, or of other weights that make meshes; "
            f"use another output directory, or remove {path.parent}"
        )
    return maps.numpy()
