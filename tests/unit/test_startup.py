"""What a process pays before and beside a run: libraries are loaded where they are used.

Claims:
    Pages, pictures, figures
    - a solve at any level, all of its arrays, and a check load neither `scipy.linalg` nor
      `numpy.ma` nor matplotlib; the parser of one command reads as that of all | exact | passes
"""

from __future__ import annotations

import argparse
import subprocess
import sys

import numpy as np
import pytest

from pinflex.__main__ import build_parser
from pinflex.cli.commands import COMMANDS
from pinflex.linalg import eigh, lapack


def done(code: str) -> None:
    """Run code in a process of its own."""
    subprocess.run([sys.executable, "-c", code], check=True)


def commands(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """The commands that a parser knows; argparse has no public way to them."""
    return next(a.choices for a in parser._actions if isinstance(a.choices, dict))


@pytest.mark.parametrize("model", ["3rrr", "ur5"])
def test_a_solve_at_any_level_loads_no_library_that_it_does_not_use(model: str) -> None:
    done(
        "import sys, pinflex as pf\n"
        f"robot = pf.load({model!r})\n"
        "for level in ('rigid', 'quasistatic', 'ked', 'coupled'):\n"
        "    dict(pf.solve(robot, level=level).arrays)\n"
        "dict(pf.solve(robot, level='coupled', tol=1e-2).arrays)\n"
        "pf.check(robot)\n"
        "assert not {'scipy.linalg', 'numpy.ma', 'matplotlib'} & sys.modules.keys()"
    )


def test_scipy_linalg_can_still_be_imported_afterwards() -> None:
    done(
        "from pinflex.linalg import lapack; alone = lapack()\n"
        "import numpy as np, scipy.linalg\n"
        "A = np.array([[2.0, 1.0], [1.0, 3.0]])\n"
        "assert (scipy.linalg.lu_factor(A)[0] == alone.dgetrf(A)[0]).all()\n"
        "assert abs(scipy.linalg.eigh(A, A)[0] - 1.0).max() < 1e-15"
    )


def test_lapack_is_scipys_where_its_wrappers_are_not_found_alone() -> None:
    done(
        "import pinflex.linalg; pinflex.linalg.find_spec = lambda name: None\n"
        "found = pinflex.linalg.lapack()\n"
        "import scipy.linalg; assert found is scipy.linalg.lapack"
    )


def test_two_masses_between_three_springs_vibrate_as_in_the_book() -> None:
    K, M = np.array([[2.0, -1.0], [-1.0, 2.0]]), np.diag([3.0, 3.0])
    values, x = eigh(K, M)
    assert values == pytest.approx([1 / 3, 1.0], abs=1e-15)  # k/m and 3 k/m
    assert x.T @ M @ x == pytest.approx(np.eye(2), abs=1e-15)
    assert eigh(K, M, vectors=False)[0] == pytest.approx(values, abs=1e-15)
    assert eigh(np.zeros((0, 0)), np.zeros((0, 0)))[0].shape == (0,)
    with pytest.raises(np.linalg.LinAlgError):
        eigh(K, -M)
    assert lapack() is lapack()


@pytest.mark.parametrize("command", COMMANDS)
def test_the_parser_of_one_command_reads_as_that_of_all(command: str) -> None:
    one, every = (commands(parser)[command] for parser in (build_parser(command), build_parser()))
    assert one.format_help() == every.format_help()


def test_a_command_that_does_not_exist_is_told_all() -> None:
    for typed in (None, "", "chek", "--help"):
        assert set(COMMANDS) == set(commands(build_parser(typed)))
