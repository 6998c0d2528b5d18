"""Draws from several threads, in forked processes, and interrupted."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

SCRIPT = """
import multiprocessing, os, signal, sys, threading, time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

import bench
from bench.draw.cloud import Drawing, draw_file
from bench.draw.cloud_file import CloudFile
from bench.draw.thread import on_drawing_thread
from data_prep.failures import BadInput
from data_prep.randomness import generator
from data_prep.scene import View

METHODS = ("surface-bpa", "alpha-wrap", "splat-net@grey")  # MeshLab, OpenGL, PyTorch
points = generator("test").normal(size=(300, 3)) * (1, 2, 3)

def draw(method):
    return bench.draw_cloud(points, method=method)

def equal(images):
    return [np.array_equal(image, alone[method]) for image, method in zip(images, METHODS * 3)]

def draw_from_file(path):
    return draw_file(CloudFile(path, as_is=False), Drawing("splat", (View(30.0, 20.0),)))[0]

if __name__ == "__main__":
    environment = dict(os.environ)
    with ThreadPoolExecutor(3) as threads:
        drawn = list(threads.map(draw, METHODS * 3))
        alone = {method: draw(method) for method in METHODS}
        print("threads", all(equal(drawn)))
        np.save("cloud.npy", points)
        from_file = list(threads.map(draw_from_file, [Path("cloud.npy")] * 2))
        print("files", all(np.array_equal(image, draw("splat")) for image in from_file))
        print("environment", dict(os.environ) == environment | {"PYOPENGL_PLATFORM": "egl"})
    with multiprocessing.get_context("fork").Pool(1) as pool:
        print("forked", all(equal(pool.map_async(draw, METHODS).get(60))))
    nested = on_drawing_thread(lambda: draw("alpha-wrap"))
    print("nested", np.array_equal(nested, alone["alpha-wrap"]))
    try:
        draw("splta")
    except BadInput as error:
        print("refused", str(error)[:22])
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's `&` has it ignored
    threading.Timer(0.2, os.kill, [os.getpid(), signal.SIGINT]).start()
    start = time.monotonic()
    try:
        on_drawing_thread(lambda: time.sleep(3))
    except KeyboardInterrupt:
        print("interrupted", time.monotonic() - start < 2)
    threading.Thread(target=lambda: [draw("alpha-wrap") for _ in range(99)], daemon=True).start()
"""


@pytest.mark.opengl
def test_any_thread_draws_by_any_method_and_the_process_ends_as_it_should(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    command = [sys.executable, "-W", "ignore", script]  # Python warns of any fork beside threads
    # Threads of Mesa that someone asks for are not in a forked process, which waits for them.
    env = {name: value for name, value in os.environ.items() if name != "LP_NUM_THREADS"}
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, env=env)
    told = ("threads", "files", "environment", "forked", "nested")
    lines = [*(f"{name} True" for name in told), "refused unknown method 'splta'"]
    assert (done.stdout.splitlines(), done.stderr) == ([*lines, "interrupted True"], "")
    assert done.returncode == 0
