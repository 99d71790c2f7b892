"""Servers on the loopback interface: for this machine, under its own name, and gone afterwards.

Claims:
    Pages, pictures, figures
    - servers: this machine and its own name only; live play leaves no process, thread or port | - |
      -
    Bad input, costs, signals
    - pages closed while they load, ports 6000 and 7000 taken: live play goes on | - | exact |
      passes
"""

from __future__ import annotations

import http.client
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinflex as pf
from pinflex.errors import DescriptionError, PinflexError
from pinflex.viewer.links import triangles
from pinflex.viewer.live import Live, Server
from tests.synthetic import synthetic_result


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Server]:
    (tmp_path / "page.html").write_text("<p>page</p>", encoding="utf-8")
    with Server(tmp_path / "page.html") as started:
        thread = threading.Thread(target=started.serve_forever)
        thread.start()
        yield started
        started.shutdown()
        thread.join()


def test_the_page_and_nothing_else_is_served(server: Server) -> None:
    port = server.server_address[1]
    assert _get(port, f"127.0.0.1:{port}") == (200, b"<p>page</p>")
    assert _get(port, f"localhost:{port}")[0] == 200
    assert _get(port, f"127.0.0.1:{port}", "/../page.html")[0] == 404
    assert server.server_address[0] == "127.0.0.1"


@pytest.mark.parametrize("host", ["evil.example", "evil.example:{port}", "127.0.0.1:1", ""])
def test_another_host_name_is_refused(server: Server, host: str) -> None:
    port = server.server_address[1]
    assert _get(port, host.format(port=port))[0] == 403


def test_a_port_in_use_is_told(server: Server, tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match="cannot be used"):
        Server(tmp_path / "page.html", server.server_address[1])


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of pyzmq and tornado
def test_live_play_listens_to_this_machine_only_and_leaves_nothing_behind(
    capfd: pytest.CaptureFixture[str],
) -> None:
    before, children = threading.active_count(), _children()
    with Live(synthetic_result(samples=21)) as live:
        port = int(live.url.split(":")[2].split("/")[0])
        status, page = _get(port, f"127.0.0.1:{port}", "/static/")
        assert (status, b"MeshCat" in page or b"meshcat" in page) == (200, True)
        assert _get(port, f"evil.example:{port}", "/static/")[0] == 403
        assert _get(port, f"evil.example:{port}", "/")[0] == 403
        assert live.url.startswith("http://127.0.0.1:")
        assert _listening(port) in ({"0100007F"}, set())  # 127.0.0.1, where /proc tells
        live.play(seconds=0.3)
        assert _children() == children
    assert threading.active_count() == before
    with pytest.raises(ConnectionRefusedError), socket.create_connection(("127.0.0.1", port), 2):
        pass
    assert capfd.readouterr().out == ""


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_pages_closed_while_they_load_do_not_end_live_play() -> None:
    """A handshake, one read, then a reset, twenty times; the server answers to the end."""
    with Live(synthetic_result(samples=21)) as live:
        port = int(live.url.split(":")[2].split("/")[0])
        lines = (
            *("GET / HTTP/1.1", f"Host: 127.0.0.1:{port}", f"Origin: http://127.0.0.1:{port}"),
            *("Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13"),
            *("Sec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==", "", ""),
        )
        for k in range(20):
            with socket.create_connection(("127.0.0.1", port), 5) as page:
                page.sendall("\r\n".join(lines).encode())
                assert page.recv(64).startswith(b"HTTP/1.1 101")
                page.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1" + bytes(7))
            live.show(0.01 * k)
        live.play(seconds=0.3)
        assert _get(port, f"127.0.0.1:{port}", "/static/")[0] == 200


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_live_play_takes_any_free_port(capfd: pytest.CaptureFixture[str]) -> None:
    """meshcat's own, 6000 and 7000, may be taken."""
    with ExitStack() as stack:
        for port in (6000, 7000):
            taken = stack.enter_context(socket.socket())
            with suppress(OSError):  # by somebody else: as good
                taken.bind(("127.0.0.1", port))
                taken.listen()
        live = stack.enter_context(Live(synthetic_result(samples=21)))
        assert ":7000/" not in live.url
    assert capfd.readouterr() == ("", "")


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_live_play_draws_the_robots_own_meshes_and_bends_them() -> None:
    pytest.importorskip("example_robot_data")
    result = pf.solve(pf.load("ur5"), until=0.02, samples=3)
    with Live(result, scale=1) as live:
        commands: list[dict[str, Any]] = []
        live._window.send = lambda command: commands.append(command.lower())  # type: ignore
        live._bodies()
        live.show(result.t[-1])
    bodies = {c["path"] for c in commands if c["type"] == "set_object" and "/body_" in c["path"]}
    drawn = [c for c in commands if c["type"] == "set_object" and "/link_" in c["path"]]
    assert len(bodies) == 5  # of meshes: a body of simple shapes has several objects each
    assert len(drawn) == 2
    for command, link in zip(drawn, live.scene["links"], strict=True):
        sent = command["object"]["geometries"][0]["data"]["attributes"]["position"]["array"]
        points = np.frombuffer(sent["data"] if isinstance(sent, dict) else sent.data, "<f4")
        points = points.reshape(-1, 3)
        ends = link["rigid"][-1]  # a straight link is kept by its two ends
        line = ends[0] + np.outer(link["x"] / link["x"][-1], ends[1] - ends[0])
        away = np.linalg.norm(points[:, None] - line[None], axis=2).min(axis=1)
        mesh = triangles(link["mesh"])[0]
        # as far from its line as the mesh is: true deflections are small, stations 0.02 m apart
        assert away.max() == pytest.approx(np.hypot(*mesh[:, 1:].T).max(), rel=0.2)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_command_that_plays_live_ends_with_its_signal_and_leaves_no_process(
    tmp_path: Path,
) -> None:
    file = synthetic_result(samples=21).save(tmp_path / "run.npz")
    command = [sys.executable, "-m", "pinflex", "view", str(file), "--live", "--no-open"]
    env = {**os.environ, "PYTHONPATH": str(Path(pf.__file__).parents[1])}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=env) as live:
        assert live.stdout is not None
        live.stdout.readline()  # the page
        port = int(live.stdout.readline().split(":")[2].split("/")[0])
        assert _get(port, f"127.0.0.1:{port}", "/static/")[0] == 200
        assert _children(live.pid) == []
        live.send_signal(signal.SIGTERM)
        assert live.wait(10) == 0  # as Ctrl-C ends it
    with pytest.raises(ConnectionRefusedError), socket.create_connection(("127.0.0.1", port), 2):
        pass


def _get(port: int, host: str, path: str = "/") -> tuple[int, bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    try:
        connection.putrequest("GET", path, skip_host=True)
        connection.putheader("Host", host)
        connection.endheaders()
        answer = connection.getresponse()
        return answer.status, answer.read()
    finally:
        connection.close()


def _listening(port: int) -> set[str]:
    """Local addresses, as /proc/net writes them, that listen on a port."""
    found = set()
    for table in (Path("/proc/net/tcp"), Path("/proc/net/tcp6")):
        for line in table.read_text().splitlines()[1:] if table.is_file() else []:
            local, state = line.split()[1], line.split()[3]
            if state == "0A" and int(local.split(":")[1], 16) == port:
                found.add(local.split(":")[0])
    return found


def _children(pid: int | str = "self") -> list[str]:
    tasks = Path(f"/proc/{pid}/task")
    found = tasks.glob("*/children") if tasks.is_dir() else []
    return sorted(pid for path in found for pid in path.read_text().split())


def test_without_meshcat_live_says_so_and_a_page_is_written_all_the_same(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "meshcat", None)  # any import of it fails
    monkeypatch.setattr("pinflex.viewer.live.find_spec", lambda name: None)
    run = synthetic_result(samples=5)
    with pytest.raises(PinflexError, match="meshcat is not installed"):
        Live(run)
    assert pf.view(run, tmp_path / "page.html").path.stat().st_size > 1e5
