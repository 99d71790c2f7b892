"""Expand a xacro in a process that can do nothing but compute; run as a script by `xacro_files`.

A xacro holds Python expressions, and the package xacro does not keep those from reaching the whole
interpreter. So the package is loaded first; then Linux takes every right from this process but to
compute and to talk to its parent through two pipes (seccomp), which reads files for it. One JSON
object a line: a request goes out, its answer comes in.
"""

from __future__ import annotations

import ctypes
import io
import json
import os
import platform
import struct
import sys
from typing import Any

# System calls that stay, in this order: read write close fstat lseek mmap mprotect munmap brk
# rt_sigaction rt_sigprocmask rt_sigreturn sched_yield mremap madvise getpid exit futex
# clock_gettime exit_group gettid getrandom restart_syscall. All work on memory or on open pipes.
_CALLS = {
    "x86_64": (
        *(0, 1, 3, 5, 8, 9, 10, 11, 12, 13, 14, 15, 24, 25, 28, 39, 60, 202, 228, 231, 186),
        *(318, 219),
    ),
    "aarch64": (
        *(63, 64, 57, 80, 62, 222, 226, 215, 214, 134, 135, 139, 124, 216, 233, 172, 93, 98, 113),
        *(94, 178, 278, 128),
    ),
}
_ARCHITECTURE = {"x86_64": 0xC000003E, "aarch64": 0xC00000B7}
_LOAD, _EQUAL, _RETURN = 0x20, 0x15, 0x06  # instructions of the filter (BPF)
_ALLOW, _REFUSE, _KILL = 0x7FFF0000, 0x00050001, 0x80000000  # the second: EPERM
_NO_NEW_RIGHTS, _SECCOMP, _FILTER = 38, 22, 2  # of prctl
SECONDS, MEMORY = 5, 2**31


def limit() -> None:
    """Bound this process in time and memory."""
    try:
        import resource
    except ImportError:  # Windows
        return
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if sys.platform == "linux":
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))


def confine() -> bool:
    """Give up every right but to compute and to use open pipes; False where that cannot be done."""
    machine = platform.machine()
    if sys.platform != "linux" or machine not in _CALLS:
        return False
    calls = _CALLS[machine]
    # Another architecture's numbers (32 bit) mean other calls: such a call ends the process.
    rules = [(_LOAD, 0, 0, 4), (_EQUAL, 1, 0, _ARCHITECTURE[machine]), (_RETURN, 0, 0, _KILL)]
    rules.append((_LOAD, 0, 0, 0))
    rules += [(_EQUAL, len(calls) - k, 0, call) for k, call in enumerate(calls)]
    rules += [(_RETURN, 0, 0, _REFUSE), (_RETURN, 0, 0, _ALLOW)]
    code = ctypes.create_string_buffer(b"".join(struct.pack("<HBBI", *rule) for rule in rules))
    program = struct.pack("@HP", len(rules), ctypes.addressof(code))
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(_NO_NEW_RIGHTS, 1, 0, 0, 0):
        return False
    return not libc.prctl(_SECCOMP, _FILTER, ctypes.c_char_p(program), 0, 0)


def _ask(request: dict[str, Any]) -> Any:
    sys.__stdout__.write(json.dumps(request) + "\n")  # type: ignore[union-attr]
    sys.__stdout__.flush()  # type: ignore[union-attr]
    answer = json.loads(sys.__stdin__.readline())  # type: ignore[union-attr]
    if "error" in answer:
        raise OSError(f"{next(iter(request.values()))}: {answer['error']}")
    return answer["value"]


def main() -> None:
    """Answer one request: what to expand, by which paths of modules."""
    first = json.loads(sys.stdin.readline())
    sys.path[:] = first["path"]

    import xml.dom.expatbuilder  # noqa: F401, xacro would import it when no file can be read

    import xacro  # type: ignore[import-not-found,import-untyped,unused-ignore]
    import xacro.substitution_args  # type: ignore[import-not-found,import-untyped,unused-ignore]

    xacro.open = lambda name, *_, **__: io.StringIO(_ask({"read": str(name)}))
    xacro.glob.glob = lambda pattern, *_, **__: _ask({"match": str(pattern)})
    xacro.substitution_args._eval_find = lambda package: _ask({"package": str(package)})
    os.getcwd = lambda: first["folder"]
    limit()
    confined = confine()
    if not confined and not first["trusted"]:
        _ask({"unconfined": True})
        return
    sys.stdout = io.StringIO()
    try:
        text = xacro.process_file(first["file"], mappings=first["boundary"]).toxml()
    except BaseException as error:  # whatever its expressions raise, SystemExit among it
        _ask({"failed": (str(error).strip() or type(error).__name__)[:2000]})
        return
    _ask({"text": text})


if __name__ == "__main__":
    main()
