from dataclasses import replace

import pytest

from sim_hw.camera.controls import CONTROLS, Controls, Taken
from sim_hw.camera.queue import FrameQueue
from tests.sim_hw.scene_double import FakeHead

TAKEN = Taken(exposure_s=0.02, gain=1.0, balance=(1.0, 1.0, 1.0), focus_px=0.0)
WHITE, RED, DARK = FakeHead(), FakeHead(white=0.0, red=1.0), FakeHead(white=0.0)


def _queue(buffers: int = 4, watched: list[float] | None = None) -> FrameQueue:
    def watch(start_s: float, _exposure_s: float) -> tuple[FakeHead, ...]:
        if watched is not None:
            watched.append(start_s)
        return (WHITE,)

    return FrameQueue(buffers, 0.0, lambda: 0.1, lambda _t_s: TAKEN, watch)


def test_nothing_is_there_before_the_first_frame_was_exposed_and_read_out() -> None:
    queue = _queue()
    assert queue.dequeue(0.031) is None
    assert queue.next_event_s() == pytest.approx(0.032)
    frame = queue.dequeue(0.033)
    assert frame is not None
    assert (frame.sequence, frame.start_s) == (0, 0.0)


def test_a_reader_that_keeps_up_gets_every_frame() -> None:
    queue = _queue()
    frames = [queue.dequeue(0.1 * k + 0.05) for k in range(30)]
    assert [frame.sequence for frame in frames if frame is not None] == list(range(30))


def test_a_reader_that_paused_gets_old_frames_first_and_a_gap_after_them() -> None:
    queue = _queue(buffers=4)
    stale = [queue.dequeue(5.0 + 0.001 * k) for k in range(4)]
    assert [frame.sequence for frame in stale if frame is not None] == [0, 1, 2, 3]
    # the buffers given back meanwhile fill with frames that began after the pause
    fresh = queue.dequeue(5.2)
    assert fresh is not None
    assert fresh.start_s == pytest.approx(5.0, abs=0.11)
    assert fresh.sequence == round(fresh.start_s / 0.1)


def test_the_held_buffer_is_not_filled_again_before_it_is_given_back() -> None:
    queue = _queue(buffers=1)
    held = queue.dequeue(0.05)
    queue.advance(0.95)
    assert queue.held is held
    again = queue.dequeue(0.96)
    assert again is None  # only now a buffer is free
    later = queue.dequeue(1.05)
    assert later is not None
    assert later.sequence == 10


def test_a_long_pause_is_passed_over_and_only_filled_buffers_were_watched() -> None:
    watched: list[float] = []
    queue = _queue(buffers=2, watched=watched)
    assert queue.dequeue(0.2) is not None
    queue.advance(86_400.0)
    assert len(watched) == 2
    assert queue.dequeue(86_400.1) is not None
    assert queue.dequeue(86_400.5) is not None
    frame = queue.dequeue(86_401.0)
    assert frame is not None
    assert frame.start_s == pytest.approx(86_400.3, abs=0.4)
    assert frame.sequence == pytest.approx(frame.start_s / 0.1, abs=1.0)


def test_a_long_exposure_stretches_the_period() -> None:
    slow = replace(TAKEN, exposure_s=0.25)
    queue = FrameQueue(10, 0.0, lambda: 0.1, lambda _t_s: slow, lambda _s, _e: (WHITE,))
    queue.advance(1.1)
    starts = []
    while (frame := queue.dequeue(1.1)) is not None:
        starts.append(frame.start_s)
    assert starts == pytest.approx([0.0, 0.25, 0.5, 0.75])


@pytest.mark.parametrize(
    ("name", "asked", "taken"),
    [
        ("exposure_us", 20_049, 20_000),
        ("exposure_us", -5, 100),
        ("exposure_us", 10**9, 100_000),
        ("gain", 3.6, 4),
        ("focus", 123, 125),
        ("white_balance_k", 9000, 6500),
        ("auto_exposure", 7, 1),
    ],
)
def test_a_control_takes_the_nearest_value_it_can(name: str, asked: float, taken: int) -> None:
    controls = Controls()
    assert controls.set(name, asked) == taken
    assert controls.listing()[name]["value"] == taken


def test_an_unknown_control_is_refused() -> None:
    with pytest.raises(KeyError):
        Controls().set("zoom", 1)


def _manual(controls: Controls) -> Controls:
    for name in ("auto_exposure", "auto_white_balance", "auto_focus"):
        controls.set(name, 0)
    return controls


def test_with_the_automatics_off_frames_are_taken_as_set() -> None:
    controls = _manual(Controls())
    controls.set("exposure_us", 5000)
    controls.set("gain", 64)
    for head in (WHITE, DARK, RED):
        assert controls.expose(head) == Taken(0.005, 2.0, (1.0, 1.0, 1.0), 0.0)


def test_automatic_exposure_drifts_after_each_switch_of_the_light() -> None:
    controls = Controls()
    lit = [controls.expose(WHITE).exposure_s for _ in range(30)]
    assert lit[-1] == pytest.approx(0.020, rel=0.05)
    dark = [controls.expose(DARK).exposure_s for _ in range(30)]
    assert dark[0] < dark[5] < dark[-1]
    assert dark[-1] == pytest.approx(0.060, rel=0.02)
    assert controls.expose(WHITE).exposure_s > 0.03


def test_a_value_set_while_its_automatic_is_on_counts_once_it_is_off() -> None:
    controls = Controls()
    controls.set("exposure_us", 5000)
    assert controls.expose(WHITE).exposure_s != 0.005
    controls.set("auto_exposure", 0)
    assert controls.expose(WHITE).exposure_s == 0.005


def test_focus_and_white_balance_change_the_picture() -> None:
    controls = _manual(Controls())
    controls.set("focus", CONTROLS["focus"].maximum)
    controls.set("white_balance_k", 3000)
    taken = controls.expose(WHITE)
    assert taken.focus_px > 1.0
    assert taken.balance[0] > 1.0 > taken.balance[2]
