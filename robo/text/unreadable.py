"""What comes out of bytes that are not what they should be."""

import msgspec

UNREADABLE = (msgspec.DecodeError, UnicodeDecodeError, RecursionError)
"""What decoding by msgspec may raise, whatever the bytes are."""
