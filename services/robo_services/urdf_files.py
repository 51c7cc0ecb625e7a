"""Reading URDF files, and making URDFs of those that are written for xacro."""

from collections.abc import Sequence

from robo.errors import UnreadableFile
from robo.text.brief import shown
from robo.text.files import read_text
from robo_services.urdf_model import UrdfError

MOST_BYTES = 20_000_000
"""A larger file is no URDF: meshes stand in files of their own."""

XACRO = ".xacro"
ASSIGN = ":="


def load(path: str, arguments: Sequence[str] = ()) -> tuple[str, str]:
    """The text of a URDF, and what its places are called in messages.

    Args:
        path: of the file; xacro makes a URDF of one whose name ends with `.xacro`.
        arguments: for xacro, `name:=value` each.

    Raises:
        UrdfError: it is missing or unreadable, xacro refuses it, or is not installed.
    """
    try:
        text = read_text(path, MOST_BYTES).removeprefix("\ufeff")
    except UnreadableFile as error:
        raise UrdfError(f"URDF {path} cannot be read: {error}") from None
    if path.endswith(XACRO):
        return _expanded(path, arguments), f"{path} (expanded)"
    if arguments:
        raise UrdfError(f"{path} takes no arguments: its name does not end with {XACRO}")
    return text, path


def _expanded(path: str, arguments: Sequence[str]) -> str:
    mappings: dict[str, str] = {}
    for argument in arguments:
        name, assigned, value = argument.partition(ASSIGN)
        if not (name and assigned):
            raise UrdfError(f"an argument of xacro is name{ASSIGN}value, and not {shown(argument)}")
        mappings[name] = value
    try:
        import xacro
    except ModuleNotFoundError as error:
        if error.name != "xacro":
            raise
        text = f"{path} needs xacro, which is not installed: pip install 'robo-zenoh[urdf]'; a plain URDF needs none"
        raise UrdfError(text) from None
    try:
        text = xacro.process_file(path, mappings=mappings).toprettyxml(indent="  ")
    except Exception as error:  # xacro raises what the expressions of the file raise
        reason = " ".join(str(error).split()) or type(error).__name__
        raise UrdfError(f"{path}: xacro: {reason}; `xacro {path}` says where") from None
    return str(text)
