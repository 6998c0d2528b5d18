"""What test_processes.py has torchrun start twice: python two_processes.py FOLDER."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import save_file

from learning import processes, training_loop
from learning.training_loop import Cadence, seeded
from pc2pix.model import Encoder, ModelConfig
from pc2pix.train_autoencoder import AutoencoderConfig, AutoencoderData, train_autoencoder
from pc2pix.train_gan import GanConfig, GanData, train_gan
from pc2pix.weights import export

TINY = ModelConfig(width=0.0625, latent_dim=4)
CADENCE = Cadence(log=1, sheet=9, checkpoint=2)


def gradients(team, folder):
    """Each process has half of a batch of a network with kernels in both memory layouts."""
    network = seeded(0, two_layers)
    inputs = torch.load(folder / "inputs.pt")
    network(inputs.chunk(team.count)[team.rank]).square().mean().backward()
    team.average_gradients(network.parameters())
    parameters = dict(network.named_parameters())
    save_file({name: p.grad.contiguous() for name, p in parameters.items()},
              folder / f"gradients-{team.rank}.safetensors")  # fmt: skip


def two_layers():
    return torch.nn.Sequential(
        torch.nn.Conv2d(2, 3, 3).to(memory_format=torch.channels_last),
        torch.nn.Flatten(),
        torch.nn.Linear(12, 5),
    )


def make_data():
    rng = np.random.default_rng(1)
    return GanData(
        images=rng.integers(0, 256, (3, 2, 128, 128, 3), dtype=np.uint8),
        azimuth_deg=rng.uniform(-180, 180, (3, 2)),
        elevation_deg=rng.uniform(-40, 40, (3, 2)),
        clouds=rng.uniform(-0.5, 0.5, (3, 2048, 3)).astype(np.float32),
    )


def start_gan(folder, steps, on_progress=lambda report: None):
    config = GanConfig(model=TINY, batch=2, cadence=CADENCE, steps=steps)
    return train_gan(
        make_data(), seeded(0, lambda: Encoder(TINY)), config, folder, on_progress=on_progress
    )


def start_decoder(folder):
    """By the command's own function, and the files that this process replaced by new ones."""
    from bench.commands.train import DecoderOptions, train_decoder

    replaced = []
    replace = os.replace
    os.replace = lambda old, new: (replaced.append(Path(new).name), replace(old, new))
    options = DecoderOptions(
        weights=str(folder / "weights.safetensors"),
        objects=2,
        steps=2,
        batch=2,
        threads=1,
        out=folder / "decoder",
    )
    train_decoder(options)
    os.replace = replace
    (folder / f"decoder-wrote-{os.environ['RANK']}.json").write_text(json.dumps(replaced))


def keep_states(folder):
    """Have every process write its trainer's state after each training."""
    run = training_loop.run

    def run_and_keep(trainer, config, data_hash, out_dir, on_progress, team):
        path = run(trainer, config, data_hash, out_dir, on_progress, team)
        plain = {key: value.detach().contiguous() for key, value in trainer.state().items()}
        save_file(plain, folder / f"{out_dir.name}-{team.rank}.safetensors")
        return path

    training_loop.run = run_and_keep


def main(folder):
    team = processes.connect(torch.device("cpu"))
    gradients(team, folder)
    keep_states(folder)
    reports = []
    start_gan(folder / "whole", 4, lambda report: reports.append(report.step))
    start_gan(folder / "cut", 2)
    start_gan(folder / "cut", 4)
    train_autoencoder(
        AutoencoderData(make_data().clouds),
        AutoencoderConfig(model=TINY, batch=2, steps=2, cadence=CADENCE),
        folder / "autoencoder",
    )
    if team.rank == 0:
        export(folder / "whole" / "checkpoint.safetensors", folder / "weights.safetensors")
    team.average({"exported": 1.0})
    start_decoder(folder)
    said = {"rank": int(os.environ["RANK"]), "first": processes.is_first(), "reports": reports}
    (folder / f"said-{team.rank}.json").write_text(json.dumps(said))


if __name__ == "__main__":
    torch.set_num_threads(1)
    main(Path(sys.argv[1]))
