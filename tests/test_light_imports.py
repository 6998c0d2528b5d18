"""What loads in a moment has to stay so: the command line, shared types, names of weights."""

from __future__ import annotations

import subprocess
import sys

import pytest

HEAVY = {"numpy", "scipy", "pandas", "trimesh", "pyrender", "OpenGL", "pymeshlab", "torch", "PIL"}
# Of one interpreter, what is done after what, and which of these packages may be there then.
STEPS = {
    "import bench, pc2pix": set(),
    "import data_prep.scene": {"numpy"},
    "import pc2pix.weights, baselines.splat_net.weights, learning.weights": {"numpy"},
    "import baselines.fused_net.weights, baselines.occupancy_net.weights": {"numpy"},
    "import baselines.upsampler.weights, baselines.upsampler.config": {"numpy"},
    "import bench.metrics.inception_weights, bench.metrics.packaged_weights": {"numpy"},
    "import bench.metrics.image_scores, bench.judges.answers": {"numpy"},
}


@pytest.fixture(scope="module")
def loaded():
    """After each step, which of them are."""
    script = "import sys\n"
    for step in STEPS:
        script += f"{step}\nprint(*sorted({HEAVY!r} & {{n.split('.')[0] for n in sys.modules}}))\n"
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    return dict(zip(STEPS, done.stdout.splitlines(), strict=True))


@pytest.mark.parametrize("step", STEPS)
def test_nothing_heavy_is_imported(loaded, step):
    assert set(loaded[step].split()) <= STEPS[step]
