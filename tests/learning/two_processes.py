"""The program of test_processes.py for torchrun: python -m tests.learning.two_processes FOLDER."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import torch
from safetensors.torch import save_file

from bench.training.networks import train
from bench.training.options import OPTIONS
from learning import processes, training_loop
from learning.training_loop import seeded
from pc2pix.weights import export
from tests.learning.trainings import TRAININGS


def two_layers():
    """Return a network with kernels in both memory layouts."""
    return torch.nn.Sequential(
        torch.nn.Conv2d(2, 3, 3).to(memory_format=torch.channels_last),
        torch.nn.Flatten(),
        torch.nn.Linear(12, 5),
    )


def gradients(team, folder):
    """Each process has half of a batch."""
    network = seeded(0, two_layers)
    inputs = torch.load(folder / "inputs.pt")
    network(inputs.chunk(team.count)[team.rank]).square().mean().backward()
    team.average_gradients(network.parameters())
    parameters = dict(network.named_parameters())
    save_file({name: p.grad.contiguous() for name, p in parameters.items()},
              folder / f"gradients-{team.rank}.safetensors")  # fmt: skip


def start_decoder(folder):
    """Train a decoder by the command's function; return the files that this process replaced."""
    replaced = []
    replace = os.replace
    os.replace = lambda old, new: (replaced.append(Path(new).name), replace(old, new))
    options = OPTIONS["decoder"](
        weights=str(folder / "weights.safetensors"),
        objects=2,
        steps=2,
        batch=2,
        threads=1,
        out=folder / "decoder",
    )
    train("decoder", options)
    os.replace = replace
    return replaced


def keep_states(folder):
    """Have every process write its trainer's state after each training."""
    run = training_loop.run

    def run_and_keep(trainer, out_dir, *more):
        path = run(trainer, out_dir, *more)
        plain = {key: value.detach().contiguous() for key, value in trainer.state().items()}
        save_file(plain, folder / f"{out_dir.name}-{trainer.processes.rank}.safetensors")
        return path

    training_loop.run = run_and_keep


def main(folder):
    team = processes.connect(torch.device("cpu"))
    gradients(team, folder)
    keep_states(folder)
    reports = []
    gan = TRAININGS["gan"]
    gan(folder / "whole", 4, lambda report: reports.append(report.step))
    gan(folder / "cut", 2)
    gan(folder / "cut", 4)
    if team.rank == 0:
        export(folder / "whole" / "checkpoint.safetensors", folder / "weights.safetensors")
    team.average({"exported": 1.0})
    replaced = start_decoder(folder)
    said = {"first": processes.is_first(), "reports": reports}
    (folder / f"said-{team.rank}.json").write_text(json.dumps(said | {"replaced": replaced}))


if __name__ == "__main__":
    torch.set_num_threads(1)
    main(Path(sys.argv[1]))
