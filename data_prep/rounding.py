"""Directed and random rounding of all that this thread computes.

IEEE 754 has four rounding modes. C's `fesetround` chooses one for everything that the calling
thread does: NumPy, PyTorch, MeshLab, CGAL, Mesa. A computation that is repeated with the mode drawn
anew at each call of a native function shows how many digits of its result are above rounding: the
random rounding of CADNA, at the grain of calls. Within a call the mode stays, so that the errors of
a long sum add up where they would cancel, and vectorised exponentials and sines that count on
rounding to nearest err by up to some hundred units in the last place (NumPy 2.4, float32). The
digits found are a lower bound.
"""

from __future__ import annotations

import ctypes
import platform
import random
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from types import FrameType
from typing import Any, Literal

from data_prep.failures import MissingDependency

Mode = Literal["nearest", "down", "up", "toward-zero"]
# fenv.h of glibc on x86-64; other processors number the modes otherwise.
MODES: dict[Mode, int] = {"nearest": 0x000, "down": 0x400, "up": 0x800, "toward-zero": 0xC00}
PROCESSOR = "x86_64"


@cache
def rounding_modes(machine: str = platform.machine()) -> Any:
    """Return the C library's mathematics, which has `fesetround`.

    Raises MissingDependency for a `machine` whose rounding modes we do not know.
    """
    try:
        if machine != PROCESSOR:
            raise OSError(f"its processor is {machine}")
        return ctypes.CDLL("libm.so.6")
    except OSError as error:
        raise MissingDependency(
            f"no rounding modes on this machine ({error}): they need glibc on {PROCESSOR}; run "
            "other suites here"
        ) from error


@contextmanager
def rounded(mode: Mode) -> Iterator[None]:
    """Round in one mode within the block. Raises MissingDependency as `rounding_modes`."""
    library = rounding_modes()
    library.fesetround(MODES[mode])
    try:
        yield
    finally:
        library.fesetround(MODES["nearest"])


@contextmanager
def rounded_at_random(choices: random.Random) -> Iterator[None]:
    """Round in a mode that `choices` draw anew for each native call within the block.

    Native calls are those that Python's profiler sees (`sys.setprofile`), which the block may not
    use. Raises MissingDependency as `rounding_modes`.
    """
    fesetround, modes = rounding_modes().fesetround, tuple(MODES.values())

    def draw_mode(frame: FrameType, event: str, argument: Any) -> None:
        if event == "c_call":
            fesetround(modes[choices.getrandbits(2)])

    fesetround(modes[choices.getrandbits(2)])
    sys.setprofile(draw_mode)
    try:
        yield
    finally:
        sys.setprofile(None)
        fesetround(MODES["nearest"])
