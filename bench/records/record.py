"""Records of a run: one for each suite, method, condition, object and view.

The order of the fields is the order of the columns of `records.parquet`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

SCHEMA_VERSION = 4  # of records and manifest; newer ones are refused, never guessed at

Outcome = Literal["ok", "failed", "skipped"]
CLAIMED = "times as claimed"  # in the notes of records of images that were drawn elsewhere
GROUND_TRUTH = "ground-truth"  # stands where a method's id stands, in features and artifacts


@dataclass(frozen=True)
class Record:
    """One image and its scores, or the reason why there is none.

    Scores are None unless the outcome is ok; `ssim_object` and the thin scores also where the image
    does not define them (`bench/catalogue/metrics.csv` says when). Times are wall time in
    seconds; workers of a run disturb each other: compare times within a run only.

    Attributes
    ----------
    reason : str
        Why there is no image; empty where the outcome is ok.
    notes : str
        What the method repaired on its way; CLAIMED where its author states the times.
    prepare_s : float or None
        The time to prepare the object, repeated for each view; of a failed one all time until then.
    draw_s : float or None
        This view's share of the time to draw all views at once; 0 of a failed one.
    """

    suite: str
    method: str
    condition: str
    class_name: str
    object: str
    view: int
    azimuth_deg: float
    elevation_deg: float
    outcome: Outcome
    reason: str
    notes: str
    ssim: float | None = None
    luminance: float | None = None
    contrast: float | None = None
    structure: float | None = None
    psnr: float | None = None
    ssim_object: float | None = None
    silhouette_iou: float | None = None
    thin_recall: float | None = None
    thin_precision: float | None = None
    lpips: float | None = None
    prepare_s: float | None = None
    draw_s: float | None = None


TIMES = ("prepare_s", "draw_s")  # the columns that differ from run to run
COLUMNS = tuple(  # of `records.parquet`
    "class" if name == "class_name" else name for name in Record.__dataclass_fields__
)
TYPES = {  # of the columns that are not text
    "view": "int32",
    **dict.fromkeys(("azimuth_deg", "elevation_deg"), "float64"),
    **dict.fromkeys(("ssim", "luminance", "contrast", "structure", "psnr"), "float64"),
    **dict.fromkeys(("ssim_object", "silhouette_iou", "thin_recall", "thin_precision"), "float64"),
    "lpips": "float64",
    **dict.fromkeys(TIMES, "float64"),
}
