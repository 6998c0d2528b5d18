"""Training by several processes at once, one for each GPU or CPU, as `torchrun` starts them.

Every process has the whole networks, and draws batches of its own with a random generator of its
own. Gradients are averaged before each optimiser step, so that weights stay the same in all
processes, and the batch is `count` times as large. Lightning Fabric (extra `distributed`) connects
the processes; a single process does not need it.

BatchNorm's statistics are not averaged. Each process normalises by those of its own batch, and has
moving statistics of its own; those of process 0 are saved. Moving statistics change no gradient,
because networks train on those of batches. The vectors of spectral normalisation are the same in
all processes, because they follow from the weights alone.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, TypeVar

import torch
from torch import Tensor, nn

from data_prep.failures import BadInput, MissingDependency
from data_prep.randomness import generator

if TYPE_CHECKING:
    from lightning_fabric import Fabric

Name = TypeVar("Name")


class Processes:
    """The processes of a training. This base class is for one process, where nothing is averaged.

    rank   number of this process, from 0
    count  number of all processes

    With several processes, every method but `random` waits until all of them have called it.
    """

    rank = 0
    count = 1

    def random(self, seed: int) -> torch.Generator:
        """Return the random generator of this process; process 0 has PyTorch's own for `seed`."""
        return torch.Generator().manual_seed(seed)

    def average_gradients(self, parameters: Iterable[nn.Parameter]) -> None:
        """Replace each gradient by its mean over the processes, in place."""

    def average(self, values: Mapping[Name, float]) -> dict[Name, float]:
        """Return the mean of each value over the processes; NaN where a value is NaN."""
        return dict(values)

    def gather(self, tensor: Tensor) -> list[Tensor]:
        """Return the tensors of all processes, in the order of ranks, on the CPU.

        They must have the same shape.
        """
        return [tensor]


ONE = Processes()


class _FabricProcesses(Processes):
    """A group of processes connected by Fabric: gloo between CPUs, NCCL between GPUs."""

    def __init__(self, fabric: Fabric) -> None:
        self.fabric = fabric
        self.rank, self.count = fabric.global_rank, fabric.world_size

    def random(self, seed: int) -> torch.Generator:
        if self.rank == 0:
            return ONE.random(seed)
        stream_seed = generator("training process", seed, self.rank).integers(2**63)
        return torch.Generator().manual_seed(int(stream_seed))

    @torch.no_grad()
    def average_gradients(self, parameters: Iterable[nn.Parameter]) -> None:
        """Replace all gradients by their means over the processes, in one message.

        The same parameters must have gradients in all processes.
        """
        gradients = [p.grad for p in parameters if p.grad is not None]
        flat = torch.cat([gradient.reshape(-1) for gradient in gradients])
        self._reduce(flat)
        sizes = [gradient.numel() for gradient in gradients]
        for gradient, mean in zip(gradients, flat.split(sizes), strict=True):
            gradient.copy_(mean.view(gradient.shape))

    def average(self, values: Mapping[Name, float]) -> dict[Name, float]:
        """Return the mean of each value over the processes, computed in float64.

        All processes must pass the same names in the same order.
        """
        numbers = torch.tensor(list(values.values()), dtype=torch.float64)
        numbers = numbers.to(self.fabric.device)
        self._reduce(numbers)
        return dict(zip(values, numbers.tolist(), strict=True))

    def gather(self, tensor: Tensor) -> list[Tensor]:
        """Return the tensors of all processes, without rounding.

        Each process fills its own row of a table of zeros, and the tables are added up.
        """
        table = tensor.new_zeros(self.count, *tensor.shape, device=self.fabric.device)
        table[self.rank] = tensor
        self.fabric.all_reduce(table, reduce_op="sum")
        return list(table.cpu())

    def _reduce(self, tensor: Tensor) -> None:
        self.fabric.all_reduce(tensor, reduce_op="mean")


def is_first() -> bool:
    """Return whether this process is the one that writes files and messages."""
    return _from_torchrun("RANK", 0) == 0


def local_rank() -> int | None:
    """Return the number of this process on its machine; None where there is only one process."""
    if _from_torchrun("WORLD_SIZE", 1) == 1:
        return None
    return _from_torchrun("LOCAL_RANK", 0)


def connect(device: torch.device) -> Processes:
    """Return the processes that `torchrun` started, or this one where it did not.

    device  type of device that each process trains on

    Raises BadInput where a machine has more processes than GPUs, and MissingDependency where there
    are several processes and Lightning Fabric is not installed.
    """
    count = _from_torchrun("WORLD_SIZE", 1)
    if count == 1:
        return ONE
    here = _from_torchrun("LOCAL_WORLD_SIZE", count)
    if device.type == "cuda" and here > torch.cuda.device_count():
        raise BadInput(
            f"--nproc_per_node {here}: this machine has {torch.cuda.device_count()} GPUs; start "
            "at most one process for each, or use --device cpu"
        )
    try:
        from lightning_fabric import Fabric
    except ImportError:
        raise MissingDependency(
            f"torchrun started {count} processes, and training with more than one needs Lightning "
            "Fabric; pip install 'pc2pix-bench[distributed]', or start one process"
        ) from None
    # Otherwise Fabric writes a line for every process on standard error.
    logging.getLogger("lightning_fabric").setLevel(logging.WARNING)
    fabric = Fabric(
        accelerator=device.type,
        devices=here,
        num_nodes=_from_torchrun("GROUP_WORLD_SIZE", 1),
        strategy="ddp",
    )
    fabric.launch()  # `torchrun` has started the processes, so this only connects them
    return _FabricProcesses(fabric)


def _from_torchrun(name: str, default: int) -> int:
    """Return the number in an environment variable of `torchrun`, or `default` without it."""
    # Other launchers also set WORLD_SIZE, with another meaning; this one only `torchrun` sets.
    if "TORCHELASTIC_RUN_ID" not in os.environ:
        return default
    return int(os.environ.get(name, default))
