"""What Python hands to the kernel is laid out as the C sources say."""

from __future__ import annotations

import ctypes

import pytest

from pinflex.kernel import library

Int, Pointer = ctypes.c_int64, ctypes.c_void_p


def test_structures_have_the_fields_of_the_sources(monkeypatch):
    text = "typedef struct { Int n, *at; double x; } In;\ntypedef struct { In in; double y; } Out;"
    monkeypatch.setattr(library, "_commented", lambda: text)
    for cached in (library._structures, library.structure):
        cached.cache_clear()
    try:
        inner, outer = library.structure("In"), library.structure("Out")
        assert inner._fields_ == [("n", Int), ("at", Pointer), ("x", ctypes.c_double)]
        assert outer._fields_ == [("in", inner), ("y", ctypes.c_double)]
        assert ctypes.sizeof(outer) == 32  # three numbers of eight bytes, and one
        assert library.names("In", Int) == ("n",)
    finally:
        for cached in (library._structures, library.structure):
            cached.cache_clear()


def test_every_array_of_a_system_is_filled():
    """One that the sources read and nobody fills would end the process."""
    assert {*library.shapes("Tables")} == set(library.names("Tables", Pointer))


def test_functions_have_the_types_of_the_sources():
    found = library.header_functions()
    assert found["pinflex_work_size"] == (Int, (Pointer,))
    assert found["pinflex_poses"] == (None, (Pointer, Pointer, Int, Pointer, Int, Pointer, Pointer))
    assert found["pinflex_factor"] == (ctypes.c_int, (Pointer, Pointer))
    assert found["pinflex_fingerprint"] == (ctypes.c_char_p, ())
    assert all(name.startswith("pinflex_") for name in found)


def test_constants_are_counted_or_given():
    assert [library.constant(name) for name in ("FULL", "PAUSED", "MOST_STAGES")] == [0, 4, 9]
    with pytest.raises(KeyError):
        library.constant("NONE_OF_THEM")
