"""Measurements of cost and of numerical differences, quoted by the pages under docs/.

Each module with a command line (`python -m studies.NAME`, from a checkout) is one study; its head
says what it measures and how to run it. They are not installed, and no package imports them.
"""

import os

os.environ["MPLBACKEND"] = "agg"  # as in `bench.cli.main`
