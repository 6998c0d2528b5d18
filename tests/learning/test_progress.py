from __future__ import annotations

from learning.progress import describe, training_progress
from learning.training_loop import StepReport


def report(step, **changes):
    values = {"losses": {"chamfer": 0.03125}, "images_per_s": 98.06, "seconds_left": 3671.6}
    return StepReport(step=step, steps=100, **values | changes)


def test_description():
    expected = "step 7/100, chamfer 0.03125, 98.1 images/s, 1:01:12 left"
    assert describe(report(7)) == expected
    assert describe(report(7, images_per_s=None)) == "step 7/100, chamfer 0.03125"


def test_plain_lines_where_there_is_no_terminal(capsys):
    with training_progress("autoencoder") as progress:
        for step in (1, 2, 3, 100):
            progress(report(step))
    out, err = capsys.readouterr()
    assert out == ""
    assert [line.split(",")[0] for line in err.splitlines()] == [
        "autoencoder: step 1/100",
        "autoencoder: step 100/100",
    ]
