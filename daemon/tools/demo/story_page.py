"""Page of a demonstration: its figures in one line, the map by verdict, pictures of what was recovered, every point."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jinja2 import ChoiceLoader, FileSystemLoader

from daemon.domain.point_test import Cause, PointRecord, PointVerdict, Rung
from daemon.tools.demo.story import Judged, Story
from daemon.tools.report.page import environment, write_text
from daemon.tools.report.run_facts import STYLES, RunReport, Tested, pictures_of
from daemon.tools.report.run_map import draw_map
from daemon.tools.report.run_page import write_run

RUN_FOLDER = "run"
LANDINGS = ("before-landing", "after-landing")
"""Names of the pictures that show where the needle would come down: at the first look, and at the last."""


@dataclass(frozen=True)
class Shown:
    """A point of which there is more to tell than its line: words and pictures, each with its caption."""

    tested: Tested
    judged: Judged
    words: str
    pictures: tuple[tuple[Path, str], ...]


def write_story(story: Story, report: RunReport, out: Path, speed: float) -> Path:
    """Write the page and the run's own report into a folder; return the page's path. OSError as it comes."""
    write_run(report, out / RUN_FOLDER)
    tested = {(one.test.point, one.test.method): one for one in report.tested}
    pairs = [(tested[one.record.point, one.record.method], one) for one in story.points]
    made = environment()
    made.loader = ChoiceLoader([FileSystemLoader(Path(__file__).parent), made.loader])  # type: ignore[list-item]
    shown = sorted(_shown(pairs, out), key=lambda one: _rank(one.judged.record))
    text = made.get_template("story.html.j2").render(
        story=story, report=report, sentence=story.sentence(speed), map=draw_map(report), styles=STYLES.values(),
        shown=shown, judged={one.test.point: judged for one, judged in pairs}, speed=speed, run_folder=RUN_FOLDER,
    )  # fmt: skip
    path = out / "index.html"
    write_text(path, text)
    return path


def _shown(pairs: list[tuple[Tested, Judged]], out: Path) -> Iterator[Shown]:
    for tested, judged in pairs:
        record = judged.record
        if record.verdict is PointVerdict.PASS_FIRST and not judged.wrong:
            continue
        files = {path.stem: path.resolve() for path in pictures_of(record)}
        captions = zip(LANDINGS, _captions(tested), strict=True)
        pictures = [(files[name].relative_to(out.resolve()), said) for name, said in captions if name in files]
        yield Shown(tested, judged, _words(tested, judged), tuple(pictures))


def _rank(record: PointRecord) -> tuple[int, float]:
    """Return a key by which what the eye cured comes first, the farthest miss of all."""
    return (0 if record.recovered_by is Rung.LOOK else 1), -(record.error_um or 0.0)


def _captions(tested: Tested) -> tuple[str, str]:
    record = tested.record
    if record is not None and record.recovered_by is Rung.LOOK and record.cause is Cause.MISPLACED:
        return f"First touch: {tested.first or 'nothing'} read. Here the needle had come down.", (
            f"After the correction: {tested.last} read."
        )
    return "After the first touch: here the needle had come down.", "The last look."


def _words(tested: Tested, judged: Judged) -> str:
    """Say what happened at a point."""
    record = tested.record
    if record is None:
        return ""
    first, last = tested.first or "nothing", tested.last or "nothing"
    if record.recovered_by is not None:
        return f"The first touch read {first}; recovered {judged.cured}, then {last}."
    if record.verdict is PointVerdict.OPEN_CONFIRMED:
        proofs = sum(reading.proof is True for reading in record.readings)
        return f"Open: in {proofs} presses the needle was proved to stand on metal, and nothing came through the net."
    return f"First {first}, in the end {last}. {record.reason}"


def told_as_json(story: Story, sentence: str) -> dict[str, Any]:
    """Return the same for programs."""
    points = [
        {**one.record.model_dump(mode="json"), "sound": one.sound, "truth": one.truth, "wrong": one.wrong}
        for one in story.points
    ]
    return {"good": story.good, "sentence": sentence, "scratches": story.scratches, "dents": story.dents,
            "ended": story.ended, "why": story.why, "odd": story.odd, "points": points}  # fmt: skip
