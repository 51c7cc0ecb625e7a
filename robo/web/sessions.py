"""What a browser remembers instead of a token: a word that only this server can have made."""

import hashlib
import hmac
import secrets
from collections.abc import Iterable

from robo.web.access import Right, Tokens


class Sessions:
    """Words that stand for a right, as long as the tokens are these and the key is this one.

    They are no tokens: who guesses those cannot try them out by making such a word, since it takes the key.
    """

    def __init__(self, tokens: Tokens, key: str = "") -> None:
        """
        Args:
            tokens: that are asked for.
            key: nobody else knows it; empty for one of this process alone.
        """
        self._key = (key or secrets.token_urlsafe(32)).encode()
        self._tokens = tokens

    def word(self, right: Right) -> str:
        """What a browser with this right is to remember."""
        token = self._tokens.drive if right is Right.DRIVE else self._tokens.view
        return hmac.new(self._key, f"{right.name} {token}".encode(), hashlib.sha256).hexdigest()

    def right(self, word: str) -> Right:
        """What a word stands for."""
        given = word.encode(errors="replace")
        rights = [right for right in (Right.DRIVE, Right.VIEW) if right is Right.DRIVE or self._tokens.view]
        found = [right for right in rights if hmac.compare_digest(given, self.word(right).encode())]
        return found[0] if found else Right.NONE


def cookie(lines: Iterable[str], name: str) -> str:
    """What a browser remembers under a name; empty where it has nothing.

    Args:
        lines: the headers `Cookie`. Others of the same host write into them, whatever their port, and what they like.
        name: of the cookie.
    """
    for line in lines:
        for part in line.split(";"):
            said, equals, value = part.strip().partition("=")
            if equals and said == name:
                return value
    return ""
