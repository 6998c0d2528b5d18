"""Weights as files, which are looked up, checksummed, written, and checked before use.

They are safetensors files; the header says what a file is and how it was trained. Only functions
that handle tensors import PyTorch: names and checksums are for the command line, which has no time
for it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from data_prep.failures import BadInput
from data_prep.files.atomic_write import atomic_write
from data_prep.files.checksums import MOST_BYTES, file_sha256
from data_prep.files.safe_read import is_regular_file, open_file

if TYPE_CHECKING:
    from torch import Tensor, nn

_NetworkT = TypeVar("_NetworkT", bound="nn.Module")

MOST_HEADER_BYTES = 2**24
_MOST_OBJECTIVE_LENGTH = 100
_MOST_REASON = 120  # characters of a library's complaint
_COUNTER = "num_batches_tracked"  # of BatchNorm; drawing does without


@dataclass(frozen=True, eq=False)
class NetworkWeights:
    """A network in float32 and evaluation mode, on the CPU, and its origin.

    card    how it was trained: objective, steps, learning rates, seed, ...
    sha256  of the file
    """

    network: Any
    card: Mapping[str, Any]
    sha256: str


@dataclass(frozen=True)
class WeightFiles:
    """The files of weights of one package.

    kind     of the checkpoints that they are exported from
    format   in their headers
    folder   of those that are bundled
    bundled  by name, the sha256 of the file
    files    by name, whose file it is where that is another's
    remedy   against a file that is none
    """

    kind: str
    format: str
    folder: Path
    bundled: Mapping[str, str]
    files: Mapping[str, str] = field(default_factory=dict)
    remedy: str = ""

    def find(self, name_or_path: str | Path) -> Path:
        """Return the file of a bundled name, its checksum verified, or the path itself.

        Raises BadInput, naming file, value and remedy, where a name is unknown, a file is missing,
        or a bundled file differs from its checksum.
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
        """Write weights of a checkpoint, atomically, and return the sha256.

        Kernels become float16, everything of one dimension stays as it is; counters are left out.

        select  returns the tensors, and what the header has apart from the training, of the state
                and the configuration

        Raises BadInput where the checkpoint is of something else, or a weight does not fit float16.
        """
        from learning import checkpoint

        state, step, config = checkpoint.load(checkpoint_path, self.kind)
        tensors, apart = select(state, config)
        stored = halved(_without_counters(tensors), checkpoint_path, remedy)
        texts = {k: v if isinstance(v, str) else json.dumps(v) for k, v in apart.items()}
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

        configure  returns its configuration, of that in the header, and may take tensors away
        build      returns the network of a configuration

        Raises BadInput where the file is no safetensors file or of another format, or tensors are
        missing, superfluous, of the wrong shape or not finite.
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
    folder = Path(__file__).parents[1].joinpath(*package.split("."), "weights")
    files = {f"{name}-grey": name for name in in_grey}
    bundled = {**bundled, **{grey: bundled[name] for grey, name in files.items()}}
    remedy = f"write the file again with {package}.weights.export"
    return WeightFiles(kind, file_format, folder, bundled, files, remedy)


# The bundled weights of each package; a file with colours has the grey network in it.
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
    # of the first format, networks had a code of the whole cloud
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
        {"all": "e5be7a567f234de205fa6ac03598604c5f51b0fb19e1cf56082234adba13bb33"},
        in_grey=("all",),
    ),
    "baselines.upsampler": _files(
        "baselines.upsampler",
        "upsampler",
        "upsampler-weights-1",
        {"all": "fcbfd77b7e0776ac17d5f66b740d36119fc9b858f49950908654e74c29e9e314"},
    ),
    "baselines.occupancy_net": _files(
        "baselines.occupancy_net",
        "occupancy-net",
        "occupancy-net-weights-1",
        {"all": "4050b55af22160f2296d15ea2e249b0adc2818d20eb4cb6d660d51d776e3ddb9"},
    ),
}


def check_sha256(path: Path, expected: str, remedy: str) -> str:
    """Return the checksum of a file. Raises BadInput, with the `remedy`, where it is another."""
    actual = file_sha256(path)
    if actual != expected:
        raise BadInput(f"{path}: sha256 {actual} is not the expected {expected}; {remedy}")
    return actual


def objective_of(path: Path) -> str:
    """Return the objective of exported weights from the file's header; "" if it has none.

    Raises BadInput as `card_of`.
    """
    objective = card_of(path).get("objective", "")
    if not isinstance(objective, str) or len(objective) > _MOST_OBJECTIVE_LENGTH:
        raise BadInput(
            f"{path}: its header cannot be read (the objective is no short text); fetch or write "
            "the file again"
        )
    return objective


def card_of(path: Path, most_header_bytes: int = MOST_HEADER_BYTES) -> dict[str, Any]:
    """Return how exported weights were trained, and `model`, from the file's header alone.

    A safetensors file begins with the length of its header (8 bytes, little-endian) and the header,
    which is JSON. Raises BadInput where this one does not, or its header is too long.
    """
    with open_file(path, MOST_BYTES) as file:
        length = int.from_bytes(file.read(8), "little")
        text = file.read(min(length, most_header_bytes))
    try:
        if len(text) < length:
            raise ValueError(f"{length} bytes by its own account")
        header = json.loads(text).get("__metadata__", {})
        training, model = (json.loads(header.get(name, "{}")) for name in ("training", "model"))
        card = {"model": dict(model), **training}
    except (AttributeError, TypeError, ValueError, RecursionError) as error:
        raise BadInput(
            f"{path}: its header cannot be read ({error}); fetch or write the file again"
        ) from None
    return card


def write_atomically(path: Path, tensors: Mapping[str, Tensor], header: Mapping[str, str]) -> None:
    """Write a safetensors file, whole or not at all."""
    from safetensors.torch import save_file

    plain = {key: value.detach().cpu().contiguous() for key, value in tensors.items()}
    with atomic_write(path) as new:
        save_file(plain, new, metadata=dict(header))


def read_safetensors(path: Path) -> tuple[dict[str, Tensor], dict[str, str]]:
    """Return the tensors, on the CPU, and the header of a safetensors file.

    Raises BadInput where the file is missing, cut short, of another kind, or larger than
    `MOST_BYTES`. Nothing in it is executed, and no more memory taken than the file has bytes.
    """
    from safetensors import safe_open

    if not is_regular_file(path):
        raise BadInput(f"{path}: no such file; give the path of a safetensors file")
    with open_file(path, MOST_BYTES):
        pass
    try:
        with safe_open(path, framework="pt") as file:
            header = dict(file.metadata() or {})
            return {key: file.get_tensor(key) for key in file.keys()}, header  # noqa: SIM118
    except Exception as error:  # whatever safetensors and torch raise for a type or shape
        reason = (str(error).splitlines() or [type(error).__name__])[0][:_MOST_REASON]
        raise BadInput(
            f"{path}: not a whole safetensors file ({reason}); fetch or write it again"
        ) from None


def read_weights(
    path: Path, expected: str, remedy: str
) -> tuple[dict[str, Tensor], dict[str, str]]:
    """Return tensors and header of exported weights, whose header names the format `expected`.

    Raises BadInput as `read_safetensors`, for an earlier number of the format, and with the
    `remedy` where it names another one.
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


@contextmanager
def understanding_header(path: Path, remedy: str) -> Generator[None]:
    """Turn errors inside, from a header that lacks or misstates something, into BadInput.

    The message has the `remedy`.
    """
    try:
        yield
    except (AttributeError, KeyError, TypeError, ValueError, RecursionError) as error:
        raise BadInput(f"{path}: its header cannot be read ({error!r}); {remedy}") from None


def _training_header(config: Mapping[str, Any], step: int, apart: Iterable[str]) -> str:
    """Return how weights were trained, as JSON for their file's header.

    It has the configuration, the steps that were taken, and their learning rates. The keys `apart`,
    which the header has of their own, are left out, and so are how often something was written
    and the checksum of the names of the data.
    """
    left_out = {*apart, "cadence", "source"}
    kept = {key: value for key, value in config.items() if key not in left_out}
    return json.dumps(kept | {"steps": step})


def halved(tensors: Mapping[str, Tensor], source: Path, remedy: str) -> dict[str, Tensor]:
    """Return kernels in float16, everything of one dimension as it is, for export.

    Raises BadInput, naming the checkpoint `source` and the `remedy`, where a value does not fit.
    """
    stored = {key: value.half() if value.dim() > 1 else value for key, value in tensors.items()}
    for key, value in stored.items():
        if not value.isfinite().all():
            raise BadInput(
                f"{source}: {key} reaches {tensors[key].abs().max():g}, beyond float16; {remedy}"
            )
    return stored


def sub_state(state: Mapping[str, Tensor], name: str) -> dict[str, Tensor]:
    """Return the entries below `name.`, without that prefix."""
    prefix = f"{name}."
    return {key.removeprefix(prefix): v for key, v in state.items() if key.startswith(prefix)}


def _without_counters(tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Return the tensors that are stored: all but counters."""
    return {key: value for key, value in tensors.items() if not key.endswith(_COUNTER)}


def expected_shapes(network: nn.Module, prefix: str = "") -> dict[str, tuple[int, ...]]:
    """Return the shapes that a file has to hold for `network`, which may be a meta network."""
    state = _without_counters(network.state_dict())
    return {f"{prefix}{key}": tuple(value.shape) for key, value in state.items()}


def check_tensors(
    path: Path,
    tensors: Mapping[str, Tensor],
    expected: Mapping[str, tuple[int, ...]],
    remedy: str,
) -> None:
    """Check that tensors have the names, shapes and types expected, and are finite.

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

    Raises BadInput as `check_tensors`, before the network takes memory.
    """
    import torch

    with torch.device("meta"):  # shapes without memory: the file has yet to prove its size
        expected = expected_shapes(build())
    check_tensors(path, tensors, expected, remedy)
    network = build()
    fill_network(network, tensors)
    return network


def fill_network(network: nn.Module, tensors: Mapping[str, Tensor]) -> None:
    """Put checked tensors into `network`, in float32 and evaluation mode."""
    state = {key: value.float() for key, value in tensors.items()}
    network.load_state_dict(state, strict=False)  # no counters; `check_tensors` is strict
    network.eval().requires_grad_(False)
