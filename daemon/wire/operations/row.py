"""Row of an operation: its request, its reply, who may ask it, how long it may take, and its examples."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum, auto
from functools import cached_property
from typing import Any, get_args

from daemon.domain.roles import Role
from daemon.wire.replies import Reply
from daemon.wire.requests import ImmediateRequest, JobRequest, Request


class DefaultDeadline(Enum):
    """How long an operation may take where its request has no `deadline_ms`."""

    NONE = auto()
    """Answered whatever its deadline says."""
    SHORT = auto()
    """A moment: a request whose deadline has passed is refused, and nothing else is timed."""
    JOB = auto()
    """`servo.job_timeout_s`."""
    LENGTHY_JOB = auto()
    """`servo.calibration_timeout_s`, for jobs of minutes."""
    RUN = auto()
    """A day: a run is as long as its plan, and each point of it has the time of a job."""


_OF_JOBS = frozenset({DefaultDeadline.JOB, DefaultDeadline.LENGTHY_JOB, DefaultDeadline.RUN})


@dataclass(frozen=True, kw_only=True, eq=False)
class Operation:
    """One operation; raise ValueError where its fields contradict each other."""

    request: type[Request]
    """A subclass of `JobRequest` makes the operation a job, one of `ImmediateRequest` has it answered on the spot."""
    reply: type[Reply]
    least_role: Role
    deadline: DefaultDeadline
    outcomes: tuple[str, ...] = ()
    """How its job can end well, in the words of `JobResult.outcome`; empty where it is no job."""
    asks_only: bool = False
    """Whether it changes nothing although not everybody may ask; such a one is no order, and not written down."""
    example: Mapping[str, Any] = field(default_factory=dict)
    """The own fields of an example request."""
    example_reply: Mapping[str, Any]
    """What an example reply says beside the envelope."""

    def __post_init__(self) -> None:
        """Check that request, deadline and outcomes tell the same of it."""
        if "op" not in self.request.model_fields:
            raise ValueError(f"{self.request.__name__} names no operation: it has no field `op`")
        if self.is_job != (self.deadline in _OF_JOBS):
            raise ValueError(f"{self.op}: a job, and nothing else, has the default deadline of a job")
        if self.is_job != bool(self.outcomes):
            raise ValueError(f"{self.op}: a job, and nothing else, has outcomes")
        if issubclass(self.request, ImmediateRequest) and self.deadline is not DefaultDeadline.NONE:
            raise ValueError(f"{self.op}: what is answered on the spot has no deadline")

    @cached_property
    def op(self) -> str:
        """Its name, as requests say it: the one literal of the field `op`."""
        (name,) = get_args(self.request.model_fields["op"].annotation)
        return str(name)

    @property
    def is_job(self) -> bool:
        """Whether it starts work on the station."""
        return issubclass(self.request, JobRequest)

    @property
    def is_order(self) -> bool:
        """Whether who sent it is written down. What is answered on the spot, many times a second, is not."""
        return self.least_role != "observe" and not self.asks_only and not issubclass(self.request, ImmediateRequest)

    @property
    def is_lengthy(self) -> bool:
        """Whether it is a job of minutes."""
        return self.deadline is DefaultDeadline.LENGTHY_JOB

    @property
    def sentence(self) -> str:
        """What it does, for the page: the docstring of its request."""
        return inspect.getdoc(self.request) or ""
