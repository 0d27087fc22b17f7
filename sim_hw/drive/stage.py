"""Shared parts of a drive: its time, motor, objects and units, and what the switches say."""

from __future__ import annotations

from collections.abc import Callable

from sim_hw.drive.motor import SWITCH_BITS, Motor, Switch
from sim_hw.drive.objects import ObjectDictionary
from sim_hw.drive.units import units_for
from sim_hw.plant.axis import AxisSpec
from sim_hw.plant.plant import Plant

CYCLE_S = 0.001
"""The drive looks at a new controlword or mode once per cycle."""

SENSE_BIT = 3
"""Input 4 of the Z drive, where the touch sense is wired to."""

Due = tuple[float, Callable[[], None]]
"""Something that is due: when, and what to do."""


class Stage:
    """Hold a drive's motor and settings; `now_s` is the time its owner works at."""

    def __init__(self, spec: AxisSpec, plant: Plant, objects: ObjectDictionary, t_s: float) -> None:
        self.plant = plant
        self.objects = objects
        self.motor = Motor(spec, plant, t_s)
        self.now_s = t_s
        self.controlword = 0
        self.refresh_units()

    def refresh_units(self) -> None:
        """Take changed unit objects over."""
        self.units = units_for(self.motor.spec, self.objects.get(0x60A8), self.objects.get(0x60A9))

    def position(self, index: int, sub: int = 0) -> float:
        """Return a position object in machine units."""
        return self.objects.get(index, sub) / self.units.position

    def speed(self, index: int, sub: int = 0) -> float:
        """Return a speed object in machine units per second."""
        return self.objects.get(index, sub) / self.units.speed

    def rate(self, index: int) -> float:
        """Return an acceleration object in machine units per second squared, never zero."""
        return max(1, self.objects.get(index)) / self.units.acceleration

    def watches_rotor(self) -> bool:
        """Tell whether the drive sees its rotor, by an encoder or by what it measures of the motor."""
        return bool(self.plant.faults.get("stall")["detected"])

    def lag(self) -> float:
        """Return the following error in machine units, 0 in open loop."""
        return self.motor.behind(self.now_s) if self.watches_rotor() else 0.0

    def moving(self) -> bool:
        """Tell whether motion is demanded now."""
        return self.motor.moving(self.now_s)

    def stop(self, rate_index: int) -> None:
        """Brake with the rate of an object."""
        self.motor.stop(self.now_s, self.rate(rate_index))

    def watched(self, switch: Switch) -> bool:
        """Tell whether an input acts as this switch (3240h:01)."""
        return bool(self.objects.get(0x3240, 1) >> SWITCH_BITS[switch] & 1)

    def active(self, switch: Switch) -> bool:
        """Tell whether a switch acts now."""
        return self.watched(switch) and self.motor.active(switch, self.now_s)

    def ahead(self) -> Switch:
        """Return the limit switch that lies in the direction of the present motion."""
        return "positive" if self.motor.direction() > 0.0 else "negative"

    def inputs(self) -> int:
        """Return 60FDh: what acts as a switch in bits 0..2, the bare inputs in bits 16..18, the sense in 19."""
        raw = sum(self.motor.active(switch, self.now_s) << bit for switch, bit in SWITCH_BITS.items())
        if self.motor.spec.name == "z":
            raw |= self.plant.sense(self.now_s) << SENSE_BIT
        return raw << 16 | raw & self.objects.get(0x3240, 1)
