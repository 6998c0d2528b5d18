"""The measured table of `auto`. `python -m studies.auto_table` writes this file.

Scores: `bench run --suite thirteen-classes --dataset procedural:validation --truth grey`, 39
objects, 2 views each, at 2048, 1024, 512, 256, noise-0.05, noise-0.10.
Candidates: alpha-wrap, denoised-wrap, occupancy-net, splat-net@grey, alpha-shape, denoised-alpha,
splat-fill, splat, surface-bpa, fused-net@grey, splat-net@tiny-grey.
The score is the mean of `ssim` and 1 - `lpips`, more is better. The cost is of one view of a new
cloud in milliseconds, on one thread of one machine (results/docs/auto-costs.csv). Methods that
cost no less than a better one are left out.
"""

from bench.catalogue.auto import AutoTable, Candidate

TABLE = AutoTable(
    noisy_from=0.638,
    clean={
        2048: (
            Candidate("fused-net@grey", 0.9407, 729.5),
            Candidate("splat-net@grey", 0.9318, 25.8),
            Candidate("splat-net@tiny-grey", 0.8997, 6.5),
            Candidate("splat", 0.7398, 6.0),
        ),
        1024: (
            Candidate("fused-net@grey", 0.9299, 658.6),
            Candidate("splat-net@grey", 0.9194, 17.8),
            Candidate("splat-net@tiny-grey", 0.8881, 5.3),
            Candidate("splat", 0.7287, 3.1),
        ),
        512: (
            Candidate("fused-net@grey", 0.9144, 658.2),
            Candidate("occupancy-net", 0.9057, 582.2),
            Candidate("splat-net@grey", 0.8986, 15.2),
            Candidate("splat-net@tiny-grey", 0.8635, 5.3),
            Candidate("splat", 0.7202, 2.6),
        ),
        256: (
            Candidate("fused-net@grey", 0.8921, 656.2),
            Candidate("occupancy-net", 0.8894, 600.3),
            Candidate("splat-net@grey", 0.8706, 15.0),
            Candidate("alpha-wrap", 0.8506, 14.8),
            Candidate("denoised-alpha", 0.8241, 9.6),
            Candidate("splat-net@tiny-grey", 0.8233, 4.9),
            Candidate("splat", 0.7143, 1.8),
        ),
    },
    noisy={
        2048: (
            Candidate("fused-net@grey", 0.8711, 1608.2),
            Candidate("splat-net@grey", 0.8582, 26.0),
            Candidate("splat-net@tiny-grey", 0.794, 7.1),
        ),
    },
)
