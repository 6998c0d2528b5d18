from __future__ import annotations

import dataclasses

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from baselines.upsampler.network import Surroundings, Upsampler, UpsamplerConfig
from baselines.upsampler.surroundings import surroundings
from tests.baselines.clouds import lattice_sphere

SMALL = UpsamplerConfig(width=8, rounds=2)


def make_network() -> Upsampler:
    """Return a network all of whose weights are random, those too that are 0 before training."""
    torch.manual_seed(0)
    network = Upsampler(SMALL).eval().requires_grad_(False)
    rounds = [layer for heard in network.rounds for layer in (heard.multiples, heard.back)]
    for layer in (network.answer, *rounds):
        torch.nn.init.normal_(layer.weight, std=0.5)
    return network


def see(points: np.ndarray) -> Surroundings:
    return surroundings(points.astype(np.float32))[0]


def ask(network: Upsampler, seen: Surroundings, places: torch.Tensor):
    nearest = torch.cdist(places, seen.points).argmin(dim=1)
    return network(seen, places, nearest)


def test_answers_are_moved_turned_and_scaled_with_the_cloud_whatever_the_signs_of_normals() -> None:
    network = make_network()
    noisy = lattice_sphere(200) + np.random.default_rng(0).normal(size=(200, 3)) * 0.1
    seen = see(noisy)
    places = seen.points[::3] + 0.02
    points, normals = ask(network, seen, places)
    turn = torch.from_numpy(Rotation.from_euler("xyz", (0.3, 1.0, -2.0)).as_matrix()).float()
    shift, scale = torch.tensor([3.0, -1.0, 2.0]), 0.25
    signs = torch.tensor([1.0, -1.0]).repeat(100)[:, None]
    moved = dataclasses.replace(
        seen,
        points=seen.points @ turn.T * scale + shift,
        raw=seen.raw @ turn.T * scale + shift,
        normals=signs * seen.normals @ turn.T,
        raw_normals=-signs * seen.raw_normals @ turn.T,
        radius=seen.radius * scale,
    )
    again, turned = ask(network, moved, places @ turn.T * scale + shift)
    # float32 of coordinates about 3, over a spacing of .03
    torch.testing.assert_close(again, points @ turn.T * scale + shift, rtol=0, atol=2e-5)
    same = (turned * (normals @ turn.T)).sum(dim=1).abs()
    torch.testing.assert_close(same, torch.ones(len(same)), rtol=0, atol=1e-4)
    assert (points - places).norm(dim=1).median() > 0.02  # the network does something


def test_the_order_of_points_and_of_places_does_not_matter() -> None:
    network, seen = make_network(), see(lattice_sphere(100))
    points, normals = ask(network, seen, seen.points)
    order = torch.randperm(100)
    place = order.argsort()
    fields = {name: value[order] for name, value in vars(seen).items()}
    shuffled = Surroundings(**{**fields, "neighbours": place[seen.neighbours[order]]})
    again, turned = ask(network, shuffled, shuffled.points)
    torch.testing.assert_close(again, points[order], rtol=0, atol=1e-5)
    torch.testing.assert_close(turned, normals[order], rtol=0, atol=1e-4)


def test_without_training_places_go_onto_the_plane_of_the_points_around_them() -> None:
    rng = np.random.default_rng(0)
    flat = rng.uniform(-1, 1, (300, 3)) * [1, 1, 0]
    network, seen = Upsampler(SMALL).requires_grad_(False), see(flat)
    places = seen.points + torch.tensor([0.01, 0.02, 0.05])
    points, normals = ask(network, seen, places)
    torch.testing.assert_close(points, places * torch.tensor([1, 1, 0]), rtol=0, atol=1e-6)
    torch.testing.assert_close(normals.abs(), torch.eye(3)[2].expand(300, 3), rtol=0, atol=1e-5)


def test_a_part_of_the_places_gets_what_all_of_them_get() -> None:
    network, seen = make_network(), see(lattice_sphere(100))
    places = seen.points.repeat(30, 1) + torch.linspace(0, 0.02, 3000)[:, None]
    points, _ = ask(network, seen, places)
    some, _ = ask(network, seen, places[1000:1100])
    torch.testing.assert_close(some, points[1000:1100], rtol=0, atol=1e-5)
