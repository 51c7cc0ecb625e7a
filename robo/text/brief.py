"""Long values and texts, cut so that a message stays one that people read."""


def shown(value: object, most: int = 60) -> str:
    """A value as a message shows it: what Python would write, cut where it is long."""
    text = repr(value[: most + 1]) if isinstance(value, (str, bytes)) else repr(value)
    return text if len(text) <= most else f"{text[: most - 3]}…"


def brief(text: str, most: int = 1_000) -> str:
    """A line of a message: where it is too long, its middle is left out; the advice stands at the end."""
    if len(text) <= most:
        return text
    left_out = len(text) - most
    return f"{text[: most * 3 // 4]} … ({left_out:,} characters) … {text[-(most // 4) :]}"


def brief_lines(text: str, most: int = 200) -> str:
    """A message of several lines, each of them brief, and not too many."""
    lines = text.split("\n")
    kept = [brief(line) for line in lines[:most]]
    return "\n".join(kept if len(lines) <= most else [*kept, f"… and {len(lines) - most:,} lines more"])


def marked(line: str, offset: int, width: int = 100) -> tuple[str, str]:
    """A line, cut around one of its characters where it is long, and what stands below it: a mark under that one."""
    begin = max(0, offset - 59) if len(line) > width else 0
    part = "".join(c if c.isprintable() else " " for c in line[begin : begin + width])
    return part, f"{' ' * (offset - begin)}^"
