"""The closed pose of a mechanism as the block `home` of its YAML, and writing it there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array
from pinflex.description.description import read
from pinflex.description.home_text import with_home
from pinflex.errors import DescriptionError
from pinflex.mechanics.mechanism import Mechanism
from pinflex.writing import replaced

_PACKAGE = Path(__file__).resolve().parents[1]
_ZERO = 5e-10  # [rad | m] a value that is not written: joints stand at zero anyway


def home_values(mechanism: Mechanism) -> dict[str, float | list[float]]:
    """Value of each joint at home, as `home` takes it; joints at zero are left out."""
    model, q = mechanism.rigid.rigid, mechanism.home
    found: dict[str, float | list[float]] = {}
    for name, joint in zip(model.names[1:], model.joints[1:], strict=True):
        part = q[joint.idx_q : joint.idx_q + joint.nq]
        if joint.nv == 1 and joint.nq == 2:  # a continuous joint: cosine and sine
            part = np.array([np.arctan2(part[1], part[0])])
        elif joint.nv == 3 and joint.nq == 4 and joint.shortname() == "JointModelPlanar":
            part = np.array([*part[:2], np.arctan2(part[3], part[2])])
        values = [float(f"{x:.9g}") for x in part]
        stem = name.rpartition(".")[0]
        if stem and mechanism.description.joints.get(stem) is not None:
            both = found.setdefault(stem, [])  # NAME.1 and NAME.2 are the axes of a universal joint
            assert isinstance(both, list)
            both.append(values[0])
            continue
        found[name] = values[0] if joint.nv == 1 else values
    neutral = pin.neutral(model)
    return {
        name: value
        for name, value in found.items()
        if {name, f"{name}.1"} & {*mechanism.description.home}
        or not _at_rest(model, neutral, name, value)
    }


def _at_rest(model: pin.Model, neutral: Array, name: str, value: float | list[float]) -> bool:
    if model.existJointName(name):
        joint = model.joints[model.getJointId(name)]
        if joint.nq > 2 and joint.shortname() != "JointModelPlanar":
            rest = neutral[joint.idx_q : joint.idx_q + joint.nq]
            return bool(np.max(np.abs(rest - value)) < _ZERO)
    return bool(np.max(np.abs(value)) < _ZERO)


def write_home(mechanism: Mechanism) -> Path:
    """Write the closed pose into the YAML that the mechanism was read from, and return its path.

    Comments and all other lines stay; the file is replaced in one step, so that it is never half
    written.

    Raises:
        DescriptionError: There is no such file, it came with pinflex, or it cannot be written.
    """
    path = mechanism.description.path
    if path is None:
        raise DescriptionError(f"{mechanism.name}: home: read from no file. Write the block there.")
    path = path.resolve()
    if path.is_relative_to(_PACKAGE) or "site-packages" in path.parts:
        raise DescriptionError(
            f"{mechanism.name}: home: this model came with an installed package, and the next "
            "update would undo the change. Copy its folder and give the copy."
        )
    raw = path.read_bytes()
    # what the robot's file says joins the YAML's own text, so both are read
    if read(path).yaml_text != mechanism.description.yaml_text:
        raise DescriptionError(
            f"{path.name}: home: the model is not that of the file (an override, or the file has "
            "changed since), and its pose may not fit. Write the changes into the file first."
        )
    mark = b"\xef\xbb\xbf" if raw.startswith(b"\xef\xbb\xbf") else b""
    text = with_home(raw[len(mark) :].decode("utf-8"), home_values(mechanism), path.name)
    with replaced(path) as part:
        part.write_bytes(mark + text.encode("utf-8"))
    return path
