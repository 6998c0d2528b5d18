from __future__ import annotations

from data_prep.progress import PLAIN_EVERY_S, progress, step_progress
from learning.training_loop import StepReport


def test_plain_lines_now_and_then_and_at_the_end(clock, capsys):
    with progress("items", 4) as advance:
        for failed in (0, 1, 1, 1):
            clock[0] += PLAIN_EVERY_S - 5
            advance(failed)
    out, err = capsys.readouterr()
    assert out == ""
    assert err.splitlines() == [
        "items: 2/4 done, 1 failed, 20 s, about 20 s left",
        "items: 4/4 done, 1 failed, 40 s, about 0 s left",
    ]


def test_no_progress_is_claimed_where_all_failed(clock, capsys):
    """The one line that says why is the caller's."""
    with progress("ground truth", 2) as advance:
        advance(1)
        advance(2)
    assert capsys.readouterr().err == ""


def test_a_live_bar_in_a_terminal(monkeypatch, capsys):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    with progress("items", 3) as advance:
        for failed in (0, 1, 2):
            advance(failed)
    out, err = capsys.readouterr()
    assert out == ""
    assert "items" in err
    assert "3/3" in err
    assert "2 failed" in err


def test_a_training_says_its_first_and_last_step(capsys):
    with step_progress("autoencoder") as show:
        for step in (1, 2, 3, 100):
            show(
                StepReport(step, 100, {"chamfer": 0.03125}, 32, 98.06 if step > 1 else None, 3671.6)
            )
    assert capsys.readouterr() == (
        "",
        "autoencoder: step 1/100, chamfer 0.03125\n"
        "autoencoder: step 100/100, chamfer 0.03125, 98.1 images/s, 1:01:12 left\n",
    )
