"""A xacro runs nothing but xacro: no command, no foreign file, no end of time or memory.

Claims:
    Hard cases
    - code in a xacro opens, starts, ends and lists nothing; no foreign file; limits of time and
      memory | - | refused | passes
"""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from pinflex.description.description import read
from pinflex.description.robots import confined
from pinflex.errors import DescriptionError

pytest.importorskip("xacro")
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="confined on Linux only")

HEAD = '<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">'
INERTIAL = (
    '<inertial><mass value="${MASS}"/>'
    '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
)
BODY = (
    f'<link name="base"/><link name="rod">{INERTIAL}</link><joint name="j" type="continuous">'
    '<parent link="base"/><child link="rod"/><axis xyz="0 0 1"/></joint></robot>'
)
REACH = (  # out of xacro's own evaluator, to the modules behind it
    "(lambda: [c for c in ().__class__.__base__.__subclasses__() "
    "if c.__name__=='_wrap_close'][0].__init__.__globals__)()"
)


def robot(folder: Path, mass: str, more: str = "") -> Path:
    path = folder / "arm.xacro"
    path.write_text(HEAD + more + BODY.replace("MASS", mass), "utf-8")
    return path


def test_what_xacro_computes_is_taken(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "m.xacro").write_text(
        HEAD + '<xacro:property name="m" value="${1 + 0.5}"/></robot>'
    )
    (tmp_path / "n.yaml").write_text("n: 2\n")
    more = (
        '<xacro:include filename="parts/m.xacro"/><xacro:include filename="$(find parts)/m.xacro"/>'
    )
    path = robot(tmp_path, "m * load_yaml('n.yaml')['n']", more)
    assert 'mass value="3.0"' in read(path).urdf_text


def test_arguments_are_those_of_the_yaml(tmp_path: Path) -> None:
    (tmp_path / "n.xacro").write_text(HEAD + '<xacro:arg name="heavy" default="false"/></robot>')
    more = '<xacro:arg default="1" name="m"/><xacro:include filename="n.xacro"/>'
    robot(tmp_path, "float('$(arg m)') * (2 if '$(arg heavy)' == 'true' else 1)", more)
    scene = tmp_path / "scene.yaml"
    for given, mass in (("{}", 1.0), ("{m: 1.5}", 1.5), ("{m: '1.5', heavy: true}", 3.0)):
        scene.write_text(f"urdf: arm.xacro\nxacro_args: {given}\n")
        assert f'mass value="{mass}"' in read(scene).urdf_text
    lighter = read(scene).with_overrides(["xacro_args.m=0.25"])
    assert 'mass value="0.5"' in lighter.urdf_text
    for given, words in (
        ("{heavi: true}", 'no such <xacro:arg>: "heavi". Did you mean "heavy"'),
        ("{m: [1]}", r"scene.yaml: xacro_args.m: \[1\] is not a text"),
    ):
        scene.write_text(f"urdf: arm.xacro\nxacro_args: {given}\n")
        with pytest.raises(DescriptionError, match=words):
            read(scene)
    (tmp_path / "arm.urdf").write_text(lighter.urdf_text)
    scene.write_text("urdf: arm.urdf\nxacro_args: {m: 1}\n")
    with pytest.raises(DescriptionError, match="xacro_args: arm.urdf is no xacro"):
        read(scene)


@pytest.mark.parametrize(
    "expression",
    [
        f"{REACH}['open']('made_it', 512)",
        f"{REACH}['fork']()",
        f"{REACH}['kill'](1, 0)",
        f"{REACH}['listdir']('/')",
    ],
    ids=["open", "fork", "kill", "listdir"],
)
def test_code_in_it_gets_nowhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, expression: str
) -> None:
    monkeypatch.chdir(tmp_path)
    path = robot(tmp_path, expression)
    with pytest.raises(DescriptionError, match="Operation not permitted"):
        read(path)
    assert [p.name for p in tmp_path.iterdir()] == ["arm.xacro"]


def test_a_command_is_not_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = robot(tmp_path, REACH + "['system']('touch made_it')")
    assert 'mass value="32512"' in read(path).urdf_text  # of `system`: no shell to be had
    assert [p.name for p in tmp_path.iterdir()] == ["arm.xacro"]


@pytest.mark.parametrize("name", ["/etc/passwd", "/proc/self/environ"])
def test_files_that_are_no_robots_are_not_read(tmp_path: Path, name: str) -> None:
    with pytest.raises(DescriptionError, match="a xacro may read .xacro, .urdf") as refused:
        read(robot(tmp_path, f"load_yaml('{name}')"))
    assert "root:" not in str(refused.value)


@pytest.mark.parametrize("endless", ["9**9**9", "'a' * 10**11"], ids=["time", "memory"])
def test_it_has_limits(tmp_path: Path, endless: str) -> None:
    with pytest.raises(DescriptionError, match="arm.xacro: .*(took more than|cannot expand)"):
        read(robot(tmp_path, endless))


def test_where_the_system_cannot_confine_it_it_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = tmp_path / "no_seccomp.py"
    text = Path(confined.__file__).read_text("utf-8")
    script.write_text(text.replace('sys.platform != "linux"', "True"), "utf-8")
    monkeypatch.setattr(confined, "__file__", str(script))
    folder = tmp_path / "robot"
    folder.mkdir()
    with pytest.raises(DescriptionError, match="PINFLEX_TRUST_XACRO=1"):
        read(robot(folder, "1"))
    monkeypatch.setenv("PINFLEX_TRUST_XACRO", "1")
    assert 'mass value="1"' in read(robot(folder, "1")).urdf_text
