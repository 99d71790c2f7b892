"""Inputs that nobody means, from a seed: descriptions, URDFs, stored runs and calls, mangled."""

from __future__ import annotations

import copy
import random
from collections.abc import Callable, Iterator
from typing import Any

import yaml

from tests.cli.small import ARM_URDF, ARM_YAML, FOURBAR_URDF, FOURBAR_YAML

RICH_YAML = """\
urdf: arm.urdf
gravity: [0, -9.81, 0]
actuated: [shoulder]
joints: {shoulder: {rotor_inertia: 1.0e-3, damper: 0.01}}
platform: hand
frames: [upper]
home: {shoulder: 0.3}
damping: {rayleigh: [0.1, 1.0e-5]}
flexible:
  upper:
    material: {E: 2.0e11, nu: 0.3, rho: 7850, yield_strength: 2.0e8}
    section: {shape: tube, diameter: 0.02, wall: 0.002}
    basis: {kind: finite_element, elements: 2}
    torsion: true
    segments: 1
    tip: {mass: 0.1, inertia: [1.0e-4, 1.0e-4, 1.0e-4]}
    patches: {piezo: {from: 0.05, to: 0.15, constant: 1.0e-4}}
forces: {push: {at: hand, force: [0, -2, 0], start: 0.01, ramp: 0.02}}
springs: {rope: {between: [base, hand], stiffness: 10, damper: 0.1, length: 0.4}}
control: {quiet: {measure: {link: upper, at: 0.3}, drive: {patch: piezo}, kp: -10, kd: -0.1}}
motion: {kind: trapezoid, joints: {shoulder: 0.5}, ramp: 0.02, duration: 0.1}
solve: {level: coupled, samples: 21, dt: 5.0e-4, until: 0.12, rho_inf: 0.7}
"""
PLANE_YAML = """\
urdf: arm.urdf
platform: hand
flexible:
  "*pper":
    material: aluminium
    section: {shape: i, width: 0.02, height: 0.03, flange: 0.002, web: 0.002}
    basis: {kind: assumed, modes: 2}
    bending_z: false
    axial: true
    modal: null
motion: {kind: formula, joints: {shoulder: "0.3*t^2"}, duration: 0.2}
solve: {level: ked, samples: 21, start: static, integrator: newmark}
"""
SCENES = {  # name: (file of the URDF, URDF, YAML)
    "fourbar": ("fourbar.urdf", FOURBAR_URDF, FOURBAR_YAML),
    "arm": ("arm.urdf", ARM_URDF, ARM_YAML),
    "rich": ("arm.urdf", ARM_URDF, RICH_YAML),
    "plane": ("arm.urdf", ARM_URDF, PLANE_YAML.replace("    modal: null\n", "")),
}
NUMBERS: list[Any] = [
    *(0, -1, 1, 2, 3, 51, 400, 10_000, 10**9, 10**400, -(10**20)),
    *(0.5, 1e-3, 1e3, 1e6, 1e12, 1e15, 1e30, 1e300, 1.7e308, 1e-12, 1e-30, 1e-300, 5e-324),
    *(-1e300, float("nan"), float("inf"), -float("inf")),
]
WORDS: list[Any] = [
    *("", " ", "1", "1e-3", "true", "auto", "x", "-z", "tip", "hand", "upper", "shoulder", "*"),
    *("a\nb", "x" * 10_000, "\x1b[2J", "ü", "日本", "/dev/zero", "../..", "t", "1/t", "0*t^-1"),
    *("exp(exp(t*99))", "__import__('os')", "!!python/object:x", "9" * 400, "NaN", "nul\x00"),
]
OTHERS: list[Any] = [
    *(None, True, False, [], {}, [1], [0, 0, 0], [1, 2, 3], [1e300] * 3, [None], [[]], [["a"]]),
    *({"a": 1}, {1: 2}, {"kind": "mesh", "file": "/dev/zero"}, {"kind": "sampled"}, [[1, 2]] * 3),
    *({"kind": "finite_element", "elements": 60}, {"kind": "craig_bampton", "internal": 40}),
    {"kind": "sampled", "file": "/dev/zero"},
]
POOL = [*NUMBERS, *WORDS, *OTHERS]
FACTORS = (1e-300, 1e-12, 1e-6, 1e-3, 0.1, -1.0, 10.0, 1e3, 1e6, 1e12, 1e300)


def value(rng: random.Random) -> Any:
    """One that is probably wrong; half are numbers, most of what a description holds."""
    return copy.deepcopy(rng.choice(rng.choice((NUMBERS, NUMBERS, WORDS, OTHERS))))


def places(tree: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Every path in nested mappings and lists."""
    keys: Any = ()
    if isinstance(tree, dict):
        keys = tree.keys()
    elif isinstance(tree, list):
        keys = range(len(tree))
    for key in keys:
        yield (*path, key)
        yield from places(tree[key], (*path, key))


def _at(tree: Any, path: tuple[Any, ...]) -> Any:
    for key in path:
        tree = tree[key]
    return tree


def tree(rng: random.Random, root: Any, times: int = 1) -> Any:
    """A copy of nested data with some of it changed."""
    root = copy.deepcopy(root)
    for _ in range(times):
        every = list(places(root))
        if not every:
            return root
        path = rng.choice(every)
        block, key = _at(root, path[:-1]), path[-1]
        old = block[key]
        what = rng.randrange(9)
        if what < 4 or (what == 4 and not isinstance(old, (int, float))):
            block[key] = value(rng)
        elif what == 4:
            block[key] = old * rng.choice(FACTORS)
        elif what == 5:
            del block[key]
        elif what == 6 and isinstance(block, dict):
            name = str(key)
            spot = rng.randrange(len(name) + 1)
            block[rng.choice((name[:spot] + name[spot + 1 :], name + "s", str(value(rng))))] = old
            del block[key]
        elif what == 7:
            block[key] = rng.choice(([old], {"a": old}, str(old), [old, old], [[old] * 3] * 3))
        else:
            block[key] = copy.deepcopy(_at(root, rng.choice(every)))
    return root


def _dump(data: Any) -> str:
    class Plain(yaml.SafeDumper):
        def ignore_aliases(self, data: Any) -> bool:
            return True

    return yaml.dump(data, Dumper=Plain, sort_keys=False, allow_unicode=True)


def text(rng: random.Random, whole: str) -> str:
    """A text cut, doubled, shuffled or with noise in it."""
    lines = whole.splitlines()
    k = rng.randrange(len(lines))
    what = rng.randrange(9)
    if what == 0:
        return whole[: rng.randrange(len(whole))]
    if what == 1:
        return "\n".join([*lines[: k + 1], *lines[k:]])
    if what == 2:
        return "\n".join([*lines[:k], *lines[k + 1 :]])
    if what == 3:
        rng.shuffle(lines)
        return "\n".join(lines)
    if what == 4:
        spot = rng.randrange(len(whole))
        noise = "".join(chr(rng.choice((0, 7, 27, 9, 123, 91, 38, 42, 33, 233, 0xFFFF)))
                        for _ in range(rng.randrange(1, 9)))  # fmt: skip
        return whole[:spot] + noise + whole[spot:]
    if what == 5:
        return whole.replace("  ", rng.choice(("\t", " ", "   ")))
    if what == 6:
        a, b = rng.randrange(len(whole)), rng.randrange(len(whole))
        return whole[: min(a, b)] + whole[max(a, b) :]
    if what == 7:
        return whole * rng.choice((2, 3, 50))
    digits = [i for i, c in enumerate(whole) if c.isdigit()]
    spot = rng.choice(digits)
    return whole[:spot] + str(rng.choice(NUMBERS)) + whole[spot + 1 :]


def _bomb(rng: random.Random) -> str:
    """Merges or aliases that multiply, or contain themselves."""
    deep, wide = rng.randrange(2, 30), rng.randrange(2, 12)
    first, join = rng.choice((("{x: 1}", "{{<<: [{}]}}"), ("[x, x]", "[{}]")))
    lines = [f"a0: &a0 {first}"]
    for i in range(1, deep):
        lines.append(f"a{i}: &a{i} " + join.format(", ".join([f"*a{i - 1}"] * wide)))
    if rng.random() < 0.2:
        lines.append("loop: &loop [*loop, *loop]")
    return "\n".join(lines) + "\n"


def description(rng: random.Random) -> tuple[str, str, str]:
    """File of the URDF, URDF and YAML with the YAML mangled."""
    name, urdf, plain = SCENES[rng.choice(list(SCENES))]
    what = rng.random()
    if what < 0.75:
        return name, urdf, _dump(tree(rng, yaml.safe_load(plain), rng.choice((1, 1, 1, 2, 3))))
    if what < 0.95:
        return name, urdf, text(rng, plain)
    return name, urdf, plain + _bomb(rng) + rng.choice(("", "<<: *a1\n", "<<: *a0\n<<: *a1\n"))


def robot(rng: random.Random) -> tuple[str, str, str]:
    """The same with the URDF mangled: a number, or the text."""
    name, urdf, plain = SCENES[rng.choice(list(SCENES))]
    if rng.random() < 0.6:
        parts = urdf.split('"')
        k = rng.choice(range(1, len(parts), 2))
        words = parts[k].split(" ")
        words[rng.randrange(len(words))] = str(rng.choice((*NUMBERS, *WORDS[:24])))
        parts[k] = " ".join(words)
        return name, '"'.join(parts), plain
    return name, text(rng, urdf), plain


def override(rng: random.Random, plain: str) -> str:
    """One KEY=VALUE of a YAML that is probably wrong."""
    path = rng.choice(list(places(yaml.safe_load(plain))))
    segments = [rng.choice((str(key),) * 4 + ("*", "?", "", "x")) for key in path]
    written = value(rng)
    if rng.random() < 0.3:
        old = _at(yaml.safe_load(plain), path)
        if isinstance(old, (int, float)) and not isinstance(old, bool):
            written = old * rng.choice(FACTORS)
    return ".".join(segments) + rng.choice("====: ") + yaml.safe_dump(
        written, default_flow_style=True
    ).removesuffix("\n...\n")  # fmt: skip


Call = Callable[[], Any]
