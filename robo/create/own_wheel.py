"""robo itself as a wheel, for containers of packages where robo came from no package index."""

import base64
import hashlib
import io
import json
import zipfile
from importlib.metadata import Distribution, PackageNotFoundError, distribution

DISTRIBUTION = "robo-zenoh"

_OF_THE_INSTALLATION = ("RECORD", "INSTALLER", "REQUESTED", "direct_url.json")


def own_wheel() -> tuple[str, bytes] | None:
    """The robo that is installed here, as it came: name of the file and what is in it.

    Returns:
        None where a package index has it, and where it is installed to be edited or by hand, so that its files
        stand elsewhere.
    """
    try:
        found = distribution(DISTRIBUTION)
    except PackageNotFoundError:
        return None
    origin = found.read_text("direct_url.json")
    if origin is None or json.loads(origin).get("dir_info", {}).get("editable"):
        return None
    return _wheel(found)


def _wheel(found: Distribution) -> tuple[str, bytes] | None:
    """An installed distribution as the wheel that it was, by the binary distribution format of PyPA."""
    files = [file for file in found.files or () if file.parts[0] != ".." and "__pycache__" not in file.parts]
    info = next((file.parts[0] for file in files if file.name == "WHEEL"), None)
    tags = [
        line.partition(": ")[2] for line in (found.read_text("WHEEL") or "").splitlines() if line.startswith("Tag: ")
    ]
    if info is None or len(tags) != 1:
        return None
    packed = io.BytesIO()
    record = []
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in files:
            if file.parts[0] == info and file.name in _OF_THE_INSTALLATION:
                continue
            data = file.read_binary()
            archive.writestr(zipfile.ZipInfo(file.as_posix()), data, zipfile.ZIP_DEFLATED)
            digest = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
            record.append(f"{file.as_posix()},sha256={digest},{len(data)}\n")
        archive.writestr(zipfile.ZipInfo(f"{info}/RECORD"), "".join([*record, f"{info}/RECORD,,\n"]))
    return f"{info.removesuffix('.dist-info')}-{tags[0]}.whl", packed.getvalue()
