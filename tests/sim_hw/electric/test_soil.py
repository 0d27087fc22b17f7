"""Films and debris: seeded, at the shares asked for, broken by force and tries."""

import math

import pytest

from sim_hw.electric.soil import CLEAN, SITE_UM, Soil, SoilShares

PADS = [f"pad{number}" for number in range(20_000)]
HERE = (0.0, 0.0)


def _kinds(soil: Soil, shares: SoilShares) -> dict[str, int]:
    kinds = [soil.film(pad, shares).kind for pad in PADS]
    return {kind: kinds.count(kind) for kind in set(kinds)}


def test_with_no_shares_nothing_is_soiled_and_touching_leaves_nothing() -> None:
    soil = Soil(1)
    assert _kinds(soil, SoilShares()) == {"clean": len(PADS)}
    for _ in range(1000):
        soil.touch(SoilShares())
    assert soil.debris_ohm_n == 0.0


def test_shares_are_kept_and_the_same_seed_soils_the_same_pads() -> None:
    shares = SoilShares(oxide=0.04, stubborn=0.01)
    kinds = _kinds(Soil(3), shares)
    for kind, share in (("oxide", 0.04), ("stubborn", 0.005), ("flux", 0.005)):
        assert kinds[kind] == pytest.approx(share * len(PADS), abs=4 * math.sqrt(share * len(PADS)))
    assert [Soil(3).film(pad, shares) for pad in PADS[:500]] == [Soil(3).film(pad, shares) for pad in PADS[:500]]
    assert [Soil(4).film(pad, shares) for pad in PADS[:500]] != [Soil(3).film(pad, shares) for pad in PADS[:500]]


def test_a_share_turned_up_adds_soiled_pads_and_cleans_none() -> None:
    soil = Soil(5)
    few = {pad for pad in PADS if soil.film(pad, SoilShares(oxide=0.02)) is not CLEAN}
    more = {pad for pad in PADS if soil.film(pad, SoilShares(oxide=0.05)) is not CLEAN}
    assert few < more


def test_oxide_breaks_with_force_and_with_tries_and_stays_broken_where_it_was() -> None:
    shares = SoilShares(oxide=1.0)
    broken: dict[tuple[float, int], int] = {}
    for force_n, tries in ((0.2, 1), (0.5, 1), (0.2, 8)):
        soil = Soil(6)
        for pad in PADS[:2000]:
            left = [soil.press(pad, HERE, force_n, shares) for _ in range(tries)][-1]
            broken[force_n, tries] = broken.get((force_n, tries), 0) + (left is CLEAN)
    chance = -math.expm1(-((0.2 / 0.6) ** 2))
    assert broken[0.2, 1] == pytest.approx(2000 * chance, abs=60)
    assert broken[0.2, 8] == pytest.approx(2000 * (1 - (1 - chance) ** 8), abs=100)
    assert broken[0.5, 1] == pytest.approx(1000, abs=100)
    soil = Soil(6)
    pad = next(pad for pad in PADS if soil.press(pad, HERE, 0.5, shares) is CLEAN)
    assert soil.whole_film(pad, (SITE_UM - 1.0, 0.0), shares) is CLEAN
    assert soil.whole_film(pad, (SITE_UM + 1.0, 0.0), shares).kind == "oxide"


def test_another_board_has_films_of_its_own() -> None:
    shares, soil = SoilShares(oxide=0.5), Soil(7)
    before = [soil.film(pad, shares).kind for pad in PADS[:200]]
    soil.lay_board("another")
    assert [soil.film(pad, shares).kind for pad in PADS[:200]] != before


def test_a_pool_of_flux_has_a_side_where_it_is_not_and_no_press_breaks_it() -> None:
    soil, shares = Soil(8), SoilShares(stubborn=1.0)
    pad = next(pad for pad in PADS if soil.film(pad, shares).kind == "flux")
    assert all(soil.press(pad, HERE, 5.0, shares).kind == "flux" for _ in range(50))
    around = [(100.0 * math.cos(k), 100.0 * math.sin(k)) for k in range(6)]
    kinds = {soil.whole_film(pad, place, shares).kind for place in around}
    assert kinds == {"flux", "clean"}


def test_a_voltage_breaks_a_thin_film_and_a_small_one_does_not() -> None:
    soil, shares = Soil(9), SoilShares(oxide=1.0)
    assert not any(soil.apply_voltage(pad, HERE, 0.02, shares) for pad in PADS[:500])
    assert sum(soil.apply_voltage(pad, HERE, 20.0, shares) for pad in PADS[:500]) > 490
    assert soil.whole_film(PADS[0], HERE, shares) is CLEAN


def test_debris_stays_on_the_needle_over_touches_until_it_is_brushed() -> None:
    soil = Soil(10)
    soil.touch(SoilShares(debris=1.0))
    assert soil.debris_ohm_n > 0.0
    kept = soil.debris_ohm_n
    soil.lay_board("another")
    assert soil.debris_ohm_n == kept
    for _ in range(10):
        soil.brush()
    assert soil.debris_ohm_n == 0.0
