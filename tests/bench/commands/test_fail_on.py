"""`bench compare --fail-on worse`: what it can decide, and what it refuses to pass."""

from __future__ import annotations

import shutil

import pandas as pd
import pytest

from ..builders import overwrite, write_run

CHAIRS = {count: [f"chair/{name}" for name in "abcdefghij"[:count]] for count in (3, 7, 8)}
CLASSES = [*CHAIRS[8], *(f"table/{name}" for name in "klm")]
MORE = (
    "give runs with more objects, or compare any number with 'bench check old --bless golden.json' "
    "and 'bench check new --golden golden.json'"
)


def needed(metric, objects):
    return f"--fail-on: {metric} decides nothing: 8 objects with a value are needed, {objects}"


def moved(by):
    """Return a change of the LPIPS of splat by object."""
    return lambda frame: frame.assign(
        lpips=frame["lpips"] + frame["object"].map(by).where(frame["method"] == "splat", 0.0)
    )


def thin_in(names):
    """Return a change that leaves thin parts to some objects."""
    return lambda frame: frame.assign(
        thin_recall=0.9 * frame["thin_recall"].where(frame["object"].isin([*names]))
    )


WORSE, BETTER = (moved(dict.fromkeys("abcdefghijklm", by)) for by in (0.3, -0.01))
REFUSED = {
    "worse, of 3 objects": (
        *(CHAIRS[3], WORSE, "--metric lpips"),
        needed("lpips", f"these runs share 3; {MORE}"),
    ),
    "of 7 objects": (
        *(CHAIRS[7], BETTER, "--metric lpips"),
        needed("lpips", f"these runs share 7; {MORE}"),
    ),
    "of 7 objects in two classes": (
        *([*CHAIRS[3], *(f"table/{name}" for name in "defg")], WORSE, "--metric lpips"),
        "--fail-on: lpips decides nothing: 8 objects of a class with a value are needed, these "
        f"runs share 4; {MORE}",
    ),
    "moves that cancel in the mean": (
        *(CHAIRS[3], moved({"a": 0.25, "b": -0.25, "c": 0.0}), "--metric lpips"),
        needed("lpips", f"these runs share 3; {MORE}"),
    ),
    "a metric that few objects have, beside one of all": (
        *(CHAIRS[8], thin_in("abcde"), "--metric ssim,thin-recall"),
        needed("thin-recall", f"these runs share 5; {MORE}"),
    ),
    "a metric that no object has": (
        *(CHAIRS[8], thin_in(""), "--metric thin-recall"),
        needed("thin-recall", f"these runs share 0; {MORE}"),
    ),
}
OF_TABLES = "lpips of splat at 2048 in table (3), lpips of splat at 512 in table (3)"
DECIDED = {
    "equal runs of 3 objects": (CHAIRS[3], lambda frame: frame, "", 0, ""),
    "worse, of 8 objects": (CHAIRS[8], WORSE, "--metric lpips", 1, ""),
    "better, of 8 objects": (CHAIRS[8], BETTER, "--metric lpips", 0, ""),
    "a class of 3 tables beside 8 chairs": (
        *(CLASSES, BETTER, "--metric lpips --methods splat", 0),
        "bench: --fail-on: 2 of 4 comparisons are not decided, as they have fewer than 8 objects "
        f"with a value: {OF_TABLES}\n",
    ),
    "the same, worse": (
        *(CLASSES, WORSE, "--metric lpips --methods splat", 1),
        "bench: --fail-on: 2 of 4 comparisons are not decided, as they have fewer than 8 objects "
        f"with a value: {OF_TABLES}\n",
    ),
}


@pytest.fixture
def two_runs(tmp_path, monkeypatch):
    """Return a function that makes runs of objects, `old` and a changed `new`, where one types."""
    monkeypatch.chdir(tmp_path)

    def make(objects, change):
        old = write_run(tmp_path / "old", objects=objects, methods=["splat", "blank"])
        shutil.copytree(old, tmp_path / "new")
        for folder, changed in (("old", lambda frame: frame), ("new", change)):
            frame = pd.read_parquet(f"{folder}/records.parquet")
            frame["lpips"] = (64 * frame["lpips"]).round() / 64  # so that moves cancel exactly
            overwrite(tmp_path / folder, changed(frame))

    return make


@pytest.mark.parametrize("name", REFUSED)
def test_a_comparison_that_can_decide_nothing_does_not_pass(two_runs, refused, tmp_path, name):
    objects, change, options, said = REFUSED[name]
    two_runs(objects, change)
    assert refused("compare", "old", "new", "--fail-on", "worse", *options.split()) == said
    assert not (tmp_path / "new" / "comparisons").exists()


@pytest.mark.parametrize("name", DECIDED)
def test_what_can_be_decided_is_and_the_rest_is_named(two_runs, command, name):
    objects, change, options, status, said = DECIDED[name]
    two_runs(objects, change)
    ended, _, err = command("compare", "old", "new", "--fail-on", "worse", *options.split())
    assert (ended, err) == (status, f"written to new/comparisons/old-new\n{said}")


def test_two_methods_of_one_run_need_as_many_objects(two_runs, refused):
    two_runs(CHAIRS[3], lambda frame: frame)
    methods = ("--methods", "blank,splat", "--metric", "ssim")
    assert refused("compare", "old", *methods, "--fail-on", "worse") == (
        needed("ssim", "this run has 3; give a run with more objects")
    )


def test_moves_that_cancel_in_the_mean_are_not_unchanged(two_runs, command):
    two_runs(CHAIRS[3], moved({"a": 0.25, "b": -0.25, "c": 0.0}))
    asked = ("--metric", "lpips", "--methods", "splat", "--format", "text")
    _, out, _ = command("compare", "old", "new", *asked)
    assert "nchanged" not in out
    assert out.splitlines()[-1] == "3 objects decide nothing here: at least 8 are needed."
