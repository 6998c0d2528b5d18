"""Published networks of others, run by their own code and weights, without CUDA.

Nothing of them is part of this repository: their code is imported from a clone, and operations that
are written for CUDA, or come from packages that are not needed otherwise, are replaced by the
functions below. `studies.others_weights` measures the networks.
"""

from __future__ import annotations

import importlib
import sys
from argparse import Namespace
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock, patch

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter
from scipy.spatial import cKDTree
from torch import Tensor
from torch.nn import BatchNorm1d, BatchNorm2d, Conv1d, Conv2d, Identity, Module, Sequential
from torch.nn.utils.fusion import fuse_conv_bn_eval

from baselines.reconstruction.alpha_wrap import BALL, OFFSET, DenoisedWrap, wrapped
from baselines.reconstruction.stages import Nearest, in_grey, spacing
from data_prep.arrays import Floats
from data_prep.failures import StageFailure
from data_prep.scene import Mesh, PointCloud, Points

Surface = Callable[[Points], Mesh]  # the mesh that a network makes of a cloud
Indices = NDArray[np.integer]
_Conv, _Norm = (Conv1d, Conv2d), (BatchNorm1d, BatchNorm2d)


@dataclass(frozen=True)
class Network:
    """A published network.

    name        of the method whose images it draws
    repository  where it is from, on GitHub
    commit      of the repository
    licence     of the repository; "not stated" where it states none
    trained_on  the objects that it has seen
    about       what is drawn
    folder      of its files of weights in the repository
    weights     SHA-256 of these files
    load        returns what it makes of a cloud, from the folder of the repository and the weights
    """

    name: str
    repository: str
    commit: str
    licence: str
    trained_on: str
    about: str
    folder: str
    weights: Mapping[str, str]
    load: Callable[[list[Any]], Surface]


def surface_of(network: Network, repository: Path) -> Surface:
    """Return what a network makes of a cloud, with the code and weights of its repository."""
    sys.path.insert(0, str(repository))
    _replace_cuda()
    weights = []
    for name in network.weights:
        with torch.serialization.safe_globals([Namespace]):  # the arguments of a training
            path = repository / network.folder / name
            weights.append(torch.load(path, map_location="cpu", weights_only=True))
    return network.load(weights)


# Operations of CUDA


def _nearest(query: Tensor, points: Tensor, count: int) -> Tensor:
    """Return the indices [M, count] of the points [N, C] nearest to a query [M, C]."""
    if points.shape[1] > 3:  # features, in which a tree is slower than all distances
        return torch.cdist(query, points).topk(count, largest=False).indices
    tree = cKDTree(points.detach().numpy(), balanced_tree=False, compact_nodes=False)
    _, index = tree.query(query.detach().numpy(), k=range(1, count + 1))
    return torch.from_numpy(np.asarray(index, np.int64))


def _knn(p1: Tensor, p2: Tensor, K: int = 1, **_: Any) -> tuple[Tensor, ...]:  # noqa: N803
    """Return squared distances, indices and nearest points, as `pytorch3d.ops.knn_points` does."""
    index = torch.stack([_nearest(query, points, K) for query, points in zip(p1, p2, strict=True)])
    nearest = _rows(p2, index)
    return ((p1.unsqueeze(2) - nearest) ** 2).sum(dim=3), index, nearest


def _rows(values: Tensor, idx: Tensor) -> Tensor:
    """Return the rows [B, M, K, C] of values [B, N, C] at indices [B, M, K]."""
    return torch.stack([rows[i] for rows, i in zip(values, idx, strict=True)])


def _farthest(points: Tensor, count: int) -> Tensor:
    """Return indices [B, count] of points [B, N, 3], each farthest from those before it, from 0."""
    chosen = np.zeros((len(points), count), np.int64)
    for row, some in zip(chosen, points.detach().numpy(), strict=True):
        axes = [np.ascontiguousarray(axis) for axis in some.T]
        away = np.full(len(some), np.inf, np.float32)
        for i in range(1, count):
            x, y, z = (axis - axis[row[i - 1]] for axis in axes)
            np.minimum(away, x * x + y * y + z * z, out=away)
            row[i] = away.argmax()
    return torch.from_numpy(chosen)


def _columns(values: Tensor, index: Tensor) -> Tensor:
    """Return the columns [B, C, M] of values [B, C, N] at indices [B, M]."""
    return values.gather(2, index[:, None].expand(-1, values.shape[1], -1))


def _share_of_farthest(points: Tensor, ratio: float, **_: Any) -> Tensor:
    """Return the indices that `torch_cluster.fps` chooses when it begins with the first point."""
    return _farthest(points[None], min(len(points), int(np.ceil(ratio * len(points)))))[0]


def _replace(name: str, **functions: Any) -> None:
    """Put a module with some functions in the place of one that is not installed here."""
    module = sys.modules.setdefault(name, MagicMock(__path__=[]))
    for function, value in functions.items():
        setattr(module, function, value)
    above, _, last = name.rpartition(".")
    if above in sys.modules:
        setattr(sys.modules[above], last, module)


def _replace_cuda() -> None:
    """Replace what the networks import for CUDA, and what their examples import besides."""
    Tensor.cuda = lambda self, *_, **__: self  # pyright: ignore[reportAttributeAccessIssue]
    for name in ("sklearn", "sklearn.cluster", "sklearn.neighbors", "open3d", "numba"):
        _replace(name)
    for name in ("torchvision", "torchvision.transforms", "pointnet2_ops", "pytorch3d"):
        _replace(name)
    for name in ("loss", "structures", "loss.point_mesh_distance"):
        _replace(f"pytorch3d.{name}")
    _replace("pytorch3d.ops", knn_points=_knn, knn_gather=_rows)
    farthest = {"furthest_point_sample": _farthest, "gather_operation": _columns}
    _replace("pointnet2_ops.pointnet2_utils", **farthest)
    _replace("torch_cluster", fps=_share_of_farthest)


def _fused(network: Module) -> Module:
    """Return a network whose batch norms are computed within the convolutions before them."""
    for layers in network.modules():
        if isinstance(layers, Sequential):
            for i, (layer, norm) in enumerate(pairwise(layers)):
                if isinstance(layer, _Conv) and isinstance(norm, _Norm):
                    layers[i], layers[i + 1] = fuse_conv_bn_eval(layer, norm), Identity()
    return network


# GeoUDF: an up-sampled cloud, the unsigned distance from it, and marching cubes by its gradients

_NODES, _SIDE = 128, 1.05  # of the grid, as its authors call it for objects in a unit cube
_TOGETHER = 1024  # queries of one call of the network, which fit into a processor's cache
_TOUCHING = 0.0005  # distance of a node that counts as on the surface
_NEAR, _CROSSED = 2.0, 1.1  # voxels: of nodes that are asked about, and of ends of a crossed edge
_PAIRS = [(i, j) for i in range(8) for j in range(i + 1, 8)]  # corners of a cube


def _geoudf(weights: list[Any]) -> Surface:
    """Return GeoUDF, as its `eval_rec.py` calls it, in a box whose longest side is 1."""
    theirs, tables = (importlib.import_module(name) for name in ("model", "eval_rec"))
    networks = []
    for network, tensors in zip((theirs.PUGeo(knn=20), theirs.UDF()), weights, strict=True):
        network.load_state_dict({k.removeprefix("module."): v for k, v in tensors.items()})
        networks.append(_fused(network.eval()))
    upsampler, distance = networks

    def surface(points: Points) -> Mesh:
        low, high = points.min(axis=0), points.max(axis=0)
        centre, scale = (low + high) / 2, (high - low).max()
        dense = upsampler(torch.from_numpy(((points - centre) / scale).T[None]))

        def field(query: Floats) -> tuple[Floats, Floats]:
            parts = torch.from_numpy(query.astype(np.float32)).split(_TOGETHER)
            answers = [distance(dense, part.T[None]) for part in parts]
            value, gradient = (torch.cat(part, dim=1)[0] for part in zip(*answers, strict=True))
            return value.double().numpy(), gradient.double().numpy()

        arrays = [dense[name][0].double().numpy() for name in ("dense_xyz", "dense_normal")]
        corners = _marching_cubes(arrays[0], arrays[1], field, distance.K, tables)
        return _repaired(corners * scale + centre)

    return surface


def _marching_cubes(
    dense: Floats,
    normals: Floats,
    field: Callable[[Floats], tuple[Floats, Floats]],
    neighbours: int,
    tables: Any,
) -> Floats:
    """Return the corners [T, 3, 3] of the triangles of a field around points [N, 3].

    They are those of the function `custom_marching_cube` of GeoUDF, for all cubes at once.

    field       returns distances [M] and their gradients [M, 3] at places [M, 3]. A distance is a
                weighted mean of those to the planes of the nearest `neighbours` points, so no edge
                is crossed at a node far from all of these planes: it is asked about only where a
                cube beside it has a crossed edge.
    tables      the module `eval_rec` of GeoUDF, which has the tables of the cubes
    """
    voxel = _SIDE / (_NODES - 1)
    shape = (_NODES,) * 3
    inside = np.clip(((dense + _SIDE / 2) / voxel).astype(int), 0, _NODES - 1)
    occupied = np.zeros(shape, bool)
    occupied[tuple(inside.T)] = True
    near = np.flatnonzero(maximum_filter(occupied, 2 * int(_NEAR) + 1))

    def places(nodes: Indices) -> Floats:
        steps = np.stack(np.unravel_index(nodes, shape), axis=-1)
        return steps.astype(np.float64) * voxel - _SIDE / 2

    tree = cKDTree(dense)
    away, index = map(np.asarray, tree.query(places(near), k=neighbours))
    close = away[:, 0] < _NEAR * voxel
    near, index = near[close], index[close]
    heights = np.einsum("mkc,mkc->mk", places(near)[:, None] - dense[index], normals[index])
    value, gradient = np.full(_NODES**3, np.inf), np.zeros((_NODES**3, 3))

    def ask(nodes: Indices) -> None:
        value[nodes], gradient[nodes] = field(places(nodes))

    asked = near[np.abs(heights).min(axis=1) < _CROSSED * voxel]
    ask(asked)
    offsets = tables.cube_vert_offset
    steps = offsets @ (_NODES**2, _NODES, 1)
    firsts = np.unique(asked[:, None] - steps)
    below = np.stack(np.unravel_index(firsts[firsts >= 0], shape)) < _NODES - 1
    cubes = firsts[firsts >= 0][below.all(axis=0)][:, None] + steps
    crossed = np.empty((len(cubes), len(_PAIRS)), np.float32)
    for column, (i, j) in enumerate(_PAIRS):
        a, b = cubes[:, i], cubes[:, j]
        way = (offsets[i] - offsets[j]).astype(float)
        apart = (gradient[a] @ way > 0) & (gradient[b] @ way < 0)
        apart &= (gradient[a] * gradient[b]).sum(axis=1) < 0
        apart &= np.maximum(value[a], value[b]) < _CROSSED * voxel
        crossed[:, column] = apart | (np.minimum(value[a], value[b]) < _TOUCHING)
    cubes, crossed = cubes[crossed.any(axis=1)], crossed[crossed.any(axis=1)]
    unknown = np.unique(cubes[np.isinf(value[cubes])])
    value[unknown] = tree.query(places(unknown))[0]
    ask(np.intersect1d(unknown, near))
    drawn = value[cubes[:, 0]] <= _NEAR * voxel
    cubes, crossed = cubes[drawn], crossed[drawn]
    # Of all ways to put the corners on two sides, the first that differs least from the crossings.
    ways = tables.optimize_dict
    parted = np.array([ways[:, i] != ways[:, j] for i, j in _PAIRS], np.float32)
    chosen = (parted.sum(axis=0) - 2 * crossed @ parted).argmin(axis=1)
    edges = np.array(tables.triTable)[chosen, :15].reshape(-1, 5, 3)
    cube, triangle = np.nonzero(edges[:, :, 0] >= 0)
    ends = np.asarray(tables.edge_vert_index)[edges[cube, triangle]]  # [T, 3, 2]
    nodes = cubes[cube[:, None, None], ends]
    at, height = places(nodes), value[nodes]
    # An end on the surface takes the corner; where both are, it is the middle.
    on = height <= _TOUCHING
    share = np.where(on.any(axis=2, keepdims=True), on, height[..., ::-1])
    return (at * share[..., None]).sum(axis=2) / share.sum(axis=2)[..., None]


def _repaired(corners: Floats) -> Mesh:
    """Return the mesh of triangles [T, 3, 3], with small holes filled, in grey."""
    import trimesh

    if not len(corners):
        raise StageFailure("marching-cubes", "no triangle")
    faces = np.arange(3 * len(corners)).reshape(-1, 3)
    mesh = trimesh.Trimesh(corners.reshape(-1, 3), faces)
    mesh.update_faces(mesh.unique_faces())
    mesh.update_faces(mesh.nondegenerate_faces())
    mesh.fill_holes()
    return in_grey(mesh.vertices, mesh.faces)


# Networks that move points or add some, in front of a wrap of ours


def _denoised(clean: Tensor) -> Mesh:
    """Return what denoised-wrap makes of points [N, 3]."""
    return DenoisedWrap().prepare(PointCloud(clean.numpy().astype(np.float32))).mesh


def _upsampled(dense: Tensor, points: Points) -> Mesh:
    """Return the wrap of dense points [M, 3], with the ball that alpha-wrap takes for the cloud.

    Dense points lie in clusters, between which a ball of their own spacing carves holes.
    """
    between = spacing(Nearest(points))
    return wrapped(dense.double().numpy(), BALL * between, OFFSET * between).mesh


def _score_denoise(weights: list[Any]) -> Surface:
    """Return ScoreDenoise, as its `test_single.py` calls it, in front of denoised-wrap.

    Its patches have 1,000 points, or all of those of a smaller cloud.
    """
    denoise = importlib.import_module("utils.denoise").patch_based_denoise
    normalize = importlib.import_module("utils.transforms").NormalizeUnitSphere.normalize
    network = importlib.import_module("models.denoise").DenoiseNet(weights[0]["args"])
    network.load_state_dict(weights[0]["state_dict"])

    def surface(points: Points) -> Mesh:
        unit, centre, scale = normalize(torch.from_numpy(points))
        clean = denoise(network, unit, patch_size=min(1000, len(points)))
        return _denoised(clean * scale + centre)

    return surface


def _grad_pu(weights: list[Any]) -> Surface:
    """Return Grad-PU, as its `test.py` calls it for four times as many points, and alpha-wrap."""
    search = {"knnquery_heap": lambda k, points, query: _knn(query, points, k)[1]}
    _replace(
        "models.pointops.functions", pointops=SimpleNamespace(**search, furthestsampling=_farthest)
    )
    _replace("models.Chamfer3D.dist_chamfer_3D")
    theirs: Any = importlib.import_module("test")
    with patch.object(sys, "argv", ["grad-pu"]):
        arguments = importlib.import_module("args.pu1k_args").parse_pu1k_args()
    arguments.truncate_distance = True  # the default of test.py
    network = theirs.P2PNet(arguments)
    network.load_state_dict(weights[0])
    network.eval()

    def patches(count: int, points: Tensor, centres: Tensor) -> Tensor:
        rows = points.transpose(1, 2)
        return _knn(centres.transpose(1, 2), rows, count)[2][0].transpose(1, 2).contiguous()

    theirs.extract_knn_patch = patches

    def surface(points: Points) -> Mesh:
        unit, centre, radius = theirs.normalize_point_cloud(torch.from_numpy(points.T)[None])
        with torch.enable_grad():  # points descend along a gradient
            dense = theirs.pcd_upsample(arguments, network, unit).detach()
        return _upsampled((centre + dense * radius)[0].T, points)

    return surface


NETWORKS = (
    Network(
        "geoudf",
        "rsy6318/GeoUDF",
        "76858f5f076586c25efe59554d94fba3c8ef7ce2",
        "not stated",
        "ShapeNet, 13 classes",
        "its mesh",
        "log_reconstruction_100.00_1.000_0.100",
        {
            "pu_model_best.t7": "ce0a83399969861976beb1a1b9d7892592ee30be68b6bb764e623a08f249ef34",
            "udf_model_best.t7": "9700e2e4ff7d6e2a5e2fb92c920fb8b0363646268b9445a73a5653682d854149",
        },
        _geoudf,
    ),
    Network(
        "score-denoise",
        "luost26/score-denoise",
        "bdf0eab411afcf1e1236591c41009ac9916e8d68",
        "MIT",
        "PU-Net",
        "denoised-wrap of its points",
        "pretrained",
        {"ckpt.pt": "d8aa53cfc92161581199170bce6e326b29f70208cc0c4dfe929f87aeeef365bc"},
        _score_denoise,
    ),
    Network(
        "grad-pu",
        "yunhe20/Grad-PU",
        "435b6a078c7b5239c09c1360ac4072db83371bdf",
        "Apache 2",
        "PU1K",
        "alpha-wrap of its points",
        "pretrained_model/pu1k/ckpt",
        {"ckpt-epoch-60.pth": "b355f45bf4cbf605718388175dd372ca1a21544a33c890eebbee920ff183fac8"},
        _grad_pu,
    ),
)
