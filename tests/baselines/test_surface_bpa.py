from __future__ import annotations

import numpy as np
import pytest

from baselines.surface import SurfaceBpa, closed_surface
from data_prep.failures import StageFailure
from data_prep.mesh_files import NEUTRAL_GREY
from data_prep.scene import PointCloud

from .clouds import chair_cloud


def test_it_is_the_papers_chain_up_to_its_third_stage() -> None:
    cloud = chair_cloud()
    state = SurfaceBpa().prepare(cloud)
    expected = closed_surface(cloud.points).mesh(NEUTRAL_GREY)
    np.testing.assert_array_equal(state.mesh.faces, expected.faces)
    np.testing.assert_array_equal(state.mesh.vertices, cloud.points)  # none is made or moved
    assert state.notes == ()


@pytest.mark.parametrize("side", [0.01, 0.1])
def test_the_radius_is_a_share_of_the_diagonal(side: float) -> None:
    # Equilateral triangles: a ball smaller than their circumcircle, side / sqrt 3, falls through.
    row, column = np.mgrid[:15, :15]
    points = np.stack([column + 0.5 * (row % 2), row * 3**0.5 / 2, np.zeros_like(row)], axis=-1)
    cloud = PointCloud(side * points.reshape(-1, 3))
    least = 100 / 3**0.5 / np.hypot(14.5, 14 * 3**0.5 / 2)
    state = SurfaceBpa(radius_percent=1.03 * least).prepare(cloud)
    assert len(state.mesh.faces) >= 2 * 14**2  # all triangles, and gaps along the edge closed
    with pytest.raises(StageFailure, match="no faces") as failure:
        SurfaceBpa(radius_percent=0.97 * least).prepare(cloud)
    assert failure.value.stage == "ball-pivoting"
