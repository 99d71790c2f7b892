"""Commands that run beside the tests."""

from __future__ import annotations

import os
import subprocess
import time
from pathlib import Path


def wait_until_busy(process: subprocess.Popen[str], seconds: float = 3.0) -> None:
    """Wait until a process has computed for some seconds, however slow the machine is.

    Args:
        process: Its start, imports and all, takes about one second of them.
        seconds: Of CPU time; without Linux's /proc of the clock.
    """
    times = Path(f"/proc/{process.pid}/stat")
    if not times.exists():
        time.sleep(seconds)
        return
    while process.poll() is None:
        user, system = times.read_text().rpartition(")")[2].split()[11:13]
        if (int(user) + int(system)) / os.sysconf("SC_CLK_TCK") > seconds:
            return
        time.sleep(0.05)
