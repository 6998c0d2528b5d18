from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest
import torch

from learning.image_losses import FOREGROUND_WEIGHT, structural_similarity
from pc2pix.losses import (
    AZIMUTH_RANGE_RAD,
    ELEVATION_RANGE_RAD,
    OBJECTIVES,
    STRUCTURE_WEIGHT,
    Conditioning,
    angular_error,
    azimuth_error,
    chamfer,
    discriminator_loss,
    generator_loss,
    reconstruction_error,
)
from pc2pix.model import DiscriminatorOutput, sine_cosine


def points(*rows):
    return torch.tensor([rows], dtype=torch.float64)


def test_chamfer_by_hand():
    origin = points([0.0, 0.0, 0.0])
    assert chamfer(origin, points([1.0, 2.0, 2.0])).item() == 2 * 9
    assert chamfer(origin, points([0.0, 0.0, 0.0], [2.0, 0.0, 0.0])).item() == 0 + (0 + 4) / 2
    far = torch.rand(2, 50, 3) + 1000
    assert chamfer(far, far.flip(1)).item() == 0
    assert chamfer(torch.full((1, 4, 3), math.nan), torch.rand(1, 4, 3)).isnan()


def test_chamfer_with_half_a_cloud_in_a_plane_while_denormals_are_flushed():
    # SciPy's tree would overflow the stack, hence a process of its own
    script = (
        "import torch; from pc2pix.losses import chamfer; torch.set_flush_denormal(True);"
        "a = torch.rand(1, 100, 3, generator=torch.Generator().manual_seed(0));"
        "a[:, :60, 0] = 0.0; a[:, 60:, 0] *= 4.0;"
        "print(chamfer(a, a + 1e-3).item())"
    )
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    # Every point is nearest to itself, moved by 1e-3 in three coordinates: twice 3e-6. Sums
    # below 4 are rounded by up to 1.2e-7, which is 1.2e-4 of a move and twice that of its square.
    assert float(run.stdout) == pytest.approx(6e-6, rel=2.4e-4)


def test_chamfer_agrees_with_all_pairs():
    rng = torch.Generator().manual_seed(0)
    a = torch.rand(3, 40, 3, generator=rng, dtype=torch.float64).requires_grad_()
    b = torch.rand(3, 60, 3, generator=rng, dtype=torch.float64)
    table = (a[:, :, None] - b[:, None]).square().sum(-1)
    expected = table.amin(2).mean() + table.amin(1).mean()
    (expected_grad,) = torch.autograd.grad(expected, a)
    actual = chamfer(a, b)
    (found_grad,) = torch.autograd.grad(actual, a)
    assert abs(actual.item() - expected.item()) < 1e-14
    assert (found_grad - expected_grad).abs().max() < 1e-14


@pytest.mark.parametrize(
    ("predicted", "target", "range_rad", "expected"),
    [
        (0.99, 0.01, AZIMUTH_RANGE_RAD, 0.02 * 2 * math.pi),
        (0.01, 0.99, AZIMUTH_RANGE_RAD, 0.02 * 2 * math.pi),
        (0.25, 0.75, AZIMUTH_RANGE_RAD, math.pi),
        (0.0, 1.0, AZIMUTH_RANGE_RAD, 0.0),
        (0.5, 0.5, AZIMUTH_RANGE_RAD, 0.0),
        (0.0, 1.0, ELEVATION_RANGE_RAD, 0.4444 * math.pi),
        (0.99, 0.01, ELEVATION_RANGE_RAD, 0.98 * 0.4444 * math.pi),
    ],
)
def test_angular_error(predicted, target, range_rad, expected):
    values = (torch.tensor([[v]], dtype=torch.float64) for v in (predicted, target))
    assert abs(angular_error(*values, range_rad).item() - expected) < 1e-14


def judgement(logit, code, angle):
    return DiscriminatorOutput(
        torch.full((2, 1), float(logit)),
        torch.full((2, 3), float(code)),
        torch.full((2, 1), float(angle)),
        torch.full((2, 1), float(angle)),
    )


CONDITION = Conditioning(torch.zeros(2, 3), torch.full((2, 1), 0.5), torch.full((2, 1), 0.5))


def test_losses_stay_finite_for_certain_judgements():
    sure, objective = judgement(200, 0, 0.5), OBJECTIVES["acgan-paper"]
    assert generator_loss(sure, CONDITION, objective).total.item() == 0
    wrong = discriminator_loss(sure, sure, CONDITION, CONDITION, objective)
    assert wrong.total.item() == 200


@pytest.mark.parametrize(
    ("name", "code_term", "weight"),
    [("acgan-paper", 4.0, 1), ("acgan-code", 2.0, 10), ("paired", 2.0, 1)],
)
def test_objectives_weigh_as_their_source_says(name, code_term, weight):
    judged = judgement(0, 2, 0.6)  # undecided: a cross entropy of ln 2
    terms = generator_loss(judged, CONDITION, OBJECTIVES[name])
    azimuth, elevation = 0.1 * AZIMUTH_RANGE_RAD, 0.1 * ELEVATION_RANGE_RAD
    expected = math.log(2) + weight * (code_term + azimuth + elevation)
    assert terms.total.item() == pytest.approx(expected, rel=1e-6)  # float32
    np.testing.assert_allclose(
        [t.item() for t in terms[1:]], [math.log(2), code_term, elevation, azimuth], rtol=1e-6
    )
    both = discriminator_loss(judged, judged, CONDITION, CONDITION, OBJECTIVES[name])
    assert both.total.item() == pytest.approx(2 * expected, rel=1e-6)


def test_reconstruction_error_counts_the_object_three_times():
    real = torch.ones(1, 3, 32, 32)
    real[:, 0, :16] = -1  # the upper half is the object: cyan
    assert abs(reconstruction_error(real, real)) < 1e-6
    for half, weight in ((slice(0, 16), FOREGROUND_WEIGHT), (slice(16, 32), 1.0)):
        drawn = real.clone()
        drawn[:, 1, half] -= 0.5  # a quarter of the scale, in a third of the channels
        structure = 1 - structural_similarity((drawn + 1) / 2, (real + 1) / 2)
        expected = weight * 0.25 / 3 / 2 + STRUCTURE_WEIGHT * structure
        assert abs(reconstruction_error(drawn, real) - expected) < 1e-6


def test_sine_and_cosine_have_no_jump_at_the_back_and_an_error_of_their_own():
    front, left, back = torch.tensor([[0.5]]), torch.tensor([[0.75]]), torch.tensor([[1.0]])
    for azimuth, expected in ((front, [[0.0, 1.0]]), (left, [[1.0, 0.0]]), (back, [[0.0, -1.0]])):
        torch.testing.assert_close(sine_cosine(azimuth), torch.tensor(expected), atol=1e-6, rtol=0)
    assert azimuth_error(front, left).item() == pytest.approx(math.pi / 2, abs=1e-6)
    # judged in front, is at the side
    assert azimuth_error(torch.tensor([[0.0, 1.0]]), left).item() == pytest.approx(1, abs=1e-6)
