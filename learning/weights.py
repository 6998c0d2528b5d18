"""Weights as files, which are looked up, checksummed, written, and checked before use.

They are safetensors files; the header says what a file is and how it was trained. Only functions
that handle tensors import PyTorch: names and checksums are for the command line, which has no time
for it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import contextmanager
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


def find_file(
    name_or_path: str | Path,
    folder: Path,
    bundled: Mapping[str, str],
    files: Mapping[str, str] | None = None,
) -> Path:
    """Return the file of a bundled name, its checksum verified, or the path itself.

    bundled  sha256 by name
    files    by name, the file's where that is another

    Raises BadInput, naming file, value and remedy, where a name is unknown, a file is missing, or a
    bundled file differs from its checksum.
    """
    name = str(name_or_path)
    if name not in bundled:
        path = Path(name_or_path)
        if not is_regular_file(path):
            known = ", ".join(bundled) or "none"
            raise BadInput(
                f"weights: {name!r} is neither a bundled name ({known}) nor a file; "
                "give one of these names or the path of exported weights"
            )
        return path
    path = folder / f"{(files or {}).get(name, name)}.safetensors"
    if not is_regular_file(path):
        raise BadInput(f"{path}: the bundled weights are missing; reinstall the package")
    actual = file_sha256(path)
    if actual != bundled[name]:
        raise BadInput(
            f"{path}: sha256 {actual} is not the expected {bundled[name]}; reinstall the package"
        )
    return path


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


def training_header(config: Mapping[str, Any], step: int, apart: Iterable[str]) -> str:
    """Return how weights were trained, as JSON for their file's header.

    It has the configuration, the steps that were taken, and their learning rates. The keys `apart`,
    which the header has of their own, are left out, and so is what says only how often something
    was written.
    """
    left_out = {*apart, "cadence"}
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


def without_counters(tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Return the tensors that are stored: all but counters."""
    return {key: value for key, value in tensors.items() if not key.endswith(_COUNTER)}


def expected_shapes(network: nn.Module, prefix: str = "") -> dict[str, tuple[int, ...]]:
    """Return the shapes that a file has to hold for `network`, which may be a meta network."""
    state = without_counters(network.state_dict())
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


def checked_network(
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
