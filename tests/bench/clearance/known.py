"""What a station knows of a board in the nest: calibrations near the truth, each off by as much as they may be."""

from __future__ import annotations

from pathlib import Path
from random import Random

import numpy as np

from daemon.config.model import Config
from daemon.config.sections.motion import ClearanceSection
from daemon.domain.board import Board
from daemon.station.board_trust import BoardTrust
from daemon.station.clearance import Clearance
from daemon.station.kinematics import Geometry
from daemon.storage.calibration_records import Aligned, AlignmentRecord, Seat, SurfaceRecord, Touch
from daemon.tools.demo.session import ANGLES_DEG
from sim_hw.plant.plant import Plant
from sim_hw.plant.runout import tip_offset_um
from tests.daemon.procedures.fake_station import World
from vision.geometry import fit_plane
from vision.head import fit_head

SEEN_SIGMA_UM, TOUCHED_SIGMA_UM, STOP_SIGMA_UM = 12.0, 12.0, 8.0
STOPS = 32
INSET = 0.1


class Known:
    """The daemon's own records, geometry and clearance, made of measurements of a plant as calibrations take them."""

    def __init__(self, folder: Path, board: Board, section: ClearanceSection, chance: Random) -> None:
        self.board, self._chance = board, chance
        self._world = World(folder, board, {}).teach()
        self.config: Config = self._world.config.model_copy(update={"clearance": section})
        trust = BoardTrust(lambda: 0.0)
        trust.seen_free()
        trust.recognised()
        self.geometry = Geometry(self.config, board, self._world.calibrations, trust)
        self.clearance = Clearance(self.config, board, self._world.calibrations, self.geometry, trust)
        self._corners = [
            (board.width_um * x, board.height_um * y) for x in (INSET, 1.0 - INSET) for y in (INSET, 1.0 - INSET)
        ]

    def measure(self, plant: Plant) -> None:
        """Calibrate the head, align the board and measure its surface, with the errors of each."""
        self._head(plant)
        self._seat(plant)
        self._surface(plant)

    def real_um(self, plant: Plant, board_um: tuple[float, float]) -> tuple[float, float]:
        """Return where a place of the board really is, robot frame; the probed side is the top."""
        placement = plant.placement
        return plant.to_real_um(placement.x0_mm + board_um[0] / 1e3, placement.y0_mm + board_um[1] / 1e3)

    def _head(self, plant: Plant) -> None:
        spans = [high - low for low, high in ANGLES_DEG]
        angles = np.concatenate([
            np.linspace(low, high, round(STOPS * span / sum(spans))) for (low, high), span in
            zip(ANGLES_DEG, spans, strict=True)
        ])  # fmt: skip
        offsets = np.array([tip_offset_um(angle, plant.knobs.head_runout_scale) for angle in angles.tolist()])
        stops = (50_000.0, 50_000.0) - offsets + [self._off(STOP_SIGMA_UM) for _ in angles]
        self._world.with_head(fit_head(angles, stops[:, 0], stops[:, 1]).head)

    def _seat(self, plant: Plant) -> None:
        seen = [np.add(self.real_um(plant, at), self._off(SEEN_SIGMA_UM)) for at in self._corners]
        board, robot = np.array(self._corners), np.array(seen)
        from_middle, away = board - board.mean(axis=0), robot - robot.mean(axis=0)
        turn = complex(*_turned(from_middle, away))
        turn /= abs(turn)
        rotated = np.array([[turn.real, -turn.imag], [turn.imag, turn.real]])
        shift = robot.mean(axis=0) - rotated @ board.mean(axis=0)
        left = robot - (board @ rotated.T + shift)
        fiducials = tuple(
            Aligned(
                name=str(k), board_um=self._corners[k], robot_um=_pair(seen[k]), residual_um=_pair(left[k]), views=1
            )
            for k in range(len(seen))
        )
        record = self._world.made() | {
            "board": self.board.name, "side": self.board.side, "scale": 1.0, "tx_um": shift[0], "ty_um": shift[1],
            "theta_deg": float(np.degrees(np.angle(turn))), "rms_um": float(np.sqrt((left**2).sum(axis=1).mean())),
            "seat": Seat(verified=True, places=4, agreement=0.9), "fiducials": fiducials,
        }  # fmt: skip
        self._world.calibrations.store(AlignmentRecord(**record))

    def _surface(self, plant: Plant) -> None:
        places = np.array([self.real_um(plant, at) for at in self._corners])
        centre_um = plant.placement.centre_um
        heights = [
            plant.board_pose.height_um(_pair(at), centre_um) + self._chance.gauss(0.0, TOUCHED_SIGMA_UM)
            for at in places
        ]
        plane = fit_plane(places, np.array(heights))
        touches = tuple(Touch(x_um=x, y_um=y, height_um=h) for (x, y), h in zip(places, heights, strict=True))
        record = self._world.made() | {
            "touches": touches, "residuals_um": tuple(plane.residuals_um.tolist()), "surface": plane.to_dict(),
            "flatness_um": 0.0, "rms_um": 0.0, "limit_um": 50.0, "planar": True,
        }  # fmt: skip
        self._world.calibrations.store(SurfaceRecord(**record))

    def _off(self, sigma_um: float) -> tuple[float, float]:
        return self._chance.gauss(0.0, sigma_um), self._chance.gauss(0.0, sigma_um)


def _turned(board: np.ndarray, robot: np.ndarray) -> tuple[float, float]:
    """Return cosine and sine, unscaled, of the turn that takes one set of places about its middle to the other."""
    return float((board * robot).sum()), float((board[:, 0] * robot[:, 1] - board[:, 1] * robot[:, 0]).sum())


def _pair(place: np.ndarray) -> tuple[float, float]:
    return float(place[0]), float(place[1])
