"""One page on the loopback interface, for a browser that may not read files.

Only this machine can connect, and only under its own name: a request that names another host (a web
site whose name was made to point here) is refused.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from pinflex.errors import DescriptionError
from pinflex.results.result import Result

HOST = "127.0.0.1"


class Server(ThreadingHTTPServer):
    """Serves one page at /; `with Server(page) as server: server.serve_forever()`."""

    daemon_threads = True  # an open connection does not hold up the end

    def __init__(self, page: Path, port: int = 0) -> None:
        self.body = page.read_bytes()
        try:
            super().__init__((HOST, port), _Handler)
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or error
            raise DescriptionError(
                f"view: port {port} cannot be used ({reason}). Choose another one from 1024 to "
                "65535, or none: a free one is found."
            ) from error

    @property
    def url(self) -> str:
        """Address to open."""
        return f"http://{HOST}:{self.server_address[1]}/"


def page_until_interrupted(page: Path, port: int) -> None:
    """Serve a page until Ctrl-C; the address is printed."""
    with Server(page, port) as server, contextlib.suppress(KeyboardInterrupt):
        print(f"{server.url} (only from this machine; Ctrl-C ends it)", flush=True)
        server.serve_forever()


def live_until_interrupted(
    result: Result, field: str, scale: float | str, meshes: Sequence[str | Path]
) -> None:
    """Play a run in meshcat until Ctrl-C; the address is printed."""
    from pinflex.viewer.live import Live

    with Live(result, field, scale, meshes) as live, contextlib.suppress(KeyboardInterrupt):
        print(f"{live.url} (only from this machine; Ctrl-C ends it)", flush=True)
        live.play(seconds=math.inf)


class _Handler(BaseHTTPRequestHandler):
    server: Server
    server_version, sys_version = "pinflex", ""
    timeout = 30  # [s] a connection that says nothing

    def do_GET(self) -> None:
        """The page, and nothing else."""
        self._answer(with_body=True)

    def do_HEAD(self) -> None:
        """As GET, without the page."""
        self._answer(with_body=False)

    def _answer(self, with_body: bool) -> None:
        port = self.server.server_address[1]
        if self.headers.get("Host") not in (f"{HOST}:{port}", f"localhost:{port}"):
            self.send_error(403, "this page is for this machine only")
            return
        if self.path.partition("?")[0] != "/":
            self.send_error(404)
            return
        self.send_response(200)
        self.send_header("Content-Type", "text/html; charset=utf-8")
        self.send_header("Content-Length", str(len(self.server.body)))
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Frame-Options", "DENY")
        self.end_headers()
        if with_body:
            self.wfile.write(self.server.body)

    def log_message(self, *unused: object) -> None:
        """Say nothing: the output belongs to the command."""
