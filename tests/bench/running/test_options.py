from __future__ import annotations

import pytest
import torch

from bench.catalogue.metrics import metrics_device
from bench.running.options import Options, device_of, refuse_values
from data_prep.failures import BadInput


def refuses(**options) -> bool:
    try:
        refuse_values(Options("chair-robustness", **options))
    except BadInput:
        return True
    return False


def test_only_the_machine_that_draws_needs_the_gpu() -> None:
    if torch.cuda.is_available():
        pytest.skip("needs a machine without a GPU")
    assert refuses(device="cuda")
    assert refuses(device="cuda", ray="local")
    assert not refuses(device="cuda", ray="10.0.0.1:6379")  # a cluster's nodes have GPUs of theirs
    assert not refuses(device="auto")


@pytest.mark.parametrize(
    ("device", "ray", "here", "expected", "of_metrics"),
    [
        ("auto", None, "cpu", "auto", "cpu"),
        ("auto", None, "cuda", "cuda", "cuda"),
        ("auto", "local", "cuda", "cuda", "cuda"),
        ("auto", "10.0.0.1:6379", "cuda", "auto", "cpu"),  # its nodes may have none
        ("cpu", None, "cuda", "cpu", "cpu"),
        ("cuda", "10.0.0.1:6379", "cpu", "cuda", "cuda"),
    ],
)
def test_a_run_is_on_one_device(device, ray, here, expected, of_metrics) -> None:
    options = Options("chair-robustness", device=device, ray=ray)
    assert device_of(options, lambda asked: here) == expected
    assert metrics_device(expected) == of_metrics
