from __future__ import annotations

import pytest

import bench.report.run_figures
import bench.report.sheets
from bench.records.folder import open_folder
from bench.records.frames import Artifact
from bench.report.plots import save

from ..builders import make_result


@pytest.fixture
def drawn(monkeypatch, tmp_path):
    """Writes figures of jobs, of which no artifact needs to be there yet; gives those figures."""
    figures = {}

    def keep(figure, path, **options):
        figures[path.name] = figure
        save(figure, path, **options)

    for module in (bench.report.run_figures, bench.report.sheets):
        monkeypatch.setattr(module, "save", keep)

    def draw(write, *arguments, jobs):
        with open_folder(tmp_path) as store:
            stored = store.find([job.key for job in jobs])
            for seed, job in enumerate(jobs):
                if job.key not in stored:
                    store.append(make_result(job, (), seed))
        figures.clear()
        write(tmp_path, *arguments, {job.name: Artifact(tmp_path, job.key) for job in jobs})
        return figures

    return draw
