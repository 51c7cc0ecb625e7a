"""Licenses of packages: their SPDX names, and the texts of those that `_licenses/` has."""

import datetime
import re
from pathlib import Path

from robo.text.brief import shown
from robo.text.suggestions import closest

FOLDER = Path(__file__).parent / "_licenses"

FILE = "LICENSE"
"""The file of a package with the text; what builds a wheel looks for it by this name."""

LICENSES = (
    "AGPL-3.0-or-later", "Apache-2.0", "BSD-2-Clause", "BSD-3-Clause", "BSL-1.0", "EUPL-1.2", "GPL-2.0-only",
    "GPL-2.0-or-later", "GPL-3.0-only", "GPL-3.0-or-later", "ISC", "LGPL-2.1-or-later", "LGPL-3.0-or-later", "MIT",
    "MIT-0", "MPL-2.0", "Unlicense", "Zlib",
)  # fmt: skip
"""Licenses by their SPDX names; `LicenseRef-…` names any other."""


def license_fault(name: str) -> str | None:
    """What is wrong with a license's name; None if nothing is."""
    if name in LICENSES or re.fullmatch(r"LicenseRef-[A-Za-z0-9.-]+", name):
        return None
    by_lower = {one.lower(): one for one in LICENSES}
    close = closest(name.lower(), by_lower)
    known = f"did you mean {by_lower[close]}?" if close else f"known are {', '.join(LICENSES)};"
    return f"license {shown(name)}: {known} LicenseRef-NAME stands for one of your own"


def license_text(name: str, package: str) -> str | None:
    """The text of a license, with the year and the holder where it has a place for them.

    Args:
        name: as SPDX has it.
        package: whose authors hold the copyright.

    Returns:
        None where the text is not here.
    """
    file = FOLDER / f"{name}.txt"
    if name not in LICENSES or not file.is_file():
        return None
    text = file.read_text(encoding="utf-8").replace("<year>", str(datetime.date.today().year))
    return text.replace("<copyright holders>", holder(package))


def holder(package: str) -> str:
    """Who holds the copyright as long as nobody has written another name there."""
    return f"the authors of {package}"
