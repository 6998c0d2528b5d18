"""`bench render --keep-mesh`: the surface of a method, where the file has its points."""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from baselines.reconstruction.stages import DrawsReconstruction
from bench.catalogue.methods import METHODS
from bench.draw.kept_mesh import makes_surface
from data_prep.files.clouds import read_cloud
from tests.baselines.clouds import lattice_sphere

# A ball of 500 mm, z up, in the coordinates of a map.
CENTRE, RADIUS = np.array([700_000.25, 5_400_000.5, 300.0]), 0.5
Z_UP = ("--up", "z", "--front=-y")


def write_ball(path: Path, colors: np.ndarray | None = None) -> np.ndarray:
    ours = lattice_sphere()
    points = CENTRE + RADIUS * np.stack([-ours[:, 0], ours[:, 2], ours[:, 1]], axis=1)
    rows = points if colors is None else np.hstack([points, colors])
    names = "x,y,z" if colors is None else "x,y,z,r,g,b"
    np.savetxt(path, rows, delimiter=",", header=names, comments="", fmt="%.17g")
    return points


def test_corners_lie_where_the_file_has_its_points(command, tmp_path) -> None:
    """Ball pivoting joins the points themselves."""
    path, kept, out = (tmp_path / name for name in ("ball.csv", "kept.ply", "out.png"))
    points = write_ball(path)
    options = ("--method", "surface-bpa", *Z_UP, "--points", "1500", "--keep-mesh", kept, "-o", out)
    status, printed, _ = command("render", path, *options)
    assert (status, printed) == (0, f"{out}\n{kept}\n")
    read = read_cloud(kept, with_colors=True)
    mesh = trimesh.load(kept, process=False)
    assert np.array_equal(mesh.vertices, read.points)
    assert np.array_equal(mesh.faces, read.faces)
    assert cKDTree(points).query(read.points)[0].max() < 1e-7 * RADIUS * 4
    assert read.colors is None
    outwards = mesh.face_normals * (mesh.triangles_center - CENTRE)
    assert (outwards.sum(axis=1) > 0).mean() > 0.99
    assert len(read.faces) > 2500
    header = kept.read_bytes().partition(b"end_header")[0].decode("ascii")
    assert (
        f"comment pc2pix-bench {version('pc2pix-bench')}, method surface-bpa: a surface of the "
        "points in ball.csv, in the units and axes of that file\n"
    ) in header


def test_corners_have_the_colours_of_the_points_beside_them_and_notes_are_kept(
    command, tmp_path
) -> None:
    path, kept, out = (tmp_path / name for name in ("bäll.csv", "kept.ply", "out.png"))
    high = lattice_sphere()[:, 1:2] > 0
    write_ball(path, np.where(high, (200, 40, 20), (10, 60, 220)))
    render = ("render", path, "--method", "alpha-wrap", *Z_UP, "--keep-mesh", kept, "-o", out)
    assert command(*render)[0] == 0
    read = read_cloud(kept, with_colors=True)
    above = read.points[:, 2] - CENTRE[2]
    assert (read.colors[above > 0.1] == (200, 40, 20)).all()
    assert (read.colors[above < -0.1] == (10, 60, 220)).all()
    header = kept.read_bytes().partition(b"end_header")[0].decode("ascii")
    assert "the points in b\\xe4ll.csv" in header
    assert "comment colours: those of the nearest points\n" in header
    status, _, err = command(*render, "--colour", "grey", "--as-is")
    assert status == 1  # as it is the ball lies beside the camera, and nothing is written
    assert "points left out" in err or "points are different" in err
    assert kept.read_bytes().partition(b"end_header")[0].decode("ascii") == header


LIST = "surface-apss, surface-fit, surface-bpa, poisson, alpha-wrap, denoised-wrap, open3d-poisson"
REFUSED = {  # options, and what is said
    "": "method 'fused-net@grey' makes no surface that could be kept (the meshes inside it are a "
    "part of what its network sees); give --method with one of occupancy-net, upsampled-wrap, "
    f"{LIST}",
    "--method splat": "method 'splat' makes no surface that could be kept; give --method with one ",
    "--method poisson,alpha-wrap": "{kept}: keeps one surface; give one cloud and one method",
    "--method poisson --keep-mesh a.obj": "a.obj: a surface is written as PLY; give a name that ",
    "--method poisson --keep-mesh gone/a.ply": "gone/a.ply: is a folder, or in one that is not ",
    "--method poisson --keep-mesh {path}": "{path}: is the cloud itself; give another name",
    "--method fake-healthy": "{kept}: method 'fake-healthy' has made no surface; leave out --keep-",
}


@pytest.mark.parametrize("options", REFUSED)
def test_what_cannot_be_kept_is_refused_and_nothing_written(
    refused, plugins, tmp_path, options: str
) -> None:
    path, kept, out = (tmp_path / name for name in ("ball.ply", "kept.ply", "out.png"))
    trimesh.PointCloud(lattice_sphere()).export(path)
    words = options.format(path=path).split()
    said = refused("render", path, "-o", out, "--keep-mesh", kept, *words)
    assert said.startswith(REFUSED[options].format(path=path, kept=kept))
    assert [found.name for found in tmp_path.iterdir() if found.is_file()] == ["ball.ply"]


def test_methods_make_a_surface_where_they_draw_one() -> None:
    for method in METHODS:
        draws_surface = isinstance(method.load("cpu"), DrawsReconstruction)
        assert draws_surface == makes_surface(method), method.id
