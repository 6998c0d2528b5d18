"""The cost of an image by the number of points: writes `results/costs-by-points.csv`.

`python -m studies.costs_by_points` measures each method with a score, in a process of its own with
one thread: the processor time of preparing a new cloud and drawing one view of it. The clouds are
samples of a chair; a line has the least time of some rounds, after one that does not count.
`bench.catalogue.chosen` takes from them how many times dearer a method is at more points.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time

from bench.catalogue.chosen import COSTS_BY_POINTS, measured_methods
from bench.catalogue.methods import find_method
from bench.running.environment import WORKER_ENVIRONMENT
from bench.running.work import draw, load_renderer
from bench.tables.table import csv_text
from data_prep.clouds.sampling import sample_surface
from data_prep.files.atomic_write import write_whole
from data_prep.randomness import generator
from data_prep.scene import CLOUD_SIZE, View
from data_prep.shapes.chair.chairs import chair

_COUNTS = (CLOUD_SIZE, 8192, 32_768, 262_144)  # points
_ROUNDS = 3
_LIMIT_S = 240  # seconds for all counts of a method; those that it does not reach have no line
_VIEW = View(30.0, 20.0)  # as `bench render` draws it


def _measure(method_id: str) -> None:
    """Print the method, each number of points, and the milliseconds of one view of a new cloud."""
    method, renderer = find_method(method_id), load_renderer(method_id, "cpu")
    mesh = chair(generator("costs by points"))
    for count in _COUNTS:
        cloud = sample_surface(mesh, generator("costs by points", count), count)
        times = []
        for _ in range(1 + _ROUNDS):
            before = time.process_time()
            draw(method, renderer, cloud, (_VIEW,), generator("render"))
            times.append(1000 * (time.process_time() - before))
        print(method_id, count, f"{min(times[1:]):.4g}", flush=True)


def main() -> None:
    """Measure all methods and write the file, or print the times of METHOD."""
    if len(sys.argv) > 1:
        _measure(sys.argv[1])
        return
    scored = [m for m, measured in measured_methods().items() if measured.score is not None]
    lines = []
    for method_id in scored:
        command = ["timeout", str(_LIMIT_S), sys.executable, "-m", __spec__.name, method_id]
        environment = os.environ | WORKER_ENVIRONMENT
        done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True)
        lines += [line.split() for line in done.stdout.splitlines()]
    write_whole(COSTS_BY_POINTS, csv_text(["method", "points", "one_view_ms"], lines).encode())


if __name__ == "__main__":
    main()
