"""Results of `bench shrink`: a smaller cloud that fails alike, or a failure that is gone."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

from bench.rendering.cloud import Drawing
from data_prep.scene import Points

# Not the digits of a name: float32, SIGUSR1.
_NUMBER = re.compile(r"(?<![\w.])[-+]?(0x[0-9a-f]+|\d[\d,]*(\.\d+)?(e[-+]?\d+)?)(?!\w)", re.I)


@dataclass(frozen=True, eq=False)
class Shrunk:
    """A cloud that fails as its record says.

    reason      of its failure, on the view of `drawing`, or on all its views
    points      float32 [n, 3], as they are in `path`
    before      number of points of the whole cloud
    trials, seconds  of the search
    minimal     False where the time ran out: fewer points may do
    reproduced  the reason why `command` fails; empty where it does not fail
    """

    reason: str
    path: Path
    points: Points
    before: int
    drawing: Drawing
    trials: int
    seconds: float
    minimal: bool
    reproduced: str

    @property
    def command(self) -> str:
        """Return the command that draws the cloud from the first view of `drawing`."""
        view, device = self.drawing.views[0], self.drawing.device
        arguments = (
            *("bench", "render", str(self.path), "--as-is", "--method", self.drawing.method),
            *("--azimuth", f"{view.azimuth_deg!r}", "--elevation", f"{view.elevation_deg!r}"),
            *(() if device == "auto" else ("--device", device)),
            *("-o", "out.png"),
        )
        return shlex.join(arguments)

    @property
    def message(self) -> str:
        """Return the result in lines for people; one of them is the command."""
        end = (
            "without any one of them it does not fail so"
            if self.minimal
            else "the time is up, fewer may do"
        )
        lines = [
            f"{self.drawing.method}: {self.reason}",
            f"{self.before} points became {len(self.points)} ({self.trials} trials, "
            f"{self.seconds:.0f} s); {end}",
        ]
        if self.drawing.rng is not None:
            lines.append(
                f"it fails so with the run's random numbers and its {len(self.drawing.views)} "
                "views, not with one of them alone; the command draws the first"
            )
        lines.append(self.command)
        if fails_alike(self.reproduced, self.reason):
            lines.append("reproduced")
        else:
            lines.append(f"not reproduced: {self.reproduced or 'the command draws an image'}")
        return "\n".join(lines)


@dataclass(frozen=True)
class NotReproduced:
    """A failure that does not occur any more.

    now  the reason of another failure instead; empty where the method draws
    """

    name: str
    reason: str
    now: str

    @property
    def message(self) -> str:
        """Return one line for people."""
        now = f"fails otherwise now: {self.now}" if self.now else "is drawn now"
        return f"{self.name}: does not fail any more as it did ({self.reason}); it {now}"


def fails_alike(reason: str, other: str) -> bool:
    """Return whether two reasons are the same but for their numbers; an empty one is like none."""
    return bool(reason) and _NUMBER.sub("#", reason) == _NUMBER.sub("#", other)
