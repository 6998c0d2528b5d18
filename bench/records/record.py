"""The records of a run: one for each suite, method, condition, object and view.

Scores are missing where there is no image; `ssim_object` and the thin scores also where the image
does not define them (`bench/catalogue/metrics.csv` says when). Times are seconds of a clock on the
wall; workers of a run disturb each other: compare times within a run only.

outcome    "ok" or "failed"; a job has the images of all its views or of none
reason     why there is no image; empty where the outcome is ok
notes      what the method repaired on its way; CLAIMED where its author states the times
prepare_s  the time to prepare the object, repeated for each view; of a failed one all until then
draw_s     this view's share of the time to draw all views at once; 0 of a failed one
"""

from __future__ import annotations

SCHEMA_VERSION = 5  # of the manifest; others are refused, never guessed at
RECORDS_VERSION = 4  # of what a job gives, in the key of every job and in `records.parquet`

CLAIMED = "times as claimed"  # in the notes of records of images that were drawn elsewhere
GROUND_TRUTH = "ground-truth"  # stands where a method's id stands, in features and images
JOB = ["method", "condition", "class", "object"]  # the columns that name a job
TIMES = ("prepare_s", "draw_s")  # the columns that differ from run to run
SCORES = (
    *("ssim", "luminance", "contrast", "structure", "psnr", "ssim_object"),
    *("silhouette_iou", "thin_recall", "thin_precision", "lpips"),
)
OF_VIEWS = ("azimuth_deg", "elevation_deg", *SCORES)
COLUMNS = (  # of `records.parquet`
    *("suite", *JOB, "view", "azimuth_deg", "elevation_deg", "outcome", "reason", "notes"),
    *(*SCORES, *TIMES),
)
TYPES = {"view": "int32", **dict.fromkeys((*OF_VIEWS, *TIMES), "float64")}  # of all but text
