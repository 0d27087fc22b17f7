"""10,000 touches of a healthy station raise nothing, whatever is changed; each degradation is found by its alert."""

import pytest

from daemon.maintenance.catalogue import all_specs
from tests.bench.maintenance.histories import healthy, mended, planted
from tests.bench.maintenance.wrong import PLANTED


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_a_healthy_station_raises_no_alert_in_10_000_touches(seed: int) -> None:
    assert healthy(seed, 10_000) == {}


@pytest.mark.parametrize("name", PLANTED)
def test_each_planted_degradation_is_found(name: str) -> None:
    found = planted(PLANTED[name], seed=1003, within=15_000)
    assert found.delay is not None


def test_every_group_of_watches_is_tried_and_every_alert_that_is_right_exists() -> None:
    groups = {spec.name: spec.group for spec in all_specs(["main"])}
    tried = {groups[name] for degradation in PLANTED.values() for name in degradation.right}
    assert tried == set(groups.values()) - {"daemon"}


def test_another_probe_clears_what_was_wrong_with_the_one_before_and_is_learned_anew() -> None:
    stood, after = mended(PLANTED["bent tip"], seed=1001, touches=6000)
    assert "tip_bend" in stood
    assert after == {}
