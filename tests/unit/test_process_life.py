"""The life of a process, without a process: every phase and event, their mixtures, and what holds for all of them."""

from collections.abc import Callable, Iterator
from signal import Signals
from typing import Literal

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from robo.launch.plan import ProcessPlan, ReadyPlan, RestartPlan, StopPlan
from robo.supervisor.process_life import CANNOT_START, FINISHED, UP, Impossible, Phase, ProcessLife, Wish
from robo.supervisor.restart import Restarts
from robo.wire.reports import State
from tests.plans import node_plan

Policy = Literal["never", "on-failure", "always"]
POLICIES: list[Policy] = ["never", "on-failure", "always"]
NO_JITTER = RestartPlan(policy="on-failure", jitter=0.0)


class World:
    """A life whose time goes on when it is told to, and what it has done and said."""

    def __init__(self, plan: ProcessPlan | None = None, chance: Callable[[], float] = lambda: 0.0) -> None:
        self.now = 1000.0
        self.sent: list[Signals] = []
        self.shown: list[tuple[State, str]] = []
        self.moves = 0
        plan = plan if plan is not None else node_plan(restart=NO_JITTER)
        self.life = ProcessLife(plan, Restarts(plan.restart, chance), lambda: self.now, self)

    # What a life needs of its body.

    def send(self, number: Signals) -> None:
        if number is not Signals.SIGCONT:
            self.sent.append(number)

    def lacks(self) -> str:
        return "no sign"

    def moved(self) -> None:
        self.moves += 1

    def changed(self, before: State) -> None:
        assert before == (self.shown[-1][0] if self.shown else "starting")
        self.shown.append((self.life.state, self.life.reason))

    # Shorthands of tests.

    @property
    def states(self) -> list[State]:
        return [state for state, _ in self.shown]

    @property
    def left(self) -> float | None:
        """The time until the deadline, s."""
        return None if self.life.deadline is None else round(self.life.deadline - self.now, 6)

    def until_deadline(self) -> None:
        assert self.life.deadline is not None
        self.now = self.life.deadline
        self.life.elapsed()

    def start(self) -> "World":
        self.life.needs_are([])
        self.life.spawned()
        return self

    def become_ready(self) -> "World":
        self.start().life.became_ready()
        return self

    def crash(self, code: int = 1) -> None:
        self.life.exited(code, f"exit code {code}")


def in_phase(phase: Phase, plan: ProcessPlan | None = None) -> World:
    """A world whose life has come to a phase."""
    world = World(plan)
    life = world.life
    match phase:
        case Phase.WAITING:
            pass
        case Phase.SPAWNING:
            life.needs_are([])
        case Phase.STARTING:
            world.start()
        case Phase.READY:
            world.become_ready()
        case Phase.STANDBY:
            world.become_ready()
            life.stands_by("inactive")
        case Phase.FAILING:
            world.become_ready()
            life.hung("hangs")
        case Phase.RESTARTING:
            world.become_ready()
            life.restart_asked("as asked")
        case Phase.STOPPING:
            world.become_ready()
            life.stop_asked()
        case Phase.BACKING_OFF:
            world.become_ready()
            world.crash()
        case Phase.STOPPED:
            life.stop_asked()
        case Phase.FAILED:
            world.become_ready()
            life.restarts.plan = RestartPlan(policy="never")
            world.crash()
            life.restarts.plan = NO_JITTER
        case Phase.COMPLETED:
            world.become_ready()
            world.crash(0)
    assert life.phase is phase
    return world


# -- every event in every phase ------------------------------------------------------------------

EVENTS: dict[str, Callable[[ProcessLife], None]] = {
    "needs": lambda life: life.needs_are([]),
    "unmet": lambda life: life.needs_are(["base ready"]),
    "spawned": lambda life: life.spawned(),
    "no-child": lambda life: life.could_not_start("cannot be started"),
    "ready": lambda life: life.became_ready(),
    "standby": lambda life: life.stands_by("inactive"),
    "looked": lambda life: life.checked(None),
    "hung": lambda life: life.hung("hangs"),
    "elapsed": lambda life: life.elapsed(),
    "exited": lambda life: life.exited(1, "exit code 1"),
    "start": lambda life: life.start_asked(),
    "restart": lambda life: life.restart_asked("as asked"),
    "stop": lambda life: life.stop_asked(),
    "over": lambda life: life.run_ends(),
}

# A dot: ignored, or at least the phase stays. An exclamation mark: impossible.
TABLE = """
phase      needs    unmet spawned  no-child ready standby looked hung    elapsed exited  start      restart    stop     over
waiting    spawning .     !        !        .     .       .      .       !       !       .          .          stopped  .
spawning   .        .     starting backing  .     .       .      .       !       !       .          restarting stopping .
starting   .        .     !        !        ready standby .      .       failing backing .          restarting stopping .
ready      .        .     !        !        .     standby .      failing !       backing .          restarting stopping .
standby    .        .     !        !        ready .       .      failing !       backing .          restarting stopping .
failing    .        .     !        !        .     .       .      .       .       backing .          restarting stopping .
restarting .        .     .        waiting  .     .       .      .       .       waiting .          .          stopping stopping
stopping   .        .     .        stopped  .     .       .      .       .       stopped restarting restarting .        .
backing    .        .     !        !        .     .       .      .       waiting !       waiting    waiting    stopped  stopped
stopped    .        .     !        !        .     .       .      .       !       !       waiting    waiting    .        .
failed     .        .     !        !        .     .       .      .       !       !       waiting    waiting    .        .
completed  .        .     !        !        .     .       .      .       !       !       waiting    waiting    .        .
"""  # noqa: E501
PHASES = {phase.name.partition("_")[0].lower(): phase for phase in Phase}


def cells() -> Iterator[tuple[Phase, str, str]]:
    """Phase, event and what comes of it."""
    head, *rows = (line.split() for line in TABLE.strip().splitlines())
    assert head[1:] == list(EVENTS)
    assert [row[0] for row in rows] == list(PHASES)
    for row in rows:
        for event, then in zip(head[1:], row[1:], strict=True):
            yield PHASES[row[0]], event, then


@pytest.mark.parametrize(("phase", "event", "then"), list(cells()))
def test_every_event_in_every_phase(phase: Phase, event: str, then: str) -> None:
    world = in_phase(phase)
    life, sent = world.life, list(world.sent)
    if then == "!":
        with pytest.raises(Impossible, match=phase.name.lower()):
            EVENTS[event](life)
        assert life.phase is phase
        return
    EVENTS[event](life)
    assert life.phase is (phase if then == "." else PHASES[then])
    if event in ("start", "restart", "over", "stop") and phase not in UP:
        assert world.sent == sent, "what is being ended is not told from the beginning again"


def test_a_managed_node_may_stand_by_for_ever() -> None:
    world = World(node_plan(autostart=False, ready=ReadyPlan(timeout=5.0))).start()
    world.life.stands_by("unconfigured")
    assert world.left is None, "nobody knows when it is activated"
    world.life.stands_by("inactive")
    world.life.became_ready()
    world.life.stands_by("deactivating")
    assert world.shown == [
        ("standby", "unconfigured"),
        ("standby", "inactive"),
        ("ready", ""),
        ("standby", "deactivating"),
    ]


def test_a_node_that_hangs_while_it_stands_by_is_shown_or_ended() -> None:
    world = in_phase(Phase.STANDBY)
    world.life.hung("hangs")
    assert world.states[-1] == "degraded"
    assert world.sent == [Signals.SIGABRT]
    left_alone = in_phase(Phase.STANDBY, node_plan(restart=RestartPlan(policy="never")))
    left_alone.life.hung("hangs")
    assert left_alone.shown[-1] == ("degraded", "hangs")
    left_alone.life.stands_by("inactive")
    assert left_alone.shown[-1] == ("standby", "inactive")


@pytest.mark.parametrize("phase", list(Phase))
def test_once_the_run_ends_nothing_is_started_any_more(phase: Phase) -> None:
    world = in_phase(phase)
    life = world.life
    life.run_ends()
    ended = life.phase
    life.start_asked()
    life.restart_asked("changed")
    life.needs_are([])
    assert life.phase is ended
    assert not life.wanted
    if phase is Phase.SPAWNING:
        life.spawned()
        assert life.phase is Phase.STARTING, "it goes on until its turn to stop has come"
    if life.phase not in (Phase.WAITING, *FINISHED):
        life.exited(1, "exit code 1")
        assert (life.phase, life.state, life.reason) == (Phase.STOPPED, "stopped", "as asked")


# -- its start -----------------------------------------------------------------------------------


def test_what_waits_says_for_what() -> None:
    world = World()
    world.life.needs_are(["base ready", "router started"])
    world.life.needs_are(["base ready"])
    world.life.needs_are([])
    assert world.shown == [
        ("starting", "waits for base ready, router started"),
        ("starting", "waits for base ready"),
        ("starting", ""),
    ]
    assert world.life.starts == 0, "it has not been started before it is there"
    world.life.spawned()
    assert world.life.starts == 1


def test_what_is_not_ready_in_time_has_failed_whatever_its_exit_code() -> None:
    world = World(node_plan(restart=NO_JITTER, ready=ReadyPlan(timeout=3.0)))
    world.start()
    assert world.left == 3.0
    world.until_deadline()
    assert world.shown[-1] == ("degraded", "not ready within 3 s: no sign")
    assert world.sent == [Signals.SIGINT]
    world.life.became_ready()
    assert world.life.phase is Phase.FAILING, "too late"
    world.crash(0)
    assert world.shown[-1] == ("restarting", "not ready within 3 s: no sign; starting it again in 0.5 s")


def test_it_may_have_all_the_time_to_become_ready() -> None:
    assert World(node_plan(ready=ReadyPlan(timeout=0.0))).start().left is None


def test_a_program_that_is_not_there_has_failed_and_is_tried_again() -> None:
    world = World()
    world.life.needs_are([])
    world.life.could_not_start("cannot be started: no such file")
    assert world.life.blame == "cannot be started: no such file"
    assert world.shown[-1] == ("restarting", "cannot be started: no such file; starting it again in 0.5 s")
    never = World(node_plan())
    never.life.needs_are([])
    never.life.could_not_start("cannot be started: no such file")
    assert never.life.phase is Phase.FAILED
    assert CANNOT_START == 127


# -- its end -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("policy", "code", "words", "phase", "shown"),
    [
        ("never", 0, "exit code 0", Phase.COMPLETED, ("completed", "ended with exit code 0")),
        ("never", 3, "exit code 3", Phase.FAILED, ("failed", "ended with exit code 3")),
        ("never", -11, "killed by SIGSEGV", Phase.FAILED, ("failed", "was killed by SIGSEGV")),
        ("on-failure", 0, "exit code 0", Phase.COMPLETED, ("completed", "ended with exit code 0")),
        (
            "on-failure",
            -9,
            "killed by SIGKILL, most likely by the kernel",
            Phase.BACKING_OFF,
            ("restarting", "was killed by SIGKILL, most likely by the kernel; starting it again in 0.5 s"),
        ),
        (
            "always",
            0,
            "exit code 0",
            Phase.BACKING_OFF,
            ("restarting", "ended with exit code 0; starting it again in 0.5 s"),
        ),
    ],
)
def test_an_end_by_policy(policy: Policy, code: int, words: str, phase: Phase, shown: tuple[State, str]) -> None:
    world = World(node_plan(restart=RestartPlan(policy=policy, jitter=0.0)))
    world.become_ready()
    assert world.life.unasked
    world.life.exited(code, words)
    assert world.life.phase is phase
    assert world.shown[-1] == shown
    assert world.life.finished == (phase is not Phase.BACKING_OFF)
    assert world.life.down == (phase is Phase.FAILED)


def test_a_crash_loop_is_slowed_down_and_ends_in_a_storm() -> None:
    plan = RestartPlan(policy="on-failure", delay=0.1, max=2, max_delay=0.5, jitter=0.0)
    world = World(node_plan(restart=plan))
    waits = []
    for _ in range(4):
        world.start().crash()
        waits.append(world.left)
        world.until_deadline()
    assert waits == [0.1, 0.2, 0.5, 0.5]
    storm = ("degraded", "ended with exit code 1, more than 2 times in 60 s; next try in 0.5 s")
    assert world.shown[-1] == storm
    world.start()
    world.crash()
    assert world.life.down


def test_what_comes_back_from_a_storm_is_degraded_until_it_has_proved_itself() -> None:
    plan = RestartPlan(policy="on-failure", max=0, reset_after=10.0, jitter=0.0)
    world = World(node_plan(restart=plan))
    world.start().crash()
    world.until_deadline()
    world.become_ready()
    assert world.shown[-1] == ("degraded", "back, but not yet for 10 s")
    assert not world.life.down, "it runs"
    world.now += 9.9
    world.life.checked("a promise is broken", "hangs: nothing comes")
    assert world.life.phase is Phase.READY
    assert world.shown[-1] == ("degraded", "back, but not yet for 10 s")
    world.now += 0.1
    world.life.checked(None)
    assert world.shown[-1] == ("ready", "")
    world.crash()
    assert world.left == 30.0, "one more is a storm again where none is allowed"


def test_a_healthy_time_lets_delays_begin_anew() -> None:
    world = World()
    for expected in (0.5, 1.0, 2.0):
        world.become_ready().crash()
        assert world.left == expected
        world.until_deadline()
    world.become_ready()
    world.now += 10.0
    world.life.checked(None)
    world.crash()
    assert world.left == 0.5
    assert world.life.restarts.count == 4


def test_chance_shortens_a_delay() -> None:
    world = World(node_plan(restart=RestartPlan(policy="always", delay=2.0, jitter=0.5)), chance=lambda: 0.5)
    world.become_ready().crash()
    assert world.left == 1.5


# -- what hangs ----------------------------------------------------------------------------------


def test_what_hangs_is_asked_where_and_killed_and_its_policy_takes_over() -> None:
    world = in_phase(Phase.READY)
    world.life.hung("hangs: no sign of life for 1.0 s")
    assert world.shown[-1] == ("degraded", "hangs: no sign of life for 1.0 s")
    assert (world.sent, world.left) == ([Signals.SIGABRT], 1.0)
    world.until_deadline()
    assert (world.sent, world.left) == ([Signals.SIGABRT, Signals.SIGKILL], None)
    assert not world.life.unasked, "no hint at the kernel"
    world.life.exited(-9, "killed by SIGKILL")
    assert world.life.blame == "hangs: no sign of life for 1.0 s"
    assert world.shown[-1] == ("restarting", "hangs: no sign of life for 1.0 s; starting it again in 0.5 s")
    world.until_deadline()
    world.start()
    assert world.life.blame == "", "the next child is not to blame"


@pytest.mark.parametrize(("required", "phase"), [(False, Phase.READY), (True, Phase.FAILING)])
def test_what_would_not_come_back_is_left_alone_unless_the_run_needs_it(required: bool, phase: Phase) -> None:
    world = in_phase(Phase.READY, node_plan(required=required))
    world.life.hung("hangs")
    assert world.life.phase is phase
    assert world.shown[-1] == ("degraded", "hangs")
    if phase is Phase.READY:
        world.life.checked(None)
        assert world.shown[-1] == ("ready", ""), "it is forgiven"


def test_a_promise_that_is_kept_badly_is_shown_and_no_more() -> None:
    world = in_phase(Phase.READY)
    world.life.checked("odom comes at 3.0 Hz")
    world.life.checked("odom comes at 3.0 Hz")
    world.life.checked(None)
    assert world.shown[-2:] == [("degraded", "odom comes at 3.0 Hz"), ("ready", "")]
    world.life.checked("nothing on odom for 5.1 s", "hangs: nothing on odom for 5.1 s")
    assert world.shown[-2:] == [
        ("degraded", "nothing on odom for 5.1 s"),
        ("degraded", "hangs: nothing on odom for 5.1 s"),
    ]
    assert world.life.phase is Phase.FAILING


# -- commands and their mixtures -----------------------------------------------------------------


def test_a_stop_asks_and_then_insists() -> None:
    world = in_phase(Phase.READY, node_plan(stop=StopPlan(signal="TERM", timeout=4.0)))
    world.life.stop_asked()
    assert (world.sent, world.left) == ([Signals.SIGTERM], 4.0)
    world.until_deadline()
    assert (world.sent, world.left) == ([Signals.SIGTERM] * 2, 2.0)
    world.until_deadline()
    assert (world.sent, world.left) == ([Signals.SIGTERM] * 2 + [Signals.SIGKILL], None)
    world.life.exited(-9, "killed by SIGKILL")
    assert world.shown[-2:] == [("stopping", ""), ("stopped", "as asked")]


def test_a_stop_while_the_child_is_on_its_way_reaches_it_as_soon_as_it_is_there() -> None:
    world = in_phase(Phase.SPAWNING)
    world.life.stop_asked()
    assert (world.sent, world.left) == ([], None)
    world.life.spawned()
    assert (world.sent, world.left) == ([Signals.SIGINT], 1.0)
    world.life.became_ready()
    world.life.exited(-2, "killed by SIGINT")
    assert world.life.phase is Phase.STOPPED
    assert world.life.starts == 0, "nobody who needs it has seen it"


def test_a_restart_while_the_child_is_on_its_way_makes_another_one() -> None:
    world = in_phase(Phase.SPAWNING)
    world.life.restart_asked("changed: a.py")
    world.life.spawned()
    assert world.sent == [Signals.SIGINT]
    world.life.exited(0, "exit code 0")
    world.start()
    assert world.life.phase is Phase.STARTING
    assert world.states == ["restarting", "starting"]


def test_the_last_word_counts() -> None:
    world = in_phase(Phase.READY)
    life = world.life
    life.restart_asked("as asked")
    life.stop_asked()
    life.start_asked()
    life.stop_asked()
    assert world.sent == [Signals.SIGINT], "told once"
    life.exited(0, "exit code 0")
    assert life.phase is Phase.STOPPED
    life.needs_are([])
    assert life.finished, "nobody wants it"
    life.start_asked()
    world.start()
    assert life.starts == 2


def test_what_has_failed_may_be_stopped_and_is_then_not_wanted_but_shown_as_it_was() -> None:
    world = in_phase(Phase.FAILED)
    world.life.stop_asked()
    assert (world.life.wish, world.life.state) == (Wish.STOP, "failed")
    world.life.start_asked()
    assert world.life.wanted


def test_a_stop_of_what_hangs_does_not_begin_from_the_first_signal() -> None:
    world = in_phase(Phase.FAILING)
    world.now += 0.4
    world.life.stop_asked()
    assert (world.sent, world.left) == ([Signals.SIGABRT], 0.6)
    world.until_deadline()
    assert world.sent == [Signals.SIGABRT, Signals.SIGKILL]
    world.life.exited(-9, "killed by SIGKILL")
    assert world.shown[-1] == ("stopped", "as asked")
    assert world.life.blame == "hangs", "why it was killed is still told"


def test_a_restart_counts_once_however_often_it_is_asked_for() -> None:
    world = in_phase(Phase.READY)
    world.life.restart_asked("changed: a.py")
    world.life.restart_asked("changed: b.py")
    assert world.life.restarts.count == 1
    assert world.shown[-1] == ("restarting", "changed: a.py")
    world.life.exited(0, "exit code 0")
    world.become_ready()
    assert world.states[-3:] == ["restarting", "starting", "ready"]


def test_a_restart_is_no_failure() -> None:
    world = in_phase(Phase.READY)
    for _ in range(20):
        world.life.restart_asked("as asked")
        world.crash(-9)
        world.become_ready()
    assert not world.life.restarts.storm
    assert world.life.state == "ready"


def test_a_command_ends_a_delay() -> None:
    world = in_phase(Phase.BACKING_OFF)
    world.life.restart_asked("as asked")
    assert world.left is None
    world.become_ready()
    assert world.life.restarts.count == 1, "the delay had counted it"


def test_another_plan_holds_from_the_next_start_on() -> None:
    world = in_phase(Phase.READY)
    world.life.plan = node_plan(ready=ReadyPlan(timeout=7.0))
    world.life.restart_asked("changed")
    world.crash(0)
    assert world.start().left == 7.0


# -- what holds whatever happens -----------------------------------------------------------------

CHILD_COMING = {Phase.SPAWNING, Phase.STOPPING, Phase.RESTARTING}
CHILD_THERE = {*UP, Phase.FAILING, Phase.STOPPING, Phase.RESTARTING}
SHOWN: dict[Phase, set[State]] = {
    Phase.SPAWNING: {"starting"},
    Phase.STARTING: {"starting"},
    Phase.READY: {"ready", "degraded"},
    Phase.STANDBY: {"standby", "degraded"},
    Phase.FAILING: {"degraded"},
    Phase.RESTARTING: {"restarting"},
    Phase.STOPPING: {"stopping"},
    Phase.BACKING_OFF: {"restarting", "degraded"},
    Phase.STOPPED: {"stopped"},
    Phase.FAILED: {"failed"},
    Phase.COMPLETED: {"completed"},
}


class AnyLife(RuleBasedStateMachine):
    """A life and a child that does what it likes, at any time."""

    world: World
    child: Literal["coming", "there"] | None
    must_end: bool
    """Whether the child has been asked to end, or told why it has to."""
    over: bool
    """Whether the run ends."""
    delayed_until: float | None
    """Before when nothing but a command may start a child."""

    @initialize(
        policy=st.sampled_from(POLICIES),
        required=st.booleans(),
        timeout=st.sampled_from([0.0, 2.0]),
        delay=st.floats(0, 10),
        max_delay=st.floats(0, 60),
        allowed=st.integers(0, 4),
        chance=st.floats(0, 1),
    )
    def begin(
        self,
        policy: Policy,
        required: bool,
        timeout: float,
        delay: float,
        max_delay: float,
        allowed: int,
        chance: float,
    ) -> None:
        restart = RestartPlan(policy=policy, delay=delay, max_delay=max_delay, max=allowed)
        plan = node_plan(restart=restart, required=required, ready=ReadyPlan(timeout=timeout))
        self.world = World(plan, lambda: chance)
        self.child = None
        self.must_end = False
        self.over = False
        self.delayed_until = None

    @property
    def life(self) -> ProcessLife:
        return self.world.life

    @precondition(lambda self: self.life.phase is Phase.WAITING)
    @rule(met=st.sampled_from([True, True, False]))
    def needs(self, met: bool) -> None:
        self.life.needs_are([] if met else ["base ready"])
        if self.life.phase is Phase.SPAWNING:
            assert self.child is None, "there is never more than one child"
            assert not self.over, "nothing starts once the run ends"
            assert self.delayed_until is None or self.world.now >= self.delayed_until, "no start before its time"
            self.child, self.delayed_until, self.must_end = "coming", None, False

    @precondition(lambda self: self.child == "coming")
    @rule(works=st.booleans())
    def child_comes(self, works: bool) -> None:
        if works:
            self.child = "there"
            self.life.spawned()
        else:
            self.child = None
            self.life.could_not_start("cannot be started")
            self.note_delay()

    @precondition(lambda self: self.child == "there")
    @rule(code=st.sampled_from([0, 1, -9]))
    def child_ends(self, code: int) -> None:
        self.child = None
        self.life.exited(code, f"exit code {code}")
        self.note_delay()

    def note_delay(self) -> None:
        if self.life.phase is Phase.BACKING_OFF:
            assert self.life.deadline is not None
            plan = self.life.plan.restart
            delay = self.life.deadline - self.world.now
            assert 0 <= delay <= max(plan.delay, plan.max_delay) + 1e-9, "no delay is longer than is said"
            self.delayed_until = self.life.deadline

    @precondition(lambda self: self.child == "there")
    @rule()
    def child_is_ready(self) -> None:
        self.life.became_ready()

    @precondition(lambda self: self.child == "there")
    @rule(state=st.sampled_from(["unconfigured", "inactive"]))
    def child_stands_by(self, state: str) -> None:
        self.life.stands_by(state)

    @precondition(lambda self: self.life.phase is Phase.STANDBY)
    @rule()
    def child_hangs_while_it_stands_by(self) -> None:
        self.life.hung("hangs")

    @precondition(lambda self: self.life.phase is Phase.READY)
    @rule(problem=st.sampled_from([None, "a promise"]), hang=st.sampled_from([None, "hangs"]))
    def look(self, problem: str | None, hang: str | None) -> None:
        self.life.checked(problem, hang)

    @precondition(lambda self: self.life.deadline is not None)
    @rule(seconds=st.floats(0, 100))
    def time_passes(self, seconds: float) -> None:
        end = self.world.now + seconds
        while self.life.deadline is not None and self.life.deadline <= end:
            self.world.until_deadline()
        self.world.now = end

    @rule(command=st.sampled_from(["start", "restart"]))
    def ask_to_run(self, command: str) -> None:
        if command == "start":
            self.life.start_asked()
        else:
            self.life.restart_asked("as asked")
            self.must_end = self.must_end or not self.over
        if not self.over:
            assert self.life.wanted
            self.delayed_until = None

    @rule()
    def ask_to_stop(self) -> None:
        self.life.stop_asked()
        assert not self.life.wanted
        self.delayed_until, self.must_end = None, True

    @rule(chance=st.integers(0, 9))
    def end_run(self, chance: int) -> None:
        if chance != 5:
            return  # after it not much happens
        self.life.run_ends()
        self.over, self.delayed_until = True, None

    @invariant()
    def no_impossible_state(self) -> None:
        if not hasattr(self, "world"):
            return
        life, phase = self.life, self.life.phase
        if self.child is None:
            assert phase not in CHILD_COMING | CHILD_THERE
        else:
            assert phase in (CHILD_COMING if self.child == "coming" else CHILD_THERE)
            self.must_end = self.must_end or phase is Phase.FAILING
            assert not (self.must_end and phase in UP), "what is to end does not come back"
        assert life.state in SHOWN.get(phase, {life.state})
        assert (life.state, life.reason) == (self.world.shown[-1] if self.world.shown else ("starting", ""))
        assert life.deadline is None or life.deadline >= self.world.now, "no deadline is forgotten"
        assert phase is not Phase.BACKING_OFF or life.deadline is not None, "no delay lasts for ever"
        assert not (phase in (Phase.STOPPING, Phase.STOPPED) and life.wanted)
        assert not (phase in (Phase.RESTARTING, Phase.BACKING_OFF) and not life.wanted)
        assert life.wish is Wish.END or not self.over

    def teardown(self) -> None:
        """Every stop ends, with a child that obeys nothing but SIGKILL."""
        if not hasattr(self, "world"):
            return
        world, life = self.world, self.life
        if self.child == "coming":
            life.stop_asked()
            life.spawned()
            self.child = "there"
        life.stop_asked()
        begun = world.now
        while life.deadline is not None:
            world.until_deadline()
        if self.child == "there":
            assert world.sent[-1] is Signals.SIGKILL
            assert world.now - begun <= 1.5 * life.plan.stop.timeout + 1e-6
            life.exited(-9, "killed by SIGKILL")
        assert life.finished


TestAnyLife = AnyLife.TestCase
TestAnyLife.settings = settings(max_examples=100, stateful_step_count=50, deadline=None)
