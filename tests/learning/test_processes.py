from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file

from data_prep.failures import BadInput, MissingDependency
from learning import checkpoint, processes
from learning.training_loop import prepare_device, seeded
from tests.learning.trainings import TRAININGS

from . import two_processes


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return the folder that two processes have written."""
    pytest.importorskip(
        "lightning_fabric", reason="needs the extra 'distributed' (Lightning Fabric)"
    )
    folder = tmp_path_factory.mktemp("two")
    torch.save(torch.randn(4, 2, 4, 4, generator=torch.Generator().manual_seed(0)),
               folder / "inputs.pt")  # fmt: skip
    launch = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc_per_node=2"]
    done = subprocess.run(
        [*launch, "-m", two_processes.__name__, str(folder)],
        capture_output=True,
        text=True,
        timeout=300,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        cwd=Path(__file__).parents[2],
    )
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.slow
def test_the_mean_gradient_is_that_of_the_joined_batch(folder):
    network = seeded(0, two_processes.two_layers)
    network(torch.load(folder / "inputs.pt")).square().mean().backward()
    for rank in (0, 1):
        averaged = load_file(folder / f"gradients-{rank}.safetensors")
        for name, parameter in network.named_parameters():
            # sums of at most 48 float32 products in another order
            torch.testing.assert_close(averaged[name], parameter.grad, rtol=1e-5, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("training", ["whole", "decoder"])
def test_all_processes_end_with_the_same_weights_of_batches_of_their_own(folder, training):
    first, second = (load_file(folder / f"{training}-{rank}.safetensors") for rank in (0, 1))
    separate = ("running_", "random")  # BatchNorm's moving statistics, and the random streams
    for key, value in first.items():
        if not any(part in key for part in separate):
            assert torch.equal(value, second[key]), key
    assert not torch.equal(first["random"], second["random"])


@pytest.mark.slow
def test_a_resumed_run_is_the_uninterrupted_one(folder, tmp_path):
    (whole, step, _), (cut, other, _) = (
        checkpoint.load(folder / name / checkpoint.FILE_NAME, "gan") for name in ("whole", "cut")
    )
    assert step == other == 4
    assert whole.keys() == cut.keys()
    assert all(torch.equal(whole[key], cut[key]) for key in whole)
    logs = [(folder / name / "losses.csv").read_text() for name in ("whole", "cut")]
    assert logs[0] == logs[1]
    with pytest.raises(BadInput, match=r"trained by 2 process.*a run of 1.*nproc_per_node 2"):
        TRAININGS["gan"](folder / "whole", 6)
    alone, _, _ = checkpoint.load(TRAININGS["gan"](tmp_path, 4), "gan")
    assert torch.equal(alone["random"], whole["random"])  # process 0 draws what one would
    assert not torch.equal(alone["discriminator.real.weight"], whole["discriminator.real.weight"])


@pytest.mark.slow
def test_only_the_first_process_reports_and_writes_a_decoder(folder):
    """All fit it together; it stands beside the weights once, and its checkpoint, too."""
    first, second = (json.loads((folder / f"said-{rank}.json").read_text()) for rank in (0, 1))
    written = {"weights-decoder.safetensors", checkpoint.FILE_NAME, "losses.csv"}
    assert written <= set(first.pop("replaced"))
    assert (folder / "weights-decoder.safetensors").is_file()
    assert first == {"first": True, "reports": [1, 2, 3, 4]}
    assert second == {"first": False, "reports": [], "replaced": []}


TORCHRUN = {"TORCHELASTIC_RUN_ID": "x", "WORLD_SIZE": 2, "RANK": 1, "LOCAL_RANK": 1}


@pytest.fixture
def torchrun(monkeypatch):
    for name, value in TORCHRUN.items():
        monkeypatch.setenv(name, str(value))
    return monkeypatch


def test_what_several_processes_need(torchrun):
    torchrun.setattr(torch.cuda, "device_count", lambda: 1)
    with pytest.raises(BadInput, match="--nproc_per_node 2: this machine has 1 GPUs"):
        processes.connect(torch.device("cuda"))
    torchrun.setitem(sys.modules, "lightning_fabric", None)
    missing = r"started 2 processes.*pc2pix-bench\[distributed\]"
    with pytest.raises(MissingDependency, match=missing):
        processes.connect(torch.device("cpu"))
    # one process, and other launchers, need nothing
    torchrun.setenv("WORLD_SIZE", "1")
    assert processes.connect(torch.device("cpu")) is processes.ONE
    torchrun.setenv("WORLD_SIZE", "2")
    torchrun.delenv("TORCHELASTIC_RUN_ID")
    assert processes.connect(torch.device("cpu")) is processes.ONE
    assert processes.is_first()


def test_auto_is_the_gpu_where_there_is_one():
    assert prepare_device("auto", lambda: False) == torch.device("cpu")
    with pytest.raises(BadInput, match=r"--device cuda: .* no usable GPU; use --device cpu"):
        prepare_device("cuda", lambda: False)
    assert prepare_device("auto", lambda: True) == torch.device("cuda")


@pytest.mark.usefixtures("torchrun")
def test_each_process_has_a_gpu():
    assert prepare_device("auto", lambda: True) == torch.device("cuda", 1)
    assert prepare_device("cpu", lambda: True) == torch.device("cpu")
