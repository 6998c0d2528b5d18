"""`bench doctor`: is everything here that a run needs? One line per finding, with the remedy."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version

from bench.catalogue.methods import METHODS
from bench.catalogue.metrics import SET_METRICS, WeightsUnavailable
from bench.catalogue.plugins import plugin_problems
from bench.checking.contract.findings import Finding
from bench.commands.contract import conclude
from bench.running.environment import PACKAGES, cores, environment
from data_prep.failures import BadInput, MissingDependency
from data_prep.render import DEBIAN_PACKAGES

OPTIONAL = ("libusb-1.0-0",)  # Open3D only


def examine() -> Iterator[Finding]:
    """All findings about this machine and installation, cheap ones first."""
    for package in PACKAGES:
        try:
            yield Finding(True, package, version(package))
        except PackageNotFoundError:
            yield Finding(False, package, "not installed: run 'make install'")
    for debian, library in DEBIAN_PACKAGES.items():
        try:
            ctypes.CDLL(library)
            yield Finding(True, library, "found")
        except OSError:
            need = "optional, for Open3D" if debian in OPTIONAL else "needed"
            yield Finding(
                debian in OPTIONAL, library, f"missing ({need}): apt-get install {debian}"
            )
    try:
        yield Finding(True, "rendering", environment()["gl"])
    except MissingDependency as error:
        yield Finding(False, "rendering", str(error))
    for method in METHODS:
        try:
            yield Finding(True, f"method {method.id}", method.identity() or "ready")
        except MissingDependency as error:  # of an extra
            yield Finding(True, f"method {method.id}", f"not available: {error}")
        except (BadInput, PackageNotFoundError) as error:
            yield Finding(False, f"method {method.id}", str(error))
    for metric in SET_METRICS:
        try:
            yield Finding(True, f"metric {metric.id}", str(metric.weights(None)))
        except WeightsUnavailable as error:
            yield Finding(True, f"metric {metric.id}", f"skipped in runs: {error}")
        except BadInput as error:
            yield Finding(False, f"metric {metric.id}", str(error))
    for problem in plugin_problems():
        yield Finding(False, "other packages", problem)
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    yield Finding(True, "machine", f"{cores()} cores, {memory:.1f} GiB of memory")


def doctor() -> None:
    """Check that everything that a run needs is installed. Exit 0 if so, 1 if not."""
    conclude(examine())
