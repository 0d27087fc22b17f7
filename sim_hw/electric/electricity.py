"""Electricity of the station: the needle on the board, the coin and the brush, and what can be measured through it.

What is NOT modelled: the coin and the brush in the picture; heat, thermal voltages, charge of the cable; a needle that
walks aside. All constants are guesses until a real station gives its own.
"""

from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence

from sim_hw.board.nest import InNest
from sim_hw.electric.circuit import COIN, KELVIN, TEST_A, Circuit, Defects
from sim_hw.electric.contact import METAL, Footing, standing_on, under
from sim_hw.electric.pin import Pin
from sim_hw.electric.press import Press
from sim_hw.electric.soil import CLEAN, Soil, SoilShares
from sim_hw.electric.trace import Moment, Point, Trace
from sim_hw.plant.plant import Plant

_ELSEWHERE_UM = 5.0
"""Farther than this from where it came down, the needle stands on something else."""


class Electricity:
    """Follow the needle, and answer what is between it and the harness. Not to be used by two threads at once."""

    def __init__(self, plant: Plant, seed: int) -> None:
        self._plant = plant
        self._seed = seed
        self._soil = Soil(seed)
        self._trace = Trace(plant)
        self._press: Press | None = None
        self._metal_s = (math.inf, math.inf)
        self._touches = 0
        self._board: tuple[object, ...] | None = None

    def lay_board(self, nest: InNest, *, assembled: bool = False) -> None:
        """Put a board under the needle; the same one, laid in again or remade, keeps what was done to it."""
        self._nest = nest
        board = (nest.board.name, nest.board.side, self._plant.knobs.board_number, assembled)
        if board != self._board:
            self._board = board
            individual = f"{self._seed}/{nest.board.name}/{self._plant.knobs.board_number}"
            self.circuit = Circuit(nest.board.pads, individual, assembled=assembled)
            self._soil.lay_board(f"{nest.board.name}/{nest.board.side}/{self._plant.knobs.board_number}")

    # ------------------------------------------------------------------ what is asked

    def update(self, t_s: float) -> None:
        """Work off what the needle did up to a time, and write it to the truth log."""
        for moment in self._trace.until(t_s):
            match moment.kind:
                case "down":
                    self._down(moment)
                case "pushed":
                    self._pushed(moment.point)
                case "dragged":
                    self._note(moment.point.t_s, "scratch", {"dragged_um": moment.dragged_um, **self._where()})
                case "free":
                    self._free(moment)
        self._follow(t_s)

    def sense(self, t_s: float) -> bool:
        """Tell whether the touch sense is closed: metal under the needle, heard after its delay."""
        self.update(t_s)
        faults, knobs = self._plant.faults, self._plant.knobs
        if faults.on("sense_stuck"):
            return bool(faults.get("sense_stuck")["closed"])
        made_s, lost_s = self._metal_s
        return bool(knobs.sense_fitted) and made_s <= t_s - knobs.sense_delay_s < lost_s

    def needle_ohm(self, t_s: float) -> float:
        """Return the resistance from the pin's wire into the metal it stands on; inf where it stands on none."""
        self.update(t_s)
        if self._press is None or not self._press.held:
            return math.inf
        return self._press.ohms(self._force_at_n(t_s), self._soil.debris_ohm_n)

    def steady_since_s(self, t_s: float) -> float:
        """Return since when the needle has been in contact without a break; inf: it is not."""
        self.update(t_s)
        held = self._press is not None and bool(self._press.held)
        return self._press.made_s if held and self._press is not None else math.inf

    def ohms(self, channels: Sequence[int], t_s: float) -> float:
        """Return the resistance from the pin's wire to the closed channels, leads not counted."""
        through_ohm = self.needle_ohm(t_s)
        if math.isinf(through_ohm) or self._press is None:
            return math.inf
        if KELVIN in channels:
            # Each of the two wires stands with half of the force on half of the metal.
            return 2.0 * self._press.ohms(self._force_at_n(t_s), self._soil.debris_ohm_n, 0.5)
        return through_ohm + self.circuit.ohms(self._press.places(), self._reached(channels), self._defects())

    def farads(self, channels: Sequence[int], t_s: float) -> float:
        """Return the capacitance from the needle to the closed channels."""
        self.update(t_s)
        places = () if self._press is None else self._press.places()
        return self.circuit.farads(places, self._reached(channels), self._defects())

    def diode_v(self, channels: Sequence[int], t_s: float) -> float:
        """Return the voltage that the diode test's current needs, its contact's too; inf: none flows."""
        through_ohm = self.needle_ohm(t_s)
        if math.isinf(through_ohm) or self._press is None:
            return math.inf
        return through_ohm * TEST_A + self.circuit.diode_v(
            self._press.places(), self._reached(channels), self._defects()
        )

    def apply_voltage(self, volts: float, t_s: float) -> None:
        """Put a voltage across the needle's contact: a thin film does not bear it."""
        self.update(t_s)
        if self._press is None:
            return
        for patch in self._press.held:
            offset_um = self._press.offset_um(patch)
            if patch.key and self._soil.apply_voltage(patch.key, offset_um, volts, self._shares()):
                self._press.films[patch.key] = CLEAN

    def defects(self) -> Mapping[str, object]:
        """Return what is broken and shorted on the board in the nest, and which pads a break cuts off."""
        found = self._defects()
        broken, cut_off = self.circuit.broken(found), self.circuit.cut_off(found)
        return {"open_nets": broken, "cut_off": cut_off, "shorts": self.circuit.shorted(found)}

    def _reached(self, channels: Sequence[int]) -> Sequence[int]:
        """Return the closed channels whose wire of the harness is whole."""
        if not self._plant.faults.on("harness_open"):
            return channels
        cut = self._plant.faults.get("harness_open")["channel"]
        return [channel for channel in channels if cut not in (0, channel)]

    # ------------------------------------------------------------------ what happens

    def _down(self, moment: Moment) -> None:
        self._touches += 1
        bounce_s = random.Random(f"{self._seed}/bounce/{self._touches}").random() * self._plant.knobs.contact_bounce_s
        began = moment.point
        footing, cad_mm = self._footing(began)
        self._press = Press(began, moment.speed_um_s, footing, cad_mm, began.t_s + bounce_s)
        self._find_films()
        if self._press.held:
            self._metal_s = (began.t_s, math.inf)
        if footing.material == "brush":
            self._soil.brush()
        else:
            self._soil.touch(self._shares())

    def _follow(self, t_s: float) -> None:
        """See what the needle stands on after it went sideways, or the board below it did."""
        press = self._press
        if press is None:
            return
        point = self._trace.point(t_s)
        if math.dist(self._plant.to_cad_mm(point.x_um, point.y_um), press.cad_mm) * 1e3 <= _ELSEWHERE_UM:
            return
        held_before = press.held
        press.footing, press.cad_mm = self._footing(point)
        self._find_films()
        if press.held and not held_before:
            self._metal_s, press.made_s = (t_s, math.inf), t_s
        elif held_before and not press.held:
            self._metal_s = (self._metal_s[0], t_s)

    def _find_films(self) -> None:
        if self._press is not None:
            for patch in self._press.held:
                if patch.key:
                    film = self._soil.whole_film(patch.key, self._press.offset_um(patch), self._shares())
                    self._press.films[patch.key] = film

    def _pushed(self, point: Point) -> None:
        press = self._press
        if press is None:
            return
        press.strokes += 1
        force_n = self._force_n(point.push_um)
        for patch in press.held:
            if patch.key:
                left = self._soil.press(patch.key, press.offset_um(patch), force_n, self._shares())
                press.films[patch.key] = left
        contact = press.contact(force_n, self._soil.debris_ohm_n)
        facts = {"pressed_um": point.push_um, "force_n": force_n, **contact, "joined": self._joined(press)}
        if press.strokes == 1:
            self._note(press.began.t_s, "touch_down", {"speed_um_s": press.speed_um_s, **self._where(), **facts})
        else:
            self._note(point.t_s, "press", {"number": press.strokes, **self._where(), **facts})
        press.most_n = max(press.most_n, force_n)
        if force_n > self._plant.knobs.dent_n and not press.dented:
            press.dented = True
            self._note(point.t_s, "dent", {"force_n": force_n, **self._where()})

    def _joined(self, press: Press) -> list[str]:
        """Return the nets whose pin of the harness the needle is joined to: on a part that is cut off it is to none."""
        nodes = (self.circuit.node(place, self._defects()) for place in press.places())
        return sorted(net for net, reached in filter(None, nodes) if reached)

    def _free(self, moment: Moment) -> None:
        press, self._press = self._press, None
        # Shorter from the next touch on: a needle that wore while it is down would come free by itself.
        self._plant.tip_worn_um += self._plant.knobs.tip_wear_um
        self._metal_s = (self._metal_s[0], min(self._metal_s[1], moment.point.t_s))
        if press is not None:
            facts = {"presses": press.strokes, "most_force_n": press.most_n, "dragged_um": moment.dragged_um}
            self._note(moment.point.t_s, "lift_off", {**facts, "down_s": moment.point.t_s - press.began.t_s})

    def _footing(self, point: Point) -> tuple[Footing, tuple[float, float]]:
        """Return what the needle stands on at a place, and the CAD place."""
        plant, place_um = self._plant, (point.x_um, point.y_um)
        cad_mm = plant.to_cad_mm(*place_um)
        if plant.spots.coin.covers(place_um):
            return standing_on(METAL, COIN), cad_mm
        if plant.spots.brush.covers(place_um):
            return standing_on("brush"), cad_mm
        if plant.card is not None and plant.card.covers(place_um):
            return standing_on("card"), cad_mm
        if plant.faults.on("board_gone"):
            return standing_on("nest"), cad_mm
        return under(self._nest, *cad_mm, plant.knobs.tip_radius_um), cad_mm

    # ------------------------------------------------------------------ figures

    def _force_at_n(self, t_s: float) -> float:
        return self._force_n(self._trace.point(t_s).push_um, inwards=self._trace.inwards)

    def _force_n(self, push_um: float, *, inwards: bool = True) -> float:
        knobs = self._plant.knobs
        pin = Pin(knobs.pin_preload_n, knobs.pin_rate_n_per_mm, knobs.pin_travel_um)
        return pin.force_n(push_um, inwards=inwards, stuck=self._plant.faults.on("pin_stuck"))

    def _shares(self) -> SoilShares:
        knobs = self._plant.knobs
        return SoilShares(knobs.oxide_share, knobs.stubborn_share, knobs.debris_share)

    def _defects(self) -> Defects:
        knobs, faults = self._plant.knobs, self._plant.faults
        told = faults.get("harness_joined")
        joined = frozenset({int(told["channel"]), int(told["other"])} if faults.on("harness_joined") else ())
        return Defects(knobs.open_share, knobs.short_share, knobs.harness_ohm, joined)

    # ------------------------------------------------------------------ the log

    def _where(self) -> dict[str, object]:
        return {} if self._press is None else self._press.where(self._nest.board)

    def _note(self, t_s: float, event: str, facts: Mapping[str, object]) -> None:
        self._plant.note(t_s, event, facts)
