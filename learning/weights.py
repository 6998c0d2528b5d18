"""Files of trained weights: finding, writing and reading them, with all checks before use.

They are safetensors files, whose header tells what a file is and how it was trained. Only functions
that handle tensors import PyTorch, which takes seconds: command lines need names and checksums.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from data_prep.failures import BadInput
from data_prep.files.checksums import MOST_BYTES, file_sha256
from data_prep.files.safe_read import is_regular_file, open_file
from learning.tensor_files import (
    read_safetensors,
    sub_state,
    understanding_header,
    write_atomically,
)

if TYPE_CHECKING:
    from torch import Tensor, nn

_NetworkT = TypeVar("_NetworkT", bound="nn.Module")

MOST_HEADER_BYTES = 2**24  # longest header that is read
_MOST_OBJECTIVE_LENGTH = 100  # characters of the objective in a header, at most
_COUNTER = "num_batches_tracked"  # end of the names of BatchNorm's counters, which are not stored


@dataclass(frozen=True, eq=False)
class NetworkWeights:
    """A trained network, and where it comes from.

    network  in float32 and evaluation mode, on the CPU
    card     how it was trained: objective, steps, learning rates, seed, ...
    sha256   of its file
    """

    network: Any
    card: Mapping[str, Any]
    sha256: str


@dataclass(frozen=True)
class WeightFiles:
    """The kind of weights that one package has, and its bundled files.

    kind     of the checkpoints that weights are exported from, `NetworkTrainer.kind`
    format   what their headers have as "format"
    folder   where the bundled files are
    bundled  the sha256 of the file of each bundled name
    files    for names that share the file of another name, that other name: {"all-grey": "all"}
    remedy   what a message advises where a file cannot be used
    """

    kind: str
    format: str
    folder: Path
    bundled: Mapping[str, str]
    files: Mapping[str, str] = field(default_factory=dict)
    remedy: str = ""

    def find(self, name_or_path: str | Path) -> Path:
        """Return the path of the file of a bundled name, or the given path.

        Raises BadInput where it is neither a bundled name nor a file, and where a bundled file is
        missing or has not its checksum.
        """
        name = str(name_or_path)
        if name not in self.bundled:
            path = Path(name_or_path)
            if not is_regular_file(path):
                known = ", ".join(self.bundled) or "none"
                raise BadInput(
                    f"weights: {name!r} is neither a bundled name ({known}) nor a file; "
                    "give one of these names or the path of exported weights"
                )
            return path
        path = self.folder / f"{self.files.get(name, name)}.safetensors"
        if not is_regular_file(path):
            raise BadInput(f"{path}: the bundled weights are missing; reinstall the package")
        check_sha256(path, self.bundled[name], "reinstall the package")
        return path

    def export(
        self,
        checkpoint_path: Path,
        path: Path,
        select: Callable[[dict[str, Tensor], dict[str, Any]], tuple[dict[str, Tensor], Any]],
        remedy: str = "export an earlier checkpoint",
    ) -> str:
        """Write weights of a checkpoint to a file, atomically, and return the file's sha256.

        Tensors of two and more dimensions become float16, those of one dimension stay as they are,
        and BatchNorm's counters are left out.

        select  is called with the checkpoint's state and configuration; returns the tensors to
                write, and entries of the header beside "format" and "training"; `average_of`, say
        remedy  what the message advises where a weight does not fit into float16

        Raises BadInput where the checkpoint is of another kind, and where a weight does not fit
        into float16.
        """
        from learning import checkpoint

        state, step, config = checkpoint.load(checkpoint_path, self.kind)
        tensors, apart = select(state, config)
        stored = halved(_without_counters(tensors), checkpoint_path, remedy)
        texts = {}  # values in a header are texts; others are written as JSON
        for key, value in apart.items():
            texts[key] = value if isinstance(value, str) else json.dumps(value)
        header = {"format": self.format, **texts, "training": _training_header(config, step, apart)}
        write_atomically(path, stored, header)
        return file_sha256(path)

    def load(
        self,
        path: Path,
        configure: Callable[[Any, dict[str, Tensor]], Any],
        build: Callable[[Any], nn.Module],
    ) -> NetworkWeights:
        """Return the network of a file.

        configure  is called with the header's "network" and the tensors; returns the configuration
                   of the network, and may remove tensors that it does not need
        build      returns the network of a configuration

        Raises BadInput where the file is no safetensors file, is of another format, or has a tensor
        that is missing, unknown, of the wrong shape or not finite.
        """
        tensors, header = read_weights(path, self.format, self.remedy)
        with understanding_header(path, self.remedy):
            config = configure(json.loads(header["network"]), tensors)
            card = {"network": asdict(config), **json.loads(header["training"])}
        network = _checked_network(path, tensors, lambda: build(config), self.remedy)
        return NetworkWeights(network, card, file_sha256(path))


def _files(
    package: str,
    kind: str,
    file_format: str,
    bundled: Mapping[str, str],
    in_grey: Iterable[str] = (),
) -> WeightFiles:
    """Return the weights of a package; names `in_grey` can also be had as "NAME-grey"."""
    files = {f"{name}-grey": name for name in in_grey}
    checksums = dict(bundled)
    for grey, name in files.items():
        checksums[grey] = bundled[name]
    return WeightFiles(
        kind=kind,
        format=file_format,
        folder=Path(__file__).parents[1].joinpath(*package.split("."), "weights"),
        bundled=checksums,
        files=files,
        remedy=f"write the file again with {package}.weights.export",
    )


# The weights of each package, with the sha256 of each bundled file. A network that draws in colour
# by an albedo can also draw in grey: the name "all-grey" means the file "all" without its albedo.
FILES: dict[str, WeightFiles] = {
    "pc2pix": _files(
        "pc2pix",
        "gan",
        "pc2pix-weights-1",
        {
            "chair": "594e13a882832836421086630690853a4ba0c714867c5eaf772fdf4eec8be0d4",
            "chair-acgan": "05ee175aa1dc413d92687fd1447671d85888a36459c1a7bde8f37a0c4daf8d26",
            "all": "e874f6a798e4c66100ef83304d0829e61336ebbbcd69590d2e27092656ae54f3",
        },
    ),
    # Networks of "splat-net-weights-1" had a code of the whole cloud, which is not supported now.
    "baselines.splat_net": _files(
        "baselines.splat_net",
        "splat-net",
        "splat-net-weights-2",
        {
            "all": "6331efaaab8aadc111f7607c5a19b5396e0dfeb114491bc5ea09a236538a6a12",
            "chair": "4fd59c7c06567f4c19360be9c1954f8c2b0a16c017614dd8dfb93f59131a677c",
            "points2pix": "f8efac2fc45c43ec3f550d1e5167c459e63f4e354f4737685e086192a253da96",
        },
        in_grey=("all",),
    ),
    "baselines.fused_net": _files(
        "baselines.fused_net",
        "fused-net",
        "splat-net-weights-2",
        {"all": "e0da4d79eac648371d923a9f00d85c5512ce8a6a1a847036bffeeda887440fb3"},
        in_grey=("all",),
    ),
    "baselines.upsampler": _files(
        "baselines.upsampler",
        "upsampler",
        "upsampler-weights-1",
        {"all": "a6644843534269e5c55826198793a3a36fe33e5faf823b13741ad27a6bef9820"},
    ),
    "baselines.occupancy_net": _files(
        "baselines.occupancy_net",
        "occupancy-net",
        "occupancy-net-weights-1",
        {"all": "4050b55af22160f2296d15ea2e249b0adc2818d20eb4cb6d660d51d776e3ddb9"},
    ),
}


def average_of(
    state: dict[str, Tensor], config: dict[str, Any]
) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Return the averaged network of a checkpoint and its configuration, for `export`."""
    return sub_state(state, "average"), {"network": config["network"]}


def check_sha256(path: Path, expected: str, remedy: str) -> str:
    """Return the sha256 of a file; raise BadInput, with the `remedy`, if it is not as expected."""
    actual = file_sha256(path)
    if actual != expected:
        raise BadInput(f"{path}: sha256 {actual} is not the expected {expected}; {remedy}")
    return actual


def objective_of(path: Path) -> str:
    """Return the objective that exported weights were trained with; "" if the header has none.

    Raises BadInput as `card_of` does, and where the objective is not a short text.
    """
    objective = card_of(path).get("objective", "")
    if not isinstance(objective, str) or len(objective) > _MOST_OBJECTIVE_LENGTH:
        raise BadInput(
            f"{path}: its header cannot be read (the objective is no short text); fetch or write "
            "the file again"
        )
    return objective


def card_of(path: Path, most_header_bytes: int = MOST_HEADER_BYTES) -> dict[str, Any]:
    """Return how exported weights were trained, and their "model", from a file's header alone.

    most_header_bytes  longest header that is read

    A safetensors file begins with the length of its header (8 bytes, little-endian), and the header
    follows as JSON.

    Raises BadInput where the header is not there, is not JSON, or is too long.
    """
    with open_file(path, MOST_BYTES) as file:
        length = int.from_bytes(file.read(8), "little")
        text = file.read(min(length, most_header_bytes))
    try:
        if len(text) < length:
            raise ValueError(f"it states a length of {length} bytes")
        header = json.loads(text).get("__metadata__", {})
        training = json.loads(header.get("training", "{}"))
        model = json.loads(header.get("model", "{}"))
        card = {"model": dict(model), **training}
    except (AttributeError, TypeError, ValueError, RecursionError) as error:
        raise BadInput(
            f"{path}: its header cannot be read ({error}); fetch or write the file again"
        ) from None
    return card


def read_weights(
    path: Path, expected: str, remedy: str
) -> tuple[dict[str, Tensor], dict[str, str]]:
    """Return the tensors and the header of a file of exported weights.

    expected  format that the header must name, such as "splat-net-weights-2"
    remedy    what the message advises where it names another one

    Raises BadInput as `read_safetensors` does, and where the format is another one or an earlier
    number of it.
    """
    tensors, header = read_safetensors(path)
    kind, _, number = str(header.get("format")).rpartition("-")
    expected_kind, _, current = expected.rpartition("-")
    if kind == expected_kind and number.isdecimal() and int(number) < int(current):
        raise BadInput(
            f"{path}: weights of version 1.0.0 or earlier (format {kind}-{number}, now "
            f"{expected}); train them again"
        )
    if header.get("format") != expected:
        raise BadInput(
            f"{path}: expected format {expected!r} in the header, found {header.get('format')!r}; "
            f"{remedy}"
        )
    return tensors, header


def _training_header(config: Mapping[str, Any], step: int, apart: Iterable[str]) -> str:
    """Return how weights were trained, as JSON for the header of their file.

    It has the configuration, the number of steps taken and the learning rates. It leaves out the
    keys `apart`, which are entries of their own in the header, how often something was written
    ("cadence"), and the names of the data ("source").
    """
    left_out = {*apart, "cadence", "source"}
    kept = {key: value for key, value in config.items() if key not in left_out}
    return json.dumps(kept | {"steps": step})


def halved(tensors: Mapping[str, Tensor], source: Path, remedy: str) -> dict[str, Tensor]:
    """Return tensors for export: those of two and more dimensions in float16, others as they are.

    Raises BadInput, naming the checkpoint `source` and the `remedy`, where a value is too large for
    float16 or not finite.
    """
    stored = {key: value.half() if value.dim() > 1 else value for key, value in tensors.items()}
    for key, value in stored.items():
        if not value.isfinite().all():
            raise BadInput(
                f"{source}: {key} reaches {tensors[key].abs().max():g}, beyond float16; {remedy}"
            )
    return stored


def _without_counters(tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Return the tensors without BatchNorm's counters, which are not stored."""
    return {key: value for key, value in tensors.items() if not key.endswith(_COUNTER)}


def expected_shapes(network: nn.Module, prefix: str = "") -> dict[str, tuple[int, ...]]:
    """Return the shapes, by key, of the tensors that a file must have for `network`.

    The network may be on the device "meta", where it takes no memory.
    """
    state = _without_counters(network.state_dict())
    return {f"{prefix}{key}": tuple(value.shape) for key, value in state.items()}


def check_tensors(
    path: Path,
    tensors: Mapping[str, Tensor],
    expected: Mapping[str, tuple[int, ...]],
    remedy: str,
) -> None:
    """Check that tensors have the expected names and shapes, are floating-point, and are finite.

    Raises BadInput, naming file, tensor and `remedy`, otherwise.
    """
    import torch

    types = (torch.float16, torch.float32)
    for key in sorted(expected.keys() ^ tensors.keys()):
        problem = "is missing" if key in expected else "is unknown"
        raise BadInput(f"{path}: tensor {key} {problem}; {remedy}")
    for key, shape in expected.items():
        if tuple(tensors[key].shape) != shape:
            shape_read = list(tensors[key].shape)
            raise BadInput(
                f"{path}: {key} has shape {shape_read}, expected {list(shape)}; {remedy}"
            )
        if tensors[key].dtype not in types:
            raise BadInput(f"{path}: {key} is of {tensors[key].dtype}, not {types}; {remedy}")
        if not tensors[key].isfinite().all():
            raise BadInput(f"{path}: {key} is not finite; {remedy}")


def _checked_network(
    path: Path, tensors: Mapping[str, Tensor], build: Callable[[], _NetworkT], remedy: str
) -> _NetworkT:
    """Return the network that `build` makes, with the tensors of a file, in evaluation mode.

    Raises BadInput as `check_tensors` does, before the network takes memory.
    """
    import torch

    # On "meta" tensors have shapes but no memory: a file that states a huge network, without having
    # its tensors, is refused before memory is taken for it.
    with torch.device("meta"):
        expected = expected_shapes(build())
    check_tensors(path, tensors, expected, remedy)
    network = build()
    fill_network(network, tensors)
    return network


def fill_network(network: nn.Module, tensors: Mapping[str, Tensor]) -> None:
    """Put checked tensors into `network`, in float32 and evaluation mode."""
    state = {key: value.float() for key, value in tensors.items()}
    # Not strict, because counters are missing; `check_tensors` has checked all other names.
    network.load_state_dict(state, strict=False)
    network.eval().requires_grad_(False)
