from __future__ import annotations

from learning import loss_log
from learning.loss_log import LossLog, read_losses, write_loss_curves


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


def test_no_image_of_nothing(tmp_path):
    write_loss_curves(tmp_path / "losses.csv", tmp_path / "losses.png", 5)
    assert not list(tmp_path.iterdir())
