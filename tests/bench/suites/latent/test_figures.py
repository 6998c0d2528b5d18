from __future__ import annotations

import numpy as np

from bench.suites.latent.codes import draw_cloud
from data_prep.scene import View

FRONT = View(0, 0)


def test_a_cloud_is_drawn_where_it_is():
    cloud = np.array([[0, 0.4, 0], [0.01, 0.4, 0]], np.float32)
    image = draw_cloud(cloud, FRONT)
    rows, columns, _ = np.nonzero(image < 255)
    assert rows.max() < 64 - 20  # up
    assert abs(columns.mean() - 64) < 2
