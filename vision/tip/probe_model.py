"""Model of the taught probe: what it looks like, where it is expected, how far its end lies from its marking."""

from __future__ import annotations

import json
import zipfile
import zlib
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.core import check_bgr, check_point, despike, gray, median
from vision.tip.silhouette import Silhouette
from vision.tip.strip import ProbeShape
from vision.tip.teach import AXIS_HINT_RAD, measure

TEMPLATE_WIDTH_PX, TEMPLATE_HEIGHT_PX = 116, 220
"""The golden template of the thesis (fig. 5.7a): this much of the probe from just below its end upwards."""
TEMPLATE_BELOW_TIP_PX = 8
SEARCH_REACH_PX = 28
"""The end rides on the head as the camera does: it flexes by pixels, so the search stays this close to its taught
place."""
VERSION = 2


@dataclass(frozen=True, eq=False)
class ProbeModel:
    """Hold a taught probe. Make one with `teach`, keep it with `save`, get it back with `load`.

    tip_px: taught end (x, y); angle_rad: direction of the probe towards its end; h_px: lower rim to end along it;
    shape: its sizes; outline: where its edges were seen, row by row;
    template: (220, 116) uint8 of the median-filtered image, its top-left pixel at `corner_px`; template_mask: 255
    where the probe is; rim_form_px: lower rim's form over the probe's middle; frame_px: (width, height) taught in.
    """

    tip_px: tuple[float, float]
    angle_rad: float
    shape: ProbeShape
    outline: Silhouette
    rim_form_px: NDArray[np.float64]
    template: NDArray[np.uint8]
    template_mask: NDArray[np.uint8]
    corner_px: tuple[int, int]
    frame_px: tuple[int, int]
    marking_contrast: float
    click_offset_px: float

    @property
    def h_px(self) -> float:
        """Return h, the distance from the marking's lower rim to the end along the bisector, px."""
        return self.shape.end_to_rim_px

    @property
    def search_roi_px(self) -> tuple[int, int, int, int]:
        """Return the part of the image (x, y, width, height) the template is searched in."""
        x, y = self.corner_px[0] - SEARCH_REACH_PX, self.corner_px[1] - SEARCH_REACH_PX
        return x, y, TEMPLATE_WIDTH_PX + 2 * SEARCH_REACH_PX, TEMPLATE_HEIGHT_PX + 2 * SEARCH_REACH_PX

    @classmethod
    def teach(
        cls, white_bgr: NDArray[np.uint8], tip_px: tuple[float, float], axis_hint_rad: float = AXIS_HINT_RAD
    ) -> ProbeModel:
        """Learn the probe from a white image (H, W, 3) uint8 BGR and its true end (x, y) in px (thesis 5.3.6).

        The end should stand before a dark, quiet background; `find_tip` then finds it before brighter ones, too.
        axis_hint_rad: the probe's direction in the image towards its end, within 12 degrees. Raises ValueError naming
        what was not found.
        """
        image = check_bgr(white_bgr)
        tip = check_point(tip_px, "tip_px")
        height, width = image.shape[:2]
        if not (0 <= tip[0] < width and 0 <= tip[1] < height):
            raise ValueError(f"tip_px {tip} lies outside the picture of {width} x {height} px")
        plane = gray(image)
        taught = measure(despike(plane), tip, axis_hint_rad)
        corner = _template_corner(taught.x_px, taught.y_px, taught.angle_rad)
        x, y = corner
        if x < 0 or y < 0 or x + TEMPLATE_WIDTH_PX > width or y + TEMPLATE_HEIGHT_PX > height:
            raise ValueError(f"the golden template at {corner} does not fit into the picture of {width} x {height} px")
        part = np.s_[y : y + TEMPLATE_HEIGHT_PX, x : x + TEMPLATE_WIDTH_PX]
        outline = probe_outline((taught.x_px - x, taught.y_px - y), taught.angle_rad, taught.shape, 5.0)
        mask = np.zeros((TEMPLATE_HEIGHT_PX, TEMPLATE_WIDTH_PX), dtype=np.uint8)
        cv2.fillPoly(mask, [np.rint(outline).astype(np.int32)], (255,))
        return cls(
            tip_px=(taught.x_px, taught.y_px),
            angle_rad=taught.angle_rad,
            shape=taught.shape,
            outline=taught.outline,
            rim_form_px=taught.rim_form_px,
            template=np.ascontiguousarray(median(plane, 7)[part]),
            template_mask=mask,
            corner_px=corner,
            frame_px=(width, height),
            marking_contrast=taught.marking_contrast,
            click_offset_px=taught.click_offset_px,
        )

    def save(self, path: str | Path) -> None:
        """Write the model as one .npz file at exactly `path`."""
        facts = {
            "version": VERSION,
            "tip_px": self.tip_px,
            "angle_rad": self.angle_rad,
            "shape": asdict(self.shape),
            "cylinder_rows": self.outline.cylinder_rows,
            "dim_side": self.outline.dim_side,
            "corner_px": self.corner_px,
            "frame_px": self.frame_px,
            "marking_contrast": self.marking_contrast,
            "click_offset_px": self.click_offset_px,
        }
        with Path(path).open("wb") as file:
            np.savez_compressed(
                file,
                facts=np.array(json.dumps(facts)),
                template=self.template,
                template_mask=self.template_mask,
                rim_form_px=self.rim_form_px,
                outline=np.stack(_rows_of(self.outline)),
            )

    @classmethod
    def load(cls, path: str | Path) -> ProbeModel:
        """Read a model written by `save`; ValueError for any file that is not one, OSError if it cannot be read."""
        with Path(path).open("rb") as file:
            try:
                with np.load(file, allow_pickle=False) as stored:
                    return _from_stored(json.loads(str(stored["facts"])), stored)
            except (KeyError, TypeError, ValueError, EOFError, OSError, zipfile.BadZipFile, zlib.error) as exc:
                raise ValueError(f"{path} is not a probe model ({exc}): teach the needle again") from exc


def _from_stored(facts: dict[str, Any], stored: Any) -> ProbeModel:
    if facts["version"] != VERSION:
        raise ValueError(f"it has version {facts['version']}, this program reads version {VERSION}")
    table = np.asarray(stored["outline"], dtype=np.float64)
    outline = _outline(table, int(facts["cylinder_rows"]), int(facts.get("dim_side", 0)))
    template = np.ascontiguousarray(stored["template"])
    mask = np.ascontiguousarray(stored["template_mask"])
    form = np.asarray(stored["rim_form_px"], dtype=np.float64)
    size = (TEMPLATE_HEIGHT_PX, TEMPLATE_WIDTH_PX)
    if template.shape != size or mask.shape != size or template.dtype != np.uint8 or mask.dtype != np.uint8:
        raise ValueError(f"its template is {template.shape} {template.dtype}, expected {size} uint8")
    numbers = [*facts["shape"].values(), facts["angle_rad"], *facts["tip_px"]]
    if form.ndim != 1 or form.size < 7 or not np.all(np.isfinite([*numbers, *form])):
        raise ValueError("its numbers are damaged")
    return ProbeModel(
        tip_px=check_point(facts["tip_px"], "tip_px"),
        angle_rad=float(facts["angle_rad"]),
        shape=ProbeShape(**{name: float(number) for name, number in facts["shape"].items()}),
        outline=outline,
        rim_form_px=form,
        template=template,
        template_mask=mask,
        corner_px=(int(facts["corner_px"][0]), int(facts["corner_px"][1])),
        frame_px=(int(facts["frame_px"][0]), int(facts["frame_px"][1])),
        marking_contrast=float(facts["marking_contrast"]),
        click_offset_px=float(facts["click_offset_px"]),
    )


def _rows_of(outline: Silhouette) -> list[NDArray[np.float64]]:
    rows = [outline.u_px, outline.left_px, outline.right_px]
    return rows if outline.shade_px is None else [*rows, outline.shade_px]


def _outline(table: NDArray[np.float64], cylinder_rows: int, dim_side: int) -> Silhouette:
    columns = 4 if dim_side in (-1, 1) else 3
    rows_fit = table.ndim == 2 and table.shape[0] == columns and 8 <= cylinder_rows <= table.shape[1] - 8
    if not rows_fit or not np.all(np.isfinite(table)) or np.any(np.diff(table[0]) <= 0.0):
        raise ValueError("its outline is damaged")
    shade = table[3] if columns == 4 else None
    return Silhouette(
        u_px=table[0],
        left_px=table[1],
        right_px=table[2],
        cylinder_rows=cylinder_rows,
        dim_side=dim_side,
        shade_px=shade,
    )


def _template_corner(x_px: float, y_px: float, angle_rad: float) -> tuple[int, int]:
    """Return the template's top-left pixel: its bottom just below the end, the probe along its diagonal."""
    top = TEMPLATE_HEIGHT_PX - TEMPLATE_BELOW_TIP_PX
    drift = top / np.tan(angle_rad)
    return int(np.rint(x_px - drift / 2 - TEMPLATE_WIDTH_PX / 2)), int(np.rint(y_px - top))


def probe_outline(
    tip_px: tuple[float, float], angle_rad: float, shape: ProbeShape, margin_px: float
) -> NDArray[np.float64]:
    """Return the probe's silhouette as a polygon (N, 2) of image points, grown by `margin_px`."""
    rim = shape.end_to_rim_px
    half_end = shape.end_half_px + margin_px
    half_rim = shape.end_half_px + shape.taper_slope * rim + margin_px
    half_top = shape.cylinder_half_px + margin_px
    u = np.array([margin_px, -rim, -rim, -rim - 320.0])
    half = np.array([half_end, half_rim, max(half_top, half_rim), max(half_top, half_rim)])
    u, v = np.concatenate([u, u[::-1]]), np.concatenate([half, -half[::-1]])
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.stack([tip_px[0] + u * c - v * s, tip_px[1] + u * s + v * c], axis=1)
