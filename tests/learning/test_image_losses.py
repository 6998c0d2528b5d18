from __future__ import annotations

import numpy as np
import pytest
import torch

from learning.image_losses import structural_similarity


def images(count=2, size=40):
    rng = torch.Generator().manual_seed(0)
    a = torch.rand(count, 3, size, size + 6, generator=rng, dtype=torch.float64)
    return a, 0.6 * a + 0.4 * torch.rand(a.shape, generator=rng, dtype=torch.float64)


@pytest.mark.parametrize("every", [1, 2])
def test_structural_similarity_is_scikit_images_at_every_so_many_windows(every):
    from skimage.metrics import structural_similarity as reference

    a, b = images()
    expected = []
    for first, other in zip(a.numpy(), b.numpy(), strict=True):
        _, full = reference(
            first, other, data_range=1, channel_axis=0, gaussian_weights=True, sigma=1.5,
            use_sample_covariance=False, full=True,
        )  # fmt: skip
        expected.append(full[:, 5:-5:every, 5:-5:every].mean())
    # the windows' weights are float32 here
    assert abs(structural_similarity(a, b, every).item() - np.mean(expected)) < 1e-6


def test_structural_similarity_has_the_gradient_of_finite_differences():
    a, b = images(1, 13)
    assert torch.autograd.gradcheck(lambda x: structural_similarity(x, b), a.requires_grad_())
