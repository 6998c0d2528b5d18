"""The sources of the FID network's weights: a file, the cache, or (on request) a download.

They are apart from `bench.metrics.inception`, so that a run can be planned, and its rows marked as
skipped, without importing torch.
"""

from __future__ import annotations

import hashlib
import http.client
import os
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import IO

from data_prep.failures import BadInput
from data_prep.files.atomic_write import write_whole
from data_prep.files.safe_read import MIB, read_file

WEIGHTS_NAME = "weights-inception-2015-12-05-6726825d.pth"
WEIGHTS_URL = f"https://github.com/toshas/torch-fidelity/releases/download/v0.2.0/{WEIGHTS_NAME}"
WEIGHTS_SHA256 = "6726825d0af5f729cebd5821db510b11b1cfad8faad88a03f1befd49fb9129b2"
DOWNLOAD = "download"
DOWNLOAD_TIMEOUT_S = 30.0
MOST_BYTES = 256 * MIB  # the published file has 91 MiB


class WeightsUnavailable(RuntimeError):
    """The error for published weights that are not here and cannot be fetched; has the remedy."""


def find_weights(
    chosen: str | None,
    sha256: str = WEIGHTS_SHA256,
    open_url: Callable[..., IO[bytes]] = urllib.request.urlopen,
) -> Path:
    """Return the verified weight file.

    chosen None        the user's cache: `pc2pix-bench/` in $XDG_CACHE_HOME or ~/.cache
    chosen "download"  the same, filled from the net where it does not hold the intact file
    anything else      the path of the file

    `sha256` is the checksum that the file has to have; `open_url` fetches it, on request only: the
    default run needs none, and taking the features of all its images would more than double its
    time. Raises BadInput where a path cannot be read or is not the published file, or it cannot be
    fetched, and WeightsUnavailable where nothing was chosen and the cache does not hold it.
    """
    if chosen is not None and chosen != DOWNLOAD:
        read_weights(Path(chosen), sha256)
        return Path(chosen)
    root = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    cached = Path(root) / "pc2pix-bench" / WEIGHTS_NAME
    try:
        intact = _digest(read_file(cached, MOST_BYTES)) == sha256
    except BadInput:
        intact = False
    if not intact:
        if chosen is None:
            raise WeightsUnavailable(
                f"no weights; add --inception-weights {DOWNLOAD} (95 MB, once)"
            )
        data = _download(sha256, open_url)
        try:
            write_whole(cached, data)
        except OSError as error:
            raise BadInput(f"the FID weights cannot be kept ({error}); {_BY_HAND}") from error
    return cached


def read_weights(path: Path, sha256: str = WEIGHTS_SHA256) -> bytes:
    """Return the bytes of the weight file at `path`.

    Raises BadInput where it is not the published one.
    """
    try:
        data = read_file(path, MOST_BYTES)
    except BadInput as error:
        raise BadInput(f"{error}; {_REMEDY}") from error
    digest = _digest(data)
    if digest != sha256:
        raise BadInput(f"{path}: sha256 {digest}, expected {sha256}; {_REMEDY}")
    return data


_REMEDY = f"give --inception-weights {DOWNLOAD}, or the path of {WEIGHTS_URL}"
_BY_HAND = f"fetch {WEIGHTS_URL} yourself and give --inception-weights PATH, or go without fid"


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _download(sha256: str, open_url: Callable[..., IO[bytes]]) -> bytes:
    try:
        with open_url(WEIGHTS_URL, timeout=DOWNLOAD_TIMEOUT_S) as response:
            data = response.read(MOST_BYTES)
    except (OSError, http.client.HTTPException) as error:  # URLError and time-outs included
        raise BadInput(f"the FID weights cannot be fetched ({error}); {_BY_HAND}") from error
    digest = _digest(data)
    if digest != sha256:
        raise BadInput(
            f"the FID weights cannot be fetched (the answer has {len(data)} bytes of sha256 "
            f"{digest}, expected {sha256}); {_BY_HAND}"
        )
    return data
