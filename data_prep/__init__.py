"""Input of the benchmark: shapes, clouds, views, true images, datasets, perturbations."""

import sys

from data_prep.moved_modules import MovedModules

sys.meta_path.append(MovedModules())
