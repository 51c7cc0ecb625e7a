"""Shapes for a viewer to draw (ROS: visualization_msgs). Imported when one of its types is asked for."""

from typing import ClassVar

from msgspec import field

from robo_messages._registry import Message, message
from robo_messages._types import Float32, Int32
from robo_messages.geometry import Point, Pose, Vector3
from robo_messages.sensor import CompressedImage
from robo_messages.std import Duration, Header
from robo_messages.std_numbers import ColorRGBA


@message("visualization/UVCoordinate")
class UVCoordinate(Message):
    """A place in a picture, as parts of its width and height."""

    u: Float32 = 0.0
    """Across, 0 to 1."""
    v: Float32 = 0.0
    """Along the height, 0 to 1."""


@message("visualization/MeshFile")
class MeshFile(Message):
    """A file with a shape, within the message."""

    filename: str = ""
    """Its name, whose ending tells the viewer how to read it, for example `arm.stl`."""
    data: memoryview = memoryview(b"")
    """The file's bytes. A decoded one points into the payload: no copy is made."""


@message("visualization/Marker")
class Marker(Message):
    """One thing to draw, which stays until it is changed, deleted or its lifetime is over.

    All zeros is not seen: `scale` and `color.a` must be set.
    """

    ARROW: ClassVar[Int32] = 0
    CUBE: ClassVar[Int32] = 1
    SPHERE: ClassVar[Int32] = 2
    CYLINDER: ClassVar[Int32] = 3
    LINE_STRIP: ClassVar[Int32] = 4
    LINE_LIST: ClassVar[Int32] = 5
    CUBE_LIST: ClassVar[Int32] = 6
    SPHERE_LIST: ClassVar[Int32] = 7
    POINTS: ClassVar[Int32] = 8
    TEXT_VIEW_FACING: ClassVar[Int32] = 9
    MESH_RESOURCE: ClassVar[Int32] = 10
    TRIANGLE_LIST: ClassVar[Int32] = 11
    ARROW_STRIP: ClassVar[Int32] = 12

    ADD: ClassVar[Int32] = 0
    MODIFY: ClassVar[Int32] = 0
    DELETE: ClassVar[Int32] = 2
    DELETEALL: ClassVar[Int32] = 3

    header: Header = field(default_factory=Header)
    """The frame and time of the pose."""
    ns: str = ""
    """A group of markers; it and `id` are the marker's name."""
    id: Int32 = 0
    """Which one of its group: the same group and id again change the marker."""
    type: Int32 = ARROW
    """ARROW … ARROW_STRIP."""
    action: Int32 = ADD
    """ADD, which also changes; DELETE this one; DELETEALL of its group, or all where `ns` is empty."""
    pose: Pose = field(default_factory=Pose)
    """In the header's frame, m."""
    scale: Vector3 = field(default_factory=Vector3)
    """Its size along its own axes, m. Of lines `x` is the width, of a text `z` the height of a capital letter."""
    color: ColorRGBA = field(default_factory=ColorRGBA)
    """Its colour; `a` is 0 by default, which is not seen."""
    lifetime: Duration = field(default_factory=Duration)
    """After which it is deleted; 0 is never."""
    frame_locked: bool = False
    """It moves with its frame, rather than staying where that was at the header's time."""
    points: list[Point] = []
    """The points of lists, lines and strips, m, relative to the pose; of an arrow its start and end."""
    colors: list[ColorRGBA] = []
    """One for each point, or empty: then `color` for all."""
    texture_resource: str = ""
    """Where a picture is that covers its surface; `embedded://NAME` for the one in `texture`."""
    texture: CompressedImage = field(default_factory=CompressedImage)
    """The picture, where `texture_resource` says that it is embedded."""
    uv_coordinates: list[UVCoordinate] = []
    """Where each point stands in the picture."""
    text: str = ""
    """What a TEXT_VIEW_FACING says."""
    mesh_resource: str = ""
    """Where the shape of a MESH_RESOURCE is; `embedded://NAME` for the one in `mesh_file`."""
    mesh_file: MeshFile = field(default_factory=MeshFile)
    """The shape, where `mesh_resource` says that it is embedded."""
    mesh_use_embedded_materials: bool = False
    """The colours are those of the shape's file, rather than `color`."""


@message("visualization/MarkerArray")
class MarkerArray(Message):
    """Several markers at once."""

    markers: list[Marker] = []
    """In the order in which they take effect."""
