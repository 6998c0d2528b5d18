"""Names that a list of a command line has twice count once."""

from __future__ import annotations

import shlex
import shutil

import pytest

from bench.catalogue.methods import ALLOWED
from bench.check.golden import bless
from bench.records.folder import write_manifest

from ..builders import make_manifest, write_run

ROBUSTNESS = "run --suite chair-robustness --dry-run --limit 1 --views 1"
# Command lines with a name twice, and with it once: they say the same, and end alike.
CASES = {
    f"{ROBUSTNESS} --methods splat,constant,splat": f"{ROBUSTNESS} --methods splat,constant",
    f"{ROBUSTNESS} --conditions 512,512": f"{ROBUSTNESS} --conditions 512",
    f"{ROBUSTNESS} --metrics flip,dists,flip": f"{ROBUSTNESS} --metrics flip,dists",
    "compare run --methods splat,blank --metric ssim,ssim,ssim": "compare run --methods splat,blank"
    " --metric ssim",
    "compare run --methods splat,blank,splat": "compare run --methods splat,blank",
    "compare run --methods splat,splat": "compare run --methods splat",
    "compare run again --methods splat,splat --metric 'lpips, lpips'": "compare run again "
    "--methods splat --metric lpips",
    "score run --metrics flip,flip": "score run --metrics flip",
    "check run --golden golden.json --tolerance ssim=0.1,ssim=.1": "check run --golden golden.json "
    "--tolerance ssim=0.1",
    "check run run --claims --methods splat,splat": "check run --claims --methods splat",
    "add splat,splat of-stability": "add splat of-stability",
    "render cloud.xyz -o a.png --method splat,splat": "render cloud.xyz -o a.png --method splat",
    "train autoencoder --objects 1 --class hat,hat": "train autoencoder --objects 1 --class hat",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with two runs, golden values of one, and a cloud."""
    folder = tmp_path_factory.mktemp("here")
    run = write_run(folder / "run", objects=[f"chair/{name}" for name in "abcdefgh"])
    bless(run, folder / "golden.json")
    shutil.copytree(run, folder / "again")
    (folder / "of-stability").mkdir()
    write_manifest(folder / "of-stability", make_manifest(suite="stability"))
    (folder / "cloud.xyz").write_text("0 0 0\n1 0 0\n0 1 0\n")
    return folder


@pytest.fixture
def here(folder, no_machine, monkeypatch):
    """Return the folder in which the command lines are typed."""
    monkeypatch.chdir(folder)
    monkeypatch.setenv(ALLOWED, "")


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(("twice", "once"), CASES.items())
def test_a_name_asked_for_twice_is_one_name(command, twice, once):
    assert command(*shlex.split(twice)) == command(*shlex.split(once))


@pytest.mark.usefixtures("here")
def test_a_metric_has_one_tolerance(refused):
    given = "ssim=0.1,lpips=0.2,ssim=0.3"
    assert refused("check", "run", "--golden", "golden.json", "--tolerance", given) == (
        "--tolerance ssim=0.3: ssim has 0.1 already; give each metric one tolerance"
    )
