"""Model of the turning head: where the tip is at every angle."""

from vision.head.fit import Choice, HeadFit, fit_head, head_positions_um, order_table
from vision.head.model import CircleHead, Head, head_from_dict, head_to_dict, tip_offsets_um
from vision.head.record import repeatability_um
from vision.head.total_error import total_error_um

__all__ = [
    "Choice",
    "CircleHead",
    "Head",
    "HeadFit",
    "fit_head",
    "head_from_dict",
    "head_positions_um",
    "head_to_dict",
    "order_table",
    "repeatability_um",
    "tip_offsets_um",
    "total_error_um",
]
