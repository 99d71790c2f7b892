"""Changes of a description as texts: "key.path=value"."""

from __future__ import annotations

import json
from collections.abc import Mapping

from pinflex.writing import plain


def assignments(*changes: str | Mapping[str, object]) -> list[str]:
    """Values by key path as overrides: "key.path=value", numbers to the last digit; texts stay."""
    found: list[str] = []
    for change in changes:
        pairs = {} if isinstance(change, str) else change
        found += [change] if isinstance(change, str) else []
        found += [f"{key}={json.dumps(plain(value))}" for key, value in pairs.items()]
    return found
