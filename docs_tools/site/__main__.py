"""`python -m docs_tools.site [FOLDER]` builds the site, by default in the folder `site`."""

import sys
from pathlib import Path

from docs_tools.site.build import ROOT, Broken, build


def main() -> int:
    """Build it where the first word says."""
    target = Path(sys.argv[1] if sys.argv[1:] else "site")
    try:
        build(ROOT, target)
    except Broken as error:
        print(error, file=sys.stderr)
        return 1
    print(f"the site is in {target}: python -m http.server --directory {target}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
