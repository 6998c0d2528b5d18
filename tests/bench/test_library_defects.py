from __future__ import annotations

import importlib
import re

import pytest

from bench import library_defects
from bench.library_defects import DEFECTS, LIMITS, demonstrate, library_outcomes
from bench.running.isolation import Lost

# What each library would show if it were mended.
MENDED = {
    "apss-infinite-point-hangs": "0 faces",
    "normals-of-no-neighbours-crash": "raises RuntimeError: k has to be positive",
    "apss-negative-grid-crash": "raises RuntimeError: resolution has to be positive",
    "header-believed-ply": "raises PlyElementParseError: row 1: early end-of-file",
    "header-believed-npy": "raises ValueError: cannot reshape array of size 0",
    "apss-nan-vertices-from-a-clean-box": "0 of 102687 vertices are not finite",
    "apss-reads-unwritten-memory": "37a1f2c3 and 37a1f2c3 over noughts, 37a1f2c3 over another fill",
    "apss-coplanar-points-nothing": "3438 faces from ball pivoting, 812 from APSS",
    "apss-far-from-the-origin": "0 of 13441 vertices are not finite",
    "apss-blob-of-16-points": "28 faces",
    "normals-hide-what-is-not-finite": "a normal is not finite",
    "ball-pivoting-of-one-place": "0 faces of points that coincide",
    "ball-pivoting-of-a-line": "raises RuntimeError: the points lie on a line",
    "close-holes-without-faces": "nothing to close",
    "ball-pivoting-depends-on-the-order": "1511 faces, 1511 of the same points in reverse",
    "integer-background-black": "background 255, and 255 from floats",
    "numpy-2-unknown": "scale 2.8",
    "nan-vertex-vanishes": "raises ValueError: positions must be finite",
    "index-out-of-range-drawn": "raises ValueError: indices must be below 3",
    "renderers-share-a-display": "the other one still draws",
    "vertices-merged": "6 of 6 vertices",
    "points-are-no-mesh": "raises ValueError: no faces",
    "index-out-of-range-kept": "raises IndexError: vertex 99 of 3",
    "nan-vertex-kept": "raises ValueError: vertices must be finite",
    "nan-becomes-a-pixel": "raises ValueError: cannot convert NaN to uint8",
    "half-precision-moments-overflow": "variance 1000000.0 of -1000 and 1000",
    "decomposition-names-no-cause": "raises LinAlgError: array must not contain infs or NaNs",
    "matrix-root-complex": "real: 2.3e-13",
    "neighbour-that-is-not-there": "raises ValueError: k must be at most 1",
    "tree-of-half-a-plane-crash": "a tree of 100 points",
    "bootstrap-of-equal-values": "interval 1.0 to 1.0",
    "failures-leave-the-mean": "means {'a': nan, 'b': nan}, nan",
    "nan-becomes-a-pixel-torch": "pixel 0, a UserWarning",
    "mirrored-arrays-refused": "[2, 1, 0]",
    "range-guessed": "raises ValueError: specify data_range",
    "nan-pixel-accepted": "raises ValueError: images must be finite",
    "small-images-refused": "ssim 1.0",
}


@pytest.fixture(scope="module")
def outcomes():
    return library_outcomes(2)


def test_every_defect_is_contained(outcomes):
    assert [o for o in outcomes if o.kind != "contained"] == []
    assert sorted(o.case for o in outcomes) == sorted(d.id for d in DEFECTS)
    libraries = [o.subject for o in outcomes]
    assert libraries == sorted(libraries, key=libraries.index), "library by library"


def test_workers_were_lost_as_stated(outcomes):
    seen = {o.case: o.observed for o in outcomes}
    assert seen["apss-infinite-point-hangs"] == "timeout: no result within 15 s"
    assert seen["normals-of-no-neighbours-crash"] == "crash: the worker died (SIGSEGV)"
    assert seen["apss-negative-grid-crash"] == "crash: the worker died (SIGFPE)"
    for case in ("header-believed-ply", "header-believed-npy"):
        assert seen[case] == "memory: the worker used more than 1 GiB"


def test_what_is_said_of_a_defect(outcomes):
    (outcome,) = (o for o in outcomes if o.case == "nan-becomes-a-pixel-torch")
    assert (outcome.group, outcome.subject) == ("library", "torch")
    assert outcome.expected == (
        "NaN cast to uint8 is some number, without a word; "
        "contained by `work._checked`, which fails pictures that are not finite"
    )
    assert re.fullmatch(r"pixel \d+, no warning", outcome.observed)


def answering(answers, monkeypatch):
    """`run_tasks` with these results, as they might come from workers: in any order."""

    def run_tasks(tasks, work, workers, limits):
        assert (work, limits) == (demonstrate, LIMITS)
        return ((task, answers(task)) for task in reversed(tasks))

    monkeypatch.setattr(library_defects, "run_tasks", run_tasks)
    return {outcome.case: outcome for outcome in library_outcomes(1)}


def test_a_mended_library_is_noticed(monkeypatch):
    assert MENDED.keys() == {defect.id for defect in DEFECTS}
    for case, outcome in answering(MENDED.__getitem__, monkeypatch).items():
        assert outcome.kind == "unexpected", case
        mended = f"{MENDED[case]}; not as stated, the library may have been mended"
        assert outcome.observed == mended


def test_another_way_to_fail_is_noticed(monkeypatch):
    lost = Lost("timeout", "no result within 15 s")
    kinds = {c: o.kind for c, o in answering(lambda case: lost, monkeypatch).items()}
    assert {c for c, kind in kinds.items() if kind == "contained"} == {"apss-infinite-point-hangs"}
    gone = "raises ModuleNotFoundError: No module named 'library'"
    kinds = {c: o.kind for c, o in answering(lambda case: gone, monkeypatch).items()}
    assert set(kinds.values()) == {"unexpected"}


def test_only_the_tests_need_scikit_image(monkeypatch):
    monkeypatch.setitem(library_defects.sys.modules, "skimage.metrics", None)
    for defect in DEFECTS:
        if defect.library == "scikit-image":
            assert demonstrate(defect.id) == "not installed"
            assert re.search(defect.shows, "not installed")


def test_ids_are_unique():
    ids = [defect.id for defect in DEFECTS]
    assert len(ids) == len(set(ids))
    assert all(re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", defect_id) for defect_id in ids)


@pytest.mark.parametrize("defect", DEFECTS, ids=lambda defect: defect.id)
def test_the_remedy_is_there(defect):
    """The first name in backticks is one of ours: `module` or `module.name`."""
    path = re.match(r"`([\w.]+)`", defect.remedy)
    assert path is not None
    module, *names = path[1].split(".")
    (found,) = (
        importlib.import_module(f"{package}.{module}")
        for package in ("bench", "baselines", "pc2pix", "data_prep")
        if importlib.util.find_spec(f"{package}.{module}")
    )
    for name in names:
        found = getattr(found, name)
