"""Five extensions of pinflex from outside the package, each by one registration.

The blocks between the lines of dashes stand in CONTRIBUTING.md too, word for word.

Claims:
    Equations
    - a section shape, closure kind, stepper, output and input format from outside, one registration
      each | the built-in one of the same rows; Saint-Venant's ellipse | 1e-12; order 1 +- 0.2 of
      the stepper | passes
    Pages, pictures, figures
    - a registered integrator has a name in the YAML, goes on from a saved state, and is known in
      the processes of a sweep | the method given as a value | exact; resume 1e-8 | 1e-10
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex import registered
from pinflex.description import loops, section, solve, sources
from pinflex.errors import DescriptionError
from pinflex.results import quantities
from pinflex.studies import batch

ROOT = Path(pf.__file__).parents[1]
ARM = """<robot name="arm">
  <link name="base"/>
  <link name="rod"><inertial><origin xyz="0.25 0 0"/><mass value="1.0"/>
    <inertia ixx="1e-3" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>
  <link name="tip"/>
  <joint name="shoulder" type="continuous"><parent link="base"/><child link="rod"/>
    <axis xyz="0 0 1"/></joint>
  <joint name="wrist" type="fixed"><parent link="rod"/><child link="tip"/>
    <origin xyz="0.5 0 0"/></joint>
</robot>
"""
SCENE = """\
urdf: arm.urdf
gravity: [0, 0, 0]
flexible:
  rod:
    {material: steel, section: SECTION, bending_z: false, axial: false, torsion: false}
motion: {kind: cycloid, joints: {shoulder: 0.5}, duration: 0.2}
solve: {start: straight}
"""
RECTANGLE = "{shape: rectangle, width: 0.02, thickness: 0.005}"
# Two cranks on the ends of a coupler whose far end is held to a third link by CLOSURE.
FOUR_BAR = """<robot name="bars">
  <link name="base"/><link name="crank">INERTIA</link><link name="coupler">INERTIA</link>
  <link name="rocker">INERTIA</link><link name="end_a"/><link name="end_b"/>
  <joint name="j1" type="continuous"><parent link="base"/><child link="crank"/>
    <axis xyz="0 0 1"/></joint>
  <joint name="j2" type="continuous"><parent link="crank"/><child link="coupler"/>
    <origin xyz="0.2 0 0"/><axis xyz="0 0 1"/></joint>
  <joint name="j3" type="continuous"><parent link="base"/><child link="rocker"/>
    <origin xyz="0.4 0 0"/><axis xyz="0 0 1"/></joint>
  <joint name="f1" type="fixed"><parent link="coupler"/><child link="end_a"/>
    <origin xyz="0.4 0 0"/></joint>
  <joint name="f2" type="fixed"><parent link="rocker"/><child link="end_b"/>
    <origin xyz="0.3 0 0"/></joint>
</robot>
""".replace(
    "INERTIA",
    '<inertial><origin xyz="0.1 0 0"/><mass value="1"/><inertia ixx="1e-3" ixy="0" ixz="0" '
    'iyy="1e-2" iyz="0" izz="1e-2"/></inertial>',
)


@pytest.fixture(autouse=True)
def _tables_as_before() -> Iterator[None]:
    """What a test registers is gone after it."""
    tables: tuple[dict[str, object], ...] = (
        section.SHAPES, loops.LOOP_KINDS, sources.READERS, quantities.QUANTITIES, solve.INTEGRATORS,
    )  # type: ignore[assignment]  # fmt: skip
    before, made = [dict(table) for table in tables], [*registered._MADE]
    yield
    registered._MADE[:] = made
    for table, rows in zip(tables, before, strict=True):
        table.clear()
        table.update(rows)


def arm(folder: Path, cut: str = RECTANGLE) -> Path:
    (folder / "arm.urdf").write_text(ARM, "utf-8")
    path = folder / "scene.yaml"
    path.write_text(SCENE.replace("SECTION", cut), "utf-8")
    return path


def bars(folder: Path, kind: str) -> Path:
    (folder / "bars.urdf").write_text(FOUR_BAR, "utf-8")
    path = folder / "bars.yaml"
    path.write_text(
        "urdf: bars.urdf\nactuated: [j1]\nhome: {j1: 1.2, j2: -1.0, j3: 1.5}\n"
        f"loops: {{pin: {{kind: {kind}, between: [end_a, end_b], axis: z}}}}\n"
        "motion: {kind: cycloid, joints: {j1: 0.3}, duration: 0.5}\n",
        "utf-8",
    )
    return path


# ---- a section shape
def ellipse(height: float, width: float, where: str) -> section.Section:
    a, b, turn = height / 2, width / 2, [2 * math.pi * k / 48 for k in range(48)]
    rim = tuple((a * math.cos(x), b * math.sin(x)) for x in turn)  # (y, z)
    return section.Section(
        shape="ellipse", A=math.pi * a * b, Iy=math.pi * a * b**3 / 4, Iz=math.pi * a**3 * b / 4,
        J=math.pi * (a * b) ** 3 / (a**2 + b**2), ky=0.9, kz=0.9, fibres=rim, outline=rim,
        Wt=math.pi * a * b * min(a, b) / 2, dimensions=(("height", height), ("width", width)),
    )  # fmt: skip


def shear(cut: section.Section, y: float, z: float) -> tuple[float, float]:
    return -z / (2 * cut.Iy), y / (2 * cut.Iz)  # Saint-Venant (1855), for a torque of one


ELLIPSE = section.Shape("ellipse", {"height": "length", "width": "length"}, ellipse, shear)
# ----


def test_a_section_shape(tmp_path: Path) -> None:
    from pinflex.results.views import torsion_shear

    section.register_shape(ELLIPSE)
    path = arm(tmp_path, "{shape: ellipse, height: 0.006, width: 0.02}")
    m = pf.load(path)
    cut = m.description.flexible[0].section
    # the stress at the end of the short axis is the largest, torque / Wt
    assert torsion_shear(cut, 0.003, 0.0)[1] == pytest.approx(1 / cut.Wt, rel=1e-12)
    run = pf.solve(m, level="ked", until=0.02, samples=5, dt=1e-3)
    assert run.meta["links"]["rod"]["section"]["shape"] == "ellipse"
    round_one = ELLIPSE.build(height=0.01, width=0.01, where="")
    circle = section.Section.circle(0.01)
    for key in ("A", "Iy", "Iz", "J", "Wt"):
        assert getattr(round_one, key) == pytest.approx(getattr(circle, key), rel=1e-14)
    with pytest.raises(DescriptionError, match=r"section.width: -1 is out of range"):
        pf.load(arm(tmp_path, "{shape: ellipse, height: 0.01, width: -1}"))
    with pytest.raises(DescriptionError, match=r"width: missing"):
        pf.load(arm(tmp_path, "{shape: ellipse, height: 0.01}"))
    with pytest.raises(DescriptionError, match="shape ellipse: there is one of that name"):
        section.register_shape(ELLIPSE)
    for key, wrong in (("J", 0.0), ("Iz", float("nan")), ("A", -1.0)):

        def build(where: str, key: str = key, wrong: float = wrong, **of: float) -> section.Section:
            return replace(ELLIPSE.build(where=where, **of), **{key: wrong})

        section.register_shape(replace(ELLIPSE, name=f"wrong_{key}", build=build))
        with pytest.raises(DescriptionError, match=rf"section.{key}: {wrong:g}.* is out of range"):
            pf.load(arm(tmp_path, f"{{shape: wrong_{key}, height: 0.01, width: 0.02}}"))


# ---- a closure kind of known rows
IN_PLANE = loops.LoopKind("in_plane", points=(0, 1), directions=loops.ALONG, keys=("axis",))
# ----


def test_a_closure_kind(tmp_path: Path) -> None:
    """x and y held, the axes on one line: what `cylindrical` is, under a name of its own."""
    with pytest.raises(DescriptionError, match="'in_plane' is not known"):
        pf.load(bars(tmp_path, "in_plane"))
    loops.register_loop_kind(IN_PLANE)
    ours = pf.solve(pf.load(bars(tmp_path, "in_plane")), level="rigid", samples=21)
    theirs = pf.solve(pf.load(bars(tmp_path, "cylindrical")), level="rigid", samples=21)
    assert ours.worst_closure < 1e-9  # Newton's
    np.testing.assert_allclose(ours.torque, theirs.torque, rtol=1e-12, atol=1e-12)  # same rows
    path = bars(tmp_path, "in_plane")
    path.write_text(path.read_text("utf-8").replace("axis: z", "length: 1"), "utf-8")
    with pytest.raises(DescriptionError, match="has no meaning for the kind in_plane"):
        pf.load(path)
    with pytest.raises(DescriptionError, match=r"directions .* Allowed: none, one pair, ALONG"):
        loops.register_loop_kind(loops.LoopKind("odd", (0,), ((0, 1), (0, 2))))


# ---- a stepper
def backward_euler(at, steps, dt, start):
    """M a + C v + K d + r = 0 with v' = v + dt a, d' = d + dt v'; first order."""
    from pinflex.integrators.collocation import State, saddle

    d, v = start, np.zeros_like(start)
    for k in range(steps):
        now, h = at(k), dt if k else 0.0
        load = -now.r - now.C @ v - now.K @ (d + h * v)
        a, lam = saddle(now.M + h * now.C + h**2 * now.K, now.J, now.J, load, 0 * now.J @ v)
        v = v + h * a
        d = d + h * v
        yield State(d, v, a, lam)


EULER = solve.Integrator("backward_euler", only="ked", method=backward_euler)
# ----


def test_a_stepper(tmp_path: Path) -> None:
    m = pf.load(arm(tmp_path))
    given: dict[str, float] = {"dt": 1e-4, "until": 0.05, "samples": 11}
    best = pf.solve(m, level="ked", **given)
    ours = pf.solve(m, level="ked", integrator=backward_euler, **given)
    finer = pf.solve(m, level="ked", integrator=backward_euler, **given | {"dt": 5e-5})
    first, second = (np.abs(run.torque - best.torque).max() for run in (ours, finer))
    assert 0 < first < 0.05 * np.abs(best.torque).max()
    assert 1.7 < first / second < 2.3  # half the step, half the error of a first-order method
    assert ours.meta["settings"]["integrator"] == "backward_euler"
    with pytest.raises(DescriptionError, match="backward_euler at level coupled"):
        pf.solve(m, level="coupled", integrator=backward_euler)


def test_registered_integrators_have_names_in_the_yaml(tmp_path: Path) -> None:
    from pinflex.integrators.collocation import generalized_alpha, radau
    from pinflex.studies.bench import Case, _Scenes

    path, given = arm(tmp_path), {"until": 0.05, "samples": 11}
    text = path.read_text("utf-8")

    def named(name: str, more: str = "") -> pf.Mechanism:
        path.write_text(f"{text}".replace("straight}", f"straight, integrator: {name}{more}}}"))
        return pf.load(path)

    with pytest.raises(DescriptionError, match="solve.integrator: 'backward_euler' is not known"):
        named("backward_euler", ", level: ked")
    solve.register_integrator(EULER)
    solve.register_integrator(solve.Integrator("soft", method=generalized_alpha(0.5)))
    solve.register_integrator(solve.Integrator("radau_2", only="coupled", method=radau(2)))
    m = named("backward_euler", ", level: ked")
    ours = pf.solve(m, dt=1e-3, **given)
    value = pf.solve(m, integrator=backward_euler, dt=1e-3, **given)
    np.testing.assert_array_equal(ours.torque, value.torque)
    assert ours.meta["settings"]["integrator"] == "backward_euler"
    with pytest.raises(DescriptionError, match="is for linear systems: level ked only"):
        named("backward_euler", ", level: coupled")

    m = named("soft")  # goes on from a saved state
    at_once = pf.solve(m, level="coupled", dt=1e-3, until=0.05, samples=51)
    half = pf.solve(m, level="coupled", dt=1e-3, until=0.025, samples=26)
    on = pf.solve(m, level="coupled", until=0.05, resume=half.save(tmp_path / "half.npz"))
    assert on.meta["settings"]["integrator"] == "soft"
    # 1e-8: Newton ends at 1e-9 of the largest force, from another tangent
    np.testing.assert_allclose(on.torque[-1], at_once.torque[-1], rtol=1e-8)
    known = pf.solve(m, level="coupled", integrator="generalized_alpha", rho_inf=0.5,
                     dt=1e-3, until=0.05, samples=51)  # fmt: skip
    np.testing.assert_array_equal(known.torque, at_once.torque)

    alpha = _Scenes(m).run(Case("alpha", 1e-3))  # what bench solves: the scene's own method
    assert alpha.settings["integrator"] == "soft"

    m = named("radau_2")
    assert _Scenes(m).run(Case("alpha", 1e-3)).settings["integrator"] == "generalized_alpha"
    run = pf.solve(m, level="coupled", tol=1e-2, **given)
    assert run.meta["settings"]["stages"] == 2
    with pytest.raises(DescriptionError, match="resume: goes on with level coupled in steps"):
        pf.solve(m, level="coupled", resume=run, until=0.06)
    from pinflex.cli.runs import _require_resumable

    with pytest.raises(DescriptionError, match="only level coupled in steps"):
        _require_resumable(m, "run.npz", {"level": "coupled", "dt": 1e-3})
    _require_resumable(named("soft"), "run.npz", {"level": "coupled", "dt": 1e-3})
    for wrong in (EULER, solve.Integrator("none")):
        with pytest.raises(DescriptionError, match="one of that name|no method"):
            solve.register_integrator(wrong)


def test_a_sweep_in_processes_knows_what_was_registered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(batch, "can_fork", lambda: False)  # a copy of this process has it anyway
    solve.register_integrator(EULER)
    section.register_shape(ELLIPSE)
    path = arm(tmp_path, "{shape: ellipse, height: 0.006, width: 0.02}")
    path.write_text(path.read_text("utf-8").replace("straight", "straight, level: ked, "
                    "integrator: backward_euler, dt: 1e-3, until: 0.01"), "utf-8")  # fmt: skip
    values = {"flexible.rod.section.width": [0.02, 0.03]}
    alone, two = (pf.sweep(path, values, outputs=["torque"], jobs=jobs) for jobs in (1, 2))
    assert list(two["error"]) == ["", ""]
    for name in alone.arrays:
        if name.startswith("torque"):
            np.testing.assert_array_equal(two[name], alone[name])
    registered.note(solve.register_integrator, "stuck", (x for x in "a generator"))
    with pytest.raises(DescriptionError, match="register_integrator: stuck: cannot travel"):
        pf.sweep(path, values, outputs=["torque"], jobs=2)


def test_an_alpha_scheme_and_a_tableau_of_ones_own(tmp_path: Path) -> None:
    from pinflex.integrators.collocation import AlphaScheme, radau

    m = pf.load(arm(tmp_path))
    given: dict[str, float] = {"dt": 2e-4, "until": 0.05, "samples": 11}
    rule = AlphaScheme("trapezoidal", 0.0, 0.0, 0.25, 0.5)
    for level in ("ked", "coupled"):
        ours = pf.solve(m, level=level, integrator=rule, **given)
        theirs = pf.solve(m, level=level, integrator="newmark", **given)
        np.testing.assert_array_equal(ours.torque, theirs.torque)
        assert ours.meta["settings"]["integrator"] == "trapezoidal"
    two = pf.solve(m, level="coupled", integrator=radau(2), tol=1e-3, until=0.05, samples=11)
    five = pf.solve(m, level="coupled", tol=1e-3, until=0.05, samples=11)
    assert two.meta["settings"]["stages"] == 2
    scale = np.abs(five.torque).max()
    assert np.abs(two.torque - five.torque).max() < 1e-2 * scale  # tol of each, and a margin


# ---- an output quantity
def power(result: pf.Result) -> np.ndarray:
    speed = np.stack([result.joint(name).velocity for name in result.motors], axis=1)
    return (result.torque * speed).sum(axis=1)


POWER = quantities.Quantity("power", "W", "mechanical power of the motors", power, "#0072B2")
# ----


def test_an_output_quantity(tmp_path: Path) -> None:
    from pinflex.viewer.plot import signal, spectrum

    run = pf.solve(pf.load(arm(tmp_path)), level="rigid", samples=41)
    with pytest.raises(DescriptionError, match="no array 'power'"):
        run.array("power")
    quantities.register_quantity(POWER)
    np.testing.assert_array_equal(
        run.array("power"), run.torque[:, 0] * run.joint("shoulder").velocity
    )
    assert run.unit("power") == "W"
    assert signal(run, "power")[1:] == ("mechanical power of the motors", "W")
    assert spectrum(run, "power").axes[0].get_ylabel() == "amplitude [W]"
    assert pf.Result.load(run.save(tmp_path / "run.npz")).array("power").shape == (41,)
    with pytest.raises(DescriptionError, match="quantity torque/x: the key is taken"):
        quantities.register_quantity(quantities.Quantity("torque/x", "N", "", power))


# ---- an input format
def read_table(text: str, file: str, package_dirs: tuple[str, ...]) -> sources.Source:
    """Bars in a row, one a line: name, joint, length [m], mass [kg]."""
    parts, parent, x = ['<robot name="table"><link name="base"/>'], "base", "0"
    for name, joint, length, mass in (line.split() for line in text.splitlines()):
        body = f'<mass value="{mass}"/><inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" '
        parts.append(f'<link name="{name}"><inertial>{body}izz="1e-3"/></inertial></link>')
        parts.append(f'<joint name="{joint}" type="continuous"><parent link="{parent}"/>')
        parts.append(f'<child link="{name}"/><origin xyz="{x} 0 0"/><axis xyz="0 0 1"/></joint>')
        parent, x = name, length
    return sources.read("".join([*parts, "</robot>"]), f"{file}.urdf", package_dirs)


# ----


def test_an_input_format(tmp_path: Path) -> None:
    (tmp_path / "two.bars").write_text("upper j1 0.5 1.0\nlower j2 0.4 0.5\n", "utf-8")
    path = tmp_path / "two.yaml"
    path.write_text(
        "urdf: two.bars\nmotion: {kind: cycloid, joints: {j1: 1, j2: 1}, duration: 1}\n", "utf-8"
    )
    with pytest.raises(DescriptionError, match=r"two.bars, line 1: malformed XML"):
        pf.load(path)
    sources.register(".bars", read_table)
    m = pf.load(path)
    assert m.description.actuated == ("j1", "j2")
    assert m.description.urdf_name == "two.bars.urdf"
    changed = m.description.with_overrides(["gravity=[0, 0, 0]"])  # read again, from the same text
    assert changed.gravity == (0.0, 0.0, 0.0)
    run = pf.solve(m, level="rigid", samples=21)
    pf.view(run, tmp_path / "run.html")
    assert (tmp_path / "run.html").stat().st_size > 100_000  # the bars are drawn by the same text
    with pytest.raises(DescriptionError, match=r"source .bars: there is a reader"):
        sources.register(".bars", read_table)


def test_the_loops_of_an_input_format_join_those_of_the_yaml(tmp_path: Path) -> None:
    from dataclasses import replace

    from pinflex.description.robots.urdf import check

    def closed(text: str, file: str, package_dirs: tuple[str, ...]) -> sources.Source:
        pin = {"kind": "revolute", "between": ["end_a", "end_b"]}
        return replace(check(text, file, package_dirs), loops={"pin": pin})

    sources.register(".closed", closed)
    path = bars(tmp_path, "revolute")
    plain = pf.load(path)
    (tmp_path / "bars.closed").write_text(FOUR_BAR, "utf-8")
    text = re.sub("loops: .*\n", "", path.read_text("utf-8"))
    path.write_text(text.replace("bars.urdf", "bars.closed"), "utf-8")
    ours = pf.load(path)
    assert ours.description.loops == plain.description.loops
    assert ours.description.with_overrides(["limit=2"]).loops == plain.description.loops
    a, b = (pf.solve(m, level="rigid", samples=11).torque for m in (ours, plain))
    np.testing.assert_array_equal(a, b)
