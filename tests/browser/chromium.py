"""A headless Chromium that opens pages from disk."""

from __future__ import annotations

import io
import shutil
import time
from pathlib import Path
from typing import Any

import numpy as np

CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")


class Browser:
    """A headless Chromium that opens pages from disk."""

    def __init__(self, profile: Path) -> None:
        from selenium import webdriver
        from selenium.webdriver.chrome.service import Service

        options = webdriver.ChromeOptions()
        options.binary_location = str(CHROMIUM)
        for flag in (
            "--headless=new --no-sandbox --disable-gpu --enable-unsafe-swiftshader "
            "--disable-dev-shm-usage --disable-quic --no-first-run --disable-background-networking "
            "--disable-component-update --disable-sync --hide-scrollbars --window-size=1000,843 "
            f"--user-data-dir={profile}"
        ).split():
            options.add_argument(flag)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        self.driver: Any = webdriver.Chrome(options=options, service=Service(DRIVER))
        self.driver.set_script_timeout(60)

    def open(self, page: Path, state: str = "", size: tuple[int, int] | None = None) -> None:
        metrics = {"width": 1000, "height": 700, "deviceScaleFactor": 1, "mobile": False}
        if size is not None:
            metrics |= {"width": size[0], "height": size[1], "mobile": True}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        self.driver.get("about:blank")
        self.driver.get_log("browser")
        self.driver.get(f"{page.as_uri()}#{state}")
        self.wait()

    def wait(self) -> None:
        """Until the page is ready."""
        for _ in range(300):
            if self.run("return !!(window.pinflex && window.pinflex.ready)"):
                return
            time.sleep(0.1)
        raise AssertionError(f"the page never got ready: {self.driver.get_log('browser')}")

    def run(self, script: str, *values: Any) -> Any:
        return self.driver.execute_script(script, *values)

    def errors(self) -> list[str]:
        log = self.driver.get_log("browser")
        return [entry["message"] for entry in log if entry["level"] == "SEVERE"]

    def pixels(self, script: str = "") -> np.ndarray[Any, Any]:
        """The drawing alone, as an image array, after a script."""
        from base64 import b64decode

        from PIL import Image

        url = self.run(
            script + "; pinflex.frame(); return document.querySelector('#pane canvas')"
            ".toDataURL('image/png')"
        )
        return np.asarray(Image.open(io.BytesIO(b64decode(url.split(",")[1]))).convert("RGB"), int)

    def centreline(self, name: str) -> np.ndarray[Any, Any]:
        return np.array(self.run("return pinflex.centreline(arguments[0])", name)).reshape(-1, 3)
