from __future__ import annotations

import sys

import numpy as np
import pytest
from PIL import Image

from bench.rendering.cloud import CloudFile, Drawing, draw_cloud
from bench.rendering.sheet import LABEL_HEIGHT, MARGIN, PROBLEM_GROUND
from data_prep.dots import draw_dots
from data_prep.failures import BadInput
from data_prep.scene import View
from studies import real_clouds
from studies.real_clouds import cloud_files, drawers, parse_view


@pytest.fixture
def folder(tmp_path):
    """Two clouds of different shapes, one too small for a surface; and what is no cloud."""
    (tmp_path / "scans" / "deep").mkdir(parents=True)
    corners = np.array(np.meshgrid(*[[-0.5, 0.5]] * 3)).reshape(3, -1).T
    np.save(tmp_path / "scans" / "a.npy", corners * (1, 2, 3))
    np.savetxt(tmp_path / "scans" / "deep" / "b.xyz", corners[:5])
    (tmp_path / "scans" / "readme.md").write_text("scans")
    return tmp_path / "scans"


def test_clouds_are_found_by_their_names(folder, tmp_path):
    assert [path.name for path in cloud_files(folder)] == ["a.npy", "b.xyz"]
    with pytest.raises(BadInput, match="no point cloud there"):
        cloud_files(tmp_path / "gone")


def test_methods_that_look_at_bare_points():
    found = drawers()
    assert {"pc2pix", "surface-apss", "splat"} <= set(found)
    assert not {"true-mesh", "blank", "constant"} & set(found)


def test_views():
    assert parse_view("-150,20") == View(-150.0, 20.0)
    for wrong in ("30", "a,b", "30,20,10", "30,95"):
        with pytest.raises(ValueError):
            parse_view(wrong)


def test_a_row_for_each_cloud_and_view(folder, tmp_path, monkeypatch, capsys):
    out = tmp_path / "sheet.png"
    views = ("--view=30,20", "--view=-150,20")
    chosen = (str(folder), "--methods", "splat,surface-bpa", *views, "--up", "z", "-o", str(out))
    monkeypatch.setattr(sys, "argv", ["real_clouds", *chosen])
    real_clouds.main()
    message = capsys.readouterr().out.splitlines()
    assert sorted(message) == sorted(
        [
            "a: surface-bpa: input: 8 points; normals need at least 11",
            "b: surface-bpa: input: 5 points; normals need at least 11",
            str(out),
        ]
    )
    with Image.open(out) as picture:
        pixels = np.asarray(picture)
    wide, high = 128 + MARGIN, 128 + LABEL_HEIGHT + MARGIN
    assert pixels.shape == (MARGIN + 4 * high, MARGIN + 3 * wide, 3)
    rows = [(path, i) for path in cloud_files(folder) for i in range(2)]
    for row, (path, i) in enumerate(rows):
        view = (View(30.0, 20.0), View(-150.0, 20.0))[i]
        cloud = CloudFile(path, as_is=False, up="z").load()
        splats = draw_cloud(cloud, Drawing("splat", (view,)))
        dots, splat, surface = (
            pixels[MARGIN + row * high + LABEL_HEIGHT :, MARGIN + column * wide :][:128, :128]
            for column in range(3)
        )
        assert np.array_equal(dots, draw_dots(cloud.points, (view,))[0])
        assert np.array_equal(splat, splats[0])
        assert tuple(surface[0, 0]) == PROBLEM_GROUND


def test_what_cannot_be_used_is_one_line(folder, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["real_clouds", str(folder), "--methods", "splta"])
    with pytest.raises(SystemExit, match="real_clouds: unknown method 'splta'"):
        real_clouds.main()
