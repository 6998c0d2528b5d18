"""The measured table of `auto`. `python -m studies.auto_table` writes this file."""

from bench.catalogue.auto import AutoTable, Candidate

TABLE = AutoTable(
    noisy_from=0.61,
    clean={2048: (Candidate("splat", 0.7, 7.5),)},
    noisy={2048: (Candidate("splat", 0.5, 10.8),)},
)
