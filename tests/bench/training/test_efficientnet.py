"""EfficientNet-Lite0: its first maps, and the network as modules of PyTorch."""

from __future__ import annotations

import pytest
import torch
from torch import nn
from torch.nn import functional

from bench.metrics.learned_weights import read_tensors
from bench.training.efficientnet import WEIGHTS, EfficientNet, load_efficientnet
from tests.bench.metrics.test_lpips import disc, noise

# By the code of the package efficientnet-lite-pytorch 0.1.0 in float64, on 2026-11-25: length of
# the 1,280 means of `extract_features((uint8 - 127) / 128)`, and the three largest by their number.
IMAGES = {
    "noise 0": noise(0, 128, 128, 3),
    "disc 30 (200,80,40)": disc(30, (200, 80, 40)),
    "white": disc(0, 255),
}
GOLDEN = {
    "noise 0": (12.53489007, {113: 4.890298826, 455: 4.364327481, 434: 3.540951271}),
    "disc 30 (200,80,40)": (27.505829562, {220: 5.382782813, 353: 5.011128093, 1157: 4.790445281}),
    "white": (5.835769122, {468: 3.044018798, 949: 1.574853589, 659: 1.569849277}),
}
BLOCKS = (  # of the paper's table: blocks, kernel, stride of the first, expansion, in, out
    *((1, 3, 1, 1, 32, 16), (2, 3, 2, 6, 16, 24), (2, 5, 2, 6, 24, 40), (3, 3, 2, 6, 40, 80)),
    *((3, 5, 1, 6, 80, 112), (4, 5, 2, 6, 112, 192), (1, 3, 1, 6, 192, 320)),
)


class Same(nn.Module):
    """A convolution padded as TensorFlow's SAME, and BatchNorm."""

    def __init__(self, cin, cout, kernel, stride=1, groups=1):
        super().__init__()
        self.conv = nn.Conv2d(cin, cout, kernel, stride, groups=groups, bias=False)
        self.norm = nn.BatchNorm2d(cout, eps=1e-3)

    def forward(self, x):
        (kernel, _), (stride, _) = self.conv.kernel_size, self.conv.stride
        total = [max((-(-n // stride) - 1) * stride + kernel - n, 0) for n in x.shape[:1:-1]]
        x = functional.pad(x, [half for n in total for half in (n // 2, n - n // 2)])
        return self.norm(self.conv(x))


class Bottleneck(nn.Module):
    def __init__(self, cin, cout, kernel, stride, expansion):
        super().__init__()
        wide, relu = cin * expansion, nn.ReLU6()
        expand = [Same(cin, wide, 1), relu] if expansion > 1 else []
        depthwise = [Same(wide, wide, kernel, stride, wide), relu]
        self.layers = nn.Sequential(*expand, *depthwise, Same(wide, cout, 1))
        self.skips = stride == 1 and cin == cout

    def forward(self, x):
        return x + self.layers(x) if self.skips else self.layers(x)


@pytest.fixture(scope="module")
def network():
    """The whole network from the table of the paper, with the published weights, in float64."""
    blocks = [
        Bottleneck(cout if i else cin, cout, kernel, 1 if i else stride, expansion)
        for count, kernel, stride, expansion, cin, cout in BLOCKS
        for i in range(count)
    ]
    network = nn.Sequential(Same(3, 32, 3, 2), nn.ReLU6(), *blocks, Same(320, 1280, 1), nn.ReLU6())
    tensors = read_tensors(WEIGHTS.find(), WEIGHTS)
    stored = [tensor for name, tensor in tensors.items() if not name.startswith("_fc")]
    named = network.state_dict()
    assert [t.shape for t in named.values()] == [t.shape for t in stored]
    network.load_state_dict(dict(zip(named, stored, strict=True)))
    return network.eval().double()


@pytest.mark.parametrize("name", IMAGES)
def test_the_modules_have_the_values_of_the_published_code(network, name):
    length, largest = GOLDEN[name]
    pixels = torch.from_numpy(IMAGES[name]).permute(2, 0, 1)[None].double()
    with torch.no_grad():
        features = network((pixels - 127) / 128).mean(dim=(2, 3))[0]
    assert float(features.norm()) == pytest.approx(length, rel=1e-6)
    assert features.argsort(descending=True)[:3].tolist() == list(largest)
    assert features[list(largest)].tolist() == pytest.approx(list(largest.values()), abs=1e-6)


def test_first_maps_are_those_of_the_modules(network):
    """After the stem and its ReLU6, and the first block of each of three stages of stride 2."""
    pixels = torch.from_numpy(noise(3, 2, 64, 96, 3)).permute(0, 3, 1, 2).double().requires_grad_()
    compared = EfficientNet(WEIGHTS.find(), torch.float64).first_maps(pixels)
    assert [tuple(m.shape[1:]) for m in compared] == [
        *((32, 32, 48), (24, 16, 24), (40, 8, 12), (80, 4, 6))
    ]
    x = (pixels - 127) / 128
    for ours, layers in zip(compared, (2, 4, 6, 8), strict=True):
        torch.testing.assert_close(ours, network[:layers](x), rtol=0, atol=1e-6)
    (gradient,) = torch.autograd.grad(compared[-1].sum(), pixels)
    theirs = pixels.detach().clone().requires_grad_()
    (expected,) = torch.autograd.grad(network[:8]((theirs - 127) / 128).sum(), theirs)
    torch.testing.assert_close(gradient, expected, rtol=0, atol=1e-6)
    for ours, single in zip(
        compared, load_efficientnet(WEIGHTS.find()).first_maps(pixels), strict=True
    ):
        torch.testing.assert_close(single.double(), ours, rtol=0, atol=1e-3)
