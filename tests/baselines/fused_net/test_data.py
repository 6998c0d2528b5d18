from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from baselines.fused_net import data as fused_data
from baselines.fused_net.data import decode, encode, fused_set, mesh_weights, mirror
from baselines.fused_net.weights import MESHES
from baselines.reconstruction.denoised import is_noisy
from data_prep.datasets.registry import ProceduralObject
from data_prep.datasets.training_set import SurfaceSet, training_set
from data_prep.failures import BadInput
from data_prep.files.checksums import file_sha256
from data_prep.rendering.raycast import surface_maps
from data_prep.scene import Mesh, View
from learning.clouds import POINTS_SEEN
from learning.weights import FILES

from .conftest import Failing, Truth

OBJECTS = [ProceduralObject("chair", "train", i) for i in range(5)]


@pytest.fixture(scope="module")
def surfaces():
    seen = training_set(OBJECTS, 2, quiet=True)
    return SurfaceSet(seen, *np.zeros((2, 5, 2, 128, 128), np.uint8))


@pytest.fixture
def truth(monkeypatch):
    method = Truth()
    monkeypatch.setattr(fused_data, "reconstructors", lambda: dict.fromkeys(MESHES, method))
    return method


def test_bytes_are_the_maps_to_a_rounding():
    mesh = ProceduralObject("chair", "validation", 0).load()
    maps = np.concatenate([surface_maps(mesh, [View(30, 20), View(-70, 0)])] * 2, axis=1)
    back = decode(torch.from_numpy(encode(maps))).numpy()
    assert back.shape == maps.shape == (2, 10, 128, 128)
    np.testing.assert_array_equal(back[:, ::5], maps[:, ::5])  # coverage
    assert (back[maps == 0] == 0).all()
    np.testing.assert_allclose(back, maps, rtol=0, atol=0.5 / 127 + 1e-6)


def test_a_mirrored_map_is_that_of_the_mirrored_mesh():
    """But for samples, whose pattern has no mirror symmetry, at edges."""
    mesh = ProceduralObject("car", "validation", 0).load()
    flipped = Mesh(mesh.vertices * np.float32([-1, 1, 1]), mesh.faces, mesh.face_colors)
    maps = torch.from_numpy(surface_maps(mesh, [View(35, 20)]))
    there = torch.from_numpy(surface_maps(flipped, [View(-35, 20)]))
    inside = (mirror(maps)[:, 0] == 1) & (there[:, 0] == 1)
    assert inside.float().mean() > 0.1
    assert (mirror(maps) - there).abs().amax(dim=1)[inside].quantile(0.5) < 1e-3


def test_clouds_are_degraded_each_by_its_own_chance(surfaces, truth, tmp_path):
    data = fused_set(surfaces, OBJECTS, tmp_path)
    assert set(data.counts.tolist()) <= set(POINTS_SEEN)
    assert len(set(data.counts.tolist())) > 1
    assert (data.noise == 0).any()
    assert (data.noise > 0.01).any()
    for i, (cloud, count) in enumerate(zip(data.surfaces.seen.clouds, data.counts, strict=True)):
        assert (cloud[count:] == 0).all()
        if data.noise[i] == 0:  # points of the object
            assert {*map(tuple, cloud[:count])} <= {*map(tuple, surfaces.seen.clouds[i])}
    # neither the other objects nor their order matter
    third = {name: values[[3]] for name, values in vars(surfaces.seen).items()}
    fewer = replace(surfaces, seen=replace(surfaces.seen, **third))
    alone = fused_set(fewer, OBJECTS[3:4], tmp_path / "alone")
    np.testing.assert_array_equal(alone.surfaces.seen.clouds[0], data.surfaces.seen.clouds[3])
    assert (alone.counts[0], alone.noise[0]) == (data.counts[3], data.noise[3])
    np.testing.assert_array_equal(alone.maps[0], data.maps[3])
    whole = fused_set(surfaces, OBJECTS, tmp_path / "whole", augment=False)
    np.testing.assert_array_equal(whole.surfaces.seen.clouds, surfaces.seen.clouds)
    assert (whole.counts.min(), whole.noise.max()) == (2048, 0)


def test_maps_are_kept_and_those_of_others_refused(surfaces, truth, tmp_path, monkeypatch):
    monkeypatch.setattr(fused_data, "TOGETHER", 2)
    done = []
    data = fused_set(surfaces, OBJECTS, tmp_path, on_progress=lambda: done.append(1))
    assert len(done) == 5
    clouds = zip(data.surfaces.seen.clouds, data.counts, strict=True)
    meshes_of = np.array([1 if is_noisy(cloud[:count]) else 2 for cloud, count in clouds])
    assert set(meshes_of) == {1, 2}  # the mesh of upsampled-wrap is not made of noisy clouds
    assert truth.calls == meshes_of.sum()
    names = [path.name for path in sorted((tmp_path / "maps").iterdir())]
    assert names == ["000000.safetensors", "000002.safetensors", "000004.safetensors"]
    seen = surfaces.seen
    for i, meshes in enumerate(meshes_of):
        angles = View(seen.azimuth_deg[i, 1], seen.elevation_deg[i, 1])
        (expected,) = surface_maps(truth.prepare(None).mesh, [angles])
        second = expected if meshes == 2 else np.zeros_like(expected)
        np.testing.assert_array_equal(data.maps[i, 1], encode(np.concatenate([expected, second])))
    truth.calls = 0
    (tmp_path / "maps" / names[1]).unlink()
    again = fused_set(surfaces, OBJECTS, tmp_path)
    assert truth.calls == meshes_of[2:4].sum()
    np.testing.assert_array_equal(again.maps, data.maps)

    refused = pytest.raises(BadInput, match=r"000000.*are of other clouds or views, or of")
    turned = replace(surfaces, seen=replace(seen, azimuth_deg=seen.azimuth_deg + 1))
    for others, augment in ((turned, True), (surfaces, False)):
        with refused:
            fused_set(others, OBJECTS, tmp_path, augment=augment)
    files = [FILES[f"baselines.{name}"].find("all") for name in ("occupancy_net", "upsampler")]
    assert mesh_weights() == " ".join(map(file_sha256, files))
    monkeypatch.setattr(fused_data, "mesh_weights", lambda: "other")
    with refused:
        fused_set(surfaces, OBJECTS, tmp_path)


def test_a_mesh_that_fails_gives_empty_maps(surfaces, tmp_path, monkeypatch):
    methods = dict(zip(MESHES, (Truth(), Failing()), strict=True))
    monkeypatch.setattr(fused_data, "reconstructors", lambda: methods)
    data = fused_set(surfaces, OBJECTS, tmp_path)
    maps = decode(torch.from_numpy(data.maps))
    assert (maps[:, :, 5:] == 0).all()
    assert (maps[:, :, 0] == 1).any(dim=-1).any(dim=-1).all()
