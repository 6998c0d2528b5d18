from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from baselines.fused_net.config import FusedNetConfig
from baselines.fused_net.data import decode, mirror
from baselines.fused_net.train import FusedNetTrainer
from baselines.fused_net.weights import MESHES, PACKAGE, load_weights
from baselines.splat_net.projection import cameras, project
from baselines.splat_net.start import read_start
from baselines.splat_net.surfels import find_surfels, stack
from baselines.splat_net.weights import export
from baselines.splat_net.weights import load_weights as load_splat_net
from data_prep.failures import BadInput
from data_prep.scene import View
from learning.weights import FILES
from tests.learning.trainings import CADENCE, SMALL, SMALL_FUSED, TRAININGS, make_fused


def build(data, network_of_start=None, **changes):
    defaults = {"network": SMALL_FUSED, "batch": 8, "cadence": CADENCE, "cool_down": 2}
    config = FusedNetConfig(**defaults | changes)
    return FusedNetTrainer(data, config, start=network_of_start)


class Batches(FusedNetTrainer):
    """A trainer whose batches are clouds, and objects, instead of channels and truth."""

    def _scene(self, points, objects, views, mirrored):
        return points, objects

    def _hide_meshes(self, channels):
        pass


def test_clouds_of_a_batch_have_the_same_number_of_points():
    data = make_fused(objects=6)
    data.counts[1] = 512
    trainer = Batches(data, build(data).config)
    seen = set()
    for _ in range(30):
        points, objects, noise = trainer._draw_batch()
        counts = {int(data.counts[i]) for i in objects}
        assert counts == {points.shape[1]}
        seen |= {int(i) for i in objects}
        expected = np.repeat(data.noise[objects.numpy()], 2)
        np.testing.assert_array_equal(noise.numpy(), expected)
        for cloud, i in zip(points.numpy(), objects, strict=True):
            np.testing.assert_array_equal(cloud, data.surfaces.seen.clouds[i, : len(cloud)])
    assert seen == set(range(6))


def test_a_scene_has_the_maps_of_its_views_mirrored_as_the_image():
    data = make_fused(views=4)
    trainer = build(data)
    objects, views = torch.tensor([2, 2]), torch.tensor([[3, 1], [3, 1]])
    clouds = torch.from_numpy(data.surfaces.seen.clouds)[objects]
    (channels, _), truth = trainer._scene(clouds, objects, views, torch.tensor([False, True]))
    maps = decode(torch.from_numpy(data.maps[2, [3, 1]]))
    assert torch.equal(channels[:2, -10:], maps)
    assert torch.equal(channels[2:, -10:], mirror(maps))
    assert torch.equal(truth.grey[2:], truth.grey[:2].flip(3))
    seen = data.surfaces.seen
    looks = [View(-seen.azimuth_deg[2, i], seen.elevation_deg[2, i]) for i in (3, 1)]
    surfels = find_surfels(seen.clouds[2] * np.array([-1, 1, 1], np.float32))
    expected = project(stack([surfels] * 2), cameras(looks), SMALL.inputs)
    assert torch.equal(channels[2:, :-10], expected)


def test_it_starts_as_splat_net_draws_and_learns_from_the_meshes():
    widths, heads = (16, 32, 64, 128, 160), ("grey", "albedo")
    config = replace(SMALL_FUSED, widths=widths, heads=heads)
    start = read_start("all", config)
    data = make_fused()
    trainer = build(data, start.network, network=config, start=start.sha256)
    kernel = trainer.network.first.conv.weight
    assert (kernel[:, -10:] == 0).all()
    channels = torch.rand(1, config.inputs.channels, 32, 32)
    other = channels.clone()
    other[:, -10:] = 0
    with torch.no_grad():
        assert torch.equal(trainer.average(channels), trainer.average(other))
    plain = load_splat_net("all-grey").network.first.conv.weight
    assert torch.equal(kernel[:, :-10], plain)
    trainer.take_step()
    assert (trainer.network.first.conv.weight[:, -10:] != 0).any()


def test_files_of_weights_know_their_meshes(tmp_path):
    export(TRAININGS["fused-net"](tmp_path / "x", 1), tmp_path / "w.safetensors", "grey", PACKAGE)
    weights = load_weights(tmp_path / "w.safetensors")
    assert weights.network.config.inputs.meshes == MESHES
    with pytest.raises(BadInput, match=r"w\.safetensors: the network sees meshes; use it as fused"):
        load_splat_net(tmp_path / "w.safetensors")
    with pytest.raises(BadInput, match=r"all\.safetensors: the network sees no meshes; use it as"):
        load_weights(FILES["baselines.splat_net"].find("all"))


def test_one_mesh_of_some_clouds_is_hidden_in_all_of_their_views():
    trainer = build(make_fused())
    shown = torch.ones(200, SMALL_FUSED.inputs.channels, 1, 1)
    trainer._hide_meshes(shown)
    of_points = SMALL_FUSED.inputs.of_points
    assert (shown[:, :of_points] == 1).all()
    seen = shown[:, of_points:].unflatten(1, (2, 5))[..., 0, 0]
    assert (seen == seen[..., :1]).all()  # all maps of a mesh, or none
    assert torch.equal(seen[::2], seen[1::2])  # both views of a cloud
    hidden = (1 - seen[::2, :, 0]).sum(dim=0)
    # Of 100 clouds one in five, half of these each mesh: within four deviations of the binomial.
    assert ((hidden - 10).abs() <= 4 * np.sqrt(100 * 0.1 * 0.9)).all()
    assert (seen.sum(dim=(1, 2)) >= 5).all()  # never both


def test_files_of_other_meshes_are_refused(tmp_path):
    other = replace(SMALL_FUSED, inputs=replace(SMALL.inputs, meshes=MESHES[::-1]))
    checkpoint = TRAININGS["fused-net"](tmp_path / "x", 1, network=other)
    export(checkpoint, tmp_path / "w.safetensors", "grey", PACKAGE)
    with pytest.raises(BadInput, match=r"w\.safetensors: the network sees the meshes of upsampled"):
        load_weights(tmp_path / "w.safetensors")
