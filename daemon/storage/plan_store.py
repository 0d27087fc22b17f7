"""Store of test plans: each version of a plan is a file of its own, replaced whole, and changed only by approval."""

from __future__ import annotations

import re
from pathlib import Path

from pydantic import ValidationError

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.plan import PLAN_NAME, Approval, Plan, StoredPlan
from daemon.platform.atomic_file import replace_whole
from daemon.platform.clock import utc_now
from daemon.platform.plain_file import read_small

MOST_BYTES = 16_000_000
"""5000 tests with all that may be said of them."""
_VERSION = re.compile(r"(\d{4,})\.json")


def plans_folder(data_dir: Path) -> Path:
    """Return where the plans of a station are kept."""
    return data_dir / "plans"


class PlanStore:
    """Plans below a folder, `NAME/0001.json` and so on. Every method does I/O."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def store(self, plan: Plan, by: str) -> StoredPlan:
        """Keep a plan as a new version; one that says the same as the newest is that version. Raises OSError."""
        versions = self._versions(plan.name)
        if versions:
            newest = self.get(plan.name, versions[-1])
            if newest.plan == plan:
                return newest
        stored = StoredPlan(
            version=(versions[-1] if versions else 0) + 1, plan=plan, hash=plan.hash, stored_at=utc_now(), stored_by=by
        )
        self._write(stored)
        return stored

    def approve(self, name: str, version: int | None, by: str) -> StoredPlan:
        """Write down that a person took a version, the newest if none is named, for good."""
        stored = self.get(name, version)
        approved = stored.model_copy(update={"approved": Approval(by=by, at=utc_now())})
        self._write(approved)
        return approved

    def get(self, name: str, version: int | None = None) -> StoredPlan:
        """Return a version of a plan, the newest if none is named; raise `Fault` where there is none."""
        versions = self._versions(name)
        if not versions or (version is not None and version not in versions):
            known = f"versions {versions[0]}..{versions[-1]} of it are" if versions else "no plan of that name is"
            wanted = name if version is None else f"{name}, version {version}"
            raise Fault(FaultCode.UNKNOWN_PLAN, f"plan {wanted} is not stored; {known} stored"[:200], plan=name)
        path = self._path(name, version or versions[-1])
        try:
            stored = StoredPlan.model_validate_json(read_small(path, MOST_BYTES))
        except (OSError, ValidationError, ValueError) as exc:
            raise _damaged(path, exc) from exc
        if stored.hash != stored.plan.hash:
            raise _damaged(path, ValueError("its fingerprint is not that of its content"))
        return stored

    def newest(self) -> tuple[list[StoredPlan], list[Fault]]:
        """Return the newest version of every plan, by name, and why others cannot be read."""
        found, damaged = [], []
        for folder in sorted(self._folder.iterdir()) if self._folder.is_dir() else ():
            if not self._versions(folder.name):
                continue
            try:
                found.append(self.get(folder.name))
            except Fault as fault:
                damaged.append(fault)
        return found, damaged

    def _versions(self, name: str) -> list[int]:
        """Return the versions of a plan, oldest first."""
        folder = self._folder / name
        if not re.fullmatch(PLAN_NAME, name) or not folder.is_dir():
            return []
        return sorted(int(found[1]) for file in folder.iterdir() if (found := _VERSION.fullmatch(file.name)))

    def _path(self, name: str, version: int) -> Path:
        return self._folder / name / f"{version:04d}.json"

    def _write(self, stored: StoredPlan) -> None:
        text = stored.model_dump_json(indent=1)
        path = self._path(stored.plan.name, stored.version)
        replace_whole(path, lambda beside: beside.write_text(text, encoding="utf-8"))


def _damaged(path: Path, why: Exception) -> Fault:
    return Fault(
        FaultCode.UNKNOWN_PLAN, f"the stored plan {path} cannot be read: {str(why)[:100]}",
        advice="store the plan again, or take another version",
    )  # fmt: skip
