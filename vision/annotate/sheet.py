"""Drawing surface: a magnified piece of an image, drawn on in image pixels, that remembers what is taken up.

Green is what was used, yellow the answer, orange what was refused, magenta what could not be decided, blue where was
looked.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.annotate.labels import Label, Spot, arrange
from vision.core import Bgr, Gray, check_bgr

Colour = tuple[int, int, int]
USED: Colour = (80, 220, 80)
ANSWER: Colour = (0, 230, 255)
THROWN: Colour = (60, 150, 255)
UNDECIDED: Colour = (255, 80, 255)
FRAME: Colour = (230, 170, 90)
INK: Colour = (255, 255, 255)
SHADOW: Colour = (20, 20, 20)
SHIFT = 4
"""Sub-pixel positions are drawn with this many binary places."""
FONT, TEXT_SCALE = cv2.FONT_HERSHEY_SIMPLEX, 0.46
LINE_WORTH, INSIDE_WORTH = 255, 60
"""How much a label should spare a place: a drawn line, and the ground inside a ring."""
BRIGHT_LEVEL, LEAST_GAIN, MOST_GAIN = 215.0, 1.25, 8.0
"""The bright parts of a piece are drawn at this level, so that dark images can be read by people too."""
SCALE_LENGTHS_PX = (200, 100, 50, 20, 10, 5, 2, 1)
LONGEST_SCALE = 150.0
SHORT_LEADER = 5.0
"""A label nearer than this to what it names needs no line to it."""


class Sheet:
    """Hold a piece of an image, `zoom` sheet pixels to an image pixel, and the labels that are still to be placed."""

    def __init__(self, image: Bgr, area_px: tuple[int, int, int, int], zoom: float) -> None:
        self.x_px, self.y_px, self.zoom = area_px[0], area_px[1], zoom
        self.piece = image
        self.pixels = magnified(image, zoom)
        self.busy: Gray = np.zeros(self.pixels.shape[:2], dtype=np.uint8)
        self.labels: list[Label] = []

    def place(self, x_px: float, y_px: float) -> tuple[int, int]:
        """Return the sheet's place of an image point, in 1/16 px (a pixel's centre is the middle of its square)."""
        one = 1 << SHIFT
        x = ((x_px - self.x_px + 0.5) * self.zoom - 0.5) * one
        y = ((y_px - self.y_px + 0.5) * self.zoom - 0.5) * one
        return int(np.clip(np.nan_to_num(x), -1e6, 1e6)), int(np.clip(np.nan_to_num(y), -1e6, 1e6))

    def line(self, start: tuple[float, float], end: tuple[float, float], colour: Colour, thickness: int = 1) -> None:
        """Draw a line between image points."""
        a, b = self.place(*start), self.place(*end)
        cv2.line(self.pixels, a, b, colour, thickness, cv2.LINE_AA, SHIFT)
        cv2.line(self.busy, a, b, (LINE_WORTH,), thickness + 1, cv2.LINE_8, SHIFT)

    def dashes(self, start: tuple[float, float], end: tuple[float, float], colour: Colour) -> None:
        """Draw a dashed line between image points: where something would be, if it went on."""
        span = float(np.hypot(end[0] - start[0], end[1] - start[1])) * self.zoom
        if not np.isfinite(span):
            return
        at = np.linspace(0.0, 1.0, 2 * int(np.clip(span / 12.0, 1, 60)) + 2)
        for a, b in zip(at[:-1:2], at[1::2], strict=True):
            ends = [tuple(s + t * (e - s) for s, e in zip(start, end, strict=True)) for t in (float(a), float(b))]
            self.line((ends[0][0], ends[0][1]), (ends[1][0], ends[1][1]), colour)

    def outline(self, points: NDArray[np.float64], colour: Colour, *, closed: bool = True) -> None:
        """Draw a polygon of image points (N, 2)."""
        placed = np.array([self.place(float(x), float(y)) for x, y in points], dtype=np.int32)
        cv2.polylines(self.pixels, [placed], closed, colour, 1, cv2.LINE_AA, SHIFT)
        cv2.polylines(self.busy, [placed], closed, (LINE_WORTH,), 2, cv2.LINE_8, SHIFT)

    def fill(self, points: NDArray[np.float64]) -> None:
        """Ask labels to spare the inside of a polygon of image points (N, 2)."""
        placed = np.array([self.place(float(x), float(y)) for x, y in points], dtype=np.int32)
        inside = np.zeros_like(self.busy)
        cv2.fillPoly(inside, [placed], (INSIDE_WORTH,), cv2.LINE_8, SHIFT)
        np.maximum(self.busy, inside, out=self.busy)

    def cross(
        self, at: tuple[float, float], size_px: float, colour: Colour, *, gap_px: float = 0.0, turn_deg: float = 0.0
    ) -> None:
        """Draw a cross at an image point; a gap leaves the point itself free, 45 degrees make it an x."""
        ways = [(float(np.cos(way)), float(np.sin(way))) for way in np.radians(turn_deg + np.arange(0.0, 360.0, 90.0))]
        for ink, thickness in ((SHADOW, 3), (colour, 1)):
            for c, s in ways:
                start, end = (at[0] + gap_px * c, at[1] + gap_px * s), (at[0] + size_px * c, at[1] + size_px * s)
                self.line(start, end, ink, thickness)

    def ring(
        self,
        at: tuple[float, float],
        axes_px: tuple[float, float],
        turn_deg: float,
        colour: Colour,
        *,
        thing: bool = True,
    ) -> None:
        """Draw an ellipse: its semi-axes along and across the direction `turn_deg`; labels spare what is in a thing."""
        scale = self.zoom * (1 << SHIFT)
        axes = max(int(axes_px[0] * scale), 1), max(int(axes_px[1] * scale), 1)
        place = self.place(*at)
        if thing:
            inside = np.zeros_like(self.busy)
            cv2.ellipse(inside, place, axes, turn_deg, 0.0, 360.0, (INSIDE_WORTH,), -1, cv2.LINE_8, SHIFT)
            np.maximum(self.busy, inside, out=self.busy)
        cv2.ellipse(self.pixels, place, axes, turn_deg, 0.0, 360.0, colour, 1, cv2.LINE_AA, SHIFT)
        cv2.ellipse(self.busy, place, axes, turn_deg, 0.0, 360.0, (LINE_WORTH,), 2, cv2.LINE_8, SHIFT)

    def label(self, text: str, at: tuple[float, float], colour: Colour, *, clear_px: float = 0.0) -> None:
        """Ask for a label `clear_px` or more away from an image point; those asked for first choose first."""
        x, y = self.place(*at)
        spot = Spot(x / (1 << SHIFT), y / (1 << SHIFT), clear_px * self.zoom)
        height, width = self.busy.shape
        if 0 <= spot.x < width and 0 <= spot.y < height:
            self.labels.append(Label(text, spot, colour, text_size(text)))

    def scale_bar(self) -> None:
        """Draw a bar of a round number of image pixels into the lower right corner."""
        length = next((n for n in SCALE_LENGTHS_PX if n * self.zoom <= LONGEST_SCALE), SCALE_LENGTHS_PX[-1])
        span, (height, width) = round(length * self.zoom), self.busy.shape
        x, y = width - 14 - span, height - 12
        shade(self.pixels, (x - 8, y - 24, span + 16, 32))
        for tick in (x, x + span):
            cv2.line(self.pixels, (tick, y - 4), (tick, y + 4), INK, 1)
        cv2.line(self.pixels, (x, y), (x + span, y), INK, 1)
        text = f"{length} px"
        write(self.pixels, text, x + (span - text_size(text)[0]) // 2, y - 8, INK)
        self.reserve((x - 8, y - 24, span + 16, 32))

    def inset(self, image: Bgr, title: str) -> None:
        """Lay another image into the lower left corner."""
        height, width = image.shape[:2]
        x, y = 8, self.pixels.shape[0] - height - 8
        if y < 0 or x + width > self.pixels.shape[1]:
            return
        self.pixels[y : y + height, x : x + width] = image
        cv2.rectangle(self.pixels, (x - 1, y - 1), (x + width, y + height), INK, 1)
        shade(self.pixels, (x, y, text_size(title)[0] + 10, 19))
        write(self.pixels, title, x + 5, y + 14, INK)
        self.reserve((x - 4, y - 4, width + 8, height + 8))

    def reserve(self, box: tuple[int, int, int, int]) -> None:
        """Keep labels out of a box (x, y, width, height) of the sheet."""
        x, y, width, height = box
        self.busy[max(y, 0) : y + height, max(x, 0) : x + width] = LINE_WORTH

    def finish(self) -> Bgr:
        """Place the labels where they hide least, each with a line to what it names, and return the image."""
        for label, (box, line) in zip(self.labels, arrange(self.labels, self.busy), strict=True):
            x, y, _, height = box
            if np.hypot(*(line[1] - line[0])) > SHORT_LEADER:
                start, end = ((round(float(point[0])), round(float(point[1]))) for point in line)
                cv2.line(self.pixels, start, end, SHADOW, 3, cv2.LINE_AA)
                cv2.line(self.pixels, start, end, label.colour, 1, cv2.LINE_AA)
            shade(self.pixels, box)
            write(self.pixels, label.text, x + 3, y + height - 5, label.colour)
        self.labels = []
        return self.pixels


def crop(image: Bgr, area_px: tuple[int, int, int, int], zoom: int = 1) -> Bgr:
    """Return a magnified copy of part of an image: (x, y, width, height) px, black where it leaves the image."""
    whole = check_bgr(image)
    x, y, width, height = area_px
    if width < 1 or height < 1 or zoom < 1:
        raise ValueError(f"nothing to crop: area {area_px}, zoom {zoom}")
    part = np.zeros((height, width, 3), dtype=np.uint8)
    x1, y1, x2, y2 = max(x, 0), max(y, 0), min(x + width, whole.shape[1]), min(y + height, whole.shape[0])
    if x2 > x1 and y2 > y1:
        part[y1 - y : y2 - y, x1 - x : x2 - x] = whole[y1:y2, x1:x2]
    return magnified(part, zoom)


def magnified(image: Bgr, zoom: float) -> Bgr:
    """Return a copy of an image at another size; by a whole number, its pixels stay squares: they were measured."""
    size = max(round(image.shape[1] * zoom), 1), max(round(image.shape[0] * zoom), 1)
    how = cv2.INTER_AREA if zoom < 1.0 else cv2.INTER_NEAREST if zoom == int(zoom) else cv2.INTER_LINEAR
    return np.array(cv2.resize(image, size, interpolation=how), dtype=np.uint8)


def brightened(image: Bgr) -> tuple[Bgr, str]:
    """Return an image whose bright parts can be seen by people, and in words what was done to it, if anything."""
    gain = float(np.clip(BRIGHT_LEVEL / max(float(np.percentile(image, 99.9)), 1.0), 1.0, MOST_GAIN))
    if gain < LEAST_GAIN:
        return image, ""
    return np.asarray(cv2.convertScaleAbs(image, alpha=gain), dtype=np.uint8), f", brightened {gain:.1f} times"


def text_size(text: str, scale: float = TEXT_SCALE, font: int = FONT) -> tuple[int, int]:
    """Return width and height of the box a line of text needs, sheet pixels."""
    (width, _), _ = cv2.getTextSize(text, font, scale, 1)
    return int(width) + 6, round(38.0 * scale)


def write(pixels: Bgr, text: str, x: int, y: int, colour: Colour, scale: float = TEXT_SCALE, font: int = FONT) -> None:
    """Write a line of text whose baseline begins at the sheet's own (x, y)."""
    cv2.putText(pixels, text, (x, y), font, scale, colour, 1, cv2.LINE_AA)


def shade(pixels: Bgr, box: tuple[int, int, int, int]) -> None:
    """Darken a box (x, y, width, height), so that what is written there reads on any ground."""
    x, y, width, height = box
    ground = pixels[max(y, 0) : max(y + height, 0), max(x, 0) : max(x + width, 0)]
    ground[:] = ground // 5
