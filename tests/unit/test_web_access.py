"""Who may look and who may drive."""

import os
from pathlib import Path

import pytest

from robo.errors import UsageError
from robo.web.access import Doorkeeper, Right, Tokens, is_own_host, is_own_origin, keep_secret
from robo.web.limits import Budget, WaitingRoom
from robo.web.sessions import Sessions, cookie

TOKENS = Tokens(view="look-look-look", drive="drive-drive-drive")


@pytest.mark.parametrize(
    ("token", "right"),
    [
        ("drive-drive-drive", Right.DRIVE),
        ("look-look-look", Right.VIEW),
        ("", Right.NONE),
        ("drive", Right.NONE),
        ("drive-drive-drivé", Right.NONE),
    ],
)
def test_a_token_is_worth_a_right(token: str, right: Right) -> None:
    assert TOKENS.right(token) is right


def test_without_tokens_everybody_drives_and_without_one_to_look_nobody_only_looks() -> None:
    assert Tokens().right("") is Right.DRIVE
    assert Tokens(drive="drive-drive-drive").right("") is Right.NONE


def test_new_tokens_are_never_the_same() -> None:
    made = [Tokens.new() for _ in range(100)]
    assert len({word for one in made for word in (one.view, one.drive)}) == 200
    assert all(len(word) >= 20 for one in made for word in (one.view, one.drive))


def test_a_thousand_guesses_take_hours() -> None:
    door = Doorkeeper(TOKENS)
    now = 0.0
    for number in range(1000):
        now += door.wait("1.2.3.4", now)
        assert door.right(f"guess {number}", "1.2.3.4", now) is Right.NONE
    assert now > 15 * 3600
    assert door.wait("1.2.3.5", now) == 0.0, "somebody else is not held up"


def test_while_somebody_has_to_wait_the_right_token_is_no_better() -> None:
    door = Doorkeeper(TOKENS)
    for number in range(6):
        door.right(f"guess {number}", "1.2.3.4", 0.0)
    assert door.wait("1.2.3.4", 0.0) == 1.0
    assert door.right("drive-drive-drive", "1.2.3.4", 0.5) is Right.NONE
    assert door.right("drive-drive-drive", "1.2.3.4", 1.1) is Right.DRIVE
    assert door.right("another guess", "1.2.3.4", 1.2) is Right.NONE
    assert door.wait("1.2.3.4", 1.2) == 2.0, "a right one takes back no wrong ones"


def test_who_may_look_guesses_the_token_to_drive_no_faster() -> None:
    door = Doorkeeper(TOKENS)
    now = 0.0
    for number in range(20):
        door.right(f"guess {number}", "1.2.3.4", now)
        now += door.wait("1.2.3.4", now)
        assert door.right(TOKENS.view, "1.2.3.4", now) is Right.VIEW
    assert now > 600.0


def test_the_addresses_that_one_host_has_count_as_one() -> None:
    door = Doorkeeper(TOKENS)
    for number in range(6):
        door.right(f"guess {number}", f"2001:db8::{number}", 0.0)
    assert door.wait("2001:db8::ffff:1", 0.0) == 1.0
    assert door.wait("2001:db8:0:1::1", 0.0) == 0.0
    assert door.wait("::ffff:1.2.3.4", 0.0) == 0.0


def test_what_a_browser_remembers_is_no_token_and_ends_with_it() -> None:
    sessions = Sessions(TOKENS, "key")
    word = sessions.word(Right.DRIVE)
    assert TOKENS.drive not in word
    assert (sessions.right(word), sessions.right(sessions.word(Right.VIEW))) == (Right.DRIVE, Right.VIEW)
    assert sessions.right("") is sessions.right(TOKENS.drive) is sessions.right("é") is Right.NONE
    assert Sessions(TOKENS, "key").right(word) is Right.DRIVE, "it outlives a restart"
    assert Sessions(TOKENS).right(word) is Right.NONE
    assert Sessions(Tokens(drive="another-one-now"), "key").right(word) is Right.NONE


@pytest.mark.parametrize(
    ("lines", "found"),
    [
        (["robo=word"], "word"),
        (['prefs={"a":1}; robo=word'], "word"),
        (["a=b", "c = d;robo=word; x"], "word"),
        (["xrobo=word"], ""),
        ([""], ""),
        ([], ""),
    ],
)
def test_what_others_remember_is_in_nobodys_way(lines: list[str], found: str) -> None:
    assert cookie(lines, "robo") == found


def test_tokens_that_are_made_up_are_kept_for_this_user_alone(tmp_path: Path) -> None:
    file = tmp_path / "tokens"
    made = Tokens.kept(file)
    assert "" not in (made.drive, made.view)
    assert file.stat().st_mode & 0o777 == 0o600
    assert Tokens.kept(file) == made
    with pytest.raises(UsageError, match="No such file"):
        Tokens.kept(tmp_path / "none" / "tokens")


def test_who_waits_longest_goes_first() -> None:
    room = WaitingRoom[str](2)
    assert room.enter("a") is None
    assert room.enter("b") is None
    assert room.enter("c") == "a"
    room.leave("b")
    assert room.enter("d") is None
    assert room.enter("e") == "c"


def test_a_budget_is_so_much_at_once_and_so_much_a_second() -> None:
    budget = Budget(10, 5.0)
    assert [budget.take(0.0) for _ in range(12)] == [True] * 10 + [False] * 2
    budget = Budget(10, 5.0)
    assert all(budget.take(number / 5) for number in range(1000))


def test_who_shows_nothing_does_not_guess() -> None:
    door = Doorkeeper(TOKENS)
    for _ in range(100):
        assert door.right("", "1.2.3.4", 0.0) is Right.NONE
    assert door.wait("1.2.3.4", 0.0) == 0.0


def test_many_addresses_fill_no_memory_and_wait_together() -> None:
    door = Doorkeeper(TOKENS)
    for number in range(2_000):
        door.right(f"guess {number}", f"address {number}", 0.0)
    assert door.wait("another one", 0.0) > 0.0
    assert door.wait("address 0", 0.0) == 0.0
    assert door.wait("another one", 1_000.0) == 0.0


@pytest.mark.parametrize(
    ("host", "own"),
    [
        ("127.0.0.1:8080", True),
        ("localhost", True),
        ("[::1]:8080", True),
        ("r1.local:8080", True),
        ("evil.example:8080", False),
        ("", False),
        ("[", False),
        ("127.0.0.1.evil.example", False),
    ],
)
def test_a_page_has_only_its_own_names(host: str, own: bool) -> None:
    assert is_own_host(host, ("r1.local",)) is own


def test_a_page_that_tries_an_old_token_again_and_again_guesses_nothing() -> None:
    door = Doorkeeper(TOKENS)
    for _ in range(1000):
        assert door.right("the token of yesterday", "1.2.3.4", 0.0) is Right.NONE
    assert door.right("drive-drive-drive", "1.2.3.4", 0.0) is Right.DRIVE


@pytest.mark.parametrize(("host", "own"), [("192.168.1.5:8080", True), ("[fe80::1%eth0]:8080", True), ("r1", False)])
def test_an_address_in_numbers_is_no_foreign_name(host: str, own: bool) -> None:
    assert is_own_host(host, addresses=True) is own
    assert not is_own_host(host)


def test_tokens_are_read_from_a_file(tmp_path: Path) -> None:
    file = tmp_path / "tokens"
    file.write_text("drive-drive-drive\n\nlook-look-look\n")
    assert Tokens.of("0.0.0.0", file) == TOKENS
    file.write_text("drive-drive-drive")
    assert Tokens.of("127.0.0.1", file) == Tokens(drive="drive-drive-drive")
    for wrong in ("", "short", "1234567890123\n1234567890123\n1234567890123"):
        file.write_text(wrong)
        with pytest.raises(UsageError, match="first line is the token to drive"):
            Tokens.of("0.0.0.0", file)
    with pytest.raises(UsageError, match="No such file"):
        Tokens.of("0.0.0.0", tmp_path / "none")


def test_only_this_machine_needs_no_tokens() -> None:
    assert Tokens.of("127.0.0.1", None) == Tokens()
    assert Tokens.of("0.0.0.0", None).drive != ""


def test_a_star_is_any_name() -> None:
    assert is_own_host("anything.example", ("*",))


@pytest.mark.parametrize(
    ("origin", "own"),
    [
        (None, True),
        ("http://127.0.0.1:8080", True),
        ("https://127.0.0.1:8080", True),
        ("http://127.0.0.1:8081", False),
        ("http://evil.example", False),
        ("null", False),
        ("file://127.0.0.1:8080", False),
        ("http://[", False),
    ],
)
def test_a_socket_is_for_the_page_alone(origin: str | None, own: bool) -> None:
    assert is_own_origin(origin, "127.0.0.1:8080") is own


@pytest.mark.parametrize("has_links", [True, False])
def test_a_secret_is_kept_for_this_user_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, has_links: bool) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError("this file system has no links")

    if not has_links:
        monkeypatch.setattr(os, "link", refuse)
    file = tmp_path / "r1%dashboard.key"
    assert keep_secret(file, "first") == "first"
    assert keep_secret(file, "second") == "first"
    assert file.stat().st_mode & 0o777 == 0o600
    assert list(tmp_path.iterdir()) == [file]


def test_a_secret_that_could_not_be_written_leaves_no_empty_file(tmp_path: Path) -> None:
    with pytest.raises(UsageError):
        keep_secret(tmp_path / "key", "cannot be written: \udc00")
    assert list(tmp_path.iterdir()) == []


def test_two_who_make_a_secret_at_once_have_the_same_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "key"
    link = os.link

    def come_second(*paths: str) -> None:
        file.write_text("of the other one")
        link(*paths)

    monkeypatch.setattr(os, "link", come_second)
    assert keep_secret(file, "of this one") == "of the other one"
