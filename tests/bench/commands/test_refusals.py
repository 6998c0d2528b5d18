"""What commands refuse: a command line, and what its one line says. Nothing is written."""

from __future__ import annotations

import shlex

import pytest
import torch

from bench.metrics import inception_weights

from ..builders import write_run

ROBUSTNESS = "run --suite chair-robustness"
CASES = {
    # --- words of the command line
    "--foo": "No such option: --foo; see 'bench --help'",
    "run": "Missing option '--suite'; see 'bench run --help'",
    "table": "Missing argument 'DIR'; see 'bench table --help'",
    "render": "Missing argument 'CLOUD'; see 'bench render --help'",
    "run --suit chair-robustness": "No such option: --suit (Possible options: ",
    f"{ROBUSTNESS} --views many": "Invalid value for '--views': ",
    f"{ROBUSTNESS} --device gpu": "Invalid value for '--device': 'gpu' is not one of 'auto', 'cpu'",
    "train gan --steps x": "see 'bench train gan --help'",
    # --- names that there are not
    "rnder": "unknown command 'rnder': did you mean 'render'? there are run, merge, list, table, "
    "check and 11 more; see 'bench --help'",
    "xyz": "unknown command 'xyz': there are run, merge, list, table, check and 11 more; ",
    "train gann": "unknown command 'gann': did you mean 'gan'? there are autoencoder, ",
    "list metrcs": "unknown section 'metrcs': did you mean 'metrics'? there are suites, methods, "
    "variants, conditions, metrics and 1 more; see 'bench list --help'",
    "run --suite chair-robustnes": "unknown suite 'chair-robustnes': did you mean "
    "'chair-robustness'? there are chair-robustness, speed-accuracy, thirteen-classes, "
    "beyond-training, latent and 2 more; see 'bench list'",
    f"{ROBUSTNESS} --methods splta,blank": "unknown method 'splta': did you mean 'splat'? there ",
    f"{ROBUSTNESS} --methods splta --dry-run": "unknown method 'splta': did you mean 'splat'? ",
    f"{ROBUSTNESS} --metrics nonsense --dry-run": "unknown metric 'nonsense': there are ms-ssim, ",
    f"{ROBUSTNESS} --methods pc2pix@x": "unknown method 'pc2pix@x': did you mean 'pc2pix'? there ",
    f"{ROBUSTNESS} --methods blank --conditions 2049": "unknown condition '2049': did you mean ",
    f"{ROBUSTNESS} --methods ' , '": "' , ': expected names separated by commas",
    f"{ROBUSTNESS} --dataset shapenet": "unknown dataset 'shapenet': did you mean 'shapenet:PATH'? "
    "there are procedural, folder:PATH, shapenet:PATH, modelnet:PATH, exported:PATH and 6 more; "
    "see 'bench list'",
    f"{ROBUSTNESS} --dataset folder:": "unknown dataset 'folder:': did you mean 'folder:PATH'? ",
    f"{ROBUSTNESS} --dataset /meshes": "unknown dataset '/meshes': did you mean 'folder:/meshes'?",
    "test no-such-method": "unknown method 'no-such-method'",
    "test nosuchmodule:Method": "no module 'nosuchmodule' in this folder or",
    "test 'a b:Method'": "no module 'a b' in this folder",
    # --- files and folders that are not there
    f"{ROBUSTNESS} --methods pc2pix@no.safetensors": "no.safetensors: no such weights file; train ",
    f"{ROBUSTNESS} --methods pc2pix@no.pt": "no.pt: weights are .safetensors files; 'bench train ",
    f"{ROBUSTNESS} --dataset folder:gone": "gone: no such folder; give the folder that holds your ",
    f"{ROBUSTNESS} --inception-weights no.pth": "no.pth: no such file; ",
    "table nowhere": "nowhere: no such folder; give a run's folder",
    "test folder:/no/such": "/no/such: no such folder",
    "data inspect nowhere": "nowhere: no such folder",
    "data inspect shapenet:.": "no ShapeNetCore here",
    "data verify gone": "gone: no such folder; give that of the meshes, or an export",
    # --- numbers
    f"{ROBUSTNESS} --limit 0": "--limit 0: must be at least 1",
    f"{ROBUSTNESS} --views -2": "--views -2: must be at least 1",
    f"{ROBUSTNESS} --workers 0": "--workers 0: must be at least 1",
    f"{ROBUSTNESS} --views 99999999999999999999": "too many; give at most 10000",
    f"{ROBUSTNESS} --limit 100000000": "too many; give at most 10000, or leave it for all objects ",
    f"{ROBUSTNESS} --dry-run --views 0": "--views 0: must be at least 1",
    f"{ROBUSTNESS} --dry-run --limit 100000000": "too many; give at most 10000, or leave it for ",
    "data export --views 0 --out x": "--views 0: must be at least 1",
    "data export --limit 100000000 --out x": "too many; give at most 10000, or leave it for all ",
    "data inspect . --sample -1": "--sample -1: must be at least 0",
    "data inspect . --workers 0": "--workers 0: must be at least 1",
    # --- what has no meaning together
    "run --suite latent --shard 1/2": "--shard: has no meaning for the suite latent",
    "run --suite stability --shard 1/2": "--shard: has no meaning for the suite stability",
    "run --suite speed --shard 1/2": "--shard: has no meaning for the suite speed",
    "run --suite latent --truth grey": "--truth: has no meaning for the suite latent, which has ",
    "run --suite stability --truth grey": "--truth: has no meaning for the suite stability, which ",
    "run --suite speed --truth coloured": "--truth: has no meaning for the suite speed, which has ",
    "run --suite stability --metrics flip": "--metrics: has no meaning for the suite stability",
    f"{ROBUSTNESS} --metrics flip --shard 1/2": "--metrics: has no meaning for a part of a run; ",
    f"{ROBUSTNESS} --metrics ssim": "metric 'ssim': suites that have it take it by themselves",
    "run --suite speed-accuracy --methods blank --workers 2": "--workers: has no meaning for the "
    "suite speed-accuracy, ",
    "run --suite speed-accuracy --dry-run --workers 2": "--workers: has no meaning",
    "run --suite speed --dry-run": "--dry-run: the suite speed takes minutes and has no plan",
    "run --suite latent --dry-run": "--dry-run: the suite latent takes minutes and has no plan",
    # --- packages of 'bench new'
    "new network mine": "'network' is not one of 'method', 'metric', 'dataset'",
    "new method My-Method": "an id is kebab-case (a-z, 0-9 and single hyphens), as in my-meth",
    "new method ../escape": "an id is kebab-case",
    "new method my-method@a": "an id is kebab-case",
    "new method splat-net": "pc2pix-bench uses that id itself",
    "new method best-reconstruction": "pc2pix-bench uses that id itself",
    "new metric ssim-object": "pc2pix-bench uses that id itself",
    "new dataset shapenet": "pc2pix-bench uses that id itself",
    "new method 3d-hull": "Python cannot import a module '3d_hull'",
    "new method lambda": "Python cannot import a module 'lambda'",
    "new metric numpy": "'numpy' means something else already",
}
WITHOUT_GPU = [
    f"{ROBUSTNESS} --methods splat",
    f"{ROBUSTNESS} --ray local",
    f"{ROBUSTNESS} --dry-run",
    "run --suite stability",
    "run --suite speed-accuracy",
    "train autoencoder --objects 1 --out x",
]


@pytest.fixture
def refused_here(refused, no_machine, tmp_path, monkeypatch):
    """Return the one line of a command line that is refused in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def run(line):
        said = refused(*shlex.split(line))
        assert list(tmp_path.iterdir()) == []
        return said

    return run


@pytest.mark.parametrize(("line", "says"), CASES.items())
def test_one_line_says_why_and_nothing_is_written(refused_here, line, says):
    assert says in refused_here(line)


DOWNLOAD = "--inception-weights download"
GREY = "--inception-weights: chair-robustness takes no fid against the true mesh in grey; leave it"
NO_WEIGHTS = "no weights; add --inception-weights download (95 MB, once)"
WITHOUT_FID = {  # asked for, and cannot be met
    f"{ROBUSTNESS} {DOWNLOAD}": "the FID weights cannot be fetched (<urlopen error [Errno 2] No ",
    f"{ROBUSTNESS} {DOWNLOAD} --truth grey": GREY,
    f"{ROBUSTNESS} {DOWNLOAD} --truth grey --dry-run": GREY,
    f"{ROBUSTNESS} --metrics fid": f"metric 'fid': {NO_WEIGHTS}",
    f"{ROBUSTNESS} --metrics kid --dry-run": f"metric 'kid': {NO_WEIGHTS}",
}


@pytest.mark.parametrize(("line", "says"), WITHOUT_FID.items())
def test_a_request_for_fid_that_cannot_be_met_fails_before_the_first_job(
    refused_here, tmp_path_factory, monkeypatch, line, says
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
    monkeypatch.setattr(inception_weights, "WEIGHTS_URL", "file:/no/such/weights.pth")
    assert refused_here(line).startswith(says)


def test_fid_of_a_run_without_it_is_refused_with_the_cause(refused, tmp_path):
    run = write_run(tmp_path / "run")
    for metric in ("fid", "kid"):
        said = refused("score", run, "--metrics", metric)
        assert said == f"{run}: fid: not measured, not here; start the run again so, which takes it"


@pytest.mark.skipif(torch.cuda.is_available(), reason="needs a machine without a GPU")
@pytest.mark.parametrize("line", WITHOUT_GPU)
def test_a_gpu_that_is_not_there_is_refused_before_the_first_job(refused_here, line):
    said = refused_here(f"{line} --device cuda")
    assert said.startswith(f"--device cuda: PyTorch {torch.__version__} ")
    assert "finds no usable GPU; use --device cpu" in said
