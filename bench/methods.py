"""The methods of the benchmark, as a literal table.

A factory imports its heavy packages when it is called, in the worker that needs them. Importing
this module needs no package at all, so that `bench list` answers at once.

Other packages add methods by entry points of the group `pc2pix_bench.methods`: the name is the
method's id, the object a `Method`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

from bench.lookup import find
from data_prep.failures import BadInput
from data_prep.untrusted import is_regular_file

if TYPE_CHECKING:
    from data_prep.scene import Renderer


@dataclass(frozen=True)
class Method:
    """A renderer with a name.

    `load` gets the device ("auto", "cpu" or "cuda") and returns the renderer; `version` is raised
    by hand when a change alters its pictures (finished work is then done again); `identity` gives
    whatever else its pictures depend on: the versions of its libraries, the checksum of its
    weights. Only the ceiling has `sees_mesh`.
    """

    id: str
    load: Callable[[str], Renderer]
    identity: Callable[[], str]
    version: int
    source: str
    sees_mesh: bool = False
    weights: str | None = None  # of a network: bundled name or file


def _pc2pix(weights: str, device: str) -> Renderer:
    import torch

    import pc2pix

    if device == "auto":
        device = "cuda" if torch.cuda.is_available() else "cpu"
    return pc2pix.load(weights, device=device)


def _pc2pix_identity(weights: str) -> str:
    from pc2pix.weight_files import file_sha256, find_weights

    return f"torch {_installed('torch')}, weights {file_sha256(find_weights(weights))}"


def _pc2pix_file_identity(path: str) -> str:
    """As above, for a file nobody has vouched for: it is loaded, to be refused before the run."""
    from pc2pix.weights import load_weights

    return f"torch {_installed('torch')}, weights {load_weights(path).sha256}"


def _surface_apss(device: str) -> Renderer:
    del device
    from baselines.surface import SurfaceApss

    return SurfaceApss()


def _splat(device: str) -> Renderer:
    del device
    from baselines.splat import Splat

    return Splat()


def _true_mesh(device: str) -> Renderer:
    del device
    from baselines.reference import TrueMesh

    return TrueMesh()


def _constant(device: str) -> Renderer:
    del device
    from baselines.constant import Constant, read_picture

    return Constant(read_picture())


def _constant_identity() -> str:
    """The pixels, not the file: another PNG writer may pack them differently."""
    from hashlib import sha256

    from baselines.constant import read_picture

    return f"picture {sha256(read_picture().tobytes()).hexdigest()}"


def _blank(device: str) -> Renderer:
    del device
    from baselines.reference import Blank

    return Blank()


def _installed(*packages: str) -> str:
    from importlib.metadata import version

    return ", ".join(version(package) for package in packages)


METHODS = (
    Method(
        "pc2pix",
        load=partial(_pc2pix, "chair"),
        identity=partial(_pc2pix_identity, "chair"),
        version=3,
        source="paper, section 3; bundled weights, objective paired (pc2pix/weights/chair.md)",
        weights="chair",
    ),
    Method(
        "pc2pix@acgan",
        load=partial(_pc2pix, "chair-acgan"),
        identity=partial(_pc2pix_identity, "chair-acgan"),
        version=2,
        source="paper, section 3; the paper's objective (pc2pix/weights/chair-acgan.md)",
        weights="chair-acgan",
    ),
    Method(
        "surface-apss",
        load=_surface_apss,
        identity=lambda: f"pymeshlab {_installed('pymeshlab')}",
        version=1,
        source="paper's SR; filter script of roatienza/pc2pix@23b7b46d",
    ),
    Method(
        "splat",
        load=_splat,
        identity=lambda: f"scipy {_installed('scipy')}",
        version=1,
        source="depth-buffered discs: what a viewer shows",
    ),
    Method(
        "true-mesh",
        load=_true_mesh,
        identity=lambda: "",
        version=1,
        source="the ceiling: the mesh behind the cloud",
        sees_mesh=True,
    ),
    Method(
        "constant",
        load=_constant,
        identity=_constant_identity,
        version=1,
        source="a second floor: the one picture that SSIM likes best on the training set",
    ),
    Method(
        "blank",
        load=_blank,
        identity=lambda: "",
        version=1,
        source="the floor: white pictures; failures are scored as these",
    ),
)
PLUGINS = "pc2pix_bench.methods"
FLOOR = "blank"
FLOORS = ("constant", FLOOR)  # what looks at no cloud


def find_method(method_id: str) -> Method:
    """The method with this id; `pc2pix@FILE.safetensors` is pc2pix with weights of your own.

    Raises BadInput for an unknown id (naming the nearest), for a weights file that is missing, and
    where another package announces a method that it does not have.
    """
    name, at, weights = method_id.partition("@")
    if name == "pc2pix" and at and weights.endswith(".safetensors"):
        if not is_regular_file(Path(weights)):
            raise BadInput(f"{weights}: no such weights file; train one with 'bench train gan'")
        return Method(
            method_id,
            load=partial(_pc2pix, weights),
            identity=partial(_pc2pix_file_identity, weights),
            version=3,
            source=f"pc2pix with the weights in {weights}",
            weights=weights,
        )
    if any(method.id == method_id for method in METHODS) or method_id not in plugin_ids():
        return find(method_id, METHODS, "method")
    return _plugin(method_id)


@cache
def plugin_ids() -> tuple[str, ...]:
    """Ids of the methods that other installed packages announce, sorted; none is loaded."""
    from importlib.metadata import entry_points

    return tuple(sorted(entry_points(group=PLUGINS).names))


@cache
def _plugin(method_id: str) -> Method:
    from importlib.metadata import entry_points

    (entry, *_) = entry_points(group=PLUGINS, name=method_id)
    where = f"method '{method_id}' of {entry.dist.name if entry.dist else entry.value}"
    try:
        method = entry.load()
    except Exception as error:  # whatever a stranger's module raises
        raise BadInput(
            f"{where}: {entry.value} cannot be loaded ({type(error).__name__}: {error}); mend or "
            "remove that package"
        ) from error
    if not isinstance(method, Method) or method.id != method_id:
        raise BadInput(
            f"{where}: {entry.value} is not a bench.methods.Method with that id; mend or remove "
            "that package"
        )
    return method


def objectives(method_ids: Iterable[str]) -> dict[str, str]:
    """By method, what the weights of networks were trained with; other methods are left out."""
    from pc2pix.weight_files import find_weights, objective_of

    networks = ((id_, find_method(id_).weights) for id_ in method_ids)
    return {id_: objective_of(find_weights(weights)) for id_, weights in networks if weights}
