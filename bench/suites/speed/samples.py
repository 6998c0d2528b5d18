"""Files of the suite `speed`: every timed call, one file per measurement.

`measurements/KEY.json` holds the fields of `Measurement` and the version of this form. A file that
cannot be read, or is of another version, is measured again.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from data_prep.files.atomic_write import write_whole
from data_prep.files.safe_read import MIB, read_file

FORM = 1  # of the files; part of their keys
MOST_BYTES = 64 * MIB

Stage = Literal["load", "prepare", "draw"]


@dataclass(frozen=True)
class TimingSample:
    """A timed call."""

    cloud: str  # its object, "chair/test-0000"; empty for "load", which needs none
    round: int  # 0 for the first call of its kind in its process, cold; from 1 on warm
    stage: Stage
    views: int  # drawn in the call; 0 for other stages
    wall_s: float  # seconds by the clock
    core_s: float  # seconds of processor time of the whole process, all threads together


@dataclass(frozen=True)
class CloudFailure:
    """A cloud that a method failed on, and the reason."""

    cloud: str
    reason: str


@dataclass(frozen=True)
class Measurement:
    """A method with a number of threads under a condition, in a process of its own.

    The last three are None where the process died.
    """

    key: str  # names everything that the times depend on
    method: str
    condition: str
    threads: int
    views: int  # the larger of the two batches
    clouds: int  # those in `failures` were not drawn, or not to the end
    device: str  # "cpu", or the name of the GPU that was used
    samples: tuple[TimingSample, ...]
    failures: tuple[CloudFailure, ...]
    idle_mib: float | None = None  # peak resident memory before the method was loaded
    peak_mib: float | None = None  # peak resident memory at the end
    elsewhere_cores: float | None = None  # mean number that other processes kept busy meanwhile


def measurement_path(directory: Path, key: str) -> Path:
    """Return the path of a key's measurement."""
    return directory / "measurements" / f"{key}.json"


def write_measurement(directory: Path, measurement: Measurement) -> None:
    """Write a measurement to disk; when this returns, a power cut cannot take it back."""
    text = json.dumps({"form": FORM} | asdict(measurement), ensure_ascii=False)
    write_whole(measurement_path(directory, measurement.key), text.encode())


def read_measurement(directory: Path, key: str) -> Measurement | None:
    """Return the measurement of a key; None where no usable one exists."""
    path = measurement_path(directory, key)
    if not path.is_file():
        return None
    try:
        fields: dict[str, Any] = json.loads(read_file(path, MOST_BYTES))
        if fields.pop("form") != FORM or fields["key"] != key:
            return None
        fields["samples"] = tuple(TimingSample(**sample) for sample in fields["samples"])
        fields["failures"] = tuple(CloudFailure(**failure) for failure in fields["failures"])
        return Measurement(**fields)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
