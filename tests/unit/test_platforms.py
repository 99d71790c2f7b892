"""Other systems and smaller installations: locks and imports without what may be absent.

Claims:
    Documentation, other systems
    - every public name loads, 3rrr is solved, without fcntl, resource, matplotlib, pillow, meshcat
      | a process that cannot import them | runs | runs
    - files are locked as Windows has it | a stand-in of msvcrt | as on Linux | as on Linux; never
      run on Windows
    - bash completes commands, options, models and files | bash itself | offered | offered
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from pinflex.__main__ import build_parser
from pinflex.cli import files
from pinflex.errors import DescriptionError
from pinflex.writing import lock

# Modules that Windows has not, and packages that a run needs only for what it draws.
_ABSENT = """
import sys

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {names}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Absent())
"""
_RUN = """
import pinflex as pf
from pinflex.__main__ import main

for name in pf.__all__:
    getattr(pf, name)
run = pf.solve(pf.load("3rrr"), level="rigid", samples=5)
assert main(["modes", "3rrr", "--count", "1"]) == 0
pf.view(run, sys.argv[1])
print(run.torque.shape)
"""


def without(page: Path, *names: str) -> subprocess.CompletedProcess[str]:
    """What a process says that has none of these: every public name, a run, modes and a page."""
    code = _ABSENT.format(names=set(names)) + _RUN
    command = [sys.executable, "-c", code, str(page)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_it_runs_without_what_only_linux_has_and_without_what_only_draws(tmp_path: Path) -> None:
    linux = ("fcntl", "resource", "termios", "pwd", "grp", "pty", "posix_ipc")
    drawing = ("matplotlib", "PIL", "meshcat", "IPython", "tornado", "zmq", "pandas", "shtab")
    done = without(tmp_path / "page.html", *linux, *drawing)
    assert done.returncode == 0, done.stderr
    assert "(5, 3)" in done.stdout
    assert (tmp_path / "page.html").stat().st_size > 1e5


def test_a_file_is_locked_against_a_second_user(tmp_path: Path) -> None:
    path = tmp_path / "journal"
    with path.open("a+b") as first, path.open("a+b") as second:
        assert lock(first)
        assert not lock(second)
    with path.open("a+b") as third:
        assert lock(third)


class Windows:
    """`msvcrt` as far as `lock` calls it: one byte of a file, locked once."""

    LK_NBLCK = 2

    def __init__(self) -> None:
        self.calls: list[tuple[int, int]] = []

    def locking(self, file: int, mode: int, size: int) -> None:
        assert size == 1
        if self.calls:
            raise OSError(36, "deadlock")
        self.calls.append((file, mode))


def test_the_lock_of_windows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    system = Windows()
    monkeypatch.setitem(sys.modules, "msvcrt", system)
    monkeypatch.setattr("pinflex.writing.sys", SimpleNamespace(platform="win32"))
    with (tmp_path / "journal").open("a+b") as stream:
        stream.write(b"kept\n")
        assert lock(stream)
        assert stream.tell() > 1e9  # far behind what is written, so that all may read it
        stream.write(b"more\n")  # at the end of the text, wherever the lock is
        assert not lock(stream)
        assert system.calls == [(stream.fileno(), Windows.LK_NBLCK)]
    assert (tmp_path / "journal").read_bytes() == b"kept\nmore\n"


def answers(script: Path, *words: str) -> list[str]:
    """What bash offers for the last of these words."""
    line = " ".join(f"'{word}'" for word in words)
    code = f"""source {script}; COMP_WORDS=({line}); COMP_CWORD={len(words) - 1}
        _shtab_pinflex; printf '%s\\n' "${{COMPREPLY[@]}}" """
    done = subprocess.run(["bash", "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.split()


def test_bash_completes_commands_options_models_and_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("shtab")
    script = tmp_path / "pinflex.bash"
    script.write_text(files.script(build_parser(), "bash"))
    monkeypatch.chdir(tmp_path)
    Path("own_robot.yaml").touch()
    assert {"command", "compare", "completion"} <= {*answers(script, "pinflex", "com")}
    assert "--until" in answers(script, "pinflex", "solve", "--u")
    assert {"3rrr", "3rrs"} <= {*answers(script, "pinflex", "solve", "3rr")}
    assert "own_robot.yaml" in answers(script, "pinflex", "solve", "own")
    assert "_pinflex_models" in files.script(build_parser(), "zsh")


def test_without_its_package_completion_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "shtab", None)
    with pytest.raises(DescriptionError, match=r"pip install \"pinflex\[completion\]\""):
        files.script(build_parser(), "bash")
