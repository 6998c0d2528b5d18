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

# Of the paper's encoder, at width 1.
_ENCODER_STAGES = 4  # with 2048, 1024, 512 and 256 positions
_BRANCH_DILATIONS = (1, 2, 4, 8)  # of the parallel convolutions of a stage
_BRANCH_CHANNELS = 64  # of each of them
_DOWN_CHANNELS = 128  # of the convolution that halves the positions after a stage
_LAST_CHANNELS = 32  # of the last convolution
_DECODER_CHANNELS = 1024  # of the hidden layers of the decoder, at width 1
_POINT_CHANNELS = (64, 128, 256)  # of the layers of PointNet, the same at every width


def initialise(network: nn.Module) -> None:
    """Set Glorot-uniform kernels and zero biases, as Keras did for the original."""
    for module in network.modules():
        if isinstance(module, nn.Conv1d | nn.Conv2d | nn.Linear):
            nn.init.xavier_uniform_(module.weight)
            assert module.bias is not None
            nn.init.zeros_(module.bias)


class _NormConv1d(nn.Module):
    """BatchNorm, ReLU, and a convolution of five positions with the "same" padding of Keras."""

    def __init__(self, cin: int, cout: int, *, dilation: int = 1, stride: int = 1) -> None:
        super().__init__()
        self.bn = nn.BatchNorm1d(cin, eps=1e-3, momentum=0.01)
        self.conv = nn.Conv1d(cin, cout, 5, dilation=dilation, stride=stride)
        # At stride 2, Keras' "same" pads one position on the left and two on the right.
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
        branch = config.scaled(_BRANCH_CHANNELS)
        down = config.scaled(_DOWN_CHANNELS)
        last = config.scaled(_LAST_CHANNELS)
        self.branches = nn.ModuleList()  # for each stage, convolutions of four dilations
        # Convolutions of the skip path. The original has one for the last stage, too, whose result
        # is not used.
        self.compress = nn.ModuleList()
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
            side_by_side = [branch(x) for branch in branches]
            wide = torch.cat([*side_by_side, skip], dim=1)  # [B, 4 branch + skip, L = 2048 ... 256]
            if stage < _ENCODER_STAGES - 1:
                skip = functional.max_pool1d(functional.relu(self.compress[stage](wide)), 2)
                x = self.down[stage](wide)  # [B, down, L / 2]
            else:
                x = self.last(wide)  # [B, last, 256]
        return self.dense(x.transpose(1, 2).flatten(1))  # [B, latent_dim]


class PointNet(nn.Module):
    """A PointNet (Qi et al. 2017): layers on each point, then the maximum and mean over all points.

    Its code does not depend on the order of the points, whose number is arbitrary. It has no
    BatchNorm, which would take more time than the layers themselves, and would make the code of a
    cloud depend on its batch. `config.width` does not change its widths.
    """

    cloud_size: int | None = None  # any number of points

    def __init__(self, config: ModelConfig) -> None:
        super().__init__()
        self.config = config
        c = _POINT_CHANNELS
        self.points = nn.ModuleList(nn.Linear(cin, cout) for cin, cout in pairwise((3, *c)))
        self.hidden = nn.Linear(2 * c[-1], c[-1])
        self.code = nn.Linear(c[-1], config.latent_dim)
        initialise(self)

    def forward(self, points: Tensor) -> Tensor:
        """Return the codes of clouds, [B, latent_dim], not whitened.

        points  [B, N, 3], N > 0, in unit-sphere coordinates
        """
        x = points
        for layer in self.points:
            x = functional.relu(layer(x))  # [B, N, c]
        pooled = torch.cat([x.amax(dim=1), x.mean(dim=1)], dim=1)  # [B, 2 c]
        return self.code(functional.relu(self.hidden(pooled)))  # [B, latent_dim]


def build_encoder(config: ModelConfig) -> Encoder | PointNet:
    """Return the encoder of a configuration, with random weights."""
    return Encoder(config) if config.encoder == "paper" else PointNet(config)


@torch.no_grad()
def decorrelated(encoder: Encoder | PointNet, codes: Tensor) -> Encoder | PointNet:
    """Return a copy of an encoder whose codes are rotated to their principal axes.

    codes  [N, latent_dim], those of the training clouds, by which the axes are found

    The axes are in the order of their variance, the largest first. Where several numbers of the
    codes were nearly the same for all clouds, there are axes of tiny variance instead. The rotation
    is put into the last layer.
    """
    rotated = copy.deepcopy(encoder)
    axes = torch.linalg.eigh(torch.cov(codes.double().T)).eigenvectors.T.flip(0)  # [d, d]
    last = rotated.dense if isinstance(rotated, Encoder) else rotated.code
    axes = axes.to(last.weight.device)
    last.weight.copy_(axes @ last.weight.double())
    last.bias.copy_(axes @ last.bias.double())
    return rotated


class Decoder(nn.Module):
    """The decoder, which makes a cloud of a code.

    It is used only to train the encoder, and to show what a code stands for.
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
