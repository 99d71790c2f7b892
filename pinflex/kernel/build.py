"""Compile the C code: `python -m pinflex.kernel.build`, and the hook of a wheel.

Stands alone (the build environment of a wheel has neither numpy nor pinflex). The compiler that CC
names comes first, then clang out of the pip package `ziglang`: it needs nothing on the machine, and
compiles for others too. PINFLEX_KERNEL_FLAGS adds flags, such as those of sanitizers.
"""

from __future__ import annotations

import hashlib
import os
import platform
import sys
from functools import cache
from pathlib import Path

SOURCE = Path(__file__).parent / "source"
# Sums are not reordered: numbers do not depend on the compiler's mood, and not-a-number stays one.
FLAGS = (
    *("-std=c11", "-O3", "-shared", "-fPIC", "-fvisibility=hidden", "-s"),
    *("-ffp-contract=fast", "-fno-math-errno", "-Wno-psabi"),
)
# Names of builds by machine, best last, with the flags of zig and of other compilers.
BUILDS = {
    "x86_64": (("baseline", ("-mcpu=x86_64",), ("-march=x86-64",)),
               ("v3", ("-mcpu=x86_64_v3",), ("-march=x86-64-v3",))),
    "aarch64": (("baseline", (), ()),),
}  # fmt: skip
# What zig calls a target, the tag of its wheel, and the ending of a shared library there.
TARGETS = {
    "linux-x86_64": ("x86_64-linux-gnu.2.17", "manylinux_2_17_x86_64", ".so"),
    "linux-aarch64": ("aarch64-linux-gnu.2.17", "manylinux_2_17_aarch64", ".so"),
    "macos-x86_64": ("x86_64-macos.11.0", "macosx_11_0_x86_64", ".dylib"),
    "macos-aarch64": ("aarch64-macos.11.0", "macosx_11_0_arm64", ".dylib"),
}
# The kernel of a page that computes: 128 bits are what every browser has, and products are not
# fused there. What a page calls is named, so that the rest (level ked, energies) is left out.
# A run takes 3 to 6 % longer than with -O2, which makes a page 19 kB larger, and unrolled loops
# 24 kB more.
WASM_FLAGS = (
    *("-std=c11", "-Os", "-fno-unroll-loops", "-mllvm", "-inline-threshold=100"),
    *("-msimd128", "-s", "-mexec-model=reactor"),
    *("-fvisibility=hidden", "-ffp-contract=off", "-fno-math-errno", "-Wno-psabi"),
)
WASM_CALLS = (
    *("work_size", "residuals", "tangent", "closure_motion", "closures", "forces", "poses"),
    *("march", "begin", "correct_steps", "samples"),
)
WASM_INSIDE = ("retract", "factors", "solve")  # functions of the sources themselves


@cache
def code() -> bytes:
    """All of the C code."""
    text = b"".join(path.read_bytes() for path in sorted(SOURCE.glob("*.[ch]")))
    return text.replace(b"\r\n", b"\n")


def fingerprint() -> str:
    """Of the C code: a library of another one is not loaded."""
    return hashlib.sha256(code()).hexdigest()[:16]


def here() -> str:
    """The target of this machine, "system-machine"."""
    machine = platform.machine().lower()
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(machine, machine)
    system = {"darwin": "macos"}.get(platform.system().lower(), platform.system().lower())
    return f"{system}-{machine}"


def name_of(target: str, build: str) -> str:
    """File name of a library."""
    return f"kernel-{target}-{build}{TARGETS[target][2]}"


def digest_of(library: Path) -> Path:
    """The file that holds the digest of a library, beside it."""
    return library.with_name(f"{library.name}.sha256")


def is_whole(library: Path) -> bool:
    """Whether a library is what was compiled: one cut short would end the process, not the load."""
    digest = digest_of(library)
    if not digest.exists():  # compiled by hand
        return True
    return digest.read_text("ascii").strip() == hashlib.sha256(library.read_bytes()).hexdigest()


def compile_all(folder: Path, target: str | None = None) -> list[Path]:
    """Compile every build of a target into a folder.

    Returns:
        The libraries.
    Raises:
        RuntimeError: The target is not known, or no compiler made it.
    """
    from subprocess import SubprocessError

    target = target or here()
    if target not in TARGETS:
        raise RuntimeError(f"no build for {target}. Known: {', '.join(TARGETS)}")
    said = []
    for compiler in compilers(target):
        try:
            return [_compile(compiler, folder, target, *one) for one in BUILDS[_machine(target)]]
        except (OSError, SubprocessError) as error:
            said.append(f"{compiler[0]}: {in_short(error)}")
    raise RuntimeError("; ".join(said) or "no compiler: pip install ziglang")


def compile_wasm(out: Path) -> Path:
    """Compile the kernel that a page carries, by the clang of the package `ziglang`.

    Returns:
        The file, WebAssembly with one import, a clock.
    Raises:
        RuntimeError: There is no `ziglang`, or it does not make it.
    """
    import subprocess

    found = zig("wasm32-wasi")
    if not found:
        raise RuntimeError("no clang that makes WebAssembly: pip install ziglang")
    calls = *(f"pinflex_{name}" for name in WASM_CALLS), *WASM_INSIDE
    try:
        _linked([*found[0], *WASM_FLAGS, *(f"-Wl,--export={name}" for name in calls)], out)
    except (OSError, subprocess.SubprocessError) as error:
        raise RuntimeError(in_short(error)) from error
    return out


def wasm_name() -> str:
    """File name of the kernel that a page carries: it says of what and for what it was compiled."""
    made_by = " ".join((*WASM_FLAGS, *WASM_CALLS, *WASM_INSIDE))
    return f"kernel-{fingerprint()}-{hashlib.sha256(made_by.encode()).hexdigest()[:4]}.wasm"


def in_short(error: Exception) -> str:
    """The first line of a compiler's complaint that says error."""
    lines = str(getattr(error, "stderr", None) or error).splitlines()
    return next((line for line in lines if "error" in line), "".join(lines[:1]))[:300]


def _machine(target: str) -> str:
    return target.rpartition("-")[2]


def compilers(target: str) -> list[list[str]]:
    """Commands to try, in order; compilers of the machine only for itself."""
    import shutil

    chosen = shutil.which(os.environ.get("CC", "")) if target == here() else None
    found = [[chosen]] if chosen else []
    found += zig(TARGETS[target][0])
    if target == here():
        found += [[path] for name in ("clang", "gcc", "cc") if (path := shutil.which(name))]
    return found


def zig(target: str) -> list[list[str]]:
    """The command of zig for what it calls a target, where it is there."""
    from importlib.util import find_spec

    there = find_spec("ziglang") is not None
    return [[sys.executable, "-m", "ziglang", "cc", "-target", target]] if there else []


def _compile(
    compiler: list[str], folder: Path, target: str, build: str, zig: tuple[str, ...],
    other: tuple[str, ...],
) -> Path:  # fmt: skip
    folder.mkdir(parents=True, exist_ok=True)
    out = folder / name_of(target, build)
    flags = (*FLAGS, *(zig if "ziglang" in compiler else other))
    flags += tuple(os.environ.get("PINFLEX_KERNEL_FLAGS", "").split())
    digest = _linked([*compiler, *flags], out)
    digest_of(out).write_text(f"{digest}\n", "ascii")
    for left in folder.glob(f"{out.name}*.pdb"):
        left.unlink()
    return out


def _linked(command: list[str], out: Path) -> str:
    """Compile the sources into a file, and answer with its digest.

    Written beside, then moved: whoever has the old one open keeps it.
    """
    import subprocess

    fresh, sources = out.with_name(f"{out.name}.{os.getpid()}"), sorted(SOURCE.glob("*.c"))
    define = f'-DPINFLEX_FINGERPRINT="{fingerprint()}"'
    whole = [*command, define, *map(str, sources), "-lm", "-o", str(fresh)]
    subprocess.run(whole, check=True, capture_output=True, text=True, timeout=600)
    digest_of(out).unlink(missing_ok=True)
    digest = hashlib.sha256(fresh.read_bytes()).hexdigest()
    os.replace(fresh, out)
    return digest


if __name__ == "__main__":
    for library in compile_all(Path(__file__).parent, *sys.argv[1:2]):
        print(library)
