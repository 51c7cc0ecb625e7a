"""Sums up for a robot what its nodes say of how well they do: ROS's diagnostic_aggregator without its configuration."""

from collections.abc import Callable
from typing import Annotated

from msgspec import Meta, field

import robo
from robo import READ_ONLY, MessageInfo, Node, Publisher, Unit, subscribe
from robo_messages import DiagnosticArray, DiagnosticStatus, Header
from robo_services.arrivals import Arrivals
from robo_services.diagnostics import ERROR, OK, Ledger, State, state_of, summed_up, told

TOLD_EVERY = 60.0
"""How often statuses that are left out are told of, s."""


class DiagnosticAggregator(Node):
    """Sum up what nodes say of how well they do, and tell when that changes. All times are of the wall clock."""

    class Parameters(robo.Parameters):
        """How it sums up."""

        pub_rate: Annotated[float, Meta(ge=0.1, le=100, description="sums per second"), Unit("Hz")] = 1.0
        timeout: Annotated[
            float, Meta(ge=0.1, le=3600, description="what has said nothing for longer is stale"), Unit("s")
        ] = 5.0
        discard_stale: Annotated[bool, Meta(description="forget what is stale, instead of telling of it")] = False
        namespaces: Annotated[
            list[str],
            Meta(description="whose nodes are summed up too: arm below its own namespace, /r2 of another robot"),
            READ_ONLY,
        ] = field(default_factory=list)

    parameters: Parameters

    sums = Publisher(DiagnosticArray, "diagnostics_agg")
    """Every check by its path, `/r1/base/battery`, and above it every node and namespace."""
    state = Publisher(DiagnosticStatus, "diagnostics_toplevel_state")
    """The worst of it."""

    def on_start(self) -> None:
        """Nobody has said anything yet."""
        self._ledger = Ledger()
        self._arrivals = Arrivals(unstamped=True)
        self._wall = self.clock.wall
        self._last: State | None = None
        for name in self.parameters.namespaces:
            topic = f"{name.rstrip('/')}/diagnostics"
            namespace = self.resolve(topic).rpartition("/")[0]
            self.create_subscription(DiagnosticArray, topic, self._taker(namespace), depth=1000)
        self.create_timer(lambda: 1.0 / self.parameters.pub_rate, self.sum_up, self._wall)

    @subscribe("diagnostics", depth=1000)
    def on_report(self, report: DiagnosticArray, info: MessageInfo) -> None:
        """Take in what a node says of itself."""
        self._take(self.namespace, report, info)

    def _taker(self, namespace: str) -> Callable[[DiagnosticArray, MessageInfo], None]:
        """What takes in the reports of a namespace."""

        def take(report: DiagnosticArray, info: MessageInfo) -> None:
            self._take(namespace, report, info)

        return take

    def _take(self, namespace: str, report: DiagnosticArray, info: MessageInfo) -> None:
        now = self._wall.monotonic()
        self._ledger.take(report.status, namespace, self._arrivals.sent(info, now, now))

    def sum_up(self) -> None:
        """Publish the sums, and tell in the log where something has changed."""
        now, p = self._wall.monotonic(), self.parameters
        self._arrivals.tick(now, 1.0 / p.pub_rate)
        if p.discard_stale:
            self._ledger.forget(now - p.timeout)
        present = self._ledger.present(now, p.timeout)
        state = state_of(present)
        self.sums.publish(DiagnosticArray(Header(self._wall.now()), summed_up(present)))
        self.state.publish(DiagnosticStatus(state.level, "toplevel_state", state.message))
        if present and (self._last is None or (state.level, state.bad) != (self._last.level, self._last.bad)):
            self._tell(state)
        if self._ledger.left_out:
            text = "left out %d statuses so far: there are too many checks"
            self.logger.warning(text, self._ledger.left_out, throttle=TOLD_EVERY)

    def _tell(self, state: State) -> None:
        tell = {OK: self.logger.info, ERROR: self.logger.error}.get(state.level, self.logger.warning)
        tell("%s", told(state))
        self._last = state


if __name__ == "__main__":
    robo.run(DiagnosticAggregator)
