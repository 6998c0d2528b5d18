"""The point-cloud autoencoder: encoders from clouds to codes, and the decoder back.

The paper's section 3.1 outlines it; the details are those of roatienza/pc2pix@23b7b46d.
"""

from __future__ import annotations

import copy
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

from data_prep.scene import CLOUD_SIZE
from pc2pix.model_config import PAPER, ModelConfig

_BRANCH_CHANNELS = 64
_BRANCH_DILATIONS = (1, 2, 4, 8)
_DOWN_CHANNELS = 128
_ENCODER_STAGES = 4  # 2048, 1024, 512, 256 positions
_LAST_CHANNELS = 32
_DECODER_CHANNELS = 1024
_POINT_CHANNELS = (64, 128, 256)  # PointNet, at every width


def initialise(network: nn.Module) -> None:
    """Set Glorot-uniform kernels and zero biases, the initial state of the original (Keras)."""
    for module in network.modules():
        if isinstance(module, nn.Conv1d | nn.Conv2d | nn.Linear):
            nn.init.xavier_uniform_(module.weight)
            assert module.bias is not None
            nn.init.zeros_(module.bias)


class _NormConv1d(nn.Module):
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
    """The paper's encoder from a cloud to a code.

    The convolutions run along the *order* of the points: shuffling the rows of a cloud changes its
    code, as in the original.
    """

    cloud_size: int | None = CLOUD_SIZE

    def __init__(self, config: ModelConfig = PAPER) -> None:
        super().__init__()
        self.config = config
        branch, down, last = (
            config.scaled(channels)
            for channels in (_BRANCH_CHANNELS, _DOWN_CHANNELS, _LAST_CHANNELS)
        )
        self.branches = nn.ModuleList()  # per stage: four dilations side by side
        self.compress = nn.ModuleList()  # the skip path; the original's fourth one feeds nothing
        self.down = nn.ModuleList()
        cin, skip = 3, 3
        for stage in range(_ENCODER_STAGES):
            self.branches.append(
                nn.ModuleList(_NormConv1d(cin, branch, dilation=d) for d in _BRANCH_DILATIONS)
            )
            wide = len(_BRANCH_DILATIONS) * branch + skip
            if stage < _ENCODER_STAGES - 1:
                self.compress.append(nn.Conv1d(wide, branch, 1))
                self.down.append(_NormConv1d(wide, down, stride=2))
                cin, skip = down, branch
            else:
                self.last = _NormConv1d(wide, last)
        self.dense = nn.Linear(CLOUD_SIZE // 2 ** (_ENCODER_STAGES - 1) * last, config.latent_dim)
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
            if stage < _ENCODER_STAGES - 1:
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
        c = _POINT_CHANNELS
        self.points = nn.ModuleList(nn.Linear(cin, cout) for cin, cout in pairwise((3, *c)))
        self.hidden = nn.Linear(2 * c[-1], c[-1])
        self.code = nn.Linear(c[-1], config.latent_dim)
        initialise(self)

    def forward(self, points: Tensor) -> Tensor:
        """Return the codes of clouds.

        points  Tensor [B, N, 3], N > 0; clouds in unit-sphere coordinates

        Tensor [B, latent_dim]: codes, not whitened.
        """
        x = points
        for layer in self.points:
            x = functional.relu(layer(x))  # [B, N, c]
        pooled = torch.cat([x.amax(dim=1), x.mean(dim=1)], dim=1)  # [B, 2 c]
        return self.code(functional.relu(self.hidden(pooled)))  # [B, latent_dim]


def build_encoder(config: ModelConfig) -> Encoder | PointNet:
    """Return the encoder that a configuration asks for, freshly initialised."""
    return Encoder(config) if config.encoder == "paper" else PointNet(config)


@torch.no_grad()
def decorrelated(encoder: Encoder | PointNet, codes: Tensor) -> Encoder | PointNet:
    """Return the encoder with its codes rotated to the principal axes of `codes` [N, latent_dim].

    Numbers of a code that are alike over the clouds make as many axes of tiny variance. The
    rotation is a part of the last layer; axes come in the order of their variance, largest first.
    """
    rotated = copy.deepcopy(encoder)
    axes = torch.linalg.eigh(torch.cov(codes.double().T)).eigenvectors.T.flip(0)  # [d, d]
    last = rotated.dense if isinstance(rotated, Encoder) else rotated.code
    axes = axes.to(last.weight.device)
    last.weight.copy_(axes @ last.weight.double())
    last.bias.copy_(axes @ last.bias.double())
    return rotated


class Decoder(nn.Module):
    """The decoder from a code to a cloud.

    It is used only to train the encoder, and to see what codes mean.
    """

    def __init__(self, config: ModelConfig = PAPER) -> None:
        super().__init__()
        self.config = config
        hidden = config.scaled(_DECODER_CHANNELS)
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
