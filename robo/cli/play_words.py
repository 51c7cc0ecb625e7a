"""The options of `robo bag play`."""

from typing import Annotated, Literal, NamedTuple

import typer


class PlayWords(NamedTuple):
    """How a recording is played."""

    rate: Annotated[
        float,
        typer.Option(
            "-r", "--rate", metavar="R", help="How many times as fast; 0 as fast as nothing is lost.", min=0.0
        ),
    ] = 1.0
    start: Annotated[
        str, typer.Option("--start", "--start-offset", metavar="TIME", help="From then on.", show_default=False)
    ] = ""
    end: Annotated[str, typer.Option("--end", metavar="TIME", help="Before then.", show_default=False)] = ""
    duration: Annotated[
        float | None, typer.Option("--duration", "--playback-duration", metavar="S", help="Play S seconds of it.")
    ] = None
    delay: Annotated[float, typer.Option("--delay", metavar="S", help="Wait S seconds before the first message.")] = 0.0
    loop: Annotated[bool, typer.Option("-l", "--loop", help="Begin again at the end, until Ctrl-C.")] = False
    start_paused: Annotated[bool, typer.Option("-p", "--start-paused", help="Begin with a pause.")] = False
    topics: Annotated[
        list[str] | None,
        typer.Option("--topics", metavar="KEY", help="Only these; * and ** match. May be repeated."),
    ] = None
    exclude: Annotated[
        list[str] | None,
        typer.Option("--exclude", "--exclude-topics", metavar="KEY", help="Not these. May be repeated."),
    ] = None
    remap: Annotated[
        list[str] | None,
        typer.Option("-m", "--remap", metavar="OLD:=NEW", help="Under another name; a/**:=b/** for all within."),
    ] = None
    order: Annotated[
        Literal["arrived", "published", "received", "sent"],
        typer.Option("--order", "--message-order", help="By when messages came, or were published."),
    ] = "arrived"
    clock: Annotated[
        bool, typer.Option("--clock", help="Tell the recording's time on /clock, for nodes with use_sim_time.")
    ] = False
    clock_rate: Annotated[
        float | None,
        typer.Option("--clock-rate", metavar="HZ", help="So often, beside once for each message; 0.1 to 1000."),
    ] = None
    wait_for_subscribers: Annotated[
        bool, typer.Option("--wait-for-subscribers", help="Begin once somebody listens to each topic.")
    ] = False
    force: Annotated[bool, typer.Option("--force", help="Also where nodes know a topic as another type.")] = False
    beside: Annotated[bool, typer.Option("--beside", help="Also where somebody publishes a topic already.")] = False
    no_keys: Annotated[
        bool, typer.Option("--no-keys", "--disable-keyboard-controls", help="Leave the terminal's keys alone.")
    ] = False
