"""Lines, discs and numbers in pixels, for pictures that no browser draws. Pure."""

from collections.abc import Sequence

_LETTERS = {
    "0": "69999996", "1": "26222227", "2": "6911248f", "3": "69121196", "4": "26aaf222",
    "5": "f88e1196", "6": "688e9996", "7": "f1122444", "8": "69969996", "9": "69997116",
    ".": "00000066", "m": "000qllll", "k": "889aca99", " ": "00000000",
}  # fmt: skip
"""Eight rows of five pixels each, a digit for a row: those above 9 are letters, as `int(digit, 36)` has them."""


class Canvas:
    """Pixels, each the number of a colour."""

    def __init__(self, width: int, height: int, colour: int = 0) -> None:
        self.width, self.height = width, height
        self.pixels = bytearray([colour]) * (width * height)

    def block(self, x: int, y: int, width: int, height: int, colour: int) -> None:
        """A rectangle; what is beside the picture is left out."""
        left, right = max(x, 0), min(x + width, self.width)
        if left < right:
            row = bytes([colour]) * (right - left)
            for line in range(max(y, 0), min(y + height, self.height)):
                self.pixels[line * self.width + left : line * self.width + right] = row

    def disc(self, x: float, y: float, radius: int, colour: int) -> None:
        """A filled circle."""
        for row in range(-radius, radius + 1):
            half = int((radius * radius - row * row) ** 0.5)
            self.block(round(x) - half, round(y) + row, 2 * half + 1, 1, colour)

    def lines(self, points: Sequence[tuple[float, float]], thick: int, colour: int) -> None:
        """A line through points, `thick` pixels across."""
        before = points[0] if points else (0.0, 0.0)
        for point in points:
            steps = round(max(abs(point[0] - before[0]), abs(point[1] - before[1])))
            for step in range(min(steps, self.width + self.height) + 1):
                part = step / steps if steps else 0.0
                x, y = before[0] + (point[0] - before[0]) * part, before[1] + (point[1] - before[1]) * part
                self.block(round(x) - thick // 2, round(y) - thick // 2, thick, thick, colour)
            before = point

    def text(self, x: int, y: int, text: str, colour: int, size: int = 2) -> None:
        """Digits, a point, m and k, with `size` pixels for each of their own; others are spaces."""
        for letter in text:
            for row, digit in enumerate(_LETTERS.get(letter, _LETTERS[" "])):
                for column in range(5):
                    if int(digit, 36) & 16 >> column:
                        self.block(x + column * size, y + row * size, size, size, colour)
            x += 6 * size
