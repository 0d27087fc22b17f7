"""A page says what its record says, judges by its figures, compares with what came before, and is one safe file."""

from __future__ import annotations

import html
import json
import re
from collections.abc import Callable
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon.storage.calibration_records import (
    AlignmentLimits,
    MapLimits,
    Record,
    RotationLimits,
    SurfaceRecord,
    parse_record,
)
from daemon.tools.report.page import Number, PageVerdict, render
from daemon.tools.report.pages import ROOMS, make_page, write_page
from tests.daemon.tools.report.synthetic import (
    alignment_record,
    backlash_record,
    map_record,
    rotation_record,
    surface_record,
)

LATER: dict[str, Any] = {"made_at": "2026-05-04T07:00:00+00:00"}
MAKERS: dict[str, Callable[..., Any]] = {
    "map": map_record,
    "rotation": rotation_record,
    "surface": surface_record,
    "backlash": backlash_record,
    "alignment": alignment_record,
}
HOSTILE = "<script>alert('x')</script>\"&"


def _verdict(record: Record) -> PageVerdict:
    return ROOMS[record.what].verdict(record)  # type: ignore[no-any-return]


def _numbers(record: Record) -> tuple[Number, ...]:
    return ROOMS[record.what].numbers(record)  # type: ignore[no-any-return]


def _table(record: Record) -> dict[str, str]:
    return {number.label: number.text for number in _numbers(record)}


def _bad(record: Record) -> list[str]:
    return [number.label for number in _numbers(record) if number.bad]


@cache
def _compared(kind: str) -> str:
    """Return a page of this kind with its drift; drawn once, for drawing takes most of these tests' time."""
    return render(make_page(MAKERS[kind](**LATER), MAKERS[kind](seed=7)))


def _words(text: str) -> str:
    """Return a page's text without its tags and style."""
    bare = re.sub(r"<(style|svg).*?</\1>", " ", text, flags=re.DOTALL)
    return " ".join(html.unescape(re.sub(r"<[^>]+>", " ", bare)).split())


class _Tags(HTMLParser):
    """Collects tags, their attributes, and what is opened but never closed."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str]] = []
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [(name, value or "") for name, value in attrs]
        if tag not in ("meta", "br", "img"):
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [(name, value or "") for name, value in attrs]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def _parsed(text: str) -> _Tags:
    tags = _Tags()
    tags.feed(text)
    return tags


def test_every_kind_of_record_has_a_room() -> None:
    kinds = {model.model_fields["what"].default for model in Record.__args__}
    assert set(ROOMS) == kinds == set(MAKERS)


@pytest.mark.parametrize("kind", MAKERS)
def test_a_page_opens_with_what_was_calibrated_where_when_and_whether_it_is_good(kind: str) -> None:
    page = make_page(MAKERS[kind]())
    text = _words(render(page))
    assert f"{page.subject} of station bench-1, calibrated 2026-03-04 05:06 UTC: good {page.verdict.because}" in text


@pytest.mark.parametrize("kind", MAKERS)
def test_a_page_is_one_well_formed_file_that_fetches_nothing_and_runs_nothing(kind: str) -> None:
    text = _compared(kind)
    tags = _parsed(text)
    assert tags.open == []
    assert tags.tags.count("svg") >= 2
    assert not {"script", "link", "iframe", "object", "embed"} & set(tags.tags)
    fetched = [v for name, v in tags.attributes if name in ("src", "href", "xlink:href")]
    assert [v for v in fetched if not v.startswith(("#", "data:image/png;base64,"))] == []
    assert not [name for name, _ in tags.attributes if name.startswith("on")]
    assert "@import" not in text


@pytest.mark.parametrize("kind", MAKERS)
def test_a_page_fits_a_telephone_and_has_a_dark_side(kind: str) -> None:
    """A row of figures becomes two lines there; what a column was called stands before its value."""
    text = _compared(kind)
    tags = _parsed(text)
    assert ("name", "viewport") in tags.attributes
    assert tags.tags.count("table") == [value for name, value in tags.attributes if name == "class"].count("cards")
    assert {"before", "change"} <= {value for name, value in tags.attributes if name == "data-is"}
    assert "prefers-color-scheme: dark" in text
    assert "max-width: 46rem" in text


def test_a_rotation_in_legs_says_so() -> None:
    """Looks and time are then of more than the last job."""
    record = rotation_record()
    assert "gone on with" not in render(make_page(record))
    assert "gone on with" in render(make_page(record.model_copy(update={"legs": 2})))


@pytest.mark.parametrize("kind", MAKERS)
def test_no_two_things_on_a_page_share_an_id(kind: str) -> None:
    tags = _parsed(_compared(kind))
    ids = [value for name, value in tags.attributes if name == "id"]
    assert len(ids) == len(set(ids))


@pytest.mark.parametrize("kind", MAKERS)
def test_everything_that_an_svg_refers_to_is_on_the_page(kind: str) -> None:
    text = _compared(kind)
    ids = {value for name, value in _parsed(text).attributes if name == "id"}
    referred = set(re.findall(r"url\(#([^)]+)\)", text)) | set(re.findall(r'xlink:href="#([^"]+)"', text))
    assert referred
    assert referred <= ids


@pytest.mark.parametrize("kind", MAKERS)
def test_no_colour_of_the_light_page_is_fixed_in_a_plot(kind: str) -> None:
    text = _compared(kind)
    plots = "".join(re.findall(r"<svg.*?</svg>", text, flags=re.DOTALL))
    assert "var(--ink)" in plots
    assert not re.search(r"#(1c2330|66708a|e3e7ee|1f6f54|2f5fb3|b97a12|b3261e)", plots)


@pytest.mark.parametrize("kind", MAKERS)
def test_a_hostile_name_is_text_and_nothing_else(kind: str) -> None:
    changes: dict[str, Any] = {"station": HOSTILE, "job": HOSTILE}
    record = MAKERS[kind](**changes)
    if kind == "map":
        record = record.model_copy(update={"mark": HOSTILE})
    if kind == "rotation":
        record = record.model_copy(update={"kind": HOSTILE})
    if kind == "alignment":
        worst = record.fiducials[0].model_copy(update={"name": HOSTILE + " $a$"})
        record = record.model_copy(update={"board": HOSTILE, "fiducials": (worst, *record.fiducials[1:])})
    text = render(make_page(record, record))
    tags = _parsed(text)
    assert "script" not in tags.tags
    assert "<script" not in text
    assert f"of station {HOSTILE}, calibrated" in _words(text)
    assert ("content", HOSTILE) in tags.attributes


def test_the_figures_of_a_rotation_are_those_of_its_record() -> None:
    record = rotation_record()
    table = _table(record)
    assert table["stops used"] == "21 of 22"
    assert table["head model"] == "fourier, order 6"
    assert table["hold-out error, rms"] == f"{record.holdout_rms_um:.1f}"
    assert table["hold-out error, largest"] == f"{record.holdout_max_um:.1f}"
    assert table["left by the model, rms"] == f"{record.rms_um:.1f}"
    assert table["circle: radius"] == f"{record.circle.radius_um:.1f}"
    together = float(table["the model in force before: off at these stops, rms (thesis eq. 6.8)"])
    assert together == pytest.approx(541.7 / len(record.before) ** 0.5, abs=0.06)
    assert table["closure: first angle again at the end"] == "6.3"
    after = [float(np.hypot(landing.dx_um, landing.dy_um)) for landing in record.after]
    assert table["landings after: largest"] == f"{max(after):.1f}"
    assert f"{len(after)} of {len(after)} within 200 um (100.0 %)" in _verdict(record).because
    text = _words(render(make_page(record)))
    for label, figure in table.items():
        assert f"{label} {figure}" in text


def test_a_rotation_is_not_good_if_one_landing_missed() -> None:
    record = rotation_record()
    far = record.after[0].model_copy(update={"dx_um": 240.0, "dy_um": 0.0})
    missed = record.model_copy(update={"after": (far, *record.after[1:])})
    n, said = len(record.after), _verdict(missed)
    assert not said.good
    assert f"{n - 1} of {n} within 200 um" in said.because
    assert "farthest 240.0 um" in said.because
    assert _bad(missed) == ["landings after: largest"]
    assert f"not good {said.because}" in _words(render(make_page(missed)))


def test_a_rotation_is_not_good_if_it_predicts_badly_or_was_never_tried() -> None:
    record = rotation_record()
    assert not _verdict(record.model_copy(update={"holdout_rms_um": 61.0})).good
    untried = _verdict(record.model_copy(update={"after": ()}))
    assert not untried.good
    assert "No landing" in untried.because


def test_a_rotation_page_has_its_six_plots_and_leaves_out_what_was_not_measured() -> None:
    record = rotation_record(**LATER)
    assert [plot.title for plot in make_page(record, rotation_record()).plots] == [
        "Circle of the stops", "Residuals over θ", "First landings", "Hold-out error", "Linearity of the map",
        "Drift since the previous calibration",
    ]  # fmt: skip
    bare = record.model_copy(update={"before": (), "after": (), "sightings": ()})
    assert [plot.title for plot in make_page(bare).plots] == [
        "Circle of the stops", "Residuals over θ", "Hold-out error",
    ]  # fmt: skip


def test_a_perfect_rotation_can_be_drawn() -> None:
    record = rotation_record(outlier=False)
    still = {"residuals_um": tuple((0.0, 0.0) for _ in record.stops), "rms_um": 0.0}
    assert make_page(record.model_copy(update=still)).plots


def test_a_map_is_judged_by_what_its_fit_leaves() -> None:
    good, bad = map_record(), map_record(noise_um=22.0)
    assert _verdict(good).good
    assert not _verdict(bad).good
    assert f"leave {bad.pose_map['residual_um']:.1f} um rms (limit 15 um)" in _verdict(bad).because
    assert _bad(bad) == ["left by the fit, rms"]


def test_a_surface_page_says_planar_or_not_as_the_record_decided() -> None:
    flat, steep = surface_record(), surface_record(tilt_um=80.0)
    assert _verdict(flat).because.startswith("The surface is planar: the touches differ by")
    assert not _verdict(steep).good
    assert _verdict(steep).because.startswith("The surface is not planar")
    heights = [touch.height_um for touch in steep.touches]
    assert _table(steep)["highest touch minus lowest"] == f"{max(heights) - min(heights):.1f}"
    assert _bad(steep) == ["highest touch minus lowest"]


def test_a_hole_in_the_surface_is_shown_as_left_out() -> None:
    record = surface_record(hole_um=120.0)
    assert _table(record)["touches used"] == "11 of 12"
    assert all("left out of the fit" in plot.svg for plot in make_page(record).plots)


def test_a_level_surface_has_no_contours_and_can_be_drawn() -> None:
    record = surface_record()
    level = record.surface | {"tilt_x_um_per_mm": 0.0, "tilt_y_um_per_mm": 0.0}
    assert "everywhere" in make_page(record.model_copy(update={"surface": level})).plots[0].svg


def test_play_is_judged_against_the_approach_that_has_to_cover_it() -> None:
    assert _verdict(backlash_record(play_um=14.0, approach_um=200.0)).good
    record = backlash_record(play_um=-40.0, approach_um=35.0)
    assert not _verdict(record).good
    assert "lengthen approach_um" in _verdict(record).because
    assert _table(record)["X: play"] == f"{record.x.backlash_um:.1f}"
    assert _bad(record) == ["X: play and 3 sigma"]


def test_an_alignment_is_judged_by_its_worst_fiducial_and_its_scale() -> None:
    assert _verdict(alignment_record()).good
    far, large = alignment_record(wrong_um=90.0), alignment_record(scale=1.0026)
    assert not _verdict(far).good
    assert _bad(far) == ["FID1: left (2 views)"]
    assert not _verdict(large).good
    assert "+2600 ppm" in _verdict(large).because


JUDGED: list[tuple[Any, dict[str, float], str]] = [
    (map_record(), {"residual_um": 2.0}, "left by the fit, rms"),
    (rotation_record(), {"holdout_um": 1.0}, "hold-out error, rms"),
    (rotation_record(), {"landing_um": 3.0}, "landings after: largest"),
    (alignment_record(), {"residual_um": 1.0}, "FID1: left (2 views)"),
    (alignment_record(), {"scale_error": 0.0002}, "scale from 1"),
]
"""Good records, a limit that would have refused them, and the row that says so."""


def _with_limits(record: Any, limits: dict[str, float]) -> Any:
    return record.model_copy(update={"limits": record.limits.model_copy(update=limits)})


@pytest.mark.parametrize(("record", "limits", "row"), JUDGED)
def test_a_page_judges_by_the_limits_that_its_record_brings(record: Any, limits: dict[str, float], row: str) -> None:
    assert _verdict(record).good
    assert row not in _bad(record)
    strict = _with_limits(record, limits)
    assert not _verdict(strict).good
    assert row in _bad(strict)


def test_a_record_that_passed_wider_limits_keeps_its_verdict() -> None:
    worn = map_record(noise_um=22.0)
    assert not _verdict(worn).good
    wide = _with_limits(worn, {"residual_um": 40.0})
    assert _verdict(wide).good
    assert "(limit 40 um)" in _verdict(wide).because
    assert _bad(wide) == []


@pytest.mark.parametrize("kind", ["map", "rotation", "alignment"])
def test_a_file_from_before_limits_were_stored_is_judged_as_it_was_then(kind: str) -> None:
    record = MAKERS[kind]()
    old = record.model_dump(mode="json")
    del old["limits"]
    read = parse_record(json.dumps(old), f"{kind}.json")
    assert read == record
    assert _verdict(read) == _verdict(record)


def test_the_limits_of_older_files_never_change() -> None:
    """Should a limit of the procedures change, these stay: they judged the files that name none."""
    assert MapLimits().model_dump() == {"residual_um": 15.0, "left_share": 0.5}
    assert RotationLimits().model_dump() == {"holdout_um": 60.0, "landing_um": 200.0, "closure_um": 40.0}
    assert AlignmentLimits().model_dump() == {"residual_um": 60.0, "scale_error": 0.002, "turn_deg": 3.0}
    assert SurfaceRecord.model_fields["max_rms_um"].default == 25.0


@pytest.mark.parametrize("kind", MAKERS)
def test_the_previous_calibration_stands_beside_this_one(kind: str) -> None:
    now, before = MAKERS[kind](**LATER), MAKERS[kind](seed=7)
    text = _words(_compared(kind))
    assert f"Since 2026-03-04 05:06 UTC: {ROOMS[kind].since(now, before)}" in text
    for label, figure in _table(before).items():
        assert f"{figure}" in text, label


@pytest.mark.parametrize("kind", MAKERS)
def test_a_calibration_compared_with_itself_has_not_drifted(kind: str) -> None:
    record = MAKERS[kind]()
    figures = re.findall(r"[+-]?\d+\.\d+", ROOMS[kind].since(record, record))
    assert figures
    assert all(float(figure) == 0 for figure in figures)


def test_a_longer_head_is_told_as_drift_of_its_radius() -> None:
    longer, before = rotation_record(grown_um=25.0, outlier=False), rotation_record(outlier=False)
    assert (grown := re.search(r"radius ([+-]\d+\.\d) um", ROOMS["rotation"].since(longer, before)))
    assert float(grown[1]) == pytest.approx(25.0, abs=1.0)


def test_a_board_that_was_moved_is_told_by_how_much() -> None:
    assert "up to 37.0 um" in ROOMS["alignment"].since(alignment_record(shift_um=37.0), alignment_record())


def test_another_board_is_no_previous_alignment_and_that_is_said() -> None:
    page = make_page(alignment_record(**LATER), alignment_record(board="other"))
    assert page.earlier == ()
    assert "other, top side" in page.notes[0]
    assert page.notes[0] in _words(render(page))


def test_another_probe_is_said_to_be_what_may_have_changed() -> None:
    assert "another probe" in make_page(map_record(**LATER), map_record(probe="ffff")).notes[0]


def test_records_of_two_stations_or_kinds_are_not_compared() -> None:
    with pytest.raises(ValueError, match="bench-2"):
        make_page(map_record(), map_record(station="bench-2"))
    with pytest.raises(ValueError, match="of a rotation, this one of a map"):
        make_page(map_record(), rotation_record())


@pytest.mark.parametrize(
    "changes",
    [
        {"used": (True,)},
        {"residuals_um": ()},
        {"used": (False,) * 22},
        {"stops": (), "used": (), "residuals_um": ()},
        {"head": {"kind": "spiral"}},
        {"head": {}},
        {"made_at": "yesterday"},
    ],
)
def test_a_rotation_that_contradicts_itself_is_refused_and_nothing_is_written(
    tmp_path: Path, changes: dict[str, Any]
) -> None:
    path = tmp_path / "page.html"
    with pytest.raises(ValueError, match=r"calibrate the rotation again|ISO 8601"):
        write_page(rotation_record().model_copy(update=changes), None, path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("record", "why"),
    [
        (map_record().model_copy(update={"sightings": ()}), "calibrate the map again"),
        (map_record().model_copy(update={"pose_map": {}}), "calibrate the map again"),
        (surface_record().model_copy(update={"touches": ()}), "again"),
        (surface_record().model_copy(update={"residuals_um": (1.0,)}), "calibrate the surface again"),
        (surface_record().model_copy(update={"surface": {}}), "again"),
        (alignment_record().model_copy(update={"fiducials": ()}), "align the board again"),
    ],
)
def test_a_record_without_what_it_needs_is_refused_with_what_to_do(record: Record, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        make_page(record)


def test_play_that_was_measured_from_one_side_only_is_refused() -> None:
    record = backlash_record()
    lame = record.model_copy(update={"y": record.y.model_copy(update={"from_above_um": ()})})
    with pytest.raises(ValueError, match="Y was not measured from both sides"):
        make_page(lame)
