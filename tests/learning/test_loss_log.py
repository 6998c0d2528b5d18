from __future__ import annotations

import numpy as np

from learning import loss_log
from learning.loss_log import LossLog, draw, make_panels, read_losses, write_loss_curves


def test_the_log_reads_back(tmp_path):
    path = tmp_path / loss_log.FILE_NAME
    log = LossLog(path, 0)
    log.add(10, {"a": 1.5, "b": -2.0})
    log.add(20, {"a": 1e-7, "b": 0.0})
    steps, losses = read_losses(path, 99)
    assert steps.tolist() == [10, 20]
    assert {name: values.tolist() for name, values in losses.items()} == {
        "a": [1.5, 1e-7],
        "b": [-2.0, 0.0],
    }
    assert read_losses(path, 10)[0].tolist() == [10]
    assert read_losses(path, 0)[1] == read_losses(tmp_path / "none.csv", 9)[1] == {}


def test_a_row_that_was_cut_short_goes(tmp_path):
    path = tmp_path / loss_log.FILE_NAME
    for cut in ("1", "12", "1230,0.5", ""):  # of "1230,0.5,0.25"
        path.write_text(f"step,a,b\n1000,1,2\n{cut}")
        assert read_losses(path, 1200)[0].tolist() == [1000]
        LossLog(path, 1200)
        assert path.read_text() == "step,a,b\n1000,1,2\n"


def test_a_panel_for_every_loss_that_has_a_value():
    steps = np.arange(1, 201)
    losses = {
        "falling": np.geomspace(10, 0.01, 200),
        "level": np.full(200, 3.0),
        "late": np.concatenate([np.zeros(150), np.ones(50)]),
        "negative": np.linspace(-1, 1, 200) + 0.001,
        "never": np.zeros(200),
    }
    panels = {panel.name: panel for panel in make_panels(steps, losses)}
    assert list(panels) == ["falling", "level", "late", "negative"]
    assert [name for name, panel in panels.items() if panel.log_scale] == ["falling"]
    np.testing.assert_allclose(panels["level"].smooth, 3.0)
    np.testing.assert_array_equal(np.isnan(panels["late"].smooth), losses["late"] == 0)
    # the mean of 11 values around the middle: a straight line stays what it is
    np.testing.assert_allclose(panels["negative"].smooth[5:-5], losses["negative"][5:-5])
    figure = draw(tuple(panels.values()))
    assert [axes.get_title() for axes in figure.axes] == list(panels)
    assert [axes.get_yscale() for axes in figure.axes] == ["log", "linear", "linear", "linear"]


def test_no_image_of_nothing(tmp_path):
    write_loss_curves(tmp_path / "losses.csv", tmp_path / "losses.png", 5)
    assert not list(tmp_path.iterdir())
