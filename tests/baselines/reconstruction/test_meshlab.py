from __future__ import annotations

import json
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest

from baselines.reconstruction.meshlab import GRID_MARGIN, MeshLab
from baselines.reconstruction.surface import closed_surface
from data_prep.failures import MissingDependency
from tests.baselines.clouds import RADIUS, lattice_sphere

# ball-pivoting-close-holes-mc-rotate.mlx of roatienza/pc2pix@23b7b46d, without its rotations.
ORIGINAL = [
    ("Compute normals for point sets", {"K": 10, "flipFlag": False, "smoothIter": 0}),
    (
        "Surface Reconstruction: Ball Pivoting",
        {"BallRadius": 0, "Clustering": 20, "CreaseThr": 90, "DeleteFaces": False},
    ),
    (
        "Close Holes",
        {"MaxHoleSize": 30, "Selected": False, "NewFaceSelected": True, "SelfIntersection": True},
    ),
    (
        "Marching Cubes (APSS)",
        {
            "FilterScale": 2,
            "ProjectionAccuracy": 1e-4,
            "MaxProjectionIters": 15,
            "SphericalParameter": 1,
            "AccurateNormal": True,
            "Resolution": 40,  # 200 there: an argument here
        },
    ),
]


def test_meshlab_confirms_the_originals_parameters(tmp_path: Path) -> None:
    """MeshLab keeps a script of what it was asked to do: that, not our call, is compared."""
    meshlab = closed_surface(lattice_sphere(400))
    meshlab.marching_cubes_apss(40)
    script = tmp_path / "script.mlx"
    meshlab._meshes.save_filter_script(str(script))
    steps = ElementTree.parse(script).getroot().findall("filter")
    assert [step.get("name") for step in steps] == [name for name, _ in ORIGINAL]
    for step, (_, expected) in zip(steps, ORIGINAL, strict=True):
        recorded = {param.get("name"): param.get("value") for param in step.findall("Param")}
        actual = {name: json.loads(recorded[name]) for name in expected}
        assert actual == expected


@pytest.mark.parametrize("resolution", [30, 61])
def test_a_cell_is_a_share_of_the_longest_side(resolution: int) -> None:
    # Longest along Y, and off the origin; more points than cells, so that none has a gap.
    stretch = np.array([0.5, 0.8, 0.4]) / RADIUS
    points = (lattice_sphere(3000) * stretch + [0.1, 0.2, 0.3]).astype(np.float32)
    meshlab = closed_surface(points)
    meshlab.marching_cubes_apss(resolution)
    # Vertices arise on the edges of cells, a third of them on those along each axis; the others
    # keep a whole number of cells in that coordinate, but for the little that projection moves
    # them. The mean of exp(2 pi i x / cell) is then 2/3, and near 0 for any other cell.
    vertices = meshlab.mesh((0, 0, 0)).vertices.astype(np.float64)
    longest = np.ptp(points[:, 1])
    for axis in range(3):
        corner = points[:, axis].min() - np.ptp(points[:, axis]) * (GRID_MARGIN - 1) / 2
        for margin in (GRID_MARGIN, 1.1, 1.15, 1.25, 1.3):
            cells = (vertices[:, axis] - corner) * resolution / (margin * longest)
            share = np.exp(2j * np.pi * cells).mean().real
            assert (share > 0.4) == (margin == GRID_MARGIN)


def test_what_meshlab_refuses_is_one_line() -> None:
    with pytest.raises(RuntimeError, match="Failed to apply filter") as failure:
        MeshLab(lattice_sphere(30)).close_holes(30)  # there are no faces
    assert "\n" not in str(failure.value)


def test_a_missing_library_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pymeshlab", None)
    with pytest.raises(MissingDependency, match=r"pymeshlab does not load .*libopengl0"):
        MeshLab(lattice_sphere(30))
