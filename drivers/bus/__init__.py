"""One Modbus line (RTU on a serial port, RTU over TCP, or Modbus TCP) shared by several slaves."""

from drivers.bus.contract import BusTiming, Line, SerialLine, TcpLine
from drivers.bus.driver import BusStatistics, ModbusBus
from drivers.bus.link import ByteTap
from drivers.bus.od import OdAddressing, OdEntry

__all__ = [
    "BusStatistics",
    "BusTiming",
    "ByteTap",
    "Line",
    "ModbusBus",
    "OdAddressing",
    "OdEntry",
    "SerialLine",
    "TcpLine",
]
