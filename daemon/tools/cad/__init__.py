"""Reading what CAD tools deliver: which file is what, and what it says, in the Gerbers' own millimetres."""

from daemon.tools.cad.model import Cad, Copy, Drill, Pin, Shape, Side, Use
from daemon.tools.cad.read import read_cad

__all__ = ["Cad", "Copy", "Drill", "Pin", "Shape", "Side", "Use", "read_cad"]
