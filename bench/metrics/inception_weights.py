"""The sources of the FID network's weights: a file, the user's cache, or (on request) a download.

This module is apart from `bench.metrics.inception`, so that a run can be planned without importing
torch, also where it skips FID for want of the weights.
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
DOWNLOAD = "download"  # the value of `--inception-weights` that asks for a download
DOWNLOAD_TIMEOUT_S = 30.0  # seconds that the server may take to go on
MOST_BYTES = 256 * MIB  # the largest file that is read; the published one has 91 MiB


class WeightsUnavailable(RuntimeError):
    """The error for published weights that are not on this machine; its text has the remedy."""


def find_weights(
    chosen: str | None,
    sha256: str = WEIGHTS_SHA256,
    open_url: Callable[..., IO[bytes]] = urllib.request.urlopen,
) -> Path:
    """Return the path of the weights, after their checksum has been verified.

    chosen    None for the user's cache, which is `pc2pix-bench/` in $XDG_CACHE_HOME or ~/.cache;
              DOWNLOAD for the cache, too, into which the file is fetched where it is not there or
              not intact; anything else is the path of the file
    sha256    the checksum that the file has to have
    open_url  opens the address of the file

    Nothing is fetched without DOWNLOAD: the default run takes no FID, for the features of all its
    images would more than double its time. Raises BadInput where the file cannot be read, is not
    the published one or cannot be fetched, and WeightsUnavailable where `chosen` is None and the
    cache does not hold the file.
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
    """Return the bytes of the file of weights at `path`.

    Raises BadInput where it cannot be read or is not the published one.
    """
    try:
        data = read_file(path, MOST_BYTES)
    except BadInput as error:
        raise BadInput(f"{error}; {_REMEDY}") from error
    digest = _digest(data)
    if digest != sha256:
        raise BadInput(f"{path}: sha256 {digest}, expected {sha256}; {_REMEDY}")
    return data


# The remedies for a file that cannot be used, and for a download that fails.
_REMEDY = f"give --inception-weights {DOWNLOAD}, or the path of {WEIGHTS_URL}"
_BY_HAND = f"fetch {WEIGHTS_URL} yourself and give --inception-weights PATH, or go without fid"


def _digest(data: bytes) -> str:
    """Return the SHA-256 checksum of some bytes."""
    return hashlib.sha256(data).hexdigest()


def _download(sha256: str, open_url: Callable[..., IO[bytes]]) -> bytes:
    """Return the bytes of the published file, fetched and verified. Raises BadInput."""
    try:
        with open_url(WEIGHTS_URL, timeout=DOWNLOAD_TIMEOUT_S) as response:
            data = response.read(MOST_BYTES)
    # URLError and a time-out are kinds of OSError.
    except (OSError, http.client.HTTPException) as error:
        raise BadInput(f"the FID weights cannot be fetched ({error}); {_BY_HAND}") from error
    digest = _digest(data)
    if digest != sha256:
        raise BadInput(
            f"the FID weights cannot be fetched (the answer has {len(data)} bytes of sha256 "
            f"{digest}, expected {sha256}); {_BY_HAND}"
        )
    return data
