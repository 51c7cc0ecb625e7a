"""`robo map`: the way of a robot, and what its lasers have hit, as a picture."""

from pathlib import Path

from robo.cli.printing import amount, note, print_json, print_line, write_file
from robo.cli.views.bag_progress import progress
from robo.cli.views.pictures import STANDARD, check_picture, written
from robo.errors import UsageError
from robo.recording.map.picture import as_png, as_svg, facts
from robo.recording.map.sources import Wanted, walk_of
from robo.text.brief import brief
from robo.text.svg import Theme
from robo.text.terminal import visible


def draw_map(path: str, output: str, wanted: Wanted, theme: Theme, *, json: bool = False) -> None:
    """Draw it, and tell what is drawn; with `json` as an object.

    Raises:
        UsageError: what is asked for is not there, or the picture cannot be written.
        BagError: the recording cannot be read.
        LogError: the log cannot be opened.
    """
    check_picture(output, (".svg", ".png"))
    if output == STANDARD and json:
        raise UsageError("--json: say -o FILE.svg, for standard output has one of both")
    with progress(f"reading {path}") as tell:
        walk = walk_of(path, wanted, tell)
    if not walk.track and not walk.scans:
        raise UsageError(f"{path}: nothing can be drawn: {brief(walk.reason or 'no transform of the base came', 300)}")
    if output.lower().endswith(".png"):
        write_file(as_png(walk, theme), Path(output))
    else:
        written(as_svg(walk, Path(path).name, theme), output)
    for text in walk.notes:
        note(visible(text))
    if walk.left_out:
        note(f"{amount(walk.left_out, 'scan')} left out; of the first: {visible(brief(walk.reason, 300))}")
    if json:
        print_json(
            {
                "file": output,
                "scans": walk.scans,
                "left_out": walk.left_out,
                "malformed": walk.malformed,
                "points": walk.cells.hits,
                "length": walk.length,
                "frame": walk.frames.fixed,
                "resolution": walk.cells.resolution,
            }
        )
    elif output != STANDARD:
        print_line(visible(f"{output}: {facts(walk)}"))
