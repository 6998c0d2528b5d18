"""Clouds and runs to turn and look at, in a notebook or as a page."""

from __future__ import annotations

from dataclasses import dataclass, field
from html import escape
from pathlib import Path

from numpy.typing import ArrayLike

from bench.draw.cloud import warn
from bench.draw.points import loaded_cloud
from bench.records.folder import read_manifest
from bench.report.build import REPORT
from bench.report.look import cloud_entry
from bench.report.page import rendered
from data_prep.failures import BadInput
from data_prep.files.atomic_write import write_whole

MOST_POINTS = 65_536  # points of a cloud that is shown alone: half a MB, as text


@dataclass(frozen=True)
class Viewer:
    """A page of clouds that turn, which a notebook shows, and which loads nothing."""

    html: str = field(repr=False)

    def _repr_html_(self) -> str:
        """Return the page in a frame of 700 pixels, which may run its script and nothing else."""
        frame = 'sandbox="allow-scripts" title="cloud" width="100%" height="700"'
        return f'<iframe {frame} srcdoc="{escape(self.html)}"></iframe>'

    def save(self, path: str | Path) -> None:
        """Write the page, whole or not at all. Raises `data_prep.failures.CannotWrite`."""
        write_whole(Path(path), self.html.encode(), remedy="give another path")


def show(
    points: ArrayLike | Path,
    *,
    up: str = "y",
    front: str | None = None,
    colour: str = "auto",
    colors: ArrayLike | None = None,
) -> Viewer:
    """Return a cloud that a pointer or arrow keys turn, or the report of a run.

    Parameters
    ----------
    points : array_like or path
        Points as of `bench.draw_cloud`, of which at most 65,536 are shown; or the folder of a
        finished run, whose `report.html` is.
    up, front, colour, colors
        As of `bench.draw_cloud`, for points; `colour` not "invented".

    Returns
    -------
    Viewer

    Raises
    ------
    data_prep.failures.BadInput
        If there are no points, or the folder is no run of this protocol or has no report.

    Examples
    --------
    >>> bench.show(points).save("cloud.html")
    """
    if isinstance(points, str | Path) and Path(points).is_dir():
        read_manifest(Path(points))  # refuses what is no run, and runs of another protocol
        report = Path(points) / REPORT
        if not report.is_file():
            raise BadInput(f"{report}: is not there; 'bench report {points}' writes it")
        return Viewer(report.read_text(encoding="utf-8"))
    loaded = loaded_cloud(points, colour, None, colors, up=up, front=front)
    warn(loaded.notes, levels=2)
    title = Path(points).name if isinstance(points, str | Path) else "cloud"
    clouds = {"": cloud_entry(loaded.cloud, MOST_POINTS)}
    objects = [{"name": title, "views": [], "clouds": clouds}]
    shown = {"objects": objects, "conditions": [""], "methods": []}
    return Viewer(rendered("show.html.jinja", scripts=("viewer.js",), shown=shown, title=title))
