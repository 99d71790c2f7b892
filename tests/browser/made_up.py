"""Results made up from the synthetic one: six links, names like markup, a mode shape."""

from __future__ import annotations

import numpy as np

from pinflex.results.result import Result

FALLEN = "t = 0.2 s: no equilibrium: the load can be put on to 95 % only."
EVIL = "</script><script>window.evil=1</script>"


def six_links(run: Result) -> Result:
    arrays, links = dict(run.arrays), dict(run.meta["links"])
    for key, value in run.arrays.items():
        if key.startswith("link/"):
            arrays[key.replace("distal", "other")] = value
    links |= {name.replace("distal", "other"): about for name, about in links.items()}
    return Result(run.t, arrays, {**run.meta, "links": links})


def with_surface(run: Result) -> Result:
    """The run with stress on a box about distal_1, larger at one corner than in any section."""
    x, y, z = np.meshgrid(np.linspace(0, 0.22, 9), (-1e-3, 1e-3), (-0.0125, 0.0125), indexing="ij")
    nodes = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    ring = [0, 1, 3, 2]
    faces = [[0, 1, 3], [0, 3, 2], [32, 35, 33], [32, 34, 35]]
    for k in range(0, 32, 4):
        for a, b in zip(ring, ring[1:] + ring[:1], strict=True):
            faces += [[k + a, k + 4 + a, k + 4 + b], [k + a, k + 4 + b, k + b]]
    wave = np.abs(np.sin(40 * run.t)) + 0.1
    section = run.link("distal_1").von_mises.max()
    stress = section * (0.2 + 0.2 * x.ravel() / 0.22 + 0.05 * (y.ravel() > 0))
    stress[18] = 1.5 * section
    about = {"frame": np.eye(3).tolist(), "origin": [0.0, 0.0, 0.0]}
    links = {**run.meta["links"], "distal_1": {**run.meta["links"]["distal_1"], **about}}
    mesh = {"nodes": nodes, "triangles": np.array(faces, float)}
    mesh["von_mises"] = np.outer(wave, stress)
    arrays = {**run.arrays, **{f"link/distal_1/mesh/{k}": v for k, v in mesh.items()}}
    return Result(run.t, arrays, {**run.meta, "links": links})


def renamed(run: Result) -> Result:
    names = {"distal_1": EVIL, "distal_2": "__proto__"}
    arrays = {}
    for key, value in run.arrays.items():
        for old, new in names.items():
            key = key.replace(f"link/{old}/", f"link/{new}/")
        arrays[key] = value
    links = {names.get(k, k): v for k, v in run.meta["links"].items()}
    return Result(run.t, arrays, {**run.meta, "links": links, "name": EVIL})


def shape(run: Result, frequency: float, size: float) -> Result:
    """One period of a motion about the first pose of a run."""
    t = np.linspace(0.0, 1.0 / frequency, 41)
    wave = size * np.sin(2 * np.pi * frequency * t)
    arrays = {}
    for key, value in run.arrays.items():
        if key.startswith(("link/", "body/")):
            arrays[key] = value if key.endswith("/x") else np.repeat(value[:1], len(t), axis=0)
    for name in run.links:
        rigid = arrays[f"link/{name}/centreline_rigid"]
        bow = np.sin(np.pi * np.linspace(0, 1, rigid.shape[1]))
        lift = wave[:, None, None] * bow[:, None] * np.array([0.0, 0.0, 0.01])
        arrays[f"link/{name}/centreline"] = rigid + lift
    return Result(t, arrays, {**run.meta, "frames": [], "platform": None, "actuated": []})


def half_bent(run: Result) -> Result:
    """A run that bends half as much and ends early, where it falls."""
    arrays = dict(run.arrays)
    for name in run.links:
        rigid = run.arrays[f"link/{name}/centreline_rigid"]
        line = run.arrays[f"link/{name}/centreline"]
        arrays[f"link/{name}/centreline"] = rigid + 0.5 * (line - rigid)
    for key in ("torque", *(f"link/{name}/stress/von_mises" for name in run.links)):
        arrays[key] = 0.5 * run.arrays[key]
    arrays = {k: v if k.endswith("/x") else v[:100] for k, v in arrays.items()}
    about = {"level": "quasistatic", "status": "failed", "message": FALLEN, "warnings": []}
    return Result(run.t[:100], arrays, {**run.meta, **about})


def with_strength(run: Result, strength: float) -> Result:
    """The run with links of a yield strength [Pa]."""
    links = {
        name: {**about, "material": {**about["material"], "yield_strength": strength}}
        for name, about in run.meta["links"].items()
    }
    return Result(run.t, run.arrays, {**run.meta, "links": links})
