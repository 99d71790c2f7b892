"""The kernel as WebAssembly beside the native one, in node: the same residuals to round-off."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.browser import page
from pinflex.browser.page import wasm
from pinflex.browser.recipe import laid_out, live_scene, recipe
from pinflex.kernel.build import zig

NODE = shutil.which("node")
SCRIPT = """
const fs = require("fs"), vm = require("vm"), [,, folder, pages] = process.argv;
const run = vm.runInThisContext, read = (name) => fs.readFileSync(`${folder}/${name}`);
for (const name of ["heap", "settle"]) run(fs.readFileSync(`${pages}/${name}.js`, "utf8"));
(async () => {
  const header = JSON.parse(read("header.json")), raw = Uint8Array.from(read("values.bin"));
  const states = JSON.parse(read("states.json")).map((x) => Float64Array.from(x));
  const kernel = await run("instantiated")(await WebAssembly.compile(read("kernel.wasm")));
  const memory = new (run("Heap"))(kernel, header, new Float64Array(raw.buffer));
  const [r, c] = new (run("Equations"))(memory).residuals(7, ...states);
  console.log(JSON.stringify([[...r], [...c]]));
})();
"""


@pytest.mark.skipif(NODE is None, reason="node is not installed")
@pytest.mark.skipif(not zig("wasm32-wasi"), reason="ziglang is not installed")
@pytest.mark.parametrize("model", ["ur5", "3rrr", "delta"])
def test_residuals_of_webassembly_are_the_native_ones(model, tmp_path):
    mechanism = pf.load(model)
    scene = live_scene(mechanism)
    made = recipe(scene, 1e-3, np.linspace(0.0, 0.1, 5))
    (header,), values = laid_out([made.image])
    dynamics = scene.equations()
    system, rng = dynamics.system, np.random.default_rng(4)
    y = np.tile(scene.start.y, (7, 1))
    y[:, dynamics.nq_rigid :] += 1e-3 * rng.standard_normal((7, system.n_eta))
    v, a = rng.standard_normal((2, 7, system.nv))
    lam = rng.standard_normal((7, system.closed.n))
    native = dynamics.residual(y, v, a, lam, 0.0)

    (tmp_path / "header.json").write_text(json.dumps(header | made.header))
    values.tofile(tmp_path / "values.bin")
    (tmp_path / "states.json").write_text(json.dumps([x.ravel().tolist() for x in (y, v, a, lam)]))
    (tmp_path / "kernel.wasm").write_bytes(wasm())
    (tmp_path / "run.js").write_text(SCRIPT)
    pages = Path(page.__file__).with_name("page")
    ran = subprocess.run(
        [str(NODE), str(tmp_path / "run.js"), str(tmp_path), str(pages)],
        check=True, capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    r, c = (np.array(x) for x in json.loads(ran.stdout))
    # Products are not fused in WebAssembly: some hundred roundings of the largest term.
    assert np.abs(r.reshape(native.r.shape) - native.r).max() < 1e-13 * np.abs(native.r).max()
    assert np.abs(c - native.c.ravel()).max(initial=0.0) < 1e-15
