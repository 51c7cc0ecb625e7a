"""Where what one user runs meets, and who holds the port where others look."""

import os
import socket
import stat
import threading
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import msgspec
import pytest

from robo.errors import NetworkError
from robo.process import door
from robo.wire import listeners, meeting, tcp, whereabouts
from robo.wire.network import RENDEZVOUS, SECURED_RENDEZVOUS, Network
from tests.conftest import free_port


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A place of this test's own, which is not there yet."""
    found = tmp_path / "m"
    monkeypatch.setenv("ROBO_MEETING", str(found))
    for name in ("ROBO_CONNECT", "ROBO_LISTEN", "ROBO_SECURITY"):
        monkeypatch.delenv(name, raising=False)
    return found


@pytest.fixture
def robot(folder: Path) -> Iterator[socket.socket]:
    """Somebody who listens where this user's robots do."""
    meeting.prepare()
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(folder / "router.sock"))
        server.listen()
        yield server


def test_the_folder_is_its_users_alone(folder: Path) -> None:
    meeting.prepare()
    meeting.prepare()
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert meeting.endpoint() == f"unixsock-stream/{folder}/router.sock"


def test_by_default_it_goes_by_the_number_of_the_user(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROBO_MEETING")
    assert meeting.endpoint() == f"unixsock-stream//tmp/robo-{os.geteuid()}/router.sock"


def test_a_folder_that_is_open_to_others_is_not_entered(folder: Path) -> None:
    folder.mkdir(mode=0o755)
    for enter in (meeting.prepare, meeting.check, lambda: Network.from_environment("client")):
        with pytest.raises(NetworkError, match=r"is open to others \(mode 755; chmod 700 closes it\)"):
            enter()
    Network.from_environment("client", ["tcp/127.0.0.1:7447"])  # it is not needed


def test_a_link_and_a_file_are_not_entered(folder: Path, tmp_path: Path) -> None:
    folder.symlink_to(tmp_path)
    with pytest.raises(NetworkError, match="is a link, made by user "):
        meeting.prepare()
    folder.unlink()
    folder.write_text("")
    for enter in (meeting.prepare, meeting.check):
        with pytest.raises(NetworkError, match="is no folder, made by user "):
            enter()


def test_somebody_elses_folder_is_not_entered(folder: Path) -> None:
    folder.mkdir(mode=0o700)
    found = meeting.distrust(folder.lstat(), os.geteuid() + 4242)
    assert found == f"belongs to user {meeting.user_name(os.geteuid())}"
    assert meeting.distrust(folder.lstat(), os.geteuid()) is None


@pytest.mark.parametrize("said", ["relative", "/tmp/" + "x" * 100])
def test_a_place_that_can_be_none_is_refused(said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROBO_MEETING", said)
    with pytest.raises(NetworkError, match="say the whole path of a folder"):
        meeting.prepare()


def test_a_folder_that_cannot_be_made_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROBO_MEETING", "/proc/none")
    with pytest.raises(NetworkError, match=r"cannot be made: .*\n.*ROBO_MEETING"):
        meeting.prepare()


def test_a_tool_looks_for_its_own_first(robot: socket.socket) -> None:
    del robot
    network = whereabouts.of_tool((), 0.0)
    assert network.connect == (meeting.endpoint(),)
    assert whereabouts.whose(network, ()) is None
    assert whereabouts.of_tool(("tcp/127.0.0.1:7999",), 0.0).connect == ("tcp/127.0.0.1:7999",)


def test_a_tool_waits_for_the_place_to_be_handed_over(robot: socket.socket) -> None:
    assert whereabouts.is_own_there(0.0)
    robot.close()
    assert not whereabouts.is_own_there(0.05), "the socket is there, and nobody listens"
    assert meeting.knock(f"{meeting.folder()}/router.sock", 0.5) is not None


def test_where_nobody_is_a_tool_looks_nowhere_else(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(whereabouts, "RENDEZVOUS", f"tcp/127.0.0.1:{free_port()}")
    assert whereabouts.of_tool((), 0.0).connect == (meeting.endpoint(),)


def test_for_want_of_its_own_a_tool_looks_where_others_listen(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        door = f"tcp/127.0.0.1:{server.getsockname()[1]}"
        monkeypatch.setattr(whereabouts, "RENDEZVOUS", door)
        network = whereabouts.of_tool((), 0.0)
        assert network.connect == (door,)
        monkeypatch.setattr(listeners, "holder", lambda _: listeners.Holder(7447, "127.0.0.1", 4242))
        assert whereabouts.whose(network, ()) == "4242"
        assert whereabouts.whose(network, (door,)) is None, "who was told does not ask"


TABLE = """\
  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode
   0: 0100007F:1D17 00000000:0000 0A 00000000:00000000 00:00000000 00000000  1001        0 1 1 0 100 0 0 10 0
   1: 0100007F:9C40 0100007F:1D17 01 00000000:00000000 00:00000000 00000000  1002        0 2 1 0 20 4 30 10 -1
   2: 0200000A:1D17 00000000:0000 0A 00000000:00000000 00:00000000 00000000  1003        0 3 1 0 100 0 0 10 0
   3: 00000000:1D18 00000000:0000 0A 00000000:00000000 00:00000000 00000000  1004        0 4 1 0 100 0 0 10 0
"""
TABLE_6 = """\
  sl  local_address                         remote_address                        st
   0: 00000000000000000000000001000000:1D17 00000000000000000000000000000000:0000 0A 0:0 00:0 0  1005 0 5
   1: 0000000000000000FFFF00000100007F:1D17 00000000000000000000000000000000:0000 0A 0:0 00:0 0  1006 0 6
   2: 000080FE000000000000000001000000:1D17 00000000000000000000000000000000:0000 0A 0:0 00:0 0  1007 0 7
"""


@pytest.mark.skipif(os.uname().sysname != "Linux", reason="it is Linux's table")
def test_the_kernel_says_which_user_listens_at_a_port_of_loopback() -> None:
    assert list(listeners.users_listening(TABLE, 7447)) == [1001]
    assert list(listeners.users_listening(TABLE, 7448)) == [1004]
    assert list(listeners.users_listening(TABLE_6, 7447)) == [1005, 1006]
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        found = listeners.holder(f"tcp/127.0.0.1:{port}")
        assert found is not None
        assert (found.uid, found.is_stranger) == (os.geteuid(), False)
        assert f"port {port} on 127.0.0.1 is held by process {os.getpid()} (" in str(found)
        (deaf,) = listeners.in_the_way([f"tcp/127.0.0.1:{port}"], 0.2)
        assert deaf == found._replace(is_deaf=True), "it is no other user, and it does not answer as Zenoh does"
        assert str(deaf) == f"{found} and no Zenoh answers there"
        assert listeners.in_the_way([f"tls/127.0.0.1:{port}"], 0.2) == [], (
            "whether it has the right keys is another question"
        )
    assert listeners.holder(f"tcp/127.0.0.1:{port}") is None
    assert listeners.holder(meeting.endpoint()) is None
    assert listeners.in_the_way([f"tcp/127.0.0.1:{port}", meeting.endpoint()], 0.2) == []


@pytest.mark.skipif(os.uname().sysname != "Linux", reason="it is Linux's table")
@pytest.mark.parametrize(("answer", "is_deaf"), [(b"SSH-2.0", True), (b"", True), (b"\x20\x00\xe1\x09", False)])
def test_a_program_is_taken_for_zenoh_only_if_it_answers_as_that(answer: bytes, *, is_deaf: bool) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        door = f"tcp/127.0.0.1:{server.getsockname()[1]}"
        over = threading.Event()

        def serve() -> None:
            while not over.is_set():
                connection, _ = server.accept()
                with connection:
                    connection.recv(100)
                    connection.sendall(answer)

        serving = threading.Thread(target=serve, daemon=True)
        serving.start()
        assert [one.is_deaf for one in listeners.in_the_way([door], 0.5 if not answer else 30.0)] == [True] * is_deaf
        over.set()
        with suppress(OSError):
            socket.create_connection(server.getsockname(), 5.0).close()
        serving.join()


@pytest.mark.skipif(os.uname().sysname != "Linux", reason="it is Linux's table")
def test_another_user_at_a_door_is_not_dialled(monkeypatch: pytest.MonkeyPatch) -> None:
    other = listeners.Holder(7447, "127.0.0.1", 4242)
    monkeypatch.setattr(listeners, "holder", lambda _: other)
    monkeypatch.setattr(tcp, "speaks_zenoh", lambda *_: pytest.fail("it is dialled"))
    assert listeners.in_the_way([RENDEZVOUS], 0.2) == [other]


def test_who_leaves_a_door_while_he_is_asked_is_not_in_the_way(monkeypatch: pytest.MonkeyPatch) -> None:
    there = iter([listeners.Holder(7447, "127.0.0.1", os.geteuid()), None])
    monkeypatch.setattr(listeners, "holder", lambda _: next(there))
    monkeypatch.setattr(tcp, "speaks_zenoh", lambda *_: None)
    assert listeners.in_the_way([RENDEZVOUS], 30.0) == []


def test_a_stranger_is_another_user_but_root() -> None:
    assert listeners.Holder(7447, "127.0.0.1", 4242).is_stranger
    assert not listeners.Holder(7447, "127.0.0.1", 0).is_stranger
    assert "by user 4242" in str(listeners.Holder(1, "127.0.0.1", 4242)), "whose process is not to be seen"


def test_how_a_router_is_reached_is_told_with_what_others_may_do() -> None:
    own = meeting.endpoint()
    guarded = Network(listen=(own, RENDEZVOUS), guarded=True)
    assert guarded.reached == f"read-only for others at {RENDEZVOUS}"
    assert msgspec.structs.replace(guarded, shared=("r1",)).reached == f"shared with others at {RENDEZVOUS}"
    assert Network(listen=("tcp/0.0.0.0:7447",)).reached == "at tcp/0.0.0.0:7447"
    assert Network(listen=(own,)).reached == "for your own tools"
    assert guarded.places == (own,), "who has the door is not believed"
    assert Network(listen=("tcp/0.0.0.0:7447",)).places == ("tcp/127.0.0.1:7447",)


SITE = "tls/site.example:7447"


@pytest.mark.parametrize("connect", [(), (SITE,)])
def test_with_security_the_door_is_one_of_tls_and_the_socket_stays(
    connect: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROBO_SECURITY", "/keys/r1")
    own = meeting.endpoint()
    network = Network.from_environment("router", connect, meeting_point=True)
    assert network == Network(connect=(*connect, own), listen=(own, SECURED_RENDEZVOUS), security="/keys/r1")
    assert (network.places, network.doors) == ((own,), (SECURED_RENDEZVOUS,)), "who has the door is not believed"
    assert network.reached == f"for your own tools, and for whom the policy names at {SECURED_RENDEZVOUS}"
    said = Network.from_environment("router", connect, ("tls/0.0.0.0:7447",), meeting_point=True)
    assert (said.places, said.doors) == (("tls/127.0.0.1:7447",), ()), "an endpoint is a network of its own"
    assert said.reached == "at tls/0.0.0.0:7447"


def test_what_is_within_a_folder_is_of_the_inner_router_and_the_rest_of_the_door(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("ROBO_SECURITY", "/keys/r1")
    own, nodes = meeting.endpoint(), "unixsock-stream//run/r1/router.sock"
    router = Network.from_environment("router", (SITE,), meeting_point=True)
    inner, outer = door.parted(msgspec.structs.replace(router, name="r1", listen=(nodes, *router.listen)))
    assert inner == Network(name="r1", connect=(own,), listen=(nodes, own))
    assert (outer.connect, outer.listen) == ((SITE, nodes), (SECURED_RENDEZVOUS,))
    assert (outer.name, outer.security) == ("door of r1", "/keys/r1")


def test_a_tool_with_a_name_looks_for_its_own_and_then_at_the_door_of_tls(
    robot: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROBO_SECURITY", "/keys/ann")
    with socket.create_server(("127.0.0.1", 0)) as server:
        place = f"tls/127.0.0.1:{server.getsockname()[1]}"
        monkeypatch.setattr(whereabouts, "SECURED_RENDEZVOUS", place)
        assert whereabouts.of_tool((), 0.0).connect == (meeting.endpoint(),)
        robot.close()
        network = whereabouts.of_tool((), 0.0)
        assert (network.connect, network.security) == ((place,), "/keys/ann")
