import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.bench.vision import __main__ as command
from tests.bench.vision import campaign, crb, figures, peers_tip, window
from tests.bench.vision.methods import OURS, methods, missing_peers
from tests.bench.vision.scenes import Artist, Name, artists, draw, plan, split


@pytest.mark.parametrize("radius", [5.0, 18.0, 40.0])
@pytest.mark.parametrize("blur", [0.7, 1.0, 2.0])
def test_the_closed_bound_and_the_fisher_information_agree_on_a_disc(radius: float, blur: float) -> None:
    disc = crb.Disc(50.3, 49.8, radius, 150.0, 50.0, blur_px=blur)
    sigma = np.sqrt(np.diag(crb.covariance(disc, 3.0, crb.PAD)))
    assert sigma[:2] == pytest.approx(crb.disc_sigma_px(3.0, 100.0, blur, radius), rel=1e-3)


def test_the_two_bounds_agree_on_an_annulus_whose_hole_shares_its_centre() -> None:
    disc = crb.Disc(50.3, 49.8, 20.0, 150.0, 50.0, hole_x=50.3, hole_y=49.8, hole_px=8.0, hole_level=30.0)
    rows, columns = np.mgrid[20:80, 20:80]
    x, y = columns.ravel().astype(float), rows.ravel().astype(float)
    step = 1e-4
    more, less = (replace(disc, x=disc.x + s, hole_x=disc.hole_x + s) for s in (step, -step))
    slope = (crb.picture(more, x, y) - crb.picture(less, x, y)) / (2 * step)
    sigma = 3.0 / np.sqrt(np.sum(slope**2))
    assert sigma == pytest.approx(crb.annulus_sigma_px(3.0, 1.0, ((20.0, 100.0), (8.0, 120.0))), rel=1e-3)


def test_unknown_form_and_hole_never_lower_the_bound() -> None:
    disc = crb.Disc(50.3, 49.8, 18.0, 150.0, 50.0, 0.87, 1.1)
    known = crb.covariance(disc, 4.0, crb.PAD)
    unknown = crb.covariance(disc, 4.0, (*crb.PAD, *crb.FORM))
    assert np.all(np.diag(unknown)[:5] >= np.diag(known) * (1 - 1e-9))
    assert crb.bound_px(disc, 8.0, 1.0) > crb.bound_px(disc, 4.0, 1.0) > 0.0
    hole = replace(disc, hole_x=50.3, hole_y=49.8, hole_px=4.0, hole_level=50.0)
    assert crb.bound_px(hole, 4.0, 1.0) > crb.bound_px(disc, 4.0, 1.0)


@pytest.mark.parametrize("artist", artists("both"), ids=lambda artist: artist.name)
@pytest.mark.parametrize("task", ["tip", "pads", "disc", "control"])
def test_a_scene_is_drawn_again_from_its_name(artist: Artist, task: str) -> None:
    name = plan(artist, task, 3, 5)[0]
    one, two = draw(artist, name), draw(artist, name)
    frame = "red_bgr" if task in {"pads", "disc"} else "white_bgr"
    assert np.array_equal(getattr(one, frame), getattr(two, frame))
    assert getattr(one, frame).shape == (1200, 1600, 3)
    assert one.truth_px == two.truth_px
    other = draw(artist, replace(name, seed=name.seed + 100))
    assert not np.array_equal(getattr(one, frame), getattr(other, frame))


@pytest.mark.parametrize("artist", artists("both"), ids=lambda artist: artist.name)
def test_a_pads_plan_holds_every_kind_hidden_ones_and_empty_scenes(artist: Artist) -> None:
    names = plan(artist, "pads", 200, 1)
    kinds = {name.kind for name in names}
    assert set(artist.pad_kinds()) | set(artist.empty_kinds()) <= kinds
    assert sum(split(name.kind)[0] in {split(k)[0] for k in artist.empty_kinds()} for name in names) == 20
    hidden = [name for name in names if "hidden" in split(name.kind)[1]]
    scene = draw(artist, hidden[0])
    assert 0.0 < scene.hidden <= 1 / 3 + 1e-9
    assert len({name.seed for name in names}) == len(names)


def drawn(kind: str, seed: int = 3) -> list[campaign.Record]:
    return campaign.judge(Name("pads", "first", kind, seed))


def test_every_method_answers_on_an_easy_site_and_its_record_holds_the_error() -> None:
    records = drawn("site without hole")
    assert [record.method for record in records] == list(methods("pads"))
    assert {record.outcome for record in records} == {"found"}
    assert all(record.error_px < 3.0 and record.ms > 0 for record in records)
    assert figures.line(OURS, records[:1]).rms_px == pytest.approx(records[0].error_px)


def test_silence_on_a_bare_board_is_quiet_and_an_answer_there_is_wrong() -> None:
    records = drawn("bare board")
    assert {record.outcome for record in records} <= {"quiet", "wrong"}
    scene = draw(artists("first")[0], Name("pads", "first", "bare board", 3))
    wrong = campaign.record_of(Name("pads", "first", "bare board", 3), scene, OURS, (430.0, 620.0), "x", 1.0)
    assert wrong.outcome == "wrong"


def test_a_pick_more_than_3_px_off_is_wrong_and_no_answer_is_missed() -> None:
    name = Name("pads", "first", "site without hole", 3)
    scene = draw(artists("first")[0], name)
    x, y = scene.truth_px
    outcomes = [campaign.record_of(name, scene, OURS, at, "", 1.0).outcome for at in ((x + 2.9, y), (x + 3.1, y), None)]
    assert outcomes == ["found", "wrong", "missed"]


def test_a_pad_is_one_to_the_peers_and_flat_ground_is_none() -> None:
    scene = draw(artists("first")[0], Name("pads", "first", "site without hole", 3))
    seen = window.window_of(scene)
    at = scene.truth_px[0] - seen.corner[0], scene.truth_px[1] - seen.corner[1]
    assert window.is_pad(seen, window.Circle(*at, scene.radius_px))
    assert not window.is_pad(seen, window.Circle(*at, scene.radius_px - 5.0))
    assert window.choose(seen, [window.Circle(*at, scene.radius_px)]) == pytest.approx(scene.truth_px)
    assert window.choose(seen, [window.Circle(12.0, 12.0, 6.0)]) is None


def test_a_tip_peer_makes_no_error_on_the_picture_it_was_taught() -> None:
    scene = draw(artists("first")[0], Name("tip", "first", "needle", 1))
    taught = replace(scene, white_bgr=scene.kit.golden_bgr, truth_px=scene.kit.tip_px)
    for name, find in peers_tip.PEERS.items():
        assert find(taught) == pytest.approx(scene.kit.tip_px, abs=1e-6), name


def record(**changes: object) -> campaign.Record:
    base = campaign.Record(
        "pads", "first", "site", 1, False, False, False, 0.0, 0.0, OURS, "found", 0.03, 0.0, 2.0, "", 0.02
    )
    return replace(base, **changes)


def test_the_verdict_says_reached_missed_and_not_measured() -> None:
    good = figures.verdicts([record(seed=i) for i in range(300)])
    by_target = {verdict.target: verdict.reached for verdict in good}
    assert by_target["target, whole, clean: rms at most 0.05 px"] is True
    assert by_target["target, needle over up to a third: rms at most 0.2 px"] is None
    assert by_target["wrong pad: none (3 px), empty scenes included"] is True
    bad = figures.verdicts([record(dx_px=0.2), record(outcome="wrong", empty=True, dx_px=float("nan"))])
    by_target = {verdict.target: verdict.reached for verdict in bad}
    assert by_target["target, whole, clean: rms at most 0.05 px"] is False
    assert by_target["wrong pad: none (3 px), empty scenes included"] is False


def test_the_worst_scenes_begin_with_wrong_picks_and_name_misses_and_large_errors() -> None:
    records = [record(seed=i, dx_px=i / 100) for i in range(20)]
    records += [record(seed=90, outcome="wrong", dx_px=9.0)]
    records += [record(seed=100 + i, outcome="missed", dx_px=float("nan")) for i in range(20)]
    worst = figures.worst(records, 10)
    assert [item.seed for item in worst] == [90, 100, 101, 102, 103, 19, 18, 17, 16, 15]


def test_the_command_prints_a_verdict_and_writes_the_records(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    path = tmp_path / "new" / "records.csv"
    assert command.main(["disc", "--scenes", "3", "--artist", "first", "--csv", str(path)]) == 0
    printed = capsys.readouterr().out
    assert "Verdict" in printed
    assert "cv2.SimpleBlobDetector" in printed
    with path.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 3 * len(methods("disc"))
    assert {row["method"] for row in rows} == set(methods("disc"))
    for peer in missing_peers():
        assert f"Not measured: {peer}" in printed


def test_the_plots_are_written(tmp_path: Path) -> None:
    from tests.bench.vision import plots

    records = [record(seed=i, dx_px=i / 100) for i in range(20)]
    records += [record(task="disc", noise=noise, bound_px=0.01) for noise in (2.0, 4.0, 8.0)]
    made = plots.draw_all(tmp_path / "plots", records)
    assert {path.name for path in made} >= {"pads_errors.png", "pads_kinds.png", "pads_misses.png", "disc_crb.png"}
    assert all(path.stat().st_size > 5000 for path in made)
