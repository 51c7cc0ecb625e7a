"""What is drawn, handed to Rerun's library."""

import importlib
import time
from pathlib import Path
from typing import Any

from robo.bridges.rerun.frames import WORLD
from robo.bridges.rerun.marks import Axes, Encoded, Gone, Grid, Mark, Moved, Numbers, Picture, Points, Said, Strips
from robo.bridges.rerun.scene import LOG, SPEED, VALUES
from robo.errors import RunError

TIMELINE = "time"
"""When messages were published."""
_FLUSH = 1.0
"""For how long it is waited at a time, s."""


def import_rerun() -> Any:
    """The library of Rerun.

    Raises:
        RunError: it is not installed; names the extra.
    """
    try:
        return importlib.import_module("rerun")
    except ImportError:
        text = "Rerun is not installed: pip install 'robo-zenoh[rerun]' (739 MB on the disk)"
        raise RunError(text) from None


class Sink:
    """A timeline of Rerun, in a file or in a viewer."""

    def __init__(self, name: str) -> None:
        """
        Args:
            name: of what is shown.

        Raises:
            RunError: Rerun is not installed.
        """
        self._rr = import_rerun()
        self._rrb = importlib.import_module("rerun.blueprint")
        self._np = importlib.import_module("numpy")
        self._stream = self._rr.RecordingStream(f"robo {name}".strip())
        self._stream.set_log_time_enabled(False)
        self._stream.set_log_tick_enabled(False)
        self.is_file = False
        """Whether it writes a file, and no viewer takes it."""
        self.is_full = False
        """Whether the file takes nothing more."""
        self.is_empty = True
        """Whether nothing was drawn."""
        self.reason = ""
        """Why what was drawn has not arrived."""
        self._framed: dict[str, str] = {}
        self._named: dict[str, tuple[str, ...]] = {}
        self._paths: dict[str, str] = {}

    def save(self, file: Path) -> None:
        """Write to a file.

        Raises:
            RunError: it cannot be written.
        """
        try:
            self._stream.save(file)
        except Exception as error:  # of another language's library
            raise RunError(f"{file} cannot be written: {error}") from None
        self.is_file = True

    def connect(self, port: int) -> None:
        """Send to a viewer on this machine."""
        self._stream.connect_grpc(f"rerun+http://127.0.0.1:{port}/proxy")

    def lay_out(self, pictures: list[str], trails: list[str]) -> None:
        """Say which views there are, and where."""
        rrb = self._rrb
        whole = rrb.TimeRangeBoundary.infinite()
        until_now = rrb.VisibleTimeRange(TIMELINE, start=whole, end=rrb.TimeRangeBoundary.cursor_relative())
        space = rrb.Spatial3DView(
            name="robot",
            origin="/",
            contents=["/**", "- /plots/**", f"- /{LOG}/**", *(f"- {self._path(one)}" for one in pictures)],
            spatial_information=rrb.SpatialInformation(WORLD, show_axes=False),
            eye_controls=rrb.EyeControls3D(
                position=(-4.0, -6.0, 9.0),
                look_target=(0.0, 0.0, 0.0),
                eye_up=(0.0, 0.0, 1.0),
                tracking_entity=self._path(f"{trails[0].rpartition('/')[0]}/base") if trails else None,
            ),
            overrides={self._path(one): [rrb.VisibleTimeRanges([until_now])] for one in trails},
        )
        beside = [rrb.Spatial2DView(name=one, origin=self._path(one)) for one in pictures[:4]]
        curves = rrb.Tabs(
            rrb.TimeSeriesView(name="speed (m/s, rad/s)", origin=f"/{SPEED}"),
            rrb.TimeSeriesView(name="values", origin=f"/{VALUES}"),
            active_tab=0,
        )
        log = rrb.TextLogView(name="log", origin=f"/{LOG}")
        right = rrb.Vertical(*([rrb.Tabs(*beside)] if beside else []), curves, log)
        self._stream.send_blueprint(
            rrb.Blueprint(
                rrb.Horizontal(space, right, column_shares=[3, 2]),
                rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following"),
                rrb.SelectionPanel(state="hidden"),
                rrb.BlueprintPanel(state="hidden"),
            )
        )

    def draw(self, marks: list[Mark], time: int) -> None:
        """Draw something.

        Args:
            marks: it.
            time: when it was said, ns since the epoch.
        """
        if not marks:
            return
        self.is_empty = False
        self._stream.set_time(TIMELINE, timestamp=self._np.datetime64(time, "ns"))
        for mark in marks:
            self._draw(mark)

    def flush(self) -> bool:
        """Wait a little until what was drawn has arrived: a slow viewer holds up who draws, and no memory is filled.

        Returns:
            whether it has; else `reason` says why not.
        """
        begun = time.monotonic()
        try:
            self._stream.flush(timeout_sec=_FLUSH)
        except Exception as error:  # of another language's library
            self.reason = str(error)
            self.is_full = self.is_file and time.monotonic() - begun < _FLUSH / 2  # a slow disk takes longer
            return False
        return True

    def close(self) -> None:
        """All has been drawn, and has arrived, or its viewer is closed: else this waits for it."""
        self._stream.disconnect()

    def _draw(self, mark: Mark) -> None:
        rr, log = self._rr, self._log
        match mark:
            case Moved(path, parent, child, at, turned, always):
                where = rr.Transform3D(
                    translation=at, quaternion=rr.Quaternion(xyzw=turned), parent_frame=parent, child_frame=child
                )
                log(path, where, static=always)
            case Axes(path, frame, length):
                log(path, rr.CoordinateFrame(frame), rr.TransformAxes3D(length), static=True)
            case Points(path, frame, places, colour, radius):
                self._in_frame(path, frame)
                log(path, rr.Points3D(self._places(places), colors=[colour], radii=[radius]))
            case Strips(path, frame, strips, colour, radius):
                self._in_frame(path, frame)
                lines = [self._places(strip) for strip in strips]
                log(path, rr.LineStrips3D(lines, colors=[colour], radii=[radius]))
            case Numbers(path, values):
                names = tuple(values)
                if self._named.get(path) != names:
                    self._named[path] = names
                    topic = path.rpartition("/")[2]
                    log(path, rr.SeriesLines(names=[f"{topic} {name}" for name in names]), static=True)
                log(path, rr.Scalars(list(values.values())))  # at once, which costs as much as one alone
            case Said(path, text, level):
                log(path, rr.TextLog(text, level=level))
            case Picture(path, image):
                self._picture(path, image)
            case Encoded(path, data, kind):
                log(path, rr.EncodedImage(contents=data, media_type=kind))
            case Grid(path, frame, grid):
                self._grid(path, frame, grid)
            case Gone(path):
                self._framed.pop(path, None)  # the frame in which it stood is gone as well
                log(path, rr.Clear(recursive=True))

    def _log(self, path: str, *what: Any, static: bool = False) -> None:
        self._stream.log(self._path(path), *what, static=static)

    def _path(self, path: str) -> str:
        """A path as Rerun reads it: names of logs and markers may have any letters."""
        found = self._paths.get(path)
        if found is None:
            found = self._paths[path] = self._rr.new_entity_path([part for part in path.split("/") if part])
        return found

    def _in_frame(self, path: str, frame: str) -> None:
        if self._framed.get(path) != frame:
            self._framed[path] = frame
            self._log(path, self._rr.CoordinateFrame(frame))

    def _places(self, places: Any) -> Any:
        with self._np.errstate(over="ignore"):  # what is too far away for Rerun is seen by nobody
            return self._np.asarray(places, self._np.float32).reshape(-1, 3)

    def _picture(self, path: str, image: Any) -> None:
        try:
            array = image.array
        except ValueError:
            return  # of an encoding that nobody can draw
        model = {"bgr8": "BGR", "bgra8": "BGRA", "rgb8": "RGB", "rgba8": "RGBA"}.get(image.encoding)
        if array.ndim == 2 and image.encoding in ("16UC1", "32FC1"):
            self._log(path, self._rr.DepthImage(array, meter=1000.0 if image.encoding == "16UC1" else 1.0))
        elif model is not None or array.ndim == 2:
            self._log(path, self._rr.Image(array, model or "L"))

    def _grid(self, path: str, frame: str, grid: Any) -> None:
        rr, info = self._rr, grid.info
        at, turned = info.origin.position, info.origin.orientation
        self._in_frame(path, frame)
        form = rr.components.ImageFormat(width=info.width, height=info.height, color_model="L", channel_datatype="U8")
        # Rows of a picture go down, and those of a map up.
        rows = self._np.frombuffer(grid.data, self._np.uint8).reshape(info.height, info.width)[::-1]
        self._log(
            path,
            rr.GridMap(
                data=rows.tobytes(),
                format=form,
                cell_size=info.resolution,
                translation=[at.x, at.y, at.z],
                quaternion=rr.Quaternion(xyzw=[turned.x, turned.y, turned.z, turned.w]),
                colormap=rr.components.Colormap.RvizMap,
            ),
        )
