"""Which test notices which broken physics: `python tests/mutations.py` (not collected by pytest),
or with a part of their names.

Each mutation switches one thing off inside a fresh interpreter and runs a handful of tests there.
The tests must pass without it and at least one must fail with it; its name is printed.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PATIENCE = 600  # [s] for the tests of one mutation

# What a mutation may use: a module of which one place reads otherwise, or the compiled kernel.
_TOOLS = """
def altered(module, old, new):
    import importlib.util, pathlib, sys
    spec = importlib.util.find_spec(module)
    text = pathlib.Path(spec.origin).read_text()
    assert text.count(old) == 1, (module, old)
    made = importlib.util.module_from_spec(spec)
    sys.modules[module] = made
    parent, _, name = module.rpartition(".")
    setattr(sys.modules[parent], name, made)
    exec(compile(text.replace(old, new), spec.origin, "exec"), made.__dict__)

def recompiled(file, old, new):
    import atexit, pathlib, shutil, tempfile
    from pinflex.kernel import build, library
    folder = pathlib.Path(tempfile.mkdtemp())
    atexit.register(shutil.rmtree, folder)
    shutil.copytree(build.SOURCE, folder / "source")
    text = (folder / "source" / file).read_text()
    assert text.count(old) == 1, (file, old)
    (folder / "source" / file).write_text(text.replace(old, new))
    build.SOURCE = folder / "source"
    build.compile_all(folder)
    library._FOLDER = folder
"""
# Name: what runs before the tests, and where they are.
MUTATIONS = {
    "dry friction off": (
        """
from pinflex.mechanics.model.loads import DryFriction
DryFriction.force = lambda self, v: 0.0 * v[..., self.rows]
""",
        ["tests/verification/test_elastic_drives.py"],
    ),
    "a rotor's inertia by the gear, not by its square": (
        """
from pinflex.description.blocks.joints import Drive
Drive.rotor_inertia = property(lambda self: self.gear * self.motor_inertia)
""",
        ["tests/verification/test_elastic_drives.py"],
    ),
    "gears without their damping": (
        """
import pinflex.mechanics.systems as systems
from dataclasses import replace
plain = systems.elastic
systems.elastic = lambda joints: {k: replace(d, damping=0.0) for k, d in plain(joints).items()}
""",
        ["tests/verification/test_elastic_drives.py"],
    ),
    "foreshortening off: bodies are linear": (
        """
import pinflex.bodies.basis as basis
plain = basis.flexible_body
from dataclasses import replace
def linear(link, *rest, **more):
    return plain(replace(link, second_order=False), *rest, **more)
basis.flexible_body = linear
import pinflex.mechanics.model.parts
pinflex.mechanics.model.parts.flexible_body = linear
""",
        ["tests/verification/test_rotating_beam.py", "tests/hard/test_preload.py"],
    ),
    "twist rows off: sections do not turn about the beam": (
        """
import pinflex.bodies.basis as basis, numpy as np
plain = basis.FlexibleBody.rows
def rows(self, x):
    Phi, G = plain(self, x)
    Phi = Phi.copy(); Phi[5] = 0.0
    if G is not None:
        G = G.copy(); G[5] = 0.0
    return Phi, G
basis.FlexibleBody.rows = rows
""",
        ["tests/verification/test_beams.py", "tests/hard/test_scales.py"],
    ),
    "bend-twist coupling off: two bendings do not twist": (
        """
import pinflex.bodies.basis as basis
plain = basis.FlexibleBody.rows
def rows(self, x):
    Phi, G = plain(self, x)
    if G is not None and len(G) > 5:
        G = G.copy(); G[5] = 0.0
    return Phi, G
basis.FlexibleBody.rows = rows
""",
        ["tests/unit/mechanics/test_expansion.py", "tests/verification/test_elastica.py"],
    ),
    "modes about a motion without gyroscopic terms": (
        """
import pinflex.levels.modes as moving
plain = moving._quadratic
moving._quadratic = lambda M, C, K: plain(M, 0 * C, K)
""",
        ["tests/verification/test_moving_modes.py"],
    ),
    "the leader of coupled joints feels nothing of the follower": (
        """
import pinflex.mechanics.closure as closure
plain = closure._coupled
def weak(couplings, model):
    from dataclasses import replace
    rows = plain(couplings, model)
    J = rows.J.copy()
    J[J != 1.0] = 0.0
    return replace(rows, J=J)
closure._coupled = weak
""",
        ["tests/verification/test_couplings.py"],
    ),
    "start speeds do not reach the loops": (
        """
import pinflex.levels.start as speeds
speeds.corrected = lambda dynamics, y, v, A, b, free: v
""",
        ["tests/verification/test_start_speeds.py"],
    ),
    "blows off: what a motor that jumps carries keeps its speeds": (
        """
import pinflex.levels.start as given
def still(dynamics, y, v, speed):
    v = v.copy(); v[dynamics.system.motors] = speed
    return v
given._struck = still
""",
        ["tests/verification/test_given_starts.py"],
    ),
    "gyroscopic terms off: velocities make no force": (
        """
import pinocchio as pin, numpy as np
plain = pin.rnea
def rnea(model, data, q, v, a, *more):
    return plain(model, data, q, np.zeros_like(v), a, *more)
pin.rnea = rnea
derivatives = pin.computeRNEADerivatives
def still(model, data, q, v, a, *more):
    return derivatives(model, data, q, np.zeros_like(v), a, *more)
pin.computeRNEADerivatives = still
""",
        ["tests/verification/test_rotating_beam.py", "tests/property"],
    ),
    "closure projection off: loops are held by accelerations only": (
        """
recompiled("alpha.c", "-m->open[k] / m->by_y", "0.0")
""",
        ["tests/hard/test_steps.py", "tests/second_opinion"],
    ),
    "consistent start off: accelerations and multipliers begin at zero": (
        """
import pinflex.integrators.problem as problem, numpy as np
def nothing(dynamics, y, v, held, a_held, *more):
    a = np.zeros(dynamics.system.nv); a[held] = a_held
    return a, np.zeros(dynamics.system.closed.n)
problem.consistent_acceleration = nothing
""",
        ["tests/hard/test_steps.py", "tests/hard/test_starts.py"],
    ),
    "riders off: what the beam cannot carry of a link's inertia is lost": (
        """
import pinflex.mechanics.model.tree as ride
from dataclasses import replace
plain = ride.split
ride.split = lambda *link: replace(plain(*link), riders=())
""",
        ["tests/unit/mechanics/test_ride.py", "tests/validation/test_ur5.py"],
    ),
    "riders at the root: none of them loads the beam": (
        """
import pinflex.mechanics.model.tree as ride
ride._beside_the_centre = lambda rest, beam: 0.0
""",
        ["tests/unit/mechanics/test_ride.py"],
    ),
    "centripetal term off: frames accelerate as if their joint only sped up": (
        """
import numpy as np
import pinflex.mechanics.evaluation.frames as moves, inspect
source = "from __future__ import annotations\\n" + inspect.getsource(moves.motion_of)
assert "cross(w, speed)" in source
exec(source.replace("cross(w, speed)", "cross(w, v)"), moves.__dict__)
import pinflex.recovery.kinematics as recovered
recovered.motion_of = moves.motion_of
""",
        ["tests/verification/test_quiet_terms.py"],
    ),
    "static start of ked off: it starts undeformed": (
        """
import pinflex.levels.ked as ked
plain = ked.linear_start
ked.linear_start = lambda m, path, structural, start: plain(m, path, structural, "straight")
""",
        ["tests/hard/test_equilibrium_starts.py"],
    ),
    "sign of Mz in the stress of unsymmetric sections": (
        """
import inspect
import pinflex.recovery.links as stress
source = inspect.getsource(stress.stresses)
assert "-y / section.Iz" in source
exec(source.replace("-y / section.Iz", "y / section.Iz"), stress.__dict__)
""",
        ["tests/verification/test_quiet_terms.py"],
    ),
    "ramps come on as u^1.05": (
        """
from pinflex.description.blocks.external import FrameForce
plain = FrameForce.scale
FrameForce.scale = lambda self, t: plain(self, t) ** 1.05
""",
        ["tests/verification/test_quiet_terms.py"],
    ),
    "map along a motion: modes of each pose as sorted, not followed": (
        """
import numpy as np
import pinflex.studies.pose_map as maps
maps.tracked = lambda shapes, mass, count, first=None: {
    place: (np.arange(x.shape[1]), 1.0) for place, x in shapes.items()}
""",
        ["tests/verification/test_quiet_terms.py"],
    ),
    "the mass of a payload that goes stays": (
        """
recompiled(
    "added_mass.c", "n->F[d] += share * f[d], n->N[d] += share *", "n->F[d] += f[d], n->N[d] +="
)
""",
        ["tests/verification/test_payload_in_time.py"],
    ),
    "a payload brings no kinetic energy": (
        """
import pinflex.recovery.kinematics as kinematics
kinematics.brought = lambda added, rates, t: 0.0 * t
""",
        ["tests/verification/test_payload_in_time.py"],
    ),
    "equal steps over a mass that goes as over a load": (
        """
altered(
    "pinflex.integrators.equal_steps", "if exact is None else crossing(", "if True else crossing("
)
""",
        ["tests/verification/test_payload_in_time.py"],
    ),
    "shares of links that are alike are not added up": (
        """
altered(
    "pinflex.mechanics.model.relevance", "-1) for p in equal]", "-1) for p in equal[:1]]"
)
""",
        ["tests/unit/mechanics/test_planes.py"],
    ),
    "what is left out first does not count for what comes next": (
        """
altered("pinflex.mechanics.model.relevance", "spent + cost < NEGLIGIBLE", "cost < NEGLIGIBLE")
""",
        ["tests/unit/mechanics/test_planes.py"],
    ),
    "turns of the base in the other order": (
        """
altered("pinflex.mechanics.model.relevance", "links[number].placement.rotation @ turn",
        "turn @ links[number].placement.rotation")
""",
        ["tests/unit/mechanics/test_planes.py"],
    ),
    "products of inertia of an SDF with the other sign": (
        """
altered("pinflex.description.robots.sdf", "[[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]",
        "[[xx, -xy, -xz], [-xy, yy, -yz], [-xz, -yz, zz]]")
""",
        ["tests/unit/description/test_sdf.py"],
    ),
    "kernel: friction gives what it takes": (
        """
recompiled("friction.c", "loss += now.level", "loss -= now.level")
""",
        [
            "tests/unit/kernel/test_outside.py::"
            "test_what_rubs_and_damps_takes_its_force_times_the_speed"
        ],
    ),
    "kernel: no values of their own at corners": (
        """
recompiled("inputs.c", "<= in->gap", "<= -1.0")
""",
        ["tests/unit/kernel/test_outside.py::test_a_run_that_ends_with_its_motion_ends_at_rest"],
    ),
    "sections anywhere are taken for the same place": (
        """
altered("pinflex.levels.outputs", "< _SECTION * at[-1]", "< 1.0")
""",
        ["tests/unit/advice/test_second_run.py"],
    ),
    "default steps by the first mode": (
        """
altered("pinflex.levels.modes", "min(2, len(alive) - 1)", "0")
""",
        ["tests/unit/solver/test_step_length.py"],
    ),
    "damping of each segment by itself": (
        """
damped = "K, np.kron(np.eye(count), first.M))"
altered("pinflex.mechanics.model.parts", "K, _mass(part))", damped)
""",
        ["tests/unit/mechanics/test_given_damping.py"],
    ),
    "ked feels jumps where the step ends": (
        """
altered("pinflex.levels.ked", "np.add.at(load, at, change)", "pass")
""",
        ["tests/levels/test_jumps.py"],
    ),
    "coupled by tol keeps the force before a jump": (
        """
import pinflex.solver.scene as scene
scene.after_jumps = lambda problem, run, breaks: run
""",
        ["tests/levels/test_jumps.py"],
    ),
    "under a digital controller accelerations are those of polynomials": (
        """
from pinflex.integrators.corrector import Inside
Inside.__call__ = lambda self, run: run
""",
        ["tests/inversion/test_closed_loop.py"],
    ),
    "equal steps feel a jump up to half a step off": (
        """
import pinflex.integrators.equal_steps as steps
import numpy as np
steps.averaged = lambda t, values, breaks: (values, np.zeros(0, int))
""",
        ["tests/levels/test_jumps.py"],
    ),
    "equal steps feel a force up to half a step off": (
        """
from pinflex.mechanics.model.loads import Loads
Loads.spread = lambda self, h: self
""",
        ["tests/levels/test_jumps.py"],
    ),
    "compare: only the band counts": (
        """
altered("pinflex.results.verdict", "return max(band, tol * deviation)", "return band")
""",
        ["tests/unit/results/test_comparison.py"],
    ),
    "damping of what a motion excites is twice as large": (
        """
altered("pinflex.levels.ringing", "/ (2.0 * omega)", "/ omega")
""",
        ["tests/unit/studies/test_check_damping.py"],
    ),
    "rotors do not shake the frame": (
        """
altered("pinflex.recovery.recover", "axes @ (armature *", "0.0 * axes @ (armature *")
""",
        ["tests/verification/test_elastic_drives.py"],
    ),
}
_LONG = "tests/hard/test_steps.py::test_a_hundred_thousand_steps_do_not_drift_off_the_loop"
_RUN = """
import sys, pytest
sys.exit(pytest.main(["-q", "-p", "no:cacheprovider", "--tb=no", "-rf", "--deselect", {long!r}]
                     + {paths!r}))
"""


def failures(code: str, paths: list[str]) -> list[str]:
    """Names of the tests that fail after some code has run."""
    script = _TOOLS + code + _RUN.format(paths=paths, long=_LONG)
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True,
        timeout=PATIENCE, env=environment, check=False,
    )  # fmt: skip
    lines = done.stdout.splitlines()
    failed = [line.split(" - ")[0].removeprefix("FAILED ") for line in lines if "FAILED " in line]
    if done.returncode not in (0, 1):
        raise SystemExit(f"the tests did not run:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return failed


def main(wanted: str = "") -> int:
    missed = tried = 0
    for name, (code, paths) in MUTATIONS.items():
        if wanted not in name:
            continue
        tried += 1
        healthy = failures("", paths)
        caught = [test for test in failures(code, paths) if test not in healthy]
        print(f"\n{name}: caught by {len(caught)}")
        for test in caught[:8]:
            print(f"  {test}")
        if healthy:
            print(f"  (failed already without it: {', '.join(healthy)})")
        missed += not caught
    print(f"\n{tried - missed} of {tried} mutations caught")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:2]))
