from __future__ import annotations

from contextlib import contextmanager

import pytest

from data_prep.stages import at_stages, stage


@pytest.fixture
def seen():
    return []


def change(seen):
    @contextmanager
    def noted():
        seen.append("in")
        try:
            yield
        finally:
            seen.append("out")

    return noted


def work(seen):
    with stage("prepare"):
        seen.append("cloud")
        with stage("normals"):
            seen.append("normals")
    with stage("draw"):
        seen.append("image")


def test_no_stage_is_changed_without_a_wish(seen):
    work(seen)
    assert seen == ["cloud", "normals", "image"]


def test_one_stage_is_changed_and_no_other(seen):
    with at_stages({"normals"}, change(seen)):
        work(seen)
    assert seen == ["cloud", "in", "normals", "out", "image"]
    work(seen)
    assert seen[-3:] == ["cloud", "normals", "image"]


def test_a_stage_within_a_changed_one_belongs_to_it(seen):
    with at_stages({"prepare", "normals"}, change(seen)):
        work(seen)
    assert seen == ["in", "cloud", "normals", "out", "image"]


def test_without_names_the_block_is_changed_once(seen):
    with at_stages((), change(seen)):
        work(seen)
    assert seen == ["in", "cloud", "normals", "image", "out"]


def test_an_exception_ends_stage_and_change(seen):
    with pytest.raises(KeyError), at_stages({"draw"}, change(seen)), stage("draw"):
        raise KeyError
    assert seen == ["in", "out"]
    work(seen)
    assert seen == ["in", "out", "cloud", "normals", "image"]
