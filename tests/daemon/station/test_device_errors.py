"""An error that was dealt with holds nothing any more."""

from __future__ import annotations

import gc
import weakref

from daemon.domain.errors import Fault, FaultCode
from daemon.station.device_errors import as_fault, forget_frames
from drivers.errors import LinkError


class _Picture:
    """Stands for megabytes."""


def _fail(watched: list[weakref.ref[_Picture]]) -> None:
    picture = _Picture()
    watched.append(weakref.ref(picture))
    try:
        deeper = _Picture()
        watched.append(weakref.ref(deeper))
        raise LinkError("gone", device="bus")
    except LinkError as exc:
        raise Fault(FaultCode.LINK_LOST, f"lost, with {picture}") from exc


def _job(watched: list[weakref.ref[_Picture]]) -> Fault:
    """Keep the fault as a job does: its traceback leads to this frame, and this frame to it."""
    try:
        _fail(watched)
    except Fault as exc:
        fault = as_fault(exc)
        forget_frames(exc)
    return fault


def test_what_the_frames_of_an_error_held_is_free_at_once() -> None:
    watched: list[weakref.ref[_Picture]] = []
    gc.disable()
    try:
        fault = _job(watched)
        assert [ref() for ref in watched] == [None, None]
    finally:
        gc.enable()
    assert fault.kind is FaultCode.LINK_LOST
    assert isinstance(fault.__cause__, LinkError)


def test_groups_are_gone_through() -> None:
    watched: list[weakref.ref[_Picture]] = []
    try:
        _fail(watched)
    except Fault as exc:
        group = ExceptionGroup("both", [exc])
    gc.disable()
    try:
        forget_frames(group)
        assert [ref() for ref in watched] == [None, None]
    finally:
        gc.enable()
