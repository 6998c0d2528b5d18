from __future__ import annotations

import pytest

import bench.report.classes
import bench.report.image_sheets
import bench.report.robustness
from bench.tables.figure import save

from ..builders import write_artifact


@pytest.fixture
def drawn(monkeypatch, tmp_path):
    """Writes figures of jobs, of which no artifact needs to be there yet; gives those figures."""
    figures = []

    def keep(figure, path, **options):
        figures.append(figure)
        save(figure, path, **options)

    for module in (bench.report.classes, bench.report.image_sheets, bench.report.robustness):
        monkeypatch.setattr(module, "save", keep)

    def draw(write, *arguments, jobs):
        for seed, job in enumerate(jobs):
            if not job.artifact.exists():
                write_artifact(job, seed)
        write(tmp_path, *arguments, {job.name: job.artifact for job in jobs})
        return figures

    return draw
