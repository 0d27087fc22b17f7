"""Wiring of the simulated station as its station.toml has it: meter, harness, reference pad and brush.

It is what a person would copy from the fixture's wiring list and measure with a ruler; where coin and brush really lie,
nobody tells.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from daemon.config.bench_template import bench_electric_toml
from daemon.tools.demo.true_place import same_net

CONTACT_CHANNEL = 1
"""Of the scanner: the needle's second wire."""


def wiring_toml(nets: Iterable[str | None], harness: Mapping[str, str], meter: str) -> str:
    """Return the sections of a station.toml; `harness` names the net of each of the scanner's channels."""
    channels = channels_of(nets, harness)
    return bench_electric_toml(meter, {channel: net for net, channel in channels.items()}, CONTACT_CHANNEL)


def channels_of(nets: Iterable[str | None], harness: Mapping[str, str]) -> dict[str, int]:
    """Return the scanner's channel of each net that the harness reaches, by the board file's names."""
    by_name = {name: int(channel) for channel, name in harness.items()}
    found = {}
    for net in sorted({net for net in nets if net}):
        cut = (channel for name, channel in by_name.items() if same_net(name, net))
        channel = by_name.get(net, next(cut, None))
        if channel is not None:
            found[net] = channel
    return found
