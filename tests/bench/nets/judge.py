"""Judgement of a campaign: its bounds, what was reached, and how sure that is."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from tests.bench.nets.bounds import at_least, at_most
from tests.bench.nets.records import Record, Station, Visit
from tests.bench.nets.single import (
    FASTEST_UM_S,
    FORCE_SHARE,
    curable,
    first_open,
    force_is_off,
    strokes_off,
    violations,
    wrong_verdict,
)

RECOVERED, NOT_MADE, OFF_PER_MISPLACED = 0.95, 0.01, 1.0
EACH = 10
"""Of so many boards that are tested unattended, one is cut short."""
LIFE_TOUCHES = 8
"""Most touches of a pad over all visits of its board."""
NOTHING = "nothing measured"
PROPERTIES = (
    "S1 sideways while pressed", "S2 force", "S2 floor", "S2 speed", "S3 pressed after the end",
    "S6 not up after the end", "S7 budget", "S8 pressed again unseen", "S9 wrong verdict",
    "S10 touched after its verdict", "S11 lowered with a closed sense",
)  # fmt: skip


@dataclass(frozen=True)
class Row:
    """One bound. `reached` is None where nothing could tell, or where it is only told."""

    bound: str
    measured: str
    sure: str
    """What is 95 % sure of it."""
    reached: bool | None


def split(records: Iterable[Record]) -> tuple[list[Visit], dict[int, Station]]:
    """Tell points and stations apart; stations by their seed."""
    listed = list(records)
    return [r for r in listed if isinstance(r, Visit)], {r.seed: r for r in listed if isinstance(r, Station)}


def judge(tested: Sequence[Visit], stations: dict[int, Station], asked: int, boards: int | None = None) -> list[Row]:
    """Hold a campaign against its bounds; `asked` is the number of points that should have been tested."""
    ended = [one for one in tested if not one.killed]
    return [
        *_complete(ended, stations, asked), *_boards(stations, boards), *_verdicts(ended), *_recovery(ended),
        *_contact(ended), *_safety(tested, stations),
    ]  # fmt: skip


def passed(rows: Sequence[Row]) -> bool:
    """Tell whether no bound was missed."""
    return all(row.reached is not False for row in rows)


def wrong(tested: Sequence[Visit], stations: dict[int, Station]) -> list[tuple[Visit, list[str]]]:
    """Return the points with anything wrong, and what."""
    known = ((one, violations(one, _station(one, stations))) for one in tested)
    return [(one, names) for one, names in known if names]


def counts(tested: Sequence[Visit]) -> Counter[str]:
    """Count the verdicts."""
    return Counter(one.verdict for one in tested)


def _complete(tested: Sequence[Visit], stations: dict[int, Station], asked: int) -> list[Row]:
    broken = [station for station in stations.values() if station.broken is not None]
    answered = sum(not one.verdict.startswith("error:") for one in tested)
    return [
        Row(f"{asked} points tested", f"{len(tested)}", "", len(tested) >= asked),
        Row("every station set up and alive", f"{len(stations) - len(broken)} of {len(stations)}", "", not broken),
        Row("every point has a verdict", f"{answered} of {len(tested)}", "", answered == len(tested) > 0),
    ]


def _boards(stations: dict[int, Station], boards: int | None) -> list[Row]:
    if boards is None:
        return []
    tested, kills = (sum(getattr(one, name) for one in stations.values()) for name in ("boards", "kills"))
    return [Row(f"{boards} boards tested, the daemon killed in each tenth", f"{tested}, killed in {kills}", "",
                tested >= boards and kills >= boards // EACH)]  # fmt: skip


def _none_of(bound: str, bad: int, of: int) -> Row:
    if not of:
        return Row(bound, NOTHING, "", None)
    return Row(bound, f"{bad} of {of}", f"at most {100 * at_most(bad, of):.3f} %", bad == 0)


def _verdicts(tested: Sequence[Visit]) -> list[Row]:
    sound = [one for one in tested if one.sound]
    broken = [one for one in tested if not one.sound]
    said = [one for one in tested if one.passed]
    accused = [one for one in tested if one.verdict == "open_confirmed"]
    through = sum((wrong_verdict(one) or "").startswith(("pass through", "pass without")) for one in said)
    failed = sum(one.verdict == "fail" for one in sound)
    return [
        _none_of("0 open_confirmed on a sound net", sum(one.sound for one in accused), len(sound)),
        _none_of("0 pass on a broken net", sum(one.passed for one in broken), len(broken)),
        _none_of("0 pass through a neighbour or without metal", through, len(said)),
        Row("fail on a sound net (told)", f"{failed} of {len(sound)}", _upper(failed, len(sound)), None),
        Row(
            "broken nets accused (told)",
            f"{len(accused) - sum(one.sound for one in accused)} of {len(broken)}",
            "",
            None,
        ),
    ]


def _recovery(tested: Sequence[Visit]) -> list[Row]:
    opens = [one for one in tested if first_open(one) is not None]
    curables = [one for one in opens if curable(one)]
    recovered = sum(one.passed for one in curables)
    misplaced = [one for one in opens if first_open(one) == "misplaced"]
    off = sum(strokes_off(one) for one in misplaced)
    bound = f"recoverable nets recovered: at least {100 * RECOVERED:.0f} %"
    if curables:
        share = recovered / len(curables)
        others = len(opens) - len(curables)
        measured = f"{recovered} of {len(curables)} ({100 * share:.1f} %), {others} more with a stubborn film"
        rows = [Row(bound, measured, f"at least {100 * at_least(recovered, len(curables)):.1f} %", share >= RECOVERED)]
    else:
        rows = [Row(bound, NOTHING, "", None)]
    per = off / len(misplaced) if misplaced else 0.0
    off_row = f"{off} at {len(misplaced)} points ({per:.2f} each)" if misplaced else NOTHING
    rows.append(Row("presses off the metal: at most 1 for each misplaced point", off_row, "",
                    per <= OFF_PER_MISPLACED if misplaced else None))  # fmt: skip
    return rows


def _contact(tested: Sequence[Visit]) -> list[Row]:
    not_made = sum(one.verdict == "contact_not_made" for one in tested)
    untested = sum(one.verdict == "not_tested" for one in tested)
    strokes = [stroke for one in tested for stroke in one.happened.strokes]
    fastest = max((stroke.speed_um_s for stroke in strokes), default=None)
    told = [one for one in tested if one.said_force_n and one.happened.on_board]
    off = sum(force_is_off(one) for one in told)
    of = len(tested)
    return [
        Row(f"contact_not_made: at most {100 * NOT_MADE:.0f} %", f"{not_made} of {of}" if of else NOTHING,
            _upper(not_made, of), not_made / of <= NOT_MADE if of else None),
        Row("not_tested (told)", f"{untested} of {of}", "", None),
        Row(f"contact speed: at most {FASTEST_UM_S / 1e3:g} mm/s",
            NOTHING if fastest is None else f"fastest {fastest / 1e3:.2f} mm/s", "",
            None if fastest is None else fastest <= FASTEST_UM_S),
        _none_of(f"force within {100 * FORCE_SHARE:.0f} % of what is said", off, len(told)),
    ]  # fmt: skip


def _safety(tested: Sequence[Visit], stations: dict[int, Station]) -> list[Row]:
    found = Counter(name for _, names in wrong(tested, stations) for name in names)
    rows = [_none_of(f"0 {name}", found[name], len(tested)) for name in PROPERTIES]
    rows.append(_none_of("0 S8 pads touched unseen in a later test", *_unseen_again(tested)))
    rows.append(_none_of(f"0 S7 pads touched more than {LIFE_TOUCHES} times in their life", *_worn_out(tested)))
    return rows


def _unseen_again(tested: Sequence[Visit]) -> tuple[int, int]:
    """Return how many tests began with an unseen touch of a pad that an earlier one had touched, and of how many."""
    touched: set[tuple[str, str]] = set()
    again = unseen = 0
    for one in tested:
        strokes = one.happened.on_board
        if strokes and (one.board_id, one.point) in touched:
            again += 1
            unseen += not strokes[0].seen
        if strokes:
            touched.add((one.board_id, one.point))
    return unseen, again


def _worn_out(tested: Sequence[Visit]) -> tuple[int, int]:
    """Return how many pads were touched too often over all visits, by the log, and how many there are."""
    touches: Counter[tuple[str, str]] = Counter()
    for one in tested:
        touches[one.board_id, one.point] += sum(stroke.first for stroke in one.happened.on_board)
    return sum(count > LIFE_TOUCHES for count in touches.values()), len(touches)


def _upper(bad: int, of: int) -> str:
    return f"at most {100 * at_most(bad, of):.2f} %" if of else ""


def _station(one: Visit, stations: dict[int, Station]) -> Station:
    return stations.get(one.seed, Station(one.seed, one.board))
