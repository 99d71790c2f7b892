"""Build hook: the compiled kernel into the wheel, or beside the sources of an editable install.

PINFLEX_BUILD_KERNEL=0 leaves it out, and a build that fails does so too: pinflex then runs on numpy
and Pinocchio. PINFLEX_BUILD_TARGET=linux-aarch64 (see pinflex/kernel/build.py) compiles for another
machine and tags the wheel with it.
"""

from __future__ import annotations

import importlib.util
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class KernelHook(BuildHookInterface):  # type: ignore[type-arg]
    """Compiles pinflex/kernel/source."""

    def dependencies(self) -> list[str]:
        """Clang, as a pip package: 100 MB to fetch, for the build alone."""
        build = self._build()
        known = (os.environ.get("PINFLEX_BUILD_TARGET") or build.here()) in build.TARGETS
        if not self._wanted() or not known or importlib.util.find_spec("ziglang") is not None:
            return []
        return ["ziglang>=0.13"]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, and tell hatchling about the libraries and the tag of the wheel."""
        if self.target_name != "wheel" or not self._wanted():
            return
        build = self._build()
        target = os.environ.get("PINFLEX_BUILD_TARGET") or build.here()
        editable = version == "editable"
        folder = (
            build.SOURCE.parent if editable else Path(tempfile.mkdtemp(prefix="pinflex-kernel-"))
        )
        try:
            made = [
                path
                for library in build.compile_all(folder, target)
                for path in (library, build.digest_of(library))
            ]
        except Exception as error:
            self.app.display_warning(f"pinflex: no compiled kernel, numpy serves: {error}")
            return
        made += self._wasm(build, folder)
        self._made = [] if editable else made
        if not editable:
            for path in made:
                build_data["force_include"][str(path)] = f"pinflex/kernel/{path.name}"
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{build.TARGETS[target][1]}"

    def _wasm(self, build: Any, folder: Path) -> list[Path]:
        """The kernel that pages carry; without it they compile it, or say what to install."""
        try:
            return [build.compile_wasm(folder / build.wasm_name())]
        except RuntimeError as error:
            self.app.display_warning(f"pinflex: no kernel for pages that compute: {error}")
            return []

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove what was compiled outside the source tree."""
        for path in getattr(self, "_made", []):
            path.unlink(missing_ok=True)
            if not any(path.parent.iterdir()):
                path.parent.rmdir()

    def _build(self) -> Any:
        return _module(Path(self.root) / "pinflex" / "kernel" / "build.py")

    def _wanted(self) -> bool:
        return os.environ.get("PINFLEX_BUILD_KERNEL", "") != "0"


def _module(path: Path) -> Any:
    """The builder, by its path: pinflex itself cannot be imported in a build environment."""
    spec = importlib.util.spec_from_file_location("pinflex_kernel_build", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module
