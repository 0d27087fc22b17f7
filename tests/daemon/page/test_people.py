"""Who is somebody is let in with the right secret, for a time, and nobody by guessing."""

from __future__ import annotations

from pathlib import Path

import pytest

from daemon.page.lockout import Lockout
from daemon.page.people import USERS_FILE, Users, UserTrouble, right_secret
from daemon.page.sessions import IDLE_HERE_S, IDLE_S, LONGEST_S, MAX_SESSIONS, Sessions
from tests.daemon.clock import Clock

SECRET = "a long secret"  # noqa: S105  # of nobody


@pytest.fixture
def clock() -> Clock:
    return Clock(1000.0)


@pytest.fixture
def users(tmp_path: Path) -> Users:
    made = Users(tmp_path / USERS_FILE)
    made.add("Kim", "operate", SECRET)
    return made


@pytest.fixture
def sessions(users: Users, clock: Clock) -> Sessions:
    return Sessions(users, clock)


def test_a_user_is_found_again_with_role_and_secret_and_the_file_holds_no_secret(users: Users, tmp_path: Path) -> None:
    file = tmp_path / USERS_FILE
    again = Users(file).find("Kim")
    assert again is not None
    assert again.role == "operate"
    assert right_secret(again, SECRET, here=False)
    assert not right_secret(again, SECRET + "x", here=True)
    assert SECRET not in file.read_text()
    assert file.stat().st_mode & 0o777 == 0o600


def test_nobody_has_no_secret() -> None:
    assert not right_secret(None, "", here=True)


def test_a_pin_counts_at_the_machine_only(users: Users) -> None:
    lee = users.add("Lee", "maintain", "123456")
    assert right_secret(lee, "123456", here=True)
    assert not right_secret(lee, "123456", here=False)


@pytest.mark.parametrize("secret", ["", "short", "12345", "1234567", "123456789"])
def test_a_secret_that_is_guessed_soon_is_refused(users: Users, secret: str) -> None:
    with pytest.raises(UserTrouble, match="letters"):
        users.add("Lee", "maintain", secret)


@pytest.mark.parametrize("name", ["", " ", "<b>", "a\nb", "x" * 49, "-"])
def test_what_is_no_name_is_refused(users: Users, name: str) -> None:
    with pytest.raises(UserTrouble, match="no name"):
        users.add(name, "observe", SECRET)


@pytest.mark.parametrize("text", ["{", "[1]", '[{"name": "x"}]', '[{"name":"x","role":"god","salt":"","digest":"00"}]'])
def test_a_damaged_file_is_said_and_lets_nobody_in(tmp_path: Path, text: str) -> None:
    file = tmp_path / USERS_FILE
    file.write_text(text)
    file.chmod(0o600)
    with pytest.raises(UserTrouble, match="damaged"):
        Users(file).find("x")


def test_a_file_that_others_could_read_is_refused(users: Users, tmp_path: Path) -> None:
    (tmp_path / USERS_FILE).chmod(0o644)
    with pytest.raises(UserTrouble, match="open to others"):
        Users(tmp_path / USERS_FILE).all()


def test_who_is_removed_or_gets_another_role_is_out_at_once(users: Users, sessions: Sessions, tmp_path: Path) -> None:
    kim = users.find("Kim")
    assert kim is not None
    cookie, _ = sessions.begin(kim, here=False)
    assert sessions.find(cookie) is not None
    Users(tmp_path / USERS_FILE).add("Kim", "observe", SECRET)
    assert sessions.find(cookie) is None


@pytest.mark.parametrize(("here", "idle_s"), [(False, IDLE_S), (True, IDLE_HERE_S)])
def test_a_session_ends_when_its_person_does_nothing(
    users: Users, sessions: Sessions, clock: Clock, *, here: bool, idle_s: float
) -> None:
    kim = users.find("Kim")
    assert kim is not None
    cookie, session = sessions.begin(kim, here=here)
    clock.now_s += idle_s - 1
    assert sessions.find(cookie) is session
    sessions.acted(session)
    clock.now_s += idle_s - 1
    assert sessions.find(cookie) is session
    clock.now_s += 1
    assert sessions.find(cookie) is None


def test_a_session_ends_after_a_shift_whatever_its_person_does(users: Users, sessions: Sessions, clock: Clock) -> None:
    kim = users.find("Kim")
    assert kim is not None
    cookie, session = sessions.begin(kim, here=False)
    end_s = clock.now_s + LONGEST_S
    while clock.now_s + IDLE_S / 2 < end_s:
        clock.now_s += IDLE_S / 2
        assert sessions.find(cookie) is session
        sessions.acted(session)
    clock.now_s = end_s
    assert sessions.find(cookie) is None


def test_sessions_are_bounded_and_the_quietest_goes(users: Users, sessions: Sessions, clock: Clock) -> None:
    kim = users.find("Kim")
    assert kim is not None
    cookies = []
    for _ in range(MAX_SESSIONS + 1):
        clock.now_s += 1
        cookies.append(sessions.begin(kim, here=False)[0])
    assert sessions.find(cookies[0]) is None
    assert all(sessions.find(cookie) for cookie in cookies[1:])


def test_five_wrong_tries_cost_a_minute_by_name_and_by_address(clock: Clock) -> None:
    lockout = Lockout(clock)
    for n in range(5):
        assert lockout.wait_s("name Kim", "address a") == 0
        lockout.wrong("name Kim", f"address {n}")
    assert lockout.wait_s("name Kim", "address new") == Lockout.WAIT_S
    assert lockout.wait_s("name Lee", "address 0") == 0
    clock.now_s += Lockout.WAIT_S
    assert lockout.wait_s("name Kim") == 0


def test_a_right_try_forgets_the_wrong_ones(clock: Clock) -> None:
    lockout = Lockout(clock)
    for _ in range(4):
        lockout.wrong("name Kim")
    lockout.right("name Kim")
    lockout.wrong("name Kim")
    assert lockout.wait_s("name Kim") == 0
