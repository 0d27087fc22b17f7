"""Operations on what is kept: results newest first, who gave which order, pictures, and all of it in one stream."""

from __future__ import annotations

import base64
import hashlib
from typing import Any, Final, Literal

from pydantic import Field

from daemon.domain.results import JobResult, Told
from daemon.domain.roles import Role
from daemon.wire.example_parts import AT, RESULT
from daemon.wire.limits import MAX_SEQ
from daemon.wire.operations.row import DefaultDeadline, Operation
from daemon.wire.replies import Reply
from daemon.wire.requests import JobId, Name, Request, Whole


class History(Request):
    """Look back over results, newest first: all, or those of an operation, point, board or outcome."""

    op: Literal["history"]
    before: Whole | None = Field(
        default=None, ge=0, le=MAX_SEQ, description="only results of a lower seq: the last seq of the page before"
    )
    limit: Whole = Field(default=50, ge=1, le=500)
    of: Name | None = Field(default=None, description="operation, such as correct")
    test_point: Name | None = None
    board_id: Name | None = Field(default=None, description="as the request named the board")
    outcome: Name | None = Field(default=None, description="such as corrected or failed")


class Audit(Request):
    """Ask who gave which order, newest first; what only asks is not written down."""

    op: Literal["audit"]
    before: Whole | None = Field(default=None, ge=0, le=MAX_SEQ, description="only entries of a lower number")
    limit: Whole = Field(default=50, ge=1, le=500)


class Note(Request):
    """Write down what a person did at a page or program of one's own, such as a login; `audit` tells it."""

    op: Literal["note"]
    by: str = Field(min_length=1, max_length=64, description="who did it")
    what: Literal["login", "logout", "refused"]
    detail: str = Field(default="", max_length=200)


class Pictures(Request):
    """Ask which pictures of a job are kept."""

    op: Literal["pictures"]
    id: JobId


class Picture(Request):
    """Ask for one kept picture of a job."""

    op: Literal["picture"]
    id: JobId
    which: Name = Field(description="as `pictures` lists it, such as before-red")


class Records(Request):
    """Fetch everything that is kept, oldest first and under one count: for who carries it away, such as `uplink`.

    A record is a result, a point's verdict, a touch, a report, an alert, an order, a measurement of the station
    itself, or a run over a board. What changes later comes again: the newest of one `kind` and `n` (or `id`) holds.
    Ask with the `journal` of the last page and its last number plus one: nothing is passed over, however the file came
    back.
    """

    op: Literal["records"]
    since: Whole = Field(default=0, ge=0, le=MAX_SEQ, description="first number wanted")
    journal: str | None = Field(
        default=None, max_length=64, description="what `since` is a number of; null: of whichever journal has it"
    )
    limit: Whole = Field(default=100, ge=1, le=500)
    kinds: list[Name] | None = Field(
        default=None, min_length=1, max_length=20, description="only of these; null: of all. Go on after `through_seq`"
    )


class Lost(Told):
    """Numbers that were trimmed before anybody fetched them."""

    from_seq: int
    to_seq: int = Field(description="included")


class JournalEnd(Told):
    """A journal that is written no longer."""

    journal: str
    seq: int = Field(description="its last number")


class NumberedFacts(Told):
    """One record."""

    seq: int = Field(description="counts records, over all journals of a station; no event's number")
    kind: str = Field(description="result, point, touch, report, alert, order, measurement or run")
    at: str | None = Field(description="UTC, ISO 8601, by the station's clock; null where `body` is")
    body: dict[str, Any] | None = Field(description="what happened; null where it was trimmed, or cannot be read")
    circumstances: dict[str, Any] = Field(
        description="in force when it was written: program, configuration (its hash), board, board_side, "
        "board_revision, needle, tip (the taught probe), calibrated (calibration -> when it was made)"
    )


class RecordsReply(Reply):
    """Records of one journal; those of the next one come with the next page."""

    station: str
    journal: str = Field(description="id of what one opening of the file wrote; a number counts together with it")
    first_seq: int = Field(description="the first number of this journal")
    previous: JournalEnd | None = Field(description="the one before it; null for the first one of the file")
    lost: Lost | None = Field(description="numbers of this journal that were wanted and are gone")
    records: list[NumberedFacts] = Field(description="oldest first; without `kinds` without a gap")
    through_seq: int = Field(
        description="the last number that was looked at; while it is below next_seq - 1, there is more to ask for"
    )
    oldest_seq: int = Field(description="the oldest number that is kept, of any journal")
    next_seq: int = Field(description="the number the next record will have")


class PastResult(JobResult):
    """A result, and the board it was made on."""

    board_id: str | None = Field(default=None, description="as the request named it")


class HistoryReply(Reply):
    """Results, newest first."""

    results: list[PastResult]
    more: bool = Field(description="there are older ones")


class AuditEntry(Told):
    """One order."""

    n: int = Field(description="counts orders")
    at: str = Field(description="UTC, ISO 8601")
    client: str = Field(description="name of its key; without CURVE, of its connection")
    role: Role
    by: str | None = Field(description="the person, as the client says; null where it does not")
    op: str
    fields: dict[str, Any] = Field(description="what was asked, as far as it was said")
    outcome: str | None = Field(
        description="how the job ended, taken (nobody waited for its end), done, or the name of the error; null while "
        "it is open, or if the daemon was stopped in it"
    )


class AuditReply(Reply):
    """Orders, newest first."""

    entries: list[AuditEntry]
    more: bool = Field(description="there are older ones")


class NoteReply(Reply):
    """It was written down."""


class PicturesReply(Reply):
    """Which pictures are kept; none where the job kept none, or is unknown, or made room for newer ones."""

    id: str
    pictures: list[str] = Field(
        description="before or after, and what it shows: the frame in white or red light as it was, or what was found "
        "in it: tip, cross, pads, board"
    )
    sha256: dict[str, str] = Field(
        default={}, description="picture -> SHA-256 of its JPEG, hexadecimal: what one has of it already"
    )


class PictureReply(Reply):
    """One picture."""

    id: str
    which: str
    jpeg: str = Field(description="base64")
    sha256: str = Field(default="", description="of the JPEG, hexadecimal: by it who keeps many finds it again")


AnyRecord = History | Audit | Note | Pictures | Picture | Records
"""Every request of this module, for the type checker; in the order of the rows."""

PICTURE_SHA256: Final = hashlib.sha256(base64.b64decode("/9j/4AAQSkZJRg==")).hexdigest()
"""Of the picture in the examples."""
ROWS: Final = (
    Operation(
        request=History,
        reply=HistoryReply,
        least_role="observe",
        deadline=DefaultDeadline.SHORT,
        example={"test_point": "TP7", "limit": 20},
        example_reply={"results": [RESULT | {"board_id": "SN-0017"}], "more": True},
    ),
    Operation(
        request=Audit,
        reply=AuditReply,
        least_role="maintain",
        deadline=DefaultDeadline.SHORT,
        asks_only=True,
        example={"limit": 20},
        example_reply={
            "entries": [{"n": 812, "at": AT, "client": "page-maintain", "role": "maintain", "by": "M. Weber",
                         "op": "home", "fields": {"id": "home-1"}, "outcome": "homed"}], "more": False,
        },
    ),
    Operation(
        request=Note,
        reply=NoteReply,
        least_role="operate",
        deadline=DefaultDeadline.SHORT,
        example={"by": "M. Weber", "what": "login", "detail": "127.0.0.1"},
        example_reply={},
    ),
    Operation(
        request=Pictures,
        reply=PicturesReply,
        least_role="observe",
        deadline=DefaultDeadline.SHORT,
        example={"id": "board17-TP7-1"},
        example_reply={"id": "board17-TP7-1", "pictures": ["before-red"],
                       "sha256": {"before-red": PICTURE_SHA256}},
    ),
    Operation(
        request=Picture,
        reply=PictureReply,
        least_role="observe",
        deadline=DefaultDeadline.SHORT,
        example={"id": "board17-TP7-1", "which": "before-red"},
        example_reply={"id": "board17-TP7-1", "which": "before-red", "jpeg": "/9j/4AAQSkZJRg==",
                       "sha256": PICTURE_SHA256},
    ),
    Operation(
        request=Records,
        reply=RecordsReply,
        least_role="observe",
        deadline=DefaultDeadline.SHORT,
        example={"since": 90211, "journal": "5f0c2a52c1f04d0e8f3f6f7a4f0f7c11", "limit": 100},
        example_reply={
            "station": "station-1", "journal": "5f0c2a52c1f04d0e8f3f6f7a4f0f7c11", "first_seq": 88120,
            "previous": {"journal": "0b7c9d9f6f2e4d1c8a55b0f3a1d9e722", "seq": 88119}, "lost": None,
            "records": [
                {"seq": 90211, "kind": "report", "at": AT,
                 "body": {"n": 318, "job": "board17-TP7-1", "retest": "pass", "touches": 12},
                 "circumstances": {"program": "0.1.0", "configuration": "77d0c5d0a5b1e0f2", "board": "demo",
                                   "board_side": "top", "board_revision": "0c5f0d1b9a7e4c33", "needle": "N-0042",
                                   "tip": "9e107d9d372bb682", "calibrated": {"map": AT}}},
            ],
            "through_seq": 90211, "oldest_seq": 1, "next_seq": 90212,
        },
    ),
)  # fmt: skip
"""One row per operation, in the order of the page."""
