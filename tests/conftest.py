"""Everything that tests send stays on free ports of loopback."""

import signal
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import hypothesis
import pytest
import zenoh

from robo.wire import tcp, zenoh_threads
from robo.wire.network import Network
from robo.wire.session import close_session, open_session
from robo.wire.tcp import HeldPort
from tests.support import Desk, eventually

# A program that a script has started in the background ignores SIGINT, and so would all that tests start.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
# And one that nohup has started ignores a terminal that goes.
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

# How long an example takes says more of the machine than of the code. A run tries the examples of the run before, so
# that what fails has come with a change; new ones are looked for by --hypothesis-profile=search.
hypothesis.settings.register_profile("robo", deadline=None, derandomize=True)
hypothesis.settings.register_profile("search", deadline=None)
hypothesis.settings.load_profile("robo")


INTEL_LOG = Path(__file__).parents[2] / "shared" / "data" / "intel.log.gz"


@pytest.fixture(scope="session")
def intel_log() -> Path:
    """The log of a real robot, which is not part of this repository."""
    if not INTEL_LOG.exists():
        pytest.skip(f"the log of a real robot is not there: {INTEL_LOG}")
    return INTEL_LOG


@pytest.fixture(autouse=True, scope="session")
def _places_of_their_own(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Robots that tests start keep their logs apart from the user's, and do not meet his."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        patch.setenv("ROBO_MEETING", str(tmp_path_factory.mktemp("meeting")))
        # Where flight recorders have their last seconds: one finds what another has left.
        patch.setenv("XDG_RUNTIME_DIR", str(tmp_path_factory.mktemp("runtime")))
        yield


@pytest.fixture(autouse=True, scope="session")
def _threads_for_linked_sessions() -> None:
    """Sessions that link within one process share its receiving threads, which are as many as the first one asks for.

    By the one thread of a node a large answer would wait for its own reader. Processes that tests start have theirs.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(zenoh_threads.VARIABLE, zenoh_threads.OF_A_ROUTER)
        close_session(open_session(Network(mode="peer")))


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[Desk]:
    """A folder and a network of its own, where commands work as printed."""
    with closing(Desk(tmp_path)) as made:
        yield made


@pytest.fixture
def endpoint() -> str:
    """A Zenoh endpoint on loopback that nobody listens on."""
    return f"tcp/127.0.0.1:{free_port()}"


def wait_until_listened_at(endpoint: str) -> None:
    """A router's session is open a moment before it listens."""
    eventually(lambda: tcp.cannot_listen(endpoint) is not None, f"somebody listens at {endpoint}")


@pytest.fixture
def session(endpoint: str) -> Iterator[zenoh.Session]:
    """The meeting point of a test's own network: a router."""
    opened = open_session(Network(mode="router", listen=(endpoint,)))
    wait_until_listened_at(endpoint)
    yield opened
    close_session(opened)


@pytest.fixture
def other(session: zenoh.Session, endpoint: str) -> Iterator[zenoh.Session]:
    """Another party on the same network."""
    del session  # it has to be there first
    opened = open_session(Network(mode="peer", connect=(endpoint,)))
    yield opened
    close_session(opened)


_held: list[HeldPort] = []


@pytest.fixture(autouse=True)
def _ports_of_a_test() -> Iterator[None]:
    """A test's ports are its own until all is over that it has started."""
    yield
    while _held:
        _held.pop().close()


def free_port() -> int:
    """A TCP port on loopback that nobody gets unasked while the test goes on."""
    _held.append(HeldPort())
    return _held[-1].number
