"""`python -m docs_tools.reference`: make the pages of the reference anew."""

import sys

from docs_tools.reference.markdown import Gap
from docs_tools.reference.pages import FOLDER, pages


def main() -> None:
    """Write the pages, and remove those that are no more."""
    try:
        made = pages()
    except Gap as gap:
        sys.exit(f"error: {gap}")
    FOLDER.mkdir(exist_ok=True)
    for file in FOLDER.glob("*.md"):
        if file.name not in made:
            file.unlink()
    for name, text in made.items():
        (FOLDER / name).write_text(text, encoding="utf-8")
    print(f"{FOLDER}: {len(made)} pages")


if __name__ == "__main__":
    main()
