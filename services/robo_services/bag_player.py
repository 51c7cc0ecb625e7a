"""Plays a recording."""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

import robo
from robo import READ_ONLY, Node, ParameterError, Unit
from robo.bag.of_robot import robots_of
from robo.bag.opening import open_bag
from robo.bag.read.reader import Bag
from robo.errors import BagError, InvalidName, UsageError
from robo.recording.play.outputs import ClockOutput, Outputs
from robo.recording.play.player import Player
from robo.recording.play.services import PlayerServices
from robo.recording.play.tape import BagTape, Window
from robo.recording.play.timeline import SLOWEST, SLOWEST_CLOCK
from robo.recording.play.topics import CLOCK, Choice, Played, select
from robo.wire.discovery import tokens
from robo.wire.keys import EndpointToken


class BagPlayer(Node):
    """Play a recording, and end with it.

    Topics of the robot that was recorded become those of this node's namespace, and its remappings hold for them.
    Others pause it, jump and so on by services below its name, as those of `robo bag play`.
    """

    class Parameters(robo.Parameters):
        """What to play, and how fast."""

        file: Annotated[str, Meta(description="the recording: MCAP, or a folder of its files"), READ_ONLY] = ""
        rate: Annotated[
            float,
            Meta(ge=0, le=1e6, description="1.0 as recorded, 2.0 twice as fast, 0 as fast as nothing is lost"),
            READ_ONLY,
        ] = 1.0
        delay: Annotated[
            float,
            Meta(ge=0, le=86_400, description="wait before the first message, for others to tune in"),
            Unit("s"),
            READ_ONLY,
        ] = 0.0
        start: Annotated[
            str,
            Meta(description="from then on: s from the beginning, or else a time as for robo bag play; empty: all"),
            READ_ONLY,
        ] = ""
        end: Annotated[str, Meta(description="before then, as start; empty: all"), READ_ONLY] = ""
        duration: Annotated[float, Meta(ge=0, le=1e9, description="so much of it; 0: all"), Unit("s"), READ_ONLY] = 0.0
        order: Annotated[
            Literal["arrived", "published"],
            Meta(description="by the times at which messages came, or were published"),
            READ_ONLY,
        ] = "arrived"
        loop: Annotated[bool, Meta(description="begin again at the end"), READ_ONLY] = False
        start_paused: Annotated[bool, Meta(description="begin with a pause"), READ_ONLY] = False
        topics: Annotated[
            list[str],
            Meta(description="only these; * and ** match; empty: all but what nodes say of themselves"),
            READ_ONLY,
        ] = msgspec.field(default_factory=list)
        exclude: Annotated[list[str], Meta(description="not these"), READ_ONLY] = msgspec.field(default_factory=list)
        publish_clock: Annotated[
            bool,
            Meta(description="publish /clock: time is that of the recording, for nodes with use_sim_time"),
            READ_ONLY,
        ] = False
        clock_rate: Annotated[
            float,
            Meta(ge=0, le=1000, description="publish it so often too, at least each 10 s; 0: with messages alone"),
            Unit("Hz"),
            READ_ONLY,
        ] = 0.0

    parameters: Parameters

    _bag: Bag | None = None
    _player: Player | None = None

    def on_start(self) -> None:
        """Open the recording, so that a wrong name is told at once."""
        p = self.parameters
        if not p.file:
            raise ParameterError(f"{self.full_name}: file names no recording; give it with -p file:=FILE")
        self.clock = self.clock.wall  # who says the time does not wait for it
        recording = self._bag = open_bag(p.file)
        try:
            self._prepare(recording)
        except BaseException:
            recording.close()
            raise

    def _prepare(self, recording: Bag) -> None:
        p = self.parameters
        try:
            choice = Choice(p.topics, p.exclude, (), self.namespace)
            chosen = select(recording.topics, choice, recording.path, robots_of(recording))
            played = [msgspec.structs.replace(one, key=self._key(one)) for one in chosen.played]
            window = Window(p.start, p.end, p.duration or None)
            self._tape = BagTape(recording, played, p.order, window)
            self._refuse_types(played)
        except UsageError as error:
            raise ParameterError(f"{self.full_name}: {error}") from None
        self._faults = recording.faults
        for fault in self._faults:
            self.logger.warning("%s; what can be read is played", fault)
        if chosen.left:
            self.logger.info("not played, for nodes that run say it of themselves: %s", ", ".join(chosen.left))
        for one in played:
            if not one.type:
                self.logger.warning("%s is published as %s: %s", one.key, one.encoding, one.topic.unknown)
        self._outputs = Outputs(self.session, played, self.full_name)
        clock = None
        if (p.publish_clock or p.clock_rate) and all(one.key != CLOCK for one in played):
            clock = ClockOutput(self.session, self.full_name)
        self._player = Player(
            self._tape,
            self._outputs,
            rate=max(p.rate, SLOWEST) if p.rate else 0.0,
            paused=p.start_paused,
            loop=p.loop,
            clock=clock,
            clock_period=1.0 / max(p.clock_rate, SLOWEST_CLOCK) if p.clock_rate else None,
        )
        self._services = PlayerServices(self.session, self._player, self.full_name, self._player.stop)

    def _refuse_types(self, played: list[Played]) -> None:
        """Refuse what nodes that are there know as another type."""
        types = {one.key: one.type or one.topic.schema or "bytes" for one in played}
        for token in tokens(self.session, 1.0):
            if isinstance(token, EndpointToken) and token.kind in ("pub", "sub") and token.topic in types:
                type_ = types[token.topic]
                if token.type_name and token.type_name != type_:
                    raise UsageError(f"{token.topic} is no {type_}: {token.full_name} knows it as {token.type_name}")

    def _key(self, played: Played) -> str:
        """Where a topic goes: as this node has it, if it is one of the robot's."""
        prefix = f"{self.namespace}/" if self.namespace else ""
        if played.key == CLOCK or not played.key.startswith(prefix):
            return played.key
        try:
            return self.resolve(played.key.removeprefix(prefix))
        except InvalidName:
            return played.key

    def shutdown(self, exit_code: int = 0) -> None:
        """End the node: wakes what waits for the next message."""
        super().shutdown(exit_code)
        if self._player is not None:
            self._player.stop()

    def main(self) -> None:
        """Play everything, then say what was played."""
        player = self._player
        assert player is not None
        if not self.sleep(self.parameters.delay):
            return
        begin = self.clock.monotonic()
        try:
            whole = player.run()
        except BagError as error:
            self.logger.error("%s; what comes before it was played", error)
            self.shutdown(1)
            return
        if whole:
            self._outputs.arrive(timeout=10.0)
        unreadable = self._tape.converter.unreadable.total()
        if unreadable:
            self.logger.warning("left out %d messages: %s", unreadable, self._tape.converter.reason)
        self.logger.info(
            "%s %d messages of %s in %.1f s",
            "played" if whole else "stopped after",
            player.played,
            self.parameters.file,
            self.clock.monotonic() - begin,
        )
        if whole and not player.played and not unreadable:
            self.logger.error("no message of what is played is in this part of the recording")
            self.shutdown(1)
        elif unreadable or self._faults:
            self.shutdown(1)

    def on_stop(self) -> None:
        """Let go of the recording."""
        if self._player is not None:
            self._services.close()
            self._player.close()
            self._outputs.close()
        if self._bag is not None:
            self._bag.close()


if __name__ == "__main__":
    robo.run(BagPlayer)
