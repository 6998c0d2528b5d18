"""The networks of pc2pix in one file: encoders, decoder, generator, discriminator.

Sources: the paper's sections 3.1 and 3.2 (Tables 1 and 2) and roatienza/pc2pix@23b7b46d; where the
two differ, the code is followed and the place says so. One number scales every width. PyTorch
layout (NCHW) inside, but wherever channels and positions meet a dense layer they are ordered as in
the original (height, width, channel), so that weights trained there can be loaded.

Two identities save 40 % of the arithmetic without changing a result beyond rounding:
- nearest up-sampling commutes with BatchNorm and ReLU, and up-sampling followed by a 3x3
  convolution is a transposed 4x4 convolution of stride 2;
- a 3x3 convolution followed by 2x2 average pooling is a 4x4 convolution of stride 2, and a 1x1
  convolution commutes with the pooling.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from data_prep.scene import CLOUD_SIZE

NOISE_DIM = 128  # z ~ U(-1, 1)
GENERATOR_CHANNELS = (1024, 1024, 512, 256, 128, 64)  # Table 1: 4, 8, 16, 32, 64, 128 px
DISCRIMINATOR_CHANNELS = (64, 128, 256, 512, 1024)  # Table 2: 64, 32, 16, 8, 4 px
CODE_HEAD_CHANNELS = (256, 1024, 1024, 1024)  # Table 2
BRANCH_CHANNELS = 64
BRANCH_DILATIONS = (1, 2, 4, 8)
DOWN_CHANNELS = 128
ENCODER_STAGES = 4  # 2048, 1024, 512, 256 positions
LAST_CHANNELS = 32
DECODER_CHANNELS = 1024
POINT_CHANNELS = (64, 128, 256)  # PointNet, at every width

EncoderKind = Literal["paper", "pointnet"]
AzimuthKind = Literal["scalar", "sine-cosine"]


@dataclass(frozen=True)
class ModelConfig:
    """Widths and variants of all networks.

    Parameters
    ----------
    width : float
        Factor on every hidden width but PointNet's; 1.0 is the paper's.
    latent_dim : int
        Length of the code rho: 32 for chairs, 512 for all classes in the paper.
    encoder : {"paper", "pointnet"}
        "paper": dilated convolutions along the order of 2,048 points. "pointnet": ours,
        independent of order, any number of points.
    azimuth : {"scalar", "sine-cosine"}
        Form in which networks give and take the azimuth. "scalar": as in the paper, one number
        that jumps at the back of the object. "sine-cosine": ours, two numbers without a jump.

    Raises
    ------
    ValueError
        Where a number is not positive or a kind is unknown.
    """

    width: float = 1.0
    latent_dim: int = 32
    encoder: EncoderKind = "paper"
    azimuth: AzimuthKind = "scalar"

    def __post_init__(self) -> None:
        if not self.width > 0:
            raise ValueError(f"width must be positive, got {self.width}")
        if self.latent_dim < 1:
            raise ValueError(f"latent_dim must be at least 1, got {self.latent_dim}")
        if self.encoder not in ("paper", "pointnet"):
            raise ValueError(f"encoder must be paper or pointnet, got {self.encoder!r}")
        if self.azimuth not in ("scalar", "sine-cosine"):
            raise ValueError(f"azimuth must be scalar or sine-cosine, got {self.azimuth!r}")

    def scaled(self, channels: int) -> int:
        """Return a width of the paper scaled to this configuration, at least 1."""
        return max(1, round(channels * self.width))

    @property
    def azimuth_numbers(self) -> int:
        """The number of values that stand for an azimuth, 1 or 2."""
        return 1 if self.azimuth == "scalar" else 2


PAPER = ModelConfig()
LITE = ModelConfig(width=0.25)


def sine_cosine(azimuth01: Tensor) -> Tensor:
    """Return the sine and cosine of a normalised azimuth.

    Parameters
    ----------
    azimuth01 : Tensor, [B, 1]
        Azimuth as the generator takes it; 0.5 is the front.

    Returns
    -------
    Tensor, [B, 2]
        Sine and cosine; (0, 1) for the front.
    """
    angle = 2 * math.pi * (azimuth01 - 0.5)
    return torch.cat([torch.sin(angle), torch.cos(angle)], dim=1)


class DiscriminatorOutput(NamedTuple):
    """The discriminator's answers about B images.

    Attributes
    ----------
    real_logit : Tensor, [B, 1]
        Logit of being real, before the sigmoid, so that the cross entropy is stable; see `real`.
    code : Tensor, [B, latent_dim]
        Reconstructed code rho.
    elevation : Tensor, [B, 1]
        Elevation in (0, 1), normalised as the generator's input.
    azimuth : Tensor, [B, 1] or [B, 2]
        Azimuth in (0, 1), normalised as the generator's input; or sine and cosine, unbounded.
    """

    real_logit: Tensor
    code: Tensor
    elevation: Tensor
    azimuth: Tensor

    @property
    def real(self) -> Tensor:
        """The probability [B, 1] that the image is a real one (Table 2: p_real)."""
        return torch.sigmoid(self.real_logit)


def initialise(network: nn.Module) -> None:
    """Set Glorot-uniform kernels and zero biases, the initial state of the original (Keras)."""
    for module in network.modules():
        if isinstance(module, nn.Conv1d | nn.Conv2d | nn.Linear):
            nn.init.xavier_uniform_(module.weight)
            assert module.bias is not None
            nn.init.zeros_(module.bias)


def channels_last(network: nn.Module) -> None:
    """Change the memory layout of 2-D kernels in place; it is faster on CPU and GPU alike."""
    network.to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue] (stub gap)


# Generator: paper Table 1


def upsample_then_conv(x: Tensor, conv: nn.Conv2d) -> Tensor:
    """Return nearest x2, then a 3x3 convolution, as one transposed convolution: 4 taps for 9.

    Parameters
    ----------
    x : Tensor, [B, cin, H, W]
        Input.
    conv : Conv2d
        Convolution with a 3x3 kernel, stride 1 and padding 1.

    Returns
    -------
    Tensor, [B, cout, 2H, 2W]
        Convolution of the up-sampled input, to rounding.
    """
    kernel = 4 * functional.avg_pool2d(conv.weight.flip(2, 3), 2, stride=1, padding=1)
    return functional.conv_transpose2d(x, kernel.transpose(0, 1), conv.bias, stride=2, padding=1)


class UpBlock(nn.Module):
    """The ResBlock of Table 1: BN-ReLU-conv-(x2)-BN-ReLU-conv beside a 1x1 convolution and x2.

    The shortcut is a convolution even where the widths agree (code). The second BN comes before
    the up-sampling here: same statistics, a quarter of the elements.
    """

    def __init__(self, cin: int, cout: int) -> None:
        super().__init__()
        self.bn1 = nn.BatchNorm2d(cin, eps=2e-5, momentum=0.1)
        self.conv1 = nn.Conv2d(cin, cout, 3, padding=1)
        self.bn2 = nn.BatchNorm2d(cout, eps=2e-5, momentum=0.1)
        self.conv2 = nn.Conv2d(cout, cout, 3, padding=1)
        self.shortcut = nn.Conv2d(cin, cout, 1)

    def forward(self, x: Tensor) -> Tensor:  # [B, cin, H, W]
        """Map [B, cin, H, W] to [B, cout, 2H, 2W]."""
        y = self.conv1(functional.relu(self.bn1(x)))  # [B, cout, H, W]
        y = upsample_then_conv(functional.relu(self.bn2(y)), self.conv2)  # [B, cout, 2H, 2W]
        return y + functional.interpolate(self.shortcut(x), scale_factor=2.0)


class Generator(nn.Module):
    """The generator of Table 1, from noise, code and angles to an image.

    Departure of the original code from Table 1, followed here: no ReLU after the first dense layer.
    """

    def __init__(self, config: ModelConfig = PAPER) -> None:
        super().__init__()
        self.config = config
        c = [config.scaled(channels) for channels in GENERATOR_CHANNELS]
        angles = 1 + config.azimuth_numbers
        self.dense = nn.Linear(NOISE_DIM + config.latent_dim + angles, 4 * 4 * c[0])
        self.blocks = nn.ModuleList(UpBlock(cin, cout) for cin, cout in pairwise(c))
        self.bn = nn.BatchNorm2d(c[-1], eps=2e-5, momentum=0.1)
        self.conv = nn.Conv2d(c[-1], 3, 3, padding=1)
        initialise(self)

    def forward(
        self, noise: Tensor, code: Tensor, elevation01: Tensor, azimuth01: Tensor
    ) -> Tensor:
        """Return images of codes seen from angles.

        Parameters
        ----------
        noise : Tensor, [B, 128]
            Noise z, uniform in (-1, 1) while training.
        code : Tensor, [B, latent_dim]
            Code rho, whitened over the training set.
        elevation01 : Tensor, [B, 1]
            elevation_deg / 80 + 0.5.
        azimuth01 : Tensor, [B, 1]
            azimuth_deg / 360 + 0.5.

        Returns
        -------
        Tensor, [B, 3, 128, 128]
            Images in [-1, 1].
        """
        azimuth = azimuth01 if self.config.azimuth == "scalar" else sine_cosine(azimuth01)
        x = torch.cat([noise, code, elevation01, azimuth], dim=1)  # [B, 128 + d + 2 or 3]
        x = self.dense(x)  # [B, 16 c0]
        x = x.unflatten(1, (4, 4, -1)).permute(0, 3, 1, 2)  # [B, c0, 4, 4]
        for block in self.blocks:
            x = block(x)  # [B, c1, 8, 8] ... [B, c5, 128, 128]
        x = functional.relu(self.bn(x))
        return torch.tanh(self.conv(x))  # [B, 3, 128, 128]


# Discriminator: paper Table 2


def spectrally_normalised(weight: Tensor, u: Tensor, *, store: bool) -> Tensor:
    """Return a kernel [cout, ...] divided by an estimate of its largest singular value.

    As in the original: one power iteration per forward pass, starting from the stored u [cout],
    which is drawn from N(0, 1), and sigma from the new vectors. Two departures: the original stores
    the new u in *every* forward pass, here only training mode does (`store`), so that evaluation
    has no side effect; and the original lets gradients flow through u and v, which are constants
    here as in Miyato et al. 2018 (measured: 0.05 % of the gradient or less once u has converged).
    Works in the precision of the weights, whatever autocast says. A zero kernel gives NaN.
    """
    with torch.autocast(weight.device.type, enabled=False):
        matrix = weight.flatten(1)  # [cout, K]
        with torch.no_grad():
            v = _unit(u @ matrix)  # [K]
            new_u = _unit(matrix @ v)  # [cout]
            if store:
                u.copy_(new_u)
        return weight / torch.dot(new_u, matrix @ v)


def _unit(vector: Tensor) -> Tensor:
    return vector / (vector.norm() + 1e-12)


class SpectralConv2d(nn.Conv2d):
    """A "same" convolution with spectral normalisation."""

    u: Tensor

    def __init__(self, cin: int, cout: int, kernel_size: int) -> None:
        super().__init__(cin, cout, kernel_size, padding=kernel_size // 2)
        self.register_buffer("u", torch.randn(cout))

    def forward(self, input: Tensor) -> Tensor:
        """Map [B, cin, H, W] to [B, cout, H, W]."""
        kernel = spectrally_normalised(self.weight, self.u, store=self.training)
        return functional.conv2d(input, kernel, self.bias, padding=self.kernel_size[0] // 2)

    def then_pool(self, x: Tensor) -> Tensor:
        """Map [B, cin, 2H, 2W] to [B, cout, H, W]: 3x3 convolution, then 2x2 average pooling."""
        kernel = spectrally_normalised(self.weight, self.u, store=self.training)
        kernel = functional.avg_pool2d(kernel, 2, stride=1, padding=1)  # 4x4
        return functional.conv2d(x, kernel, self.bias, stride=2, padding=1)


class SpectralLinear(nn.Linear):
    """The DenseSN of Table 2: a dense layer with spectral normalisation."""

    u: Tensor

    def __init__(self, cin: int, cout: int) -> None:
        super().__init__(cin, cout)
        self.register_buffer("u", torch.randn(cout))

    def forward(self, input: Tensor) -> Tensor:
        """Map [B, cin] to [B, cout]."""
        kernel = spectrally_normalised(self.weight, self.u, store=self.training)
        return functional.linear(input, kernel, self.bias)


class DownBlock(nn.Module):
    """The ResBlockSN of Table 2: ReLU-conv-ReLU-conv-pool beside a 1x1 convolution and pool.

    The first block, too, starts with a ReLU on the raw image (code): negative pixel values reach
    the network only through the shortcut.
    """

    def __init__(self, cin: int, cout: int, *, pool: bool = True) -> None:
        super().__init__()
        self.conv1 = SpectralConv2d(cin, cout, 3)
        self.conv2 = SpectralConv2d(cout, cout, 3)
        self.shortcut = SpectralConv2d(cin, cout, 1)
        self.pool = pool

    def forward(self, x: Tensor) -> Tensor:
        """Map [B, cin, H, W] to [B, cout, H/2, W/2], or to H and W without pooling."""
        y = functional.relu(self.conv1(functional.relu(x)))  # [B, cout, H, W]
        if not self.pool:
            return self.conv2(y) + self.shortcut(x)
        return self.conv2.then_pool(y) + self.shortcut(functional.avg_pool2d(x, 2))


class Discriminator(nn.Module):
    """The discriminator of Table 2, from an image to real or not, code and angles.

    Every layer is spectrally normalised.
    """

    def __init__(self, config: ModelConfig = PAPER) -> None:
        super().__init__()
        self.config = config
        c = [3, *(config.scaled(channels) for channels in DISCRIMINATOR_CHANNELS)]
        h = [config.scaled(channels) for channels in CODE_HEAD_CHANNELS]
        self.blocks = nn.ModuleList(DownBlock(cin, cout) for cin, cout in pairwise(c))
        self.last_block = DownBlock(c[-1], c[-1], pool=False)
        self.code_hidden = nn.ModuleList(
            SpectralLinear(cin, cout) for cin, cout in zip([8 * 8 * c[-2], *h[:-1]], h, strict=True)
        )
        self.code = SpectralLinear(h[-1], config.latent_dim)
        self.real = SpectralLinear(c[-1], 1)
        self.elevation = SpectralLinear(c[-1], 1)
        self.azimuth = SpectralLinear(c[-1], config.azimuth_numbers)
        initialise(self)

    def forward(self, images: Tensor) -> DiscriminatorOutput:
        """Judge images; in training mode this moves every u.

        Parameters
        ----------
        images : Tensor, [B, 3, 128, 128]
            Images in [-1, 1].

        Returns
        -------
        DiscriminatorOutput
            Answers about the B images.
        """
        x = images
        for block in self.blocks[:-1]:
            x = block(x)  # [B, c1, 64, 64] ... [B, c4, 8, 8]
        code = x.permute(0, 2, 3, 1).flatten(1)  # [B, 64 c4]
        for layer in self.code_hidden:
            code = functional.relu(layer(code))  # [B, h]
        x = self.last_block(self.blocks[-1](x))  # [B, c5, 4, 4]
        x = functional.relu(x).sum(dim=(2, 3))  # [B, c5]
        return DiscriminatorOutput(
            real_logit=self.real(x),
            code=self.code(code),
            elevation=torch.sigmoid(self.elevation(x)),
            azimuth=self._azimuth(x),
        )

    def _azimuth(self, x: Tensor) -> Tensor:
        azimuth = self.azimuth(x)
        return torch.sigmoid(azimuth) if self.config.azimuth == "scalar" else azimuth


# Point-cloud autoencoder: paper section 3.1; its details are in the code only


class NormConv1d(nn.Module):
    """A BN-ReLU-conv1d of kernel 5 with Keras' "same" padding."""

    def __init__(self, cin: int, cout: int, *, dilation: int = 1, stride: int = 1) -> None:
        super().__init__()
        self.bn = nn.BatchNorm1d(cin, eps=1e-3, momentum=0.01)
        self.conv = nn.Conv1d(cin, cout, 5, dilation=dilation, stride=stride)
        # "same" at stride 2 on an even length pads one position on the left and two on the right
        self.padding = (1, 2) if stride == 2 else (2 * dilation, 2 * dilation)

    def forward(self, x: Tensor) -> Tensor:
        """Map [B, cin, L] to [B, cout, L / stride]."""
        return self.conv(functional.pad(functional.relu(self.bn(x)), self.padding))


class Encoder(nn.Module):
    """The paper's encoder: wide dilated 1-D convolutions with skip connections (section 3.1).

    The convolutions run along the *order* of the points: shuffling the rows of a cloud changes its
    code, as in the original.
    """

    cloud_size: int | None = CLOUD_SIZE

    def __init__(self, config: ModelConfig = PAPER) -> None:
        super().__init__()
        self.config = config
        branch, down, last = (
            config.scaled(channels) for channels in (BRANCH_CHANNELS, DOWN_CHANNELS, LAST_CHANNELS)
        )
        self.branches = nn.ModuleList()  # per stage: four dilations side by side
        self.compress = nn.ModuleList()  # the skip path; the original's fourth one feeds nothing
        self.down = nn.ModuleList()
        cin, skip = 3, 3
        for stage in range(ENCODER_STAGES):
            self.branches.append(
                nn.ModuleList(NormConv1d(cin, branch, dilation=d) for d in BRANCH_DILATIONS)
            )
            wide = len(BRANCH_DILATIONS) * branch + skip
            if stage < ENCODER_STAGES - 1:
                self.compress.append(nn.Conv1d(wide, branch, 1))
                self.down.append(NormConv1d(wide, down, stride=2))
                cin, skip = down, branch
            else:
                self.last = NormConv1d(wide, last)
        self.dense = nn.Linear(CLOUD_SIZE // 2 ** (ENCODER_STAGES - 1) * last, config.latent_dim)
        initialise(self)

    def forward(self, points: Tensor) -> Tensor:
        """Return the codes of clouds.

        Parameters
        ----------
        points : Tensor, [B, 2048, 3]
            Clouds in unit-sphere coordinates.

        Returns
        -------
        Tensor, [B, latent_dim]
            Codes, not whitened.
        """
        x = skip = points.transpose(1, 2)  # [B, 3, 2048]
        for stage, branches in enumerate(self.branches):
            assert isinstance(branches, nn.ModuleList)
            # [B, 4 branch + skip, L], L = 2048, 1024, 512, 256
            wide = torch.cat([*(branch(x) for branch in branches), skip], dim=1)
            if stage < ENCODER_STAGES - 1:
                skip = functional.max_pool1d(functional.relu(self.compress[stage](wide)), 2)
                x = self.down[stage](wide)  # [B, down, L / 2]
            else:
                x = self.last(wide)  # [B, last, 256]
        return self.dense(x.transpose(1, 2).flatten(1))  # [B, latent_dim]


class PointNet(nn.Module):
    """A PointNet (Qi et al. 2017): a network on every point, then maximum and mean over them.

    The code does not depend on the order of the points, and any number of points will do. No
    BatchNorm: it costs more than the layers it would serve, and ties a cloud's code to its batch.
    Its width is the same in all profiles.
    """

    cloud_size: int | None = None  # any

    def __init__(self, config: ModelConfig) -> None:
        super().__init__()
        self.config = config
        c = POINT_CHANNELS
        self.points = nn.ModuleList(nn.Linear(cin, cout) for cin, cout in pairwise((3, *c)))
        self.hidden = nn.Linear(2 * c[-1], c[-1])
        self.code = nn.Linear(c[-1], config.latent_dim)
        initialise(self)

    def forward(self, points: Tensor) -> Tensor:
        """Return the codes of clouds.

        Parameters
        ----------
        points : Tensor, [B, N, 3], N > 0
            Clouds in unit-sphere coordinates.

        Returns
        -------
        Tensor, [B, latent_dim]
            Codes, not whitened.
        """
        x = points
        for layer in self.points:
            x = functional.relu(layer(x))  # [B, N, c]
        pooled = torch.cat([x.amax(dim=1), x.mean(dim=1)], dim=1)  # [B, 2 c]
        return self.code(functional.relu(self.hidden(pooled)))  # [B, latent_dim]


def build_encoder(config: ModelConfig) -> Encoder | PointNet:
    """Return the encoder that a configuration asks for, freshly initialised."""
    return Encoder(config) if config.encoder == "paper" else PointNet(config)


class Decoder(nn.Module):
    """The decoder from a code to a cloud: three hidden dense layers and tanh.

    It is used only to train the encoder, and to see what codes mean.
    """

    def __init__(self, config: ModelConfig = PAPER) -> None:
        super().__init__()
        self.config = config
        hidden = config.scaled(DECODER_CHANNELS)
        sizes = [config.latent_dim, hidden, hidden, hidden, CLOUD_SIZE * 3]
        self.layers = nn.ModuleList(nn.Linear(cin, cout) for cin, cout in pairwise(sizes))
        initialise(self)

    def forward(self, code: Tensor) -> Tensor:
        """Return the clouds of codes.

        Parameters
        ----------
        code : Tensor, [B, latent_dim]
            Codes, as the encoder gives them or whitened, depending on the training.

        Returns
        -------
        Tensor, [B, 2048, 3]
            Clouds in (-1, 1).
        """
        x = code
        for layer in self.layers[:-1]:
            x = functional.relu(layer(x))  # [B, hidden]
        return torch.tanh(self.layers[-1](x)).unflatten(1, (CLOUD_SIZE, 3))  # [B, 2048, 3]
