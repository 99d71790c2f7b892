"""Sleeves on beams as the flat tables of the compiled kernel."""

from __future__ import annotations

from typing import Any

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.bodies.series import Series
from pinflex.bodies.track import Track
from pinflex.mechanics.closure import Closures
from pinflex.mechanics.slider import Contact, Segment

_SORTS = ("hold", "right", "left", "pivot", "tilt", "chord", "twist")  # as in sleeve_rows.c
_AXES = {"v": 1, "w": 2}
_SHEAR = 6  # row of the shear strain in v at the far end; that in w comes next


def sleeve_tables(closed: Closures, node_of: IntArray) -> dict[str, Any]:
    """Tables of the sleeves among the closures."""
    loops, contacts = len(closed.names), closed.contacts
    each = [one.sleeve for one in contacts]
    on_b = [loops + one.loop for one in contacts]
    stretches = [_stretches(one, closed) for one in contacts]
    flat = [stretch for of in stretches for stretch in of]
    tracks = list({id(track): track for *_, track in flat}.values())
    number = {id(track): k for k, track in enumerate(tracks)}
    sorts = [sort for sleeve in each for sort in sleeve.sorts]
    return {
        "sleeve_node": node_of[closed.bodies[on_b]],
        "sleeve_loop": [one.loop for one in contacts],
        "sleeve_passes": [len(sleeve.segments) > 0 for sleeve in each],
        "sleeve_at": _starts([len(one.rows) for one in contacts]),
        "sleeve_row": np.concatenate([np.zeros(0), *(one.rows for one in contacts)]),
        "sleeve_sort": [_SORTS.index(sort) for sort, _ in sorts],
        "sleeve_axis": [_AXES[direction] for _, direction in sorts],
        "sleeve_frame": closed.local[on_b],
        "sleeve_half": [sleeve.half for sleeve in each],
        "stretch_at": _starts([len(of) for of in stretches]),
        "stretch_node": [node_of[joint] for joint, *_ in flat],
        "stretch_frame": [frame for _, frame, *_ in flat],
        "stretch_eta": [eta for _, _, eta, *_ in flat],
        "stretch_from": [start for _, _, _, start, _ in flat],
        "stretch_length": [track.length for *_, track in flat],
        "stretch_track": [number[id(track)] for *_, track in flat],
        **_tracks(tracks),
    }


def _stretches(contact: Contact, closed: Closures) -> list[tuple[int, Array, int, float, Track]]:
    """Joint, frame, first coordinate, start (m) and track of the pieces of a sleeve's beam."""
    sleeve, loop = contact.sleeve, contact.loop
    if sleeve.segments:
        return [_segment(one) for one in sleeve.segments]
    straight = Series(np.array([0.0, sleeve.length]), np.zeros((1, 1, 0)))
    none = np.zeros(0, dtype=np.intp)
    track = sleeve.track or Track(0, sleeve.length, straight, none, none, none, np.zeros((2, 0)))
    return [(int(closed.bodies[loop]), closed.local[loop], sleeve.eta.start, 0.0, track)]


def _segment(one: Segment) -> tuple[int, Array, int, float, Track]:
    root = one.root
    return root.joint, root.placement.homogeneous[:3], one.eta.start, one.offset, one.track


def _tracks(tracks: list[Track]) -> dict[str, Any]:
    """Their entries, Phi, then G with half its diagonal, then shear, and what these are made of."""
    made = [_entries(track) for track in tracks]
    breaks = [track.series.breaks for track in tracks]
    names = ("entry_row", "entry_i", "entry_j", "power")
    none = np.zeros(0)
    return {
        "track_n": [track.n for track in tracks],
        "track_degrees": [track.series.powers.shape[1] for track in tracks],
        "entry_at": _starts([len(of[0]) for of in made]),
        "piece_at": _starts([len(x) - 1 for x in breaks]),
        "power_at": _starts([of[3].size for of in made]),
        "piece_start": np.concatenate([none, *(x[:-1] for x in breaks)]),
        "piece_half": np.concatenate([none, *(0.5 * np.diff(x) for x in breaks)]),
        **{
            name: np.concatenate([none, *(of[k].ravel() for of in made)])
            for k, name in enumerate(names)
        },
    }


def _entries(track: Track) -> tuple[Array, ...]:
    shear = np.argwhere(track.shear)
    powers = track.series.powers * np.where(track.i == track.j, 0.5, 1.0)
    constant = np.zeros((*powers.shape[:2], len(shear)))
    constant[:, 0] = track.shear[tuple(shear.T)]
    return (
        np.append(track.row, _SHEAR + shear[:, 0]),
        np.append(track.i, shear[:, 1]),
        np.append(track.j, np.full(len(shear), -1)),
        np.concatenate([powers, constant], axis=2),
    )


def _starts(lengths: list[int]) -> IntArray:
    return np.concatenate([[0], np.cumsum(lengths, dtype=np.intp)]).astype(np.intp)
