"""The core files and the tests that each of them is judged by."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class CoreFile:
    """A source file and its own tests, the quick ones first, as paths below the project's root."""

    path: str
    tests: tuple[str, ...]


CORE_FILES: tuple[CoreFile, ...] = (
    CoreFile("daemon/procedures/correct.py", ("tests/daemon/procedures/test_correct.py",)),
    CoreFile("daemon/procedures/aiming.py", ("tests/daemon/procedures/test_aiming.py",)),
    CoreFile("daemon/procedures/align.py", ("tests/daemon/procedures/test_align.py",)),
    CoreFile("daemon/procedures/surface_touch.py", ("tests/daemon/procedures/test_surface_touch.py",)),
    CoreFile("daemon/procedures/move_sequence.py", ("tests/daemon/procedures/test_move_sequence.py",)),
    CoreFile("daemon/procedures/calibrate/pose_map.py", ("tests/daemon/procedures/calibrate/test_pose_map.py",)),
    CoreFile("daemon/procedures/calibrate/backlash.py", ("tests/daemon/procedures/calibrate/test_backlash.py",)),
    CoreFile("daemon/procedures/calibrate/planarity.py", ("tests/daemon/procedures/calibrate/test_planarity.py",)),
    CoreFile("daemon/procedures/calibrate/head_angles.py", ("tests/daemon/procedures/calibrate/test_head_angles.py",)),
    CoreFile("daemon/jobs/runner.py", ("tests/daemon/jobs/test_runner.py", "tests/daemon/jobs/test_fair_queue.py")),
    CoreFile("daemon/jobs/intake.py", ("tests/daemon/jobs/test_runner.py", "tests/daemon/jobs/test_fair_queue.py")),
    CoreFile("daemon/jobs/fault_latch.py", ("tests/daemon/jobs/test_fault_latch.py",)),
    CoreFile("daemon/app/supervisor.py", ("tests/daemon/app/test_supervisor.py",)),
    CoreFile("daemon/jobs/fair_queue.py", ("tests/daemon/jobs/test_fair_queue.py",)),
    CoreFile("daemon/jobs/preconditions.py", ("tests/daemon/jobs/test_preconditions.py",)),
    CoreFile("daemon/jobs/watchdog.py", ("tests/daemon/jobs/test_watchdog.py",)),
    CoreFile("daemon/station/kinematics.py", ("tests/daemon/station/test_kinematics.py",)),
    CoreFile("daemon/station/safe_shutdown.py", ("tests/daemon/station/test_safe_shutdown.py",)),
    CoreFile(
        "daemon/station/device_errors.py",
        ("tests/daemon/station/test_device_errors.py", "tests/daemon/station/test_error_fields.py"),
    ),
    CoreFile("daemon/domain/states.py", ("tests/daemon/domain/test_states.py",)),
    CoreFile("daemon/storage/calibration_store.py", ("tests/daemon/storage/test_calibration_store.py",)),
    CoreFile("drivers/l4118/arrival.py", ("tests/drivers/l4118/test_arrival.py",)),
    CoreFile("drivers/gantry/path.py", ("tests/drivers/gantry/test_path.py",)),
    CoreFile(
        "vision/geometry/board_alignment.py",
        ("tests/vision/geometry/test_board_alignment_limits.py", "tests/vision/geometry/test_board_alignment.py"),
    ),
    CoreFile(
        "vision/geometry/pose_map.py",
        ("tests/vision/geometry/test_pose_map_numbers.py", "tests/vision/geometry/test_pose_map.py"),
    ),
    CoreFile("vision/pads/rules.py", ("tests/vision/pads/test_rule_limits.py", "tests/vision/pads/test_rules.py")),
)


def chosen(names: list[str]) -> tuple[CoreFile, ...]:
    """Return the core files whose path ends in one of the names, all without names; ValueError for an unknown name."""
    for name in names:
        if not any(core.path.endswith(name) for core in CORE_FILES):
            raise ValueError(f"{name} is no core file; they are listed in tests/bench/mutants/core_files.py")
    return tuple(core for core in CORE_FILES if not names or core.path.endswith(tuple(names)))
