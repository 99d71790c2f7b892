"""Reading a xacro: expanded by the package xacro, where that is installed, then a URDF.

Its expressions are Python, so it is expanded in a process without rights (`confined`). That process
asks this one for files, and gets those that robots are made of.
"""

from __future__ import annotations

import glob
import json
import os
import re
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path

from pinflex.description.files import Source, require_regular
from pinflex.description.robots import confined, urdf
from pinflex.errors import DescriptionError, nearest

TRUST = "PINFLEX_TRUST_XACRO"
_READ = (".xacro", ".urdf", ".xml", ".yaml", ".yml")  # files that a xacro may include or load
_WAIT = 20.0  # [s] for all of it, where the process only waits
_MOST = 20_000_000  # [characters] of one answer or file
_FEW = 1000  # files that it may ask for
_ARGUMENT = re.compile(r"""<xacro:arg\s[^>]*?name\s*=\s*["']([^"']*)""")


def read(
    text: str, file: str, package_dirs: tuple[str, ...], arguments: Mapping[str, str] | None = None
) -> Source:
    """Expand a xacro and check the URDF that comes out."""
    if find_spec("xacro") is None:
        raise DescriptionError(
            f"{file}: is a xacro, and the package xacro is not installed. Run `pip install xacro`, "
            f"or expand it: `xacro {file} > x.urdf`."
        )
    folder = Path(package_dirs[0] if package_dirs else "").resolve()
    expansion = _Expansion(text, file, folder, package_dirs, dict(arguments or {}))
    expanded = expansion.run()
    for name in arguments or {}:
        if name not in expansion.known:
            raise DescriptionError(
                f'{file}: no such <xacro:arg>: "{name}".{nearest(name, sorted(expansion.known))}'
            )
    return replace(urdf.check(expanded, file, package_dirs), file=file)


@dataclass
class _Expansion:
    """One xacro and the process that expands it; `known`: arguments of all files that it reads."""

    text: str
    file: str
    folder: Path
    packages: tuple[str, ...]
    arguments: dict[str, str]

    def __post_init__(self) -> None:
        self.known = {*_ARGUMENT.findall(self.text)}

    def run(self) -> str:
        """The URDF text."""
        command = [sys.executable, "-I", "-X", "utf8", confined.__file__]
        process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            cwd=os.sep, env={"LANG": "C.UTF-8"}, text=True, encoding="utf-8",
        )  # fmt: skip
        timer = threading.Timer(_WAIT, process.kill)
        timer.start()
        try:
            return self._serve(process)
        finally:
            timer.cancel()
            process.kill()
            process.communicate()

    def _serve(self, process: subprocess.Popen[str]) -> str:
        """Answer the process until it has a text."""
        assert process.stdin is not None
        assert process.stdout is not None
        answers: dict[str, Callable[[str], object]] = {
            "read": self._read, "match": self._match, "package": self._package,
        }  # fmt: skip
        first = {"file": str(self.folder / self.file), "folder": str(self.folder),
                 "boundary": self.arguments, "path": sys.path,
                 "trusted": os.environ.get(TRUST) == "1"}  # fmt: skip
        answer: dict[str, object] = first
        for _ in range(_FEW):
            try:
                process.stdin.write(json.dumps(answer) + "\n")
                process.stdin.flush()
                line = process.stdout.readline(_MOST)
                request = json.loads(line)
                ((what, value),) = request.items()
            except (OSError, ValueError, AttributeError):
                break
            if what == "text":
                return str(value)
            if what == "failed":
                raise self._refused(
                    f"xacro cannot expand it: {str(value).splitlines()[0][:300].rstrip(' .')}"
                )
            if what not in answers:
                raise self._refused(
                    "a xacro runs Python, and this system cannot confine it. Expand it by hand, or "
                    f"set {TRUST}=1 if you trust every line of it",
                    cure=False,
                )
            try:
                answer = {"value": answers[what](str(value))}
            except (OSError, ValueError, DescriptionError) as error:
                answer = {"error": str(error)}
        raise self._refused(
            f"expanding it took more than {confined.SECONDS} s of computing, "
            f"{confined.MEMORY / 2**30:.0f} GiB or {_FEW} files, or ended its process"
        )

    def _refused(self, what: str, cure: bool = True) -> DescriptionError:
        by_hand = " Correct it, or expand it by hand" if cure else ""
        return DescriptionError(f"{self.file}: {what}.{by_hand}{'.' if cure else ''}")

    def _read(self, name: str) -> str:
        path = Path(os.path.join(self.folder, name))
        if path == self.folder / self.file:
            return self.text
        if path.suffix.lower() not in _READ:
            raise ValueError(f"a xacro may read {', '.join(_READ)} only")
        if not path.is_file():
            raise ValueError("no such file")
        require_regular(path, _MOST, path.name)
        text = path.read_text("utf-8-sig")
        self.known |= {*_ARGUMENT.findall(text)}
        return text

    def _match(self, pattern: str) -> list[str]:
        found = glob.glob(os.path.join(self.folder, pattern))
        return sorted(path for path in found if Path(path).suffix.lower() in _READ)[:_FEW]

    def _package(self, name: str) -> str:
        for folder in map(Path, self.packages):
            for place in (folder, *folder.resolve().parents):
                if place.name == name and place.is_dir():
                    return str(place)
                if (place / name).is_dir():
                    return str(place / name)
        raise ValueError(f"no package {name} in a folder above the file")
