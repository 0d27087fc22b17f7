"""Draw what was seen, for a process engineer: on a copy, in the frame's own pixels, magnified round the tip.

Green is what was used, yellow the answer, orange what was refused, magenta what could not be decided. Every object says
which rule decided it.
"""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np

from vision.image import Bgr, check_bgr
from vision.notfound import NotFound
from vision.rules import Decided
from vision.testpoint import Seen, TestPoint
from vision.tip import Tip

Colour = tuple[int, int, int]
RED_GAIN = 1.8
USED: Colour = (80, 220, 80)
ANSWER: Colour = (0, 230, 255)
THROWN: Colour = (60, 160, 255)
UNDECIDED: Colour = (255, 80, 255)
FRAME: Colour = (200, 160, 60)
INK: Colour = (255, 255, 255)
# Sub-pixel positions are drawn with this many binary places.
SHIFT = 4
FONT = cv2.FONT_HERSHEY_SIMPLEX


class Sheet:
    """A magnified copy of part of a frame that takes drawing in the frame's own pixels."""

    def __init__(self, image: Bgr, area_px: tuple[int, int, int, int], zoom: int) -> None:
        self.x_px, self.y_px, self.zoom = area_px[0], area_px[1], zoom
        self.pixels = crop(image, area_px, zoom)

    def place(self, x_px: float, y_px: float) -> tuple[int, int]:
        """Return the sheet's place of a frame point, in 1/16 px (a pixel's centre is the middle of its square)."""
        one = 1 << SHIFT
        x = ((x_px - self.x_px + 0.5) * self.zoom - 0.5) * one
        y = ((y_px - self.y_px + 0.5) * self.zoom - 0.5) * one
        return int(np.clip(x, -1e6, 1e6)), int(np.clip(y, -1e6, 1e6))

    def line(self, start: tuple[float, float], end: tuple[float, float], colour: Colour, thickness: int = 1) -> None:
        """Draw a line between frame points."""
        cv2.line(self.pixels, self.place(*start), self.place(*end), colour, thickness, cv2.LINE_AA, SHIFT)

    def cross(self, at: tuple[float, float], size_px: float, colour: Colour, thickness: int = 1) -> None:
        """Draw an upright cross at a frame point."""
        x, y = at
        self.line((x - size_px, y), (x + size_px, y), colour, thickness)
        self.line((x, y - size_px), (x, y + size_px), colour, thickness)

    def ring(self, at: tuple[float, float], radius_px: float, flat: float, turn_deg: float, colour: Colour) -> None:
        """Draw an ellipse: semi-major radius, minor over major axis, direction of the minor axis."""
        scale = self.zoom * (1 << SHIFT)
        axes = max(int(radius_px * flat * scale), 1), max(int(radius_px * scale), 1)
        cv2.ellipse(self.pixels, self.place(*at), axes, turn_deg, 0.0, 360.0, colour, 1, cv2.LINE_AA, SHIFT)

    def write(self, text: str, at: tuple[float, float], colour: Colour) -> None:
        """Write a line of text beside a frame point, on darkened ground so that it reads everywhere."""
        x, y = (number >> SHIFT for number in self.place(*at))
        self.caption(text, x, y, colour)

    def caption(self, text: str, x: int, y: int, colour: Colour) -> None:
        """Write a line of text at the sheet's own pixels, kept on the sheet."""
        (width, _), _ = cv2.getTextSize(text, FONT, 0.45, 1)
        x = max(min(x, self.pixels.shape[1] - width - 3), 3)
        y = max(min(y, self.pixels.shape[0] - 5), 14)
        ground = self.pixels[max(y - 12, 0) : y + 4, max(x - 2, 0) : x + width + 2]
        ground[:] = ground // 4
        cv2.putText(self.pixels, text, (x, y), FONT, 0.45, colour, 1, cv2.LINE_AA)


def crop(image: Bgr, area_px: tuple[int, int, int, int], zoom: int = 1) -> Bgr:
    """Return a magnified copy of part of a frame: (x, y, width, height) px, black where it leaves the frame."""
    frame = check_bgr(image)
    x, y, width, height = area_px
    if width < 1 or height < 1 or zoom < 1:
        raise ValueError(f"nothing to crop: area {area_px}, zoom {zoom}")
    part = np.zeros((height, width, 3), dtype=np.uint8)
    x1, y1, x2, y2 = max(x, 0), max(y, 0), min(x + width, frame.shape[1]), min(y + height, frame.shape[0])
    if x2 > x1 and y2 > y1:
        part[y1 - y : y2 - y, x1 - x : x2 - x] = frame[y1:y2, x1:x2]
    size = (width * zoom, height * zoom)
    return np.asarray(cv2.resize(part, size, interpolation=cv2.INTER_NEAREST), dtype=np.uint8)


def draw_tip(white_bgr: Bgr, tip: Tip | NotFound, near_px: tuple[float, float] | None = None, zoom: int = 2) -> Bgr:
    """Return a picture of how the tip was found (or why not): edges, bisector, rims, end, and the numbers.

    near_px: where to look when there is no tip (default: the frame's middle).
    """
    image = check_bgr(white_bgr)
    centre = (tip.x_px, tip.y_px) if isinstance(tip, Tip) else near_px or (image.shape[1] / 2.0, image.shape[0] / 2.0)
    area = int(centre[0]) - 190, int(centre[1]) - 270, 280, 330
    sheet = Sheet(image, area, zoom)
    if isinstance(tip, NotFound):
        _explain(sheet, tip)
        return sheet.pixels
    _draw_needle(sheet, tip)
    lines = (
        f"tip ({tip.x_px:.2f}, {tip.y_px:.2f}) px +- {tip.sigma_px:.2f}",
        f"angle {np.degrees(tip.angle_rad):.2f} deg   score {tip.score:.2f}   edges {100 * tip.edge_support:.0f} %",
        f"marking {100 * tip.marking_contrast:.0f} %   bend {tip.bend_px:+.1f} px   sharpness {tip.sharpness:.2f}",
    )
    for row, text in enumerate(lines):
        sheet.caption(text, 6, 16 + 17 * row, INK)
    return sheet.pixels


def draw_test_points(red_bgr: Bgr, seen: Seen, tip_px: tuple[float, float], zoom: int = 5) -> Bgr:
    """Return a picture of what was taken, thrown and left undecided near the tip, each with the rule that decided.

    It is brightened: under red light alone a board is a dark sight for people.
    """
    image = np.asarray(cv2.convertScaleAbs(check_bgr(red_bgr), alpha=RED_GAIN), dtype=np.uint8)
    x, y, width, height = seen.window_px
    area = x - 6, y - 14, max(min(width, 400), 1) + 12, max(min(height, 400), 1) + 28
    sheet = Sheet(image, area, zoom)
    corners = ((x, y), (x + width - 1, y), (x + width - 1, y + height - 1), (x, y + height - 1))
    for start, end in zip(corners, corners[1:] + corners[:1], strict=True):
        sheet.line(start, end, FRAME)
    _draw_decided(sheet, seen.thrown, THROWN)
    _draw_decided(sheet, seen.undecided, UNDECIDED)
    for point in seen.taken:
        _draw_point(sheet, point, ANSWER if point is seen.nearest else USED)
    sheet.cross(tip_px, 4.0, INK)
    sheet.write("tip", (tip_px[0] + 1.0, tip_px[1] - 1.5), INK)
    if isinstance(seen.nearest, NotFound):
        _explain(sheet, seen.nearest)
        return sheet.pixels
    target = seen.nearest
    sheet.line(tip_px, (target.x_px, target.y_px), ANSWER)
    error = target.x_px - tip_px[0], target.y_px - tip_px[1]
    text = f"{target.kind} at ({target.x_px:.2f}, {target.y_px:.2f}) px +- {target.sigma_px:.2f}, "
    sheet.caption(text + f"error ({error[0]:+.2f}, {error[1]:+.2f}) px", 6, 16, ANSWER)
    return sheet.pixels


def _draw_needle(sheet: Sheet, tip: Tip) -> None:
    for number, line in enumerate(tip.edges, start=1):
        c, s = np.cos(line.angle_rad), np.sin(line.angle_rad)
        far = line.x_px - 135.0 * c, line.y_px - 135.0 * s
        sheet.line((line.x_px, line.y_px), far, USED)
        sheet.write(f"L{number}", far, USED)
    c, s = np.cos(tip.angle_rad), np.sin(tip.angle_rad)
    sheet.line((tip.x_px - 260.0 * c, tip.y_px - 260.0 * s), (tip.x_px, tip.y_px), FRAME)
    for number, rim in enumerate((tip.rim1_px, tip.rim2_px), start=1):
        half = 0.6 * tip.width_px
        sheet.line((rim[0] - half * s, rim[1] + half * c), (rim[0] + half * s, rim[1] - half * c), USED)
        sheet.write(f"rim {number}", (rim[0] + (half + 3.0) * s, rim[1] - (half + 3.0) * c), USED)
    sheet.cross(tip.intersection_px, 2.5, THROWN)
    sheet.cross((tip.x_px, tip.y_px), 6.0, ANSWER)
    sheet.write("x_e", (tip.x_px + 4.0, tip.y_px - 3.0), ANSWER)


def _draw_decided(sheet: Sheet, decided: Iterable[Decided], colour: Colour) -> None:
    for item in decided:
        seen = item.object
        at = seen.x_px, seen.y_px
        if seen.circle is not None:
            sheet.ring(at, seen.circle.radius_px, 0.87, 62.8, colour)
        else:
            sheet.cross(at, 1.5, colour)
        sheet.write(item.rule, (at[0] + 2.0, at[1] + 1.0), colour)


def _draw_point(sheet: Sheet, point: TestPoint, colour: Colour) -> None:
    sheet.ring(point.pad_px, point.radius_px, 0.87, 62.8, colour)
    if point.hole_px is not None:
        sheet.ring(point.hole_px[:2], point.hole_px[2], 0.87, 62.8, colour)
    sheet.cross((point.x_px, point.y_px), 2.0, colour)
    sheet.write(point.rule, (point.pad_px[0] + 3.0, point.pad_px[1] + 0.8 * point.radius_px), colour)


def _explain(sheet: Sheet, problem: NotFound) -> None:
    """Write the reason and the message, wrapped to the sheet's width."""
    sheet.caption(str(problem.reason), 6, 16, THROWN)
    room = max((sheet.pixels.shape[1] - 12) // 8, 10)
    words, row, y = problem.message.split(), "", 34
    for word in [*words, ""]:
        if word and len(row) + 1 + len(word) <= room:
            row = f"{row} {word}".strip()
            continue
        sheet.caption(row, 6, y, INK)
        row, y = word, y + 17
