from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from bench.draw.cloud_file import CloudFile
from bench.draw.orientation_hints import lies_on_a_map, looks_like_a_line, looks_lying
from data_prep.clouds.normalise import Placement, normalise
from data_prep.clouds.sampling import sample_surface
from data_prep.datasets.registry import open_dataset
from data_prep.files.clouds import save_ply
from data_prep.files.meshes import load_mesh
from data_prep.randomness import generator
from data_prep.scene import PointCloud

MESHES = Path(__file__).parents[4] / "shared" / "meshes"


def lying(cloud, front="-y"):
    """Return the cloud as a file with z up has it, read as if y were up."""
    x, y, z = cloud.points.T
    return PointCloud(np.stack([-x, z, y] if front == "-y" else [-z, -x, y], axis=1))


@pytest.fixture(scope="module")
def tables():
    objects = open_dataset("procedural").objects("table", limit=10, endless_limit=10)
    return [
        sample_surface(table.load(), generator("test", str(i))) for i, table in enumerate(objects)
    ]


def test_tables_on_their_backs_are_recognised_and_standing_ones_are_not(tables):
    assert not any(looks_lying(table) for table in tables)
    assert sum(looks_lying(lying(table)) for table in tables) >= 5


def test_few_points_and_points_that_are_not_finite_say_nothing(tables):
    back = next(lying(table).points for table in tables if looks_lying(lying(table)))
    assert not looks_lying(PointCloud(back[:255]))
    assert not looks_lying(PointCloud(back * np.nan))
    assert not looks_lying(PointCloud(np.zeros((300, 3), np.float32)))
    assert looks_lying(PointCloud(np.concatenate([back, [[np.inf, 0, np.nan]]])))


def test_a_note_where_the_up_axis_is_a_guess(tables, tmp_path):
    path = tmp_path / "table.ply"
    save_ply(next(lying(t) for t in tables if looks_lying(lying(t))).points, path)
    note = f"{path}: its z axis seems to point up; give --up z, or --up y if it does not"
    assert CloudFile(path, as_is=False, up_unknown=True).load_with_notes()[1] == (note,)
    assert CloudFile(path, as_is=False).load_with_notes()[1] == ()
    assert CloudFile(path, as_is=False, up="z").load_with_notes()[1] == ()


def test_what_would_tip_over_lies():
    """A lamp without any symmetry: a wide foot at z = 0, and a head above one of its corners.

    With z up the centroid is above the foot. With y up the head is lowest, and the centroid is
    beside it.
    """
    rng = np.random.default_rng(0)
    foot = np.c_[rng.uniform(-1, 1, (600, 1)), rng.uniform(0, 1.5, (600, 1)), np.zeros((600, 1))]
    head = [-0.8, -0.3, 2.0] + rng.uniform(0, 0.3, (300, 3)) * [1, 2, 1]
    lamp = np.concatenate([foot, head])
    assert looks_lying(PointCloud(lamp.astype("f4")))
    assert not looks_lying(PointCloud(lamp[:, [0, 2, 1]].astype("f4")))  # y up


@pytest.mark.parametrize(
    ("centre", "far"),
    [
        ((500_123, 5_412_345, 312), True),  # an easting, a northing and a height, in metres
        ((500_123, 312, 5_412_345), False),
        ((0, 0, 5_412_345), False),
        ((500, 900, 12), False),  # fewer than 100 radii
    ],
)
def test_coordinates_of_maps_have_z_up(centre, far):
    assert lies_on_a_map(Placement(np.array(centre, float), radius=8.0)) is far


def test_a_note_where_all_points_lie_on_a_line(tmp_path):
    times, depths = np.linspace(0, 1, 50) ** 2 * 1e6, np.random.default_rng(0).normal(size=(50, 2))
    (path := tmp_path / "log.csv").write_text("x,y,z\n")
    with path.open("a") as file:
        np.savetxt(file, np.column_stack([times, depths]), delimiter=",")
    note = f"{path}: its points lie on a line; check which columns are x, y and z"
    assert CloudFile(path, as_is=False).load_with_notes()[1] == (note,)
    assert not looks_like_a_line(PointCloud(np.array([[0, 0, 0], [1, 0, 0], [1, 0.1, 0]], "f4")))


@pytest.mark.slow
@pytest.mark.skipif(not MESHES.is_dir(), reason="needs the real meshes in ../shared/meshes")
def test_rates_on_real_meshes():
    """Few clouds with Y up get the note, of those with Z up a good part."""
    with (MESHES / "manifest.csv").open(newline="") as file:
        names = [row["file"] for row in csv.DictReader(file) if row["kind"] == "mesh"]
    clouds = [
        sample_surface(normalise(load_mesh(MESHES / name)), generator("test", name))
        for name in names
    ]
    assert sum(map(looks_lying, clouds)) <= 0.02 * len(clouds)
    assert sum(looks_lying(lying(cloud)) for cloud in clouds) >= 0.3 * len(clouds)
    assert sum(looks_lying(lying(cloud, "x")) for cloud in clouds) >= 0.55 * len(clouds)
