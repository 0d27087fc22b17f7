"""Trust in the board: it needs a look, and lasts while the head goes on moving."""

from __future__ import annotations

from daemon.station.board_trust import CHANGED_WITHIN_S, BoardTrust


def test_a_board_is_trusted_after_a_look_and_while_the_head_moves_and_no_longer() -> None:
    now = [100.0]
    trust = BoardTrust(lambda: now[0])
    trust.moved()
    assert not trust.holds, "a move shows nothing"
    trust.seen_free()
    for _ in range(10):
        now[0] += 0.9 * CHANGED_WITHIN_S
        assert trust.holds
        trust.moved()
    now[0] += CHANGED_WITHIN_S
    assert not trust.holds
    trust.moved()
    assert not trust.holds, "a board may have been changed before this move"
    trust.seen_free()
    trust.end()
    assert not trust.holds


def test_a_board_is_recognised_by_a_look_and_while_it_is_trusted() -> None:
    now = [100.0]
    trust = BoardTrust(lambda: now[0])
    trust.recognised()
    assert not trust.is_recognised, "the pin may stand on it"
    trust.seen_free()
    for _ in range(10):
        now[0] += 0.9 * CHANGED_WITHIN_S
        assert trust.is_recognised
        trust.moved()
    now[0] += 1.1 * CHANGED_WITHIN_S
    trust.seen_free()
    assert trust.holds
    assert not trust.is_recognised, "it may be another one, as high"
    trust.recognised()
    trust.end()
    trust.seen_free()
    assert not trust.is_recognised
