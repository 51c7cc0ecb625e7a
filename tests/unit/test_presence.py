"""A run among others on the network: which tokens are its own, and who gives way; without a network."""

import asyncio

import pytest

from robo.errors import NetworkError
from robo.supervisor.changes import Changes
from robo.supervisor.presence import Presence
from robo.wire import claims
from robo.wire.claims import Claim, Name
from robo.wire.discovery import hostname
from robo.wire.keys import ClaimToken, EndpointToken, NodeToken, SupervisorToken
from robo.wire.network import Network
from robo.wire.qos import QoS
from tests.processes import FakeJournal, FakeProcess, FakeStopping, process_plan
from tests.virtual_time import run

OWN, EARLIER, LATER = "5-run", "4-run", "6-run"
ADVICE = "; stop it with `robo down` or choose another --robot-name"


class Taken(Claim):
    """A claim that finds what it is told to find."""

    found: list[Name] | NetworkError
    gathering = 0.0

    def take(self) -> list[Name]:
        if isinstance(self.found, NetworkError):
            raise self.found
        return self.found

    def gathers_for(self) -> float:
        return self.gathering


class Desk:
    """Run 5 of robot r1, with nodes base and lidar."""

    def __init__(self, found: list[Name] | NetworkError | None = None) -> None:
        self.processes = {f"/r1/{name}": FakeProcess(process_plan(f"/r1/{name}")) for name in ("base", "lidar")}
        self.journal, self.stopping = FakeJournal(), FakeStopping()
        claim = Taken(Network(mode="router"), "r1", self.processes, OWN)
        claim.found = found if found is not None else []
        self.claim = claim
        self.changes = Changes()
        self.presence = Presence("r1", "", claim, self.processes, self.changes, self.journal, self.stopping)

    def __getitem__(self, name: str) -> FakeProcess:
        return self.processes[f"/r1/{name}"]

    def hear(self, key: str, *, there: bool = True) -> bool:
        """A token comes or goes. Returns whether that means anything to the run."""
        work = self.presence.reaction(key, there=there)
        if work is not None:
            work()
        return work is not None

    def settle(self) -> None:
        """Others see the tokens of the run from now on."""
        asyncio.run(self.presence.settle())


def node(name: str, run: str = OWN, pid: int = 100, host: str | None = None) -> str:
    namespace, _, word = name.strip("/").rpartition("/")
    return NodeToken(namespace, word, "Base", pid, host or hostname(), run).key()


def claimed(name: str, run: str) -> str:
    return ClaimToken("r1", name, "other", 200, "pi", run).key()


# -- whose a node's token is ---------------------------------------------------------------------


def test_a_token_of_the_run_is_a_sign_of_its_process() -> None:
    desk = Desk()
    desk.hear(node("/r1/base", pid=41))
    assert desk["base"].tokens == [41], "even before its start is known"
    desk.hear(node("/r1/base", pid=42, host="pi"))
    assert desk["base"].tokens == [41, 42], "its process may be in a container of another name"
    assert desk["lidar"].tokens == []
    assert desk.journal.warned == []


def test_a_process_cannot_stand_for_another_of_the_run() -> None:
    desk = Desk()
    desk["lidar"].family = {41}
    desk.settle()
    desk.hear(node("/r1/base", pid=41))
    assert desk["base"].tokens == []
    assert desk.journal.warned == [f"another /r1/base has come up (process 41 on {hostname()})"]


def test_what_has_lost_the_runs_id_is_known_by_its_process() -> None:
    desk = Desk()
    desk["base"].family = {41}
    desk.hear(node("/r1/base", run="", pid=41))
    assert desk["base"].tokens == [41]
    desk.settle()
    desk.hear(node("/r1/base", run="", pid=77))
    desk.hear(node("/r1/base", run="", pid=41, host="pi"))
    assert desk["base"].tokens == [41]
    assert desk.journal.warned == [
        f"another /r1/base has come up (process 77 on {hostname()})",
        "another /r1/base has come up (process 41 on pi)",
    ]


# -- nodes of others -----------------------------------------------------------------------------


def test_a_node_of_others_is_there_until_the_last_of_its_tokens_has_gone() -> None:
    desk = Desk()
    first, second = node("/r2/cam", "7-run"), node("/r2/cam", "8-run")
    desk.hear(first)
    desk.hear(second)
    assert "/r2/cam" in desk.presence.elsewhere
    desk.hear(first, there=False)
    assert "/r2/cam" in desk.presence.elsewhere
    desk.hear(second, there=False)
    desk.hear(second, there=False)
    assert desk.presence.elsewhere == {}, "strangers make up names without end"


def test_whoever_waits_for_a_node_of_others_looks_again_when_it_comes() -> None:
    desk = Desk()

    async def wait() -> None:
        asyncio.get_running_loop().call_later(3.0, desk.hear, node("/r2/cam", "7-run"))
        await desk.changes.until(lambda: "/r2/cam" in desk.presence.elsewhere)

    run(wait())


# -- who gives way -------------------------------------------------------------------------------


def test_of_two_that_begin_at_once_the_later_gives_way() -> None:
    for key in (claimed("base", EARLIER), node("/r1/base", EARLIER, host="pi")):
        desk = Desk()
        desk.hear(key)
        assert desk.stopping.codes == [1]
        assert len(desk.journal.warned) == 1
        assert desk.journal.warned[0].startswith("/r1/base runs already (process ")
        assert desk.journal.warned[0].endswith(ADVICE)
    desk = Desk()
    desk.hear(claimed("base", LATER))
    assert desk.stopping.codes == []
    assert desk.journal.warned == []


def test_a_run_whose_names_others_see_gives_way_to_nobody() -> None:
    desk = Desk()
    desk.settle()
    desk.hear(claimed("base", EARLIER))
    desk.hear(node("/r1/base", EARLIER, host="pi"))
    assert desk.stopping.codes == []
    assert desk.journal.warned == ["another /r1/base has come up (process 100 on pi)"]


def test_a_run_that_began_while_robots_linked_anew_gives_way_to_who_was_there_before() -> None:
    desk = Desk()
    desk.claim.gathering = 60.0
    desk.settle()
    desk.hear(claimed("lidar", LATER))
    desk.hear(node("/r1/lidar", run="", host="pi"))
    assert desk.stopping.codes == [], "who began later gives way, and what is of no run began nobody knows when"
    for key in (claimed("base", EARLIER), claimed("lidar", EARLIER), node("/r1/base", EARLIER, host="pi")):
        desk.hear(key)
    assert desk.stopping.codes == [1]
    assert desk.journal.warned == [
        "another /r1/lidar has come up (process 100 on pi)",
        f"/r1/base runs already (process 200 on pi, robot other){ADVICE}",
    ]


def test_a_run_that_is_there_for_long_gives_way_to_nobody_while_robots_link_anew() -> None:
    desk = Desk()
    desk.settle()
    desk.claim.gathering = 60.0
    desk.hear(claimed("base", EARLIER))
    assert desk.stopping.codes == [], "a clock may have been put back"


def test_claims_of_its_own_and_of_other_names_concern_nobody() -> None:
    desk = Desk()
    desk.hear(claimed("base", OWN))
    desk.hear(claimed("camera", EARLIER))
    assert desk.stopping.codes == []
    assert desk.journal.warned == []


# -- what means nothing --------------------------------------------------------------------------


def test_what_spells_no_token_is_told_once_and_shortened() -> None:
    desk = Desk()
    assert desk.hear("@robo/" + "x" * 1000)
    assert desk.hear("@robo/nonsense/of/another/kind/altogether")
    assert len(desk.journal.warned) == 1
    assert desk.journal.warned[0].startswith("ignoring a liveliness token that means nothing here, and others like it")
    assert len(desk.journal.warned[0]) < 250


@pytest.mark.parametrize(
    "key",
    [
        EndpointToken("r1", "base", "pub", "geometry/Twist", QoS(depth=1), "r1/cmd_vel").key(),
        SupervisorToken("r1", 17, "pi").key(),
    ],
)
def test_tokens_of_others_kinds_are_no_concern_of_the_loop(key: str) -> None:
    assert not Desk().hear(key)
    assert not Desk().hear(key, there=False)
    assert not Desk().hear("@robo/nonsense", there=False)


# -- before the start ----------------------------------------------------------------------------


def may_start(desk: Desk) -> bool:
    return asyncio.run(desk.presence.may_start())


def test_a_run_starts_where_nobody_has_its_names() -> None:
    desk = Desk()
    assert may_start(desk)
    assert desk.stopping.codes == []


def test_a_run_whose_names_others_have_does_not_start() -> None:
    desk = Desk([ClaimToken("r1", "base", "other", 200, "pi", EARLIER)])
    assert not may_start(desk)
    assert desk.stopping.codes == [1]
    assert desk.journal.warned == [f"/r1/base runs already (process 200 on pi, robot other){ADVICE}"]


def test_a_port_that_another_program_holds_is_told_line_by_line() -> None:
    desk = Desk(claims.PortTaken("port 7447 is taken\n  stop that program"))
    assert not may_start(desk)
    assert desk.stopping.codes == [1]
    assert desk.journal.warned == ["port 7447 is taken", "  stop that program"]


def test_without_a_network_a_name_is_free() -> None:
    desk = Desk()
    assert asyncio.run(desk.presence.claim("/r1/new")) is None
    desk.presence.release("/r1/new")
    asyncio.run(desk.presence.leave())
