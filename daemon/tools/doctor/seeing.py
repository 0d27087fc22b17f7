"""Examination of camera and lights: modes, controls, frame rate, exposure lock, each lamp seen in the image."""

from __future__ import annotations

import asyncio
import time
from dataclasses import dataclass

import numpy as np

from daemon.config.sections.devices import CameraSection
from daemon.tools.doctor.findings import CheckResults
from drivers.camera import Camera, Frame
from drivers.deadline import Deadline
from drivers.errors import DeviceError
from drivers.lights import Light, Lights

RATE_S, FRAME_WITHIN_S, SWITCH_WITHIN_S = 2.0, 4.0, 2.0
FRAMES, LEAST_FRAMES = 12, 5
RATE_AGREES, LOCK_AGREES, SAME_SHARE = 0.15, 0.05, 0.02
LIT_BY = 3.0
"""Grey levels by which a lamp brightens the picture at least."""
CONTROLS = {"exposure_us": "exposure_us", "gain": "gain", "focus": "focus", "white_balance_k": "white_balance_k"}
AUTOMATICS = {"auto_exposure": "exposure_us", "auto_white_balance": "white_balance_k", "auto_focus": "focus"}


@dataclass(frozen=True)
class Levels:
    """Mean grey levels of one picture."""

    blue: float
    green: float
    red: float

    @classmethod
    def of(cls, frame: Frame) -> Levels:
        """Measure a frame; every fourth pixel tells as much."""
        blue, green, red = np.asarray(frame.pixels[::4, ::4].reshape(-1, 3).mean(axis=0), dtype=float)
        return cls(float(blue), float(green), float(red))

    @property
    def mean(self) -> float:
        """All three."""
        return (self.blue + self.green + self.red) / 3


def examine_settings(findings: CheckResults, camera: Camera, section: CameraSection) -> None:
    """Compare what the camera reads back with what it was told."""
    got = camera.settings()
    size = tuple(None if got.get(name) is None else round(float(got[name] or 0)) for name in ("width_px", "height_px"))
    wanted_size = (section.width, section.height)
    findings.judge("camera mode", f"{size[0]}x{size[1]} {section.encoding}", good=size == wanted_size,
                   advice="choose a size the camera lists (v4l2-ctl --list-formats-ext)")  # fmt: skip
    for name, field in CONTROLS.items():
        wanted, value = getattr(section, field), got.get(name)
        if wanted is None:
            continue
        if value is None:
            advice = f"leave camera.{field} out of the configuration if this camera has none"
            findings.warn(f"camera {name}", "the camera has no such control", advice)
        else:
            good = abs(value - wanted) <= SAME_SHARE * abs(wanted)
            findings.judge(f"camera {name}", f"set {wanted}, reads {value:g}", good=good, otherwise="warn",
                           advice=f"choose a camera.{field} the camera takes")  # fmt: skip
    for automatic, field in AUTOMATICS.items():
        if not got.get(automatic):
            continue
        if getattr(section, field) is None:
            findings.warn(f"camera {automatic}", "on", f"set camera.{field}: what changes by itself is not calibrated")
        else:
            advice = "the camera does not let go of it: use another model or firmware"
            findings.fail(f"camera {automatic}", f"on, although camera.{field} is set", advice)


async def examine_rate(findings: CheckResults, camera: Camera) -> None:
    """Count frames by the clock and by their own time stamps."""
    before, began_s = camera.statistics(), time.monotonic()
    await asyncio.sleep(RATE_S)
    after, ended_s = camera.statistics(), time.monotonic()
    by_clock = (after.grabbed - before.grabbed) / (ended_s - began_s)
    frames = await _frames(camera, FRAMES)
    spans = np.diff([f.exposure_start_s for f in frames])
    steps = np.diff([f.sequence for f in frames])
    if len(frames) < LEAST_FRAMES or (spans <= 0).any() or (steps <= 0).any():
        found = f"{len(frames)} frames, whose times do not go forward"
        findings.fail("camera time stamps", found, "the driver's times are of no use; update the kernel or the camera")
        return
    by_stamps = float(steps.sum() / spans.sum())
    age_ms = float(np.median([f.received_s - f.exposure_start_s for f in frames])) * 1e3
    found = f"{by_clock:.1f} a second by the clock, {by_stamps:.1f} by their stamps; {age_ms:.0f} ms old on arrival"
    agree = abs(by_clock / by_stamps - 1) <= RATE_AGREES
    findings.judge("camera frame rate", found, good=agree, otherwise="warn",
                   advice="frames get lost: use a USB port of its own, or a smaller size")  # fmt: skip


async def _frames(camera: Camera, count: int) -> list[Frame]:
    frames: list[Frame] = []
    after_s = time.monotonic()
    for _ in range(count):
        frames.append(await camera.frame_after(after_s, Deadline.after(FRAME_WITHIN_S)))
        after_s = frames[-1].exposure_start_s + 1e-6
    return frames


async def examine_lights(findings: CheckResults, camera: Camera, lights: Lights) -> None:
    """Switch each lamp and see it in the picture; the same lamp again has to be as bright: the exposure is locked."""
    try:
        dark = await _lit(camera, lights, Light.OFF)
        white = await _lit(camera, lights, Light.WHITE)
        red = await _lit(camera, lights, Light.RED)
        again = await _lit(camera, lights, Light.WHITE)
    except DeviceError as exc:
        findings.fail("lights", str(exc), exc.advice)
        return
    finally:
        await lights.set(Light.OFF, Deadline.after(SWITCH_WITHIN_S))
    lamp = "check the lamp, its wire and the channel named in [lights]"
    findings.judge("white lamp", f"{dark.mean:.0f} dark, {white.mean:.0f} lit", good=white.mean >= dark.mean + LIT_BY,
                   advice=f"the picture does not brighten: {lamp}")  # fmt: skip
    redder = red.red - dark.red >= LIT_BY and red.red - dark.red > 1.5 * (red.blue - dark.blue)
    found = f"red {dark.red:.0f} dark, {red.red:.0f} lit; blue {dark.blue:.0f}, {red.blue:.0f}"
    findings.judge("red lamp", found, good=redder, advice=f"the picture does not redden: {lamp}")
    change = abs(again.mean - white.mean) / max(white.mean, 1.0)
    findings.judge("exposure lock", f"the same light twice differs by {100 * change:.1f} %", good=change <= LOCK_AGREES,
                   advice="exposure or gain is not fixed: set camera.exposure_us and camera.gain")  # fmt: skip


async def _lit(camera: Camera, lights: Lights, light: Light) -> Levels:
    await lights.set(light, Deadline.after(SWITCH_WITHIN_S))
    ready_s = time.monotonic() + lights.settle_s
    return Levels.of(await camera.frame_after(ready_s, Deadline.after(lights.settle_s + FRAME_WITHIN_S)))
