"""What a page holds, read by Python's own decoder."""

from __future__ import annotations

import base64
import string
import zlib

_LETTERS = string.digits + string.ascii_uppercase + string.ascii_lowercase
_AS_GIT = str.maketrans(_LETTERS + "!#$%()*+,-./:;=?@[]^_|~", _LETTERS + "!#$%&()*+-;<=>?@^_`{|}~")


def inflated(text: str) -> bytes:
    """Bytes of a script of data; base 85 is Git's but for the digits that HTML escapes."""
    return zlib.decompress(base64.b85decode(text.translate(_AS_GIT)))
