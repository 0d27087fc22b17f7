"""Days of random work in minutes, to see whether anything of the daemon grows that should not.

    python -m tests.bench.soak [--hours 72] [--minutes 10] [--seed 1]

A simulated station whose time runs fast enough that `hours` pass in `minutes`, and a daemon on it that is given random
work: corrections, placements, looks, reports, cancels, repeated and refused requests, faults of every device with
their resets. Resident memory, descriptors, threads, journal and pictures are sampled; each line of growth is fitted
from the second half on, when caches are filled. Prints the samples and a verdict; exit code 1 if anything grew.
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from daemon.client import Client, NoAnswer, Refused
from tests.bench.idle import cpu_s, resident_mb
from tests.station.rig import Rig, running_rig

SAMPLE_S = 10.0
QUOTA_MB = 20.0
REPLY_MS = 1000.0
"""Slaves get more time to answer: two programs on a busy computer are what is slow here, not the line."""
FAULTS = ("black", "torn", "frozen", "missing", "bent", "crc_noise", "cable_out", "relay_stuck", "estop", "stall")
LIMITS = {"rss_mb": 20.0, "fds": 3.0, "threads": 2.0}
"""By how much each may drift over the second half; memory has the noise of pictures coming and going."""
KB_A_JOB = 8.0
"""What the journal may take for a job with its looks and moves; retention bounds how many are kept."""
WAL_MB = 8.0
"""SQLite works its write-ahead log off at 4 MB."""
LAST_FOLDER_MB = 6.0
"""The newest pictures stay even where they are beyond the quota."""


@dataclass(frozen=True)
class Sample:
    """The daemon at one moment."""

    at_s: float
    rss_mb: float
    fds: float
    threads: float
    journal_mb: float
    wal_mb: float
    pictures_mb: float
    jobs: int


def sample(rig: Rig, began_s: float, jobs: int) -> Sample:
    process, data = Path(f"/proc/{rig.daemon.pid}"), rig.places.out / "station"
    return Sample(
        time.monotonic() - began_s,
        resident_mb(rig.daemon.pid),
        len(list((process / "fd").iterdir())),
        len(list((process / "task").iterdir())),
        (data / "journal.sqlite").stat().st_size / 1e6,
        (data / "journal.sqlite-wal").stat().st_size / 1e6,
        sum(f.stat().st_size for f in (data / "pictures").rglob("*") if f.is_file()) / 1e6,
        jobs,
    )


class Work:
    """One tester with moods."""

    def __init__(self, rig: Rig, client: Client, seed: int) -> None:
        self.rig, self.client = rig, client
        self.dice = random.Random(seed)
        self.points = [p.name for p in rig.board.round_points()]
        self.done: Counter[str] = Counter()
        self.number = 0

    def turn(self) -> None:
        """Do one thing."""
        deeds = (self.land, self.land, self.land, self.look, self.cancel, self.nonsense, self.broken)
        try:
            self.dice.choice(deeds)()
        except Refused as exc:
            self.done[f"refused: {exc.error['name']}"] += 1
        except NoAnswer:
            self.done["no answer"] += 1
        self.recover()

    def job(self, op: str, **fields: object) -> None:
        self.number += 1
        result = self.client.job(op, job_id=f"soak-{self.number}", deadline_ms=20_000, timeout_s=30, **fields)
        self.done[result.error.name if result.error else result.outcome] += 1

    def land(self) -> None:
        point = self.dice.choice(self.points)
        theta_deg = self.dice.choice((0.0, 45.0, 90.0, 180.0, 270.0))
        self.job("place", test_point=point, theta_deg=theta_deg)
        self.job("correct", test_point=point)
        self.client.request("report", id=f"soak-{self.number}", retest="pass", touches=self.dice.randrange(40))

    def look(self) -> None:
        self.job("look", pictures=self.dice.random() < 0.5)

    def cancel(self) -> None:
        self.number += 1
        self.client.request("place", id=f"soak-{self.number}", test_point=self.dice.choice(self.points), theta_deg=90.0)
        self.client.request("cancel", id=f"soak-{self.number}")

    def nonsense(self) -> None:
        for message in (
            b"{",
            b'{"op":"fly"}',
            b'{"op":"correct","id":"x","test_point":"nowhere"}',
            b'{"v":9,"op":"status"}',
        ):
            assert not self.client.raw(message)["ok"]
        self.client.request("snapshot")
        self.client.request("results", since=0, limit=50)
        self.done["nonsense"] += 1

    def broken(self) -> None:
        name = self.dice.choice(FAULTS)
        with self.rig.fault(name):
            try:
                self.land()
            finally:
                self.done[f"with {name}"] += 1

    def recover(self) -> None:
        """Do what a person would: reset, home."""
        for _ in range(20):
            status = self.client.request("status")
            if status["running"] is not None or status["queued"]:
                time.sleep(0.02)
                continue
            if status["fault"] is None:
                return
            if status["fault"]["name"] == "not_homed":
                self.job("home")
                continue
            try:
                self.client.request("reset", timeout_s=30)
            except Refused as exc:
                if exc.error["name"] != "not_homed":
                    time.sleep(0.2)
        self.done["not recovered"] += 1


def growth(samples: list[Sample], name: str) -> float:
    """Return the drift of one number over the second half of the run, by a straight line."""
    half = samples[len(samples) // 2 :]
    times = np.array([s.at_s for s in half])
    values = np.array([getattr(s, name) for s in half], dtype=float)
    slope = np.polyfit(times - times[0], values, 1)[0]
    return float(slope * (times[-1] - times[0]))


def judge(samples: list[Sample], hours: float) -> bool:
    """Print what grew, and by how much an hour of the station's time; return whether all is well."""
    good = True
    for name, limit in LIMITS.items():
        drift = growth(samples, name)
        well = drift <= limit
        good &= well
        verdict = "ok" if well else "GREW"
        print(f"{name}: {drift:+.2f} over the second half ({drift / (hours / 2):+.3f} an hour), {verdict}")
    last = samples[-1]
    kb = growth(samples, "journal_mb") * 1e3 / max(growth(samples, "jobs"), 1.0)
    bounded = kb <= KB_A_JOB and last.wal_mb <= WAL_MB and last.pictures_mb <= QUOTA_MB + LAST_FOLDER_MB
    verdict = "ok" if bounded else "BEYOND ITS BOUND"
    print(f"journal: {last.journal_mb:.2f} MB, {kb:.1f} KB a job, WAL {last.wal_mb:.2f} MB, {verdict}")
    print(f"pictures: {last.pictures_mb:.1f} MB of {QUOTA_MB:g}")
    return good and bounded


def main() -> None:
    """Run once."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=72.0)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    speed = min(1000.0, given.hours * 60 / given.minutes)
    print(f"{given.hours:g} h at {speed:g} times the clock, in {given.minutes:g} min")
    arguments = ("--unpaced", "--speed", f"{speed:g}")
    with (
        tempfile.TemporaryDirectory() as folder,
        running_rig(
            Path(folder),
            seed=given.seed,
            pictures="failed",
            arguments=arguments,
            waits_for_speed=speed,
            reply_ms=REPLY_MS,
        ) as rig,
        rig.client(timeout_s=10.0) as client,
    ):
        restart_with_quota(rig)
        rig.session(client).set_up()
        samples, work = run(rig, client, given.minutes * 60, given.seed)
        hours = rig.bench.ask("status")["t_s"] / 3600
        print(f"{hours:.1f} simulated hours, {work.number} jobs, {cpu_s(rig.daemon.pid):.0f} s of processor time")
        print(", ".join(f"{name} {count}" for name, count in work.done.most_common()))
        good = judge(samples, hours)
        assert client.request("status")["station"]
    print("verdict:", "nothing grew" if good else "IT GROWS")
    sys.exit(0 if good else 1)


def restart_with_quota(rig: Rig) -> None:
    """Give the pictures so little room that the ring goes round."""
    rig.daemon.end()
    settings = rig.places.out / "station.toml"
    text = settings.read_text()
    settings.write_text(text.replace("pictures_quota_mb = 500.0", f"pictures_quota_mb = {QUOTA_MB:g}"))
    rig.start_daemon()


def run(rig: Rig, client: Client, seconds: float, seed: int) -> tuple[list[Sample], Work]:
    """Work for so long and sample meanwhile."""
    work, samples = Work(rig, client, seed), []
    began_s = due_s = time.monotonic()
    while (now_s := time.monotonic()) < began_s + seconds:
        if now_s >= due_s:
            samples.append(sample(rig, began_s, work.number))
            print(samples[-1], flush=True)
            due_s += SAMPLE_S
        work.turn()
    samples.append(sample(rig, began_s, work.number))
    return samples, work


if __name__ == "__main__":
    main()
