"""`bench add`: its options, and a method that does not keep its contract."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from bench.catalogue.methods import ALLOWED
from bench.commands.add import is_own, on_dataset, options_of
from bench.records.folder import write_manifest

from ..builders import make_manifest

WRITES = """from pathlib import Path
Path("executed").touch()

class Small:
    def prepare(self, cloud, rng):
        return cloud

    def draw(self, state, views, rng):
        import numpy as np
        return np.zeros((len(views), 64, 64, 3), np.float32)
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return the current folder, with a module whose images have the wrong size."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(ALLOWED, "")
    monkeypatch.setattr(sys, "path", [*sys.path])
    (tmp_path / "too_small.py").write_text(WRITES)
    return tmp_path


@pytest.mark.parametrize(
    ("name", "own"),
    [
        ("my.module:METHOD", True),
        ("splat-net@weights.safetensors", True),
        ("splat-net@chair", False),
        ("poisson@depth=6", False),
        ("images:tree", False),
    ],
)
def test_what_is_tested_first(name, own):
    assert is_own(name) == own


def test_the_options_are_those_of_the_run(tmp_path):
    request = {"suite": "chair-robustness", "dataset": "folder:a", "device": "cpu", "truth": "grey"}
    more = {"objects": ["chair/a", "chair/b", "lamp/c"], "views": 3, "conditions": ["512"]}
    write_manifest(tmp_path, make_manifest(request=request, **more))
    options = options_of(tmp_path, ["splat", "mine:METHOD"], workers=2)
    assert (options.methods, options.conditions) == (("splat", "mine:METHOD"), ("512",))
    assert (options.suite, options.dataset, options.device) == tuple(request.values())[:3]
    assert (options.truth, options.views, options.limit, options.workers) == ("grey", 3, 2, 2)
    assert options.directory == tmp_path
    assert options.adds
    elsewhere = on_dataset(options, "procedural:validation", None, None)
    kept = ("splat", "true-mesh", "blank", "mine:METHOD")
    assert (elsewhere.dataset, elsewhere.methods) == ("procedural:validation", kept)
    assert (elsewhere.out, elsewhere.adds, elsewhere.limit, elsewhere.views) == (
        *(tmp_path.with_name(f"{tmp_path.name}-procedural-validation"), False, 2, 3),
    )
    assert on_dataset(options, "procedural", 9, Path("own")).limit == 9


@pytest.mark.slow
def test_a_method_that_breaks_the_contract_is_not_added(command, folder):
    Path("run").mkdir()
    request = {"suite": "chair-robustness", "dataset": "procedural", "device": "cpu"}
    write_manifest(Path("run"), make_manifest(request=request))
    before = Path("run/manifest.json").read_bytes()
    status, out, _ = command("add", "too_small:Small", "run")
    assert status == 1
    lines = out.splitlines()
    assert any(line.startswith("FAIL images: ") for line in lines)
    assert not any(line.startswith("ok ") for line in lines)
    assert " block a run (images, " in lines[-1]
    assert lines[-1].endswith("; next: fix what is marked FAIL, then add it again")
    assert [path.name for path in Path("run").iterdir()] == ["manifest.json"]
    assert Path("run/manifest.json").read_bytes() == before
