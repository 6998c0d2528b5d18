"""Clouds and runs to turn and look at, in a notebook or as a page."""

from __future__ import annotations

from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from bench.analysis.run import read_run
from bench.draw.cloud import warn
from bench.draw.points import loaded_cloud
from bench.records.folder import MANIFEST
from bench.report.build import read_look
from bench.report.look import of_cloud
from bench.report.page import rendered
from data_prep.failures import BadInput
from data_prep.files.atomic_write import write_whole

MOST_POINTS = 65_536  # points of a cloud that is shown alone: half a MB, as text
_HEIGHT_PX = 700  # of the frame in a notebook: the cloud, its lines of text and the sliders


@dataclass(frozen=True)
class Shown:
    """A page that shows clouds, which a notebook shows in a frame.

    Attributes
    ----------
    html : str
        The page, which loads nothing.
    """

    html: str = field(repr=False)

    def _repr_html_(self) -> str:
        """Return the page in a frame of its own, which may run its script and nothing else."""
        return (
            f'<iframe sandbox="allow-scripts" title="pc2pix-bench" width="100%" '
            f'height="{_HEIGHT_PX}" style="border: 0" srcdoc="{escape(self.html)}"></iframe>'
        )

    def save(self, path: str | Path) -> None:
        """Write the page, whole or not at all.

        Parameters
        ----------
        path : path
            HTML file, which is replaced.

        Raises
        ------
        data_prep.failures.CannotWrite
            If the file cannot be written.
        """
        write_whole(Path(path), self.html.encode(), remedy="give another path")


def show(
    points: ArrayLike | Path,
    *,
    up: str = "y",
    front: str | None = None,
    colour: str = "auto",
    colors: ArrayLike | None = None,
) -> Shown:
    """Return a cloud that a pointer or arrow keys turn, or a run with its clouds and images.

    The last line of a cell of a notebook shows it, and `save` writes it as a page for any browser.

    Parameters
    ----------
    points : array_like or path
        Points as of `bench.draw_cloud`, or the folder of a finished run, whose first objects are
        shown with the true images and those of the best methods. Of more than 65,536 points so
        many are shown.
    up, front, colour, colors
        As of `bench.draw_cloud`, for points alone; `colour` not "invented".

    Returns
    -------
    Shown

    Raises
    ------
    data_prep.failures.BadInput
        If there are no points, or the folder holds no finished run of images.

    Examples
    --------
    >>> bench.show(points).save("cloud.html")
    """
    if isinstance(points, str | Path) and Path(points).is_dir():
        return _shown_run(Path(points))
    loaded = loaded_cloud(points, colour, colors, up=up, front=front)
    warn(loaded.notes, levels=2)
    name = Path(points).name if isinstance(points, str | Path) else "cloud"
    shown = of_cloud(loaded.cloud, name, MOST_POINTS)
    count = len(loaded.cloud)
    part = f", {MOST_POINTS:,} of them are shown" if count > MOST_POINTS else ""
    return _page(shown, f"{name}: {count:,} points{part}")


def _shown_run(directory: Path) -> Shown:
    if not (directory / MANIFEST).exists():
        raise BadInput(f"{directory}: holds no run; give the folder of one, or a file of points")
    shown = read_look(read_run(directory))
    if shown is None:
        raise BadInput(f"{directory}: no method that competes has an image; see its report.html")
    return _page(shown, directory.name)


def _page(shown: dict[str, Any], title: str) -> Shown:
    scripts = ("viewer.js",)
    return Shown(rendered("show.html.jinja", scripts=scripts, shown=shown, title=title))
