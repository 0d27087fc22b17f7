"""Verdicts that several checks of a probe come to, each with what to do about it."""

from __future__ import annotations

from vision.core import NotFound, Reason

BLURRED_ADVICE = "clean the lens, check its focus, or wait longer for the head to settle"
OTHER_ADVICE = "is another needle mounted, or is the background too busy here? Look from another place, or teach again"


def blurred(sharpness: float, least: float) -> NotFound:
    """Return the verdict on an image that is not sharp."""
    return NotFound(
        Reason.BLURRED, f"the picture is blurred (sharpness {sharpness:.3f}, {least:.3f} is needed): {BLURRED_ADVICE}"
    )


def no_marking(fact: str) -> NotFound:
    """Return the verdict on a marking that is not there or not as taught."""
    return NotFound(Reason.NO_MARKING, f"{fact}: clean the needle or renew the marking, then teach again")


def wrong(fact: str) -> NotFound:
    """Return the verdict on a probe that does not look like the taught one."""
    return NotFound(Reason.WRONG_NEEDLE, f"{fact}: {OTHER_ADVICE}")
