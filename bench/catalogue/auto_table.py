"""The measured table of `auto`. `python -m studies.auto_table` writes this file.

Scores: `bench run --suite thirteen-classes --dataset procedural:validation --truth grey`, 39
objects, 2 views each, at 2048, 1024, 512, 256, noise-0.05, noise-0.10.
Candidates: alpha-wrap, denoised-wrap, occupancy-net, splat-net@grey, alpha-shape, denoised-alpha,
splat-fill, splat, surface-bpa.
The score is the mean of `ssim` and 1 - `lpips`, more is better. The cost is of one view of a new
cloud in milliseconds, on one thread of one machine (results/docs/auto-costs.csv). Methods that
cost no less than a better one are left out.
"""

from bench.catalogue.auto import AutoTable, Candidate

TABLE = AutoTable(
    noisy_from=0.638,
    clean={
        2048: (
            Candidate("splat-net@grey", 0.9273, 48.4),
            Candidate("splat", 0.7398, 19.7),
        ),
        1024: (
            Candidate("splat-net@grey", 0.9155, 33.7),
            Candidate("surface-bpa", 0.7944, 33.3),
            Candidate("splat", 0.7287, 5.6),
        ),
        512: (
            Candidate("occupancy-net", 0.9057, 1187.5),
            Candidate("splat-net@grey", 0.8952, 35.7),
            Candidate("splat-fill", 0.8406, 24.7),
            Candidate("alpha-shape", 0.8116, 22.3),
            Candidate("surface-bpa", 0.7862, 15.9),
            Candidate("splat", 0.7202, 5.2),
        ),
        256: (
            Candidate("occupancy-net", 0.8894, 1273.4),
            Candidate("splat-net@grey", 0.8682, 25.1),
            Candidate("denoised-alpha", 0.8241, 17.9),
            Candidate("splat-fill", 0.8199, 17.5),
            Candidate("surface-bpa", 0.7812, 9.2),
            Candidate("splat", 0.7143, 3.6),
        ),
    },
    noisy={
        2048: (
            Candidate("occupancy-net", 0.8473, 2357.1),
            Candidate("splat-net@grey", 0.8395, 47.1),
            Candidate("splat", 0.5752, 26.4),
        ),
    },
)
