"""What the finished site is held to, beside mkdocs' own strictness: every address, every name."""

from __future__ import annotations

import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

_OWN = ("", "file")  # schemes of addresses inside the site
_SCENE = '<meta name="generator" content="pinflex">'  # pages of pf.view stand for themselves
_RAW_TEX = re.compile(r"<m[ion][^>]*>\s*(?:\\|&(?!#?\w+;)|&amp;)")


class _Page(HTMLParser):
    """Names and addresses of a page; formulas are left to `_RAW_TEX`."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.names: set[str] = set()
        self.addresses: list[str] = []
        self.fetched: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for key, value in attrs:
            if key in ("id", "name") and value:
                self.names.add(value)
            elif key in ("href", "src") and value:
                loaded = key == "src" or (tag == "link" and ("rel", "stylesheet") in attrs)
                (self.fetched if loaded else self.addresses).append(value)


def faults(site: Path, public: tuple[str, ...] = ()) -> Iterator[str]:
    """Sentences about dead addresses, things fetched from elsewhere, raw TeX and missing names.

    Args:
        site: Folder of the built site. public: Names that the reference of Python must have.
    """
    every = {path: path.read_text("utf-8") for path in sorted(site.rglob("*.html"))}
    texts = {path: text for path, text in every.items() if _SCENE not in text[:2000]}
    pages = {path: _Page(text) for path, text in texts.items()}
    for path, page in pages.items():
        place = path.relative_to(site)
        if _RAW_TEX.search(texts[path]):
            yield f"{place}: a formula was not understood"
        for address in page.fetched:
            if urlsplit(address).scheme not in (*_OWN, "data", "blob"):
                yield f"{place}: fetches {address} from elsewhere"
        if path.name == "404.html":
            continue  # its addresses are those of a server's root
        for address in (*page.addresses, *page.fetched):
            if not _leads(path, address, pages):
                yield f"{place}: {address} leads nowhere"
    reference = pages.get(site / "reference" / "python.html")
    for name in public:
        if reference is None or f"pinflex.{name}" not in reference.names:
            yield f"reference/python.html: {name} is missing"


def _leads(path: Path, address: str, pages: dict[Path, _Page]) -> bool:
    parts = urlsplit(address)
    if parts.scheme not in _OWN or address.startswith(("/", "javascript:")):
        return True
    target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
    if not target.is_file():
        return False
    own = pages.get(target)
    return not parts.fragment or own is None or unquote(parts.fragment) in own.names
