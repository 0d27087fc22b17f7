"""A camera that runs all the time in its own thread and hands out the first picture after an instant.

The camera's queue gives old pictures first; only a reader that never pauses sees new ones. So one thread grabs
without end, and decodes a picture only when somebody waits for one exposed late enough.
"""

import asyncio
import threading
import time
import zlib
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import structlog

from drivers.camera.contract import CameraConfig, CameraStatistics, Exposed, Frame, Pixels, Shown
from drivers.camera.jpeg import decode_jpeg, shown_anywhere
from drivers.camera.source import Grabbed, Retrieved, Settings, Source
from drivers.deadline import Deadline
from drivers.errors import CameraError, CameraTimeout, FrameLost

CLOSE_WITHIN_S = 3.0
"""Longest wait for the thread to end. A device that hangs in a system call keeps it longer, but nobody else."""
_T = TypeVar("_T")


@dataclass(slots=True, eq=False)
class _Wish:
    """Somebody waits for a picture exposed at or after `after_s`.

    exposed: who wants to know as soon as it is exposed; from then on that picture serves it and no later one.
    shown: who only shows it, and gets `Shown` instead of a frame.
    """

    after_s: float
    future: "Future[Any]"
    exposed: "Future[float] | None" = None
    shown: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class _OnItsWay:
    """One picture between its exposure and its last decoded row; see `Exposed`."""

    over_s: float
    device: str
    future: "Future[Frame]"

    async def frame(self, deadline: Deadline) -> Frame:
        """Give it, or raise FrameLost or CameraTimeout."""
        try:
            async with asyncio.timeout(deadline.remaining_s):
                return await asyncio.wrap_future(self.future)
        except TimeoutError as exc:
            raise CameraTimeout("a picture that was exposed did not arrive in time", device=self.device) from exc


class RunningCamera:
    """The common part of all cameras: newest frame after t, time-outs, opening again. Not for two event loops."""

    def __init__(self, config: CameraConfig, make_source: Callable[[], Source]) -> None:
        self.config = config
        self._make_source = make_source
        self._log = structlog.get_logger().bind(device=config.device)
        self._lock = threading.Lock()
        self._wishes: list[_Wish] = []
        self._bound: list[_Wish] = []
        """Wishes that the picture which is just fetched and decoded has to serve."""
        self._settings: Settings = {}
        self._statistics = CameraStatistics()
        self._trouble: str | None = None
        self._outage = False
        self._last_crc: dict[str, int] = {}
        """Of the last picture that was decoded, and of the last that was only shown."""
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    # ------------------------------------------------------------------ called from the event loop
    async def open(self, deadline: Deadline) -> None:
        """Open the camera and start grabbing; raise CameraError when it does not open by the deadline."""
        if self._thread is not None:
            raise CameraError("is open already", device=self.config.device)
        # One for each thread: a thread that was left behind must not come to life again.
        self._stop = threading.Event()
        opened: Future[None] = Future()
        thread = threading.Thread(target=self._run, args=(opened, self._stop), name="camera", daemon=True)
        try:
            thread.start()
        except RuntimeError as exc:
            raise CameraError(f"its thread does not start: {exc}", device=self.config.device) from exc
        self._thread = thread
        try:
            async with asyncio.timeout(deadline.remaining_s):
                await asyncio.wrap_future(opened)
        except TimeoutError as exc:
            await self.close()
            raise CameraTimeout("did not open in time", device=self.config.device) from exc
        except BaseException:
            await self.close()
            raise

    async def frame_after(self, t_s: float, deadline: Deadline) -> Frame:
        """Give the first frame whose exposure began at or after `t_s` (CLOCK_MONOTONIC, seconds).

        Raises CameraTimeout, which says what is wrong with the camera when that is known. May be called by
        several tasks at a time; a cancelled call leaves nothing behind.
        """
        wish = _Wish(t_s, Future())
        frame: Frame = await self._wait(wish, wish.future, deadline)
        return frame

    async def shown_after(self, t_s: float, deadline: Deadline) -> Shown:
        """Give the first picture whose exposure began at or after `t_s`, for people to look at; raise as `frame_after`.

        Where nobody else wants it, it is not decoded: that is most of what a picture costs.
        """
        wish = _Wish(t_s, Future(), shown=True)
        shown: Shown = await self._wait(wish, wish.future, deadline)
        return shown

    async def exposed_after(self, t_s: float, deadline: Deadline) -> Exposed:
        """Give the first picture whose exposure began at or after `t_s` as soon as it is exposed.

        It is on its way then: lamps may be switched while it is fetched and decoded. Raises as `frame_after`.
        """
        exposed: Future[float] = Future()
        wish = _Wish(t_s, Future(), exposed)
        return _OnItsWay(await self._wait(wish, exposed, deadline), self.config.device, wish.future)

    async def _wait(self, wish: _Wish, awaited: "Future[_T]", deadline: Deadline) -> _T:
        """Register a wish and wait for one of its futures; whatever ends that leaves no wish behind."""
        if self._thread is None:
            raise CameraError("is not open", device=self.config.device, advice="Reset: it is opened again then.")
        with self._lock:
            self._wishes.append(wish)
        try:
            async with asyncio.timeout(deadline.remaining_s):
                return await asyncio.wrap_future(awaited)
        except TimeoutError as exc:
            trouble = f": {self._trouble}" if self._trouble else ""
            text = f"no picture exposed after the wanted instant came in time{trouble}"
            raise CameraTimeout(text, device=self.config.device) from exc
        finally:
            with self._lock:
                if wish in self._wishes:
                    self._wishes.remove(wish)

    @property
    def waiting(self) -> int:
        """How many callers wait for a picture."""
        return len(self._wishes)

    @property
    def trouble(self) -> str | None:
        """What is wrong with the pictures at present, None if nothing is known."""
        return self._trouble

    def settings(self) -> Mapping[str, float | None]:
        """Give what the camera read back when it was last opened."""
        return dict(self._settings)

    def statistics(self) -> CameraStatistics:
        """Give counters."""
        return self._statistics

    async def close(self) -> None:
        """Stop the thread and close the camera; waiting callers get CameraError. Safe to call twice.

        A thread that is held by a hanging device is left behind, and closes the camera when it is let go.
        """
        thread, self._thread = self._thread, None
        if thread is None:
            return
        self._stop.set()
        # The thread ends after at most one grab time-out; it must not hold the event loop
        await asyncio.get_running_loop().run_in_executor(None, thread.join, CLOSE_WITHIN_S)
        if thread.is_alive():
            self._log.error("camera.hangs", cause=f"not closed within {CLOSE_WITHIN_S:g} s", advice="Plug it in again.")
            self._refuse_all(CameraError("was closed", device=self.config.device))

    # ------------------------------------------------------------------ the thread
    def _run(self, opened: "Future[None]", stop: threading.Event) -> None:
        """Grab until told to stop; open again with back-off after a failure, whatever it was."""
        backoff_s = self.config.backoff_s
        while not stop.is_set():
            worked, exc = self._one_opening(opened, stop)
            if exc is not None and not opened.done():
                if opened.set_running_or_notify_cancel():
                    opened.set_exception(exc)
                return
            if opened.cancelled():
                return  # the opener gave up
            if exc is not None:
                self._note(exc)
            if worked:
                backoff_s = self.config.backoff_s
            stop.wait(backoff_s)
            backoff_s = min(2 * backoff_s, self.config.backoff_max_s)
        if stop is self._stop:
            self._refuse_all(CameraError("was closed", device=self.config.device))

    def _one_opening(self, opened: "Future[None]", stop: threading.Event) -> tuple[bool, CameraError | None]:
        """Open the camera, grab until told to stop or until something fails, and close it.

        Returns whether a picture came, and what failed. Never raises: a library's error, or one in this module, is
        trouble with the camera like any other; a thread that died of it would leave a camera that looks open.
        """
        before = self._statistics.grabbed
        source: Source | None = None
        trouble: CameraError | None = None
        try:
            source = self._make_source()
            self._settings = source.open()
            if self._tell_opened(opened):
                self._grab_until_trouble(source, stop)
        except Exception as exc:  # noqa: BLE001  # see above
            trouble = self._as_trouble(exc)
        try:
            if source is not None:
                source.close()
        except Exception as exc:  # noqa: BLE001  # see above
            trouble = trouble or self._as_trouble(exc)
        return self._statistics.grabbed > before, trouble

    def _tell_opened(self, opened: "Future[None]") -> bool:
        """Answer the opener, the first time; return False if it gave up."""
        if opened.done():
            if not opened.cancelled():
                self._count(reopened=1)
            return not opened.cancelled()
        if not opened.set_running_or_notify_cancel():
            return False
        opened.set_result(None)
        return True

    def _as_trouble(self, exc: Exception) -> CameraError:
        """Return the camera's error that stands for whatever was raised in the thread."""
        if isinstance(exc, CameraError):
            return exc
        level = self._log.debug if self._outage else self._log.error
        level("camera.unexpected", exc_info=exc)
        trouble = CameraError(f"{type(exc).__name__}: {exc}", device=self.config.device)
        trouble.__cause__ = exc
        return trouble

    def _grab_until_trouble(self, source: Source, stop: threading.Event) -> None:
        last: int | None = None
        while not stop.is_set():
            grabbed = source.grab()
            if grabbed is None:
                self._count(timeouts=1)
                text = f"no picture within {self.config.frame_timeout_s:g} s"
                raise CameraError(text, device=self.config.device)
            self._count(grabbed=1, missed=0 if last is None else max(0, grabbed.sequence - last - 1))
            last = grabbed.sequence
            if self._outage:
                self._outage = False
                self._log.info("camera.back")
            if self._wanted(grabbed):
                self._deliver(source, grabbed)

    def _wanted(self, grabbed: Grabbed) -> bool:
        with self._lock:
            wanted = any(wish.after_s <= grabbed.exposure_start_s for wish in self._wishes)
            late = bool(self._wishes) and not wanted
        if late:
            self._count(late=1)
        return wanted

    def _deliver(self, source: Source, grabbed: Grabbed) -> None:
        """Fetch a picture that is exposed, decode it unless it is only shown, and give it to who waits for it."""
        bound = self._bind(grabbed)
        picture: Frame | Shown | None = None
        try:
            picture = (
                self._whole(source, grabbed) if bound or self._is_judged(grabbed) else self._shown(source, grabbed)
            )
        finally:
            self._serve(bound, picture)

    def _is_judged(self, grabbed: Grabbed) -> bool:
        """Tell whether somebody wants more of a picture than to show it."""
        with self._lock:
            return any(not wish.shown and wish.after_s <= grabbed.exposure_start_s for wish in self._wishes)

    def _bind(self, grabbed: Grabbed) -> list[_Wish]:
        """Tell who waits for an exposure that it is over: this picture is theirs, whole or not."""
        over_s = time.monotonic()
        with self._lock:
            bound = [w for w in self._wishes if w.exposed and w.after_s <= grabbed.exposure_start_s]
            self._wishes = [wish for wish in self._wishes if wish not in bound]
            self._bound += bound
        for wish in bound:
            if wish.exposed and wish.exposed.set_running_or_notify_cancel():
                wish.exposed.set_result(over_s)
        return bound

    def _whole(self, source: Source, grabbed: Grabbed) -> Frame | None:
        """Return the picture; None where it is torn, or the one before once more."""
        got = source.retrieve()
        pixels = self._decoded(got)
        if got is None or pixels is None:
            self._is_torn()
            return None
        # Noise is everywhere, so every eighth row tells as much as the whole, in an eighth of the time
        if self._is_frozen("pixels", pixels[::8].tobytes()):
            return None
        self._trouble = None
        pixels.setflags(write=False)
        jpeg = shown_anywhere(got.jpeg) if got.jpeg is not None else None
        return Frame(pixels, grabbed.exposure_start_s, grabbed.exposure_s, grabbed.sequence, got.received_s, jpeg)

    def _decoded(self, got: Retrieved | None) -> Pixels | None:
        """Return the pixels of what came; None where there are none."""
        if got is None or got.jpeg is None:
            return None if got is None else got.pixels
        return decode_jpeg(got.jpeg, self.config.width_px, self.config.height_px)

    def _shown(self, source: Source, grabbed: Grabbed) -> Shown | None:
        """Return the picture for people to look at; None where it is torn, or the one before once more."""
        got = source.retrieve()
        jpeg = shown_anywhere(got.jpeg) if got is not None and got.jpeg is not None else None
        pixels = self._decoded(got) if jpeg is None else None
        told = jpeg if pixels is None else pixels[::8].tobytes()
        if told is None:
            self._is_torn()
            return None
        if self._is_frozen("shown", told):
            return None
        self._trouble = None
        return Shown(grabbed.exposure_start_s, jpeg, pixels)

    def _is_torn(self) -> None:
        self._count(undecodable=1)
        self._trouble = "pictures arrive torn"

    def _serve(self, bound: list[_Wish], picture: Frame | Shown | None) -> None:
        """Give a picture to those that are bound to it and to all that it is late enough for; None: it was lost."""
        with self._lock:
            served = [wish for wish in bound if wish in self._bound]  # a closed camera has refused the others
            self._bound = [wish for wish in self._bound if wish not in bound]
            if picture is not None:
                served += [wish for wish in self._wishes if _serves(picture, wish)]
                self._wishes = [wish for wish in self._wishes if wish not in served]
        for wish in served:
            if not wish.future.set_running_or_notify_cancel():
                continue
            if picture is None:
                text = f"a picture that was exposed did not arrive whole: {self._trouble or 'the camera failed'}"
                wish.future.set_exception(FrameLost(text, device=self.config.device))
            else:
                self._count(delivered=1)
                wish.future.set_result(_as_shown(picture) if wish.shown else picture)

    def _is_frozen(self, kind: str, data: bytes) -> bool:
        """Tell whether a picture is the one of its kind before once more, and count it then."""
        last, now = self._last_crc.get(kind), zlib.crc32(data)
        self._last_crc[kind] = now
        if last != now or not self.config.refuse_identical:
            return False
        self._count(identical=1)
        self._trouble = "camera is frozen: the same picture again and again"
        return True

    def _note(self, exc: CameraError) -> None:
        """Log one error per outage, which lasts until a picture comes again; the rest is detail."""
        level = self._log.debug if self._outage else self._log.error
        self._outage, self._trouble = True, exc.message
        level("camera.lost", cause=exc.message)

    def _refuse_all(self, exc: CameraError) -> None:
        with self._lock:
            wishes, self._wishes, self._bound = [*self._wishes, *self._bound], [], []
        for wish in wishes:
            for future in (wish.exposed, wish.future):
                if future is not None and not future.done() and future.set_running_or_notify_cancel():
                    future.set_exception(exc)

    def _count(self, **more: int) -> None:
        old = self._statistics
        self._statistics = replace(old, **{name: getattr(old, name) + by for name, by in more.items()})


def _serves(picture: Frame | Shown, wish: _Wish) -> bool:
    """Tell whether a picture is what somebody waits for; who waits for an exposure is bound to one before."""
    enough = wish.shown or isinstance(picture, Frame)
    return enough and wish.exposed is None and wish.after_s <= picture.exposure_start_s


def _as_shown(picture: Frame | Shown) -> Shown:
    return picture if isinstance(picture, Shown) else Shown(picture.exposure_start_s, picture.jpeg, picture.pixels)
