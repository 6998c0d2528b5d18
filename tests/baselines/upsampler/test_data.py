from __future__ import annotations

import numpy as np
import torch
import trimesh

from baselines.upsampler.data import PLACES, joined, nearest_on_surface, upsampler_set
from data_prep.datasets.registry import open_dataset


def test_the_nearest_point_of_a_box_is_found_with_its_normal() -> None:
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    corners = box.vertices[box.faces]
    rng = np.random.default_rng(0)
    places = rng.uniform(-0.8, 0.8, (2000, 3))
    points, normals = nearest_on_surface(corners, places, rng)
    inside = np.abs(places).max(axis=1) < 0.5
    expected = places.clip(-0.5, 0.5)
    nearest = np.abs(places).argmax(axis=1)
    row = np.arange(len(places))
    expected[row[inside], nearest[inside]] = 0.5 * np.sign(places[row, nearest])[inside]
    apart = np.linalg.norm(places - points, axis=1), np.linalg.norm(places - expected, axis=1)
    # Near the middle of the box six faces are equally near: one of another is as good.
    np.testing.assert_allclose(*apart, rtol=0, atol=0.01)
    clear = np.sort(np.abs(places), axis=1)[:, 1] < 0.4
    np.testing.assert_allclose(points[clear & inside], expected[clear & inside], atol=1e-12)
    axis = np.abs(points).argmax(axis=1)
    outwards = (normals * np.eye(3)[axis]).sum(axis=1) * np.sign(points[row, axis])
    np.testing.assert_allclose(outwards[clear & inside], 1)


def test_a_set_has_clouds_of_many_sizes_and_places_on_their_surfaces() -> None:
    objects = open_dataset("procedural:relief").objects("lamp", 6, 6, "train")
    data = upsampler_set(objects, quiet=True)
    sizes = data.first.diff()
    assert data.places.shape == data.targets.shape == data.normals.shape == (6, PLACES, 3)
    assert len(set(sizes.tolist())) > 1
    assert int(data.first[-1]) == len(data.clouds.points)
    assert (data.nearest < sizes[:, None]).all()
    assert (data.clouds.neighbours.amax() < sizes.amax()).all()
    torch.testing.assert_close(data.normals.norm(dim=2), torch.ones(6, PLACES))
    again = upsampler_set(objects[2:3], quiet=True)
    some = slice(int(data.first[2]), int(data.first[3]))
    assert torch.equal(data.clouds.points[some], again.clouds.points)
    assert torch.equal(data.places[2], again.places[0])


def test_clouds_stand_one_after_the_other_with_their_own_numbers() -> None:
    objects = open_dataset("procedural:relief").objects("lamp", 2, 2, "train")
    first, second = (upsampler_set([obj], quiet=True).clouds for obj in objects)
    both = joined([first, second])
    assert torch.equal(both.neighbours[len(first.points) :], second.neighbours)
    assert torch.equal(both.normals[: len(first.points)], first.normals)
