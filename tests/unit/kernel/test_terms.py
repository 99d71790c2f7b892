"""What a system is made of is what the compiled kernel knows.

A new field of these records, or another record in a system, may be a term of the equations: teach
it to the kernel, or name it in `kernel_tables.uncovered`, then write it here.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import pytest

import pinflex as pf
from pinflex.bodies.basis import Curvature, Cut, FlexibleBody
from pinflex.bodies.family import Family
from pinflex.bodies.superelement import Node, Superelement
from pinflex.bodies.track import Series, Track
from pinflex.description.blocks.external import FrameForce, FrameSpring
from pinflex.mechanics.closure import Closures, Contact, CoupledRows
from pinflex.mechanics.kinks import Kinks
from pinflex.mechanics.model.loads import (
    AddedMasses,
    Attachment,
    Block,
    DryFriction,
    ElasticDrive,
    Expansion,
    Interface,
    Loads,
    Slot,
    Springs,
)
from pinflex.mechanics.model.slider import Segment, Sleeve
from pinflex.mechanics.model.system import System
from tests.every_model import NAMES

KNOWN: dict[type, str] = {
    System: "rigid expansion closed K D springs motors loads held friction added kinks",
    Springs: "v_at q_at paired stiffness rest",
    Loads: "forces springs touches",
    FrameForce: "name frame force moment follower start until ramp",
    FrameSpring: "name frame_a frame_b stiffness damper length at tension_only table",
    DryFriction: "rows coulomb excess stribeck speed",
    Kinks: "rows energy",
    AddedMasses: "joints inertia clocks",
    # Gears that give way are joints and rows of the map like those of links.
    Expansion: "model q_at v_at blocks frames slots n_eta drives carried",
    ElasticDrive: "joint eta row",
    Block: "rows q_rows Phi G eta",
    Attachment: "joint placement",
    Interface: "x attachment force_rows",
    # Inertia that turns sections is in the model; recovery asks joints, `turning`, for its moments.
    Slot: "link offset body eta root stations twists interfaces turning",
    # Stations and K of bodies are in the model, its map and System.K, the rest is here.
    FlexibleBody: "n length families slices labels second_order x mass Phi G xt It Phi_t G_t "
    "inertia Phi_r G_r K M D root_moves solid curvature rest",
    Curvature: "bend slope weight",
    Family: "n names length breaks gauss function shear",
    Superelement: "points nodes held inertia_error held_frequencies cut outer_moment corners "
    "triangles shapes stress",
    Cut: "x Phi G outer outer_twist",
    Node: "name place Phi G",
    Closures: "names kinds labels loop_of sorts a b lengths bodies local support_a support_b "
    "contacts coupled",
    CoupledRows: "rows J at A offset",
    Contact: "sleeve loop rows supports on",
    Sleeve: "link placement length half sorts track eta segments",
    Segment: "offset length track eta root",
    Track: "n length series row i j shear",
    Series: "breaks powers",
}


def records(value: Any, seen: set[int]) -> Iterator[type]:
    """Kinds of all the records that a value is made of."""
    if id(value) in seen:
        return
    seen.add(id(value))
    parts: Iterable[Any] = ()
    if is_dataclass(value) and not isinstance(value, type):
        yield type(value)
        parts = (getattr(value, field.name) for field in fields(value))
    elif isinstance(value, Mapping):
        parts = value.values()
    elif isinstance(value, tuple | list):
        parts = value
    for part in parts:
        yield from records(part, seen)


def test_the_kernel_knows_every_field_of_what_a_system_is_made_of() -> None:
    for record, known in KNOWN.items():
        assert {field.name for field in fields(record)} == set(known.split()), record


@pytest.mark.parametrize("name", NAMES)
def test_the_kernel_knows_every_record_of_the_systems_of(name: str) -> None:
    robot = pf.load(name)
    for system in (robot.rigid, robot.flexible):
        assert not {*records(system, set())} - KNOWN.keys()
