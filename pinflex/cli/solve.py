"""`pinflex solve`: one level, saved."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from pinflex.advice.solve import solve
from pinflex.cli.checkpoint import saved_meanwhile
from pinflex.cli.console import Progress, load_model, print_json
from pinflex.errors import RunInterrupted, SceneError
from pinflex.results.result import Result, peak, rms
from pinflex.studies.study import reason
from pinflex.text import length, number, table
from pinflex.writing import writable


def run(args: argparse.Namespace) -> int:
    """Solve one level and save it."""
    mechanism = load_model(args)
    for path in (args.output, args.csv):
        writable(path)
    level = args.level or mechanism.description.solve.level
    bar = Progress(level)
    options = {key: getattr(args, key) for key in ("level", "until", "dt", "tol", "samples")}
    options |= {"progress": bar, "resume": args.resume}
    try:
        if args.checkpoint is None:
            result = solve(mechanism, **options)
        else:
            result = saved_meanwhile(mechanism, args.output, args.checkpoint, options)
    except RunInterrupted as stop:
        if args.output is None or not isinstance(stop.result, Result):
            raise
        stop.result.save(args.output)
        at = f"t = {stop.result.t[-1]:.6g} s"
        raise KeyboardInterrupt(
            f"interrupted; the run up to {at} was saved, --resume {args.output} goes on"
        ) from None
    except SceneError as error:
        if not isinstance(error.result, Result):
            raise
        kept = f"-o RUN.npz saves the run up to t = {error.result.t[-1]:.6g} s."
        if args.output is not None:
            kept = f"The run up to t = {error.result.t[-1]:.6g} s was saved to {args.output}."
            error.result.save(args.output)
        if args.csv is not None:
            error.result.to_csv(args.csv)
        raise type(error)(f"{reason(error)} {kept}", **error.data) from error
    finally:
        bar.close()
    if result.meta["settings"].get("tol") is not None:  # who asks for one wants both errors
        result = result.with_errors()
    files = []
    if args.output is not None:
        files.append(result.save(args.output))
    if args.csv is not None:
        files.append(result.to_csv(args.csv))
    if args.json:
        print_json(_numbers(result) | {"files": files})
        return 0
    print(result.summary())
    print("".join(f"\n{block}\n" for block in _tables(result)), end="")
    print("".join(f"\nwrote {path}" for path in files) or "\nnothing saved (-o run.npz saves it)")
    return 0


def _tables(result: Result) -> list[str]:
    data = _numbers(result)
    motors = [
        [name, m["unit"], number(m["peak"]), number(m["rms"])] for name, m in data["motors"].items()
    ]
    links = [
        [
            name,
            length(x["deflection"]),
            number(x["von_mises"] / 1e6),
            number(1e3 * x["x"]),
            f"{x['time']:.4f}",
        ]
        for name, x in data["links"].items()
    ]
    blocks = [
        table("Motors", "motor|unit|peak|rms", motors, (24, 4)),
        table(
            "Flexible links, largest values",
            "link|off the root tangent|von Mises [MPa]|at x [mm]|at [s]",
            links,
            (24,),
        ),
    ]
    return [block for block in blocks if block]


def _numbers(result: Result) -> dict[str, Any]:
    """A run in few numbers, SI units."""
    links: dict[str, Any] = {}
    for name in result.links:
        link = result.link(name)
        when, where = np.unravel_index(int(np.argmax(link.von_mises)), link.von_mises.shape)
        links[name] = {
            "deflection": float(np.max(np.linalg.norm(link.deflection[:, :, :3], axis=2))),
            "von_mises": float(link.von_mises[when, where]),
            "x": float(link.x[where]),
            "time": float(result.t[when]),
        }
    return {
        "name": result.meta.get("name"),
        "level": result.level,
        "status": result.meta.get("status"),
        "message": result.meta.get("message"),
        "until": float(result.t[-1]),
        "instants": len(result.t),
        "motors": {
            name: {
                "unit": result.unit(f"torque/{name}"),
                "peak": peak(result.torque[:, i]),
                "rms": rms(result.torque[:, i]),
            }
            for i, name in enumerate(result.motors)
        },
        "links": links,
        "closure": result.worst_closure,
        "energy_balance": result.meta.get("energy_balance"),
        "settings": result.meta.get("settings"),
        "errors": result.meta.get("errors"),
        "cost": result.meta.get("cost"),
        "warnings": result.meta.get("warnings"),
    }
