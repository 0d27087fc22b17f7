"""The two lamp rings."""

from drivers.lights.contract import Light, Lights
from drivers.lights.modbus_relay import ModbusRelayLights
from drivers.lights.serial_relay import SerialRelayLights

__all__ = ["Light", "Lights", "ModbusRelayLights", "SerialRelayLights"]
