"""Safetensors files of any kind: written whole, read without trust.

PyTorch, which takes seconds to import, is imported by what handles tensors only.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from data_prep.failures import BadInput
from data_prep.files.atomic_write import atomic_write
from data_prep.files.checksums import MOST_BYTES
from data_prep.files.safe_read import is_regular_file, open_file

if TYPE_CHECKING:
    from torch import Tensor

_MOST_REASON = 120  # characters of a library's error that are put into a message, at most


def write_atomically(path: Path, tensors: Mapping[str, Tensor], header: Mapping[str, str]) -> None:
    """Write a safetensors file, whole or not at all."""
    from safetensors.torch import save_file

    plain = {key: value.detach().cpu().contiguous() for key, value in tensors.items()}
    with atomic_write(path) as new:
        save_file(plain, new, metadata=dict(header))


def read_safetensors(path: Path) -> tuple[dict[str, Tensor], dict[str, str]]:
    """Return the tensors, on the CPU, and the header of a safetensors file.

    Raises BadInput where the file is missing, cut short, of another kind, or larger than
    `MOST_BYTES`. Nothing in the file is executed, and reading takes no more memory than its size.
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
    except Exception as error:  # safetensors and torch raise various ones for types and shapes
        reason = (str(error).splitlines() or [type(error).__name__])[0][:_MOST_REASON]
        raise BadInput(
            f"{path}: not a whole safetensors file ({reason}); fetch or write it again"
        ) from None


@contextmanager
def understanding_header(path: Path, remedy: str) -> Generator[None]:
    """Raise BadInput, with the `remedy`, where code in the block fails to understand a header.

    Such code raises errors of types, keys and values where an entry is missing or wrong.
    """
    try:
        yield
    except (AttributeError, KeyError, TypeError, ValueError, RecursionError) as error:
        raise BadInput(f"{path}: its header cannot be read ({error!r}); {remedy}") from None


def sub_state(state: Mapping[str, Tensor], name: str) -> dict[str, Tensor]:
    """Return the entries of a state whose keys begin with "NAME.", without this prefix."""
    prefix = f"{name}."
    return {key.removeprefix(prefix): v for key, v in state.items() if key.startswith(prefix)}
