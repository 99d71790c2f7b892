"""A result keeps what it was given, reads by name, and survives its file."""

import csv
import json
import os
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pinflex.errors import DescriptionError
from pinflex.results.archive import FORMAT
from pinflex.results.result import Result, peak, rms
from tests.synthetic import synthetic_result


@pytest.fixture(scope="module")
def flexible() -> Result:
    return synthetic_result()


@pytest.fixture(scope="module")
def rigid() -> Result:
    return synthetic_result("rigid")


def turned(angle: float, axis: int) -> np.ndarray:
    """Rotation matrix about one world axis."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    matrix = np.eye(3)
    matrix[[i, i, j, j], [i, j, i, j]] = c, -s, s, c
    return matrix


# --- what a result holds


def test_arrays_are_read_only_and_the_callers_stay_writable():
    mine = np.zeros((2, 1))
    result = Result(np.array([0.0, 1.0]), {"torque": mine}, {"actuated": ["m"]})
    mine[0] = 7.0
    assert result.torque[0, 0] == 0.0
    for array in (result.t, result.torque):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_meta_is_the_same_before_and_after_the_file(tmp_path):
    meta = {"level": "ked", "gravity": np.array([0, 0, -9.81]), "joints": ("a",), "n": np.int64(3)}
    result = Result(np.array([0.0]), {}, meta)
    assert result.meta == {"level": "ked", "gravity": [0, 0, -9.81], "joints": ["a"], "n": 3}
    assert Result.load(result.save(tmp_path / "r.npz")).meta == result.meta


@pytest.mark.parametrize("t", [[], [0.0, 0.0], [1.0, 0.0], [[0.0, 1.0]], [0.0, np.nan]])
def test_times_must_increase(t):
    with pytest.raises(DescriptionError, match="increasing"):
        Result(np.array(t), {}, {})


def test_an_array_of_another_length_is_refused_with_both_numbers():
    with pytest.raises(DescriptionError, match=r"torque: shape \(3, 1\).* 2 instants"):
        Result(np.array([0.0, 1.0]), {"torque": np.zeros((3, 1))}, {})


def test_meta_that_is_not_plain_data_is_refused():
    with pytest.raises(DescriptionError, match="a object .* is not plain data"):
        Result(np.array([0.0]), {}, {"x": object()})


def test_an_array_of_texts_is_refused():
    with pytest.raises(DescriptionError, match="torque: .* real numbers"):
        Result(np.array([0.0]), {"torque": np.array(["a"])}, {})


# --- reading by name


def test_names_lead_to_the_columns_of_the_flat_arrays(flexible):
    motor = flexible.joint("motor_2")
    assert np.array_equal(motor.torque, flexible.arrays["torque"][:, 1])
    assert np.array_equal(motor.position, flexible.arrays["joint/q"][:, 1])
    assert np.array_equal(motor.velocity, flexible.arrays["joint/v"][:, 1])
    assert np.array_equal(motor.acceleration, flexible.arrays["joint/a"][:, 1])
    assert motor.reaction.shape == (201, 6)
    frame = flexible.frame("platform_c2")
    assert [a.shape[1:] for a in (frame.position, frame.rotation)] == [(3,), (3, 3)]
    assert frame.velocity.shape == frame.acceleration.shape == (201, 6)
    link = flexible.link("distal_1")
    assert link.x[-1] == link.length == 0.22
    assert link.deflection.shape == link.resultant.shape == (201, 21, 6)
    assert link.centreline.shape == link.centreline_rigid.shape == link.section_y.shape
    assert np.array_equal(link.stress("normal"), flexible.arrays["link/distal_1/stress/normal"])
    assert np.array_equal(flexible.loop("pin_2").force, flexible.loop("pin_2").wrench[:, :3])


def test_whether_a_key_is_there_can_be_asked(flexible):
    assert "loop/pin_2/wrench" in flexible
    assert "loop/pin_9/wrench" not in flexible
    assert 2 not in flexible


def test_a_joint_without_motor_has_no_torque(flexible):
    assert not flexible.joint("elbow_1").torque.any()


def test_platform_names_the_frame_that_carries_it(flexible):
    result = replace(flexible, meta={**flexible.meta, "platform": "platform_c2", "frames": []})
    with pytest.raises(DescriptionError, match="no frame 'platform_c2'"):
        result.frame("platform")
    result = replace(flexible, meta={**result.meta, "frames": ["platform_c2"]})
    assert result.frame("platform").name == "platform_c2"


@pytest.mark.parametrize("kind", ["joint", "frame", "link", "loop"])
def test_a_wrong_name_leads_to_the_right_one(flexible, kind):
    wrong = {"joint": "moter_1", "frame": "platfrm", "link": "distal1", "loop": "pin2"}[kind]
    right = {"joint": "motor_1", "frame": "platform", "link": "distal_1", "loop": "pin_2"}[kind]
    with pytest.raises(DescriptionError, match=f'Did you mean "{right}"'):
        getattr(flexible, kind)(wrong)


def test_a_rigid_result_has_no_links_and_says_so(rigid):
    assert rigid.links == ()
    with pytest.raises(DescriptionError, match="no flexible link 'distal_1'. Allowed: none"):
        rigid.link("distal_1")
    with pytest.raises(DescriptionError, match="level rigid: no array 'eta'"):
        rigid.array("eta")


def test_a_joint_of_several_coordinates_reads_as_columns():
    index = {"base": [0, 7, 0, 6], "arm": [7, 1, 6, 1]}
    arrays = {"joint/q": np.arange(16.0).reshape(2, 8), "joint/v": np.zeros((2, 7))}
    meta = {"joints": ["base", "arm"], "joint_index": index}
    result = Result(np.array([0.0, 1.0]), arrays, meta)
    assert result.joint("base").position.shape == (2, 7)
    assert result.joint("base").velocity.shape == (2, 6)
    assert result.joint("arm").position.tolist() == [7.0, 15.0]
    bare = replace(result, meta={"joints": ["base", "arm"]})
    with pytest.raises(DescriptionError, match="8 columns for 2 joints"):
        _ = bare.joint("arm").position


def test_the_longest_prefix_gives_the_unit(flexible):
    result = replace(flexible, meta={**flexible.meta, "units": {"torque/motor_1": "N"}})
    assert [result.unit(f"torque/motor_{i}") for i in (1, 2)] == ["N", "N m"]
    assert result.unit("unheard/of") == ""


# --- deviation, peak, rms


def test_deviation_is_position_and_world_rotation_from_the_other_run():
    t = np.array([0.0, 1.0])
    meta = {"frames": ["p"], "platform": "p"}

    def run(shift: float, matrix: np.ndarray) -> Result:
        place = np.tile([1.0 + shift, 2.0, 3.0], (2, 1))
        return Result(
            t, {"frame/p/position": place, "frame/p/rotation": np.tile(matrix, (2, 1, 1))}, meta
        )

    reference = turned(2.0, 2)
    deviation = run(3e-3, turned(1e-2, 0) @ reference).deviation_from(run(0.0, reference))
    assert np.allclose(deviation.position, [3e-3, 0, 0], atol=1e-15)
    assert np.allclose(deviation.rotation, [1e-2, 0, 0], atol=1e-15)  # about world x, with sign
    assert deviation.max() == pytest.approx(3e-3)
    assert np.allclose(deviation.angle, 1e-2)


def test_a_run_does_not_deviate_from_itself(flexible):
    deviation = flexible.deviation_from(flexible)
    assert deviation.max() == 0.0
    assert deviation.angle.max() < 1e-15


def test_deviation_needs_equal_instants_and_says_how_to_get_them(flexible):
    with pytest.raises(DescriptionError, match=r"201 in .* against 101 .*same `until`, `dt`"):
        flexible.deviation_from(synthetic_result("rigid", samples=101))
    shifted = replace(flexible, t=flexible.t + 1e-4)
    with pytest.raises(DescriptionError, match="different instants"):
        flexible.deviation_from(shifted)


def test_peak_and_rms_of_a_sine():
    sine = 3.0 * np.sin(np.linspace(0, 2 * np.pi, 1000, endpoint=False))
    assert peak(-sine) == pytest.approx(3.0, rel=1e-5)  # the samples miss the crest by 5e-6
    assert rms(sine) == pytest.approx(3.0 / np.sqrt(2))
    assert peak(np.array([])) == rms(np.array([])) == 0.0


# --- the file


def test_a_result_survives_its_file(flexible, tmp_path):
    path = flexible.save(tmp_path / "new folder" / "run.npz")
    back = Result.load(str(path))
    assert back.meta == flexible.meta
    assert back.arrays.keys() == flexible.arrays.keys()
    assert all(np.array_equal(back.arrays[k], flexible.arrays[k]) for k in back.arrays)
    assert np.array_equal(back.t, flexible.t)
    assert not back.torque.flags.writeable
    assert os.listdir(path.parent) == ["run.npz"]  # no temporary file stays behind


def test_only_what_shrinks_is_compressed_and_equal_runs_make_equal_files(flexible, tmp_path):
    noise = np.random.default_rng(0).standard_normal((500, 9))
    run = Result(np.arange(500.0), {"torque": noise, "zero": 0 * noise}, {})
    first, second = (run.save(tmp_path / f"{k}.npz") for k in (1, 2))
    with zipfile.ZipFile(first) as archive:
        kinds = {entry.filename: entry.compress_type for entry in archive.infolist()}
    assert kinds["torque.npy"] == zipfile.ZIP_STORED
    assert kinds["zero.npy"] == zipfile.ZIP_DEFLATED
    assert first.read_bytes() == second.read_bytes()


def test_a_failed_save_keeps_the_old_file(flexible, tmp_path, monkeypatch):
    path = flexible.save(tmp_path / "run.npz")
    before = path.read_bytes()

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pinflex.results.archive.write_arrays", full)
    with pytest.raises(DescriptionError, match=r"cannot be written \(No space left"):
        flexible.save(path)
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["run.npz"]


def test_a_damaged_header_is_said_to_be_damaged(tmp_path):
    for header in ("{", "[]", '{"format": "x"}', '{"format": 1}'):
        np.savez(tmp_path / "bad.npz", pinflex=np.array(header), t=np.zeros(1))
        with pytest.raises(DescriptionError, match="truncated or damaged"):
            Result.load(tmp_path / "bad.npz")


def test_a_missing_file_is_said_to_be_missing(tmp_path):
    too_long = tmp_path / ("9" * 300)  # for any file system
    for path in (tmp_path / "none.npz", tmp_path, too_long):
        with pytest.raises(DescriptionError, match="no such result file"):
            Result.load(path)


@pytest.mark.parametrize("content", [b"", b"t,torque\n0,1\n", b"\x93NUMPY"])
def test_a_file_of_another_kind_is_not_an_npz(tmp_path, content):
    path = tmp_path / "run.npz"
    path.write_bytes(content)
    with pytest.raises(DescriptionError, match=r"not an \.npz"):
        Result.load(path)


@pytest.mark.parametrize("kept", [0.1, 0.5, 0.99])
def test_a_truncated_file_is_said_to_be_damaged(flexible, tmp_path, kept):
    path = flexible.save(tmp_path / "run.npz")
    path.write_bytes(path.read_bytes()[: int(kept * path.stat().st_size)])
    with pytest.raises(DescriptionError, match="truncated or damaged"):
        Result.load(path)


def test_a_flipped_byte_is_noticed(flexible, tmp_path):
    path = flexible.save(tmp_path / "run.npz")
    content = bytearray(path.read_bytes())
    content[len(content) // 3] ^= 0xFF
    path.write_bytes(content)
    with pytest.raises(DescriptionError, match="truncated or damaged"):
        Result.load(path)


def test_a_rotation_that_is_none_is_named_when_the_file_is_read(flexible, tmp_path):
    flexible.save(tmp_path / "run.npz")
    members = dict(np.load(tmp_path / "run.npz"))
    for wrong in (np.zeros((3, 3)), np.diag([1.0, 1.0, -1.0]), np.full((3, 3), np.nan)):
        rotation = members["frame/platform/rotation"].copy()
        rotation[7] = wrong
        np.savez(tmp_path / "bad.npz", **members | {"frame/platform/rotation": rotation})
        with pytest.raises(DescriptionError, match=r"frame/platform/rotation\[7\].*determinant"):
            Result.load(tmp_path / "bad.npz")


def test_an_npz_of_another_program_is_refused(tmp_path):
    np.savez(tmp_path / "other.npz", t=np.zeros(3))
    with pytest.raises(DescriptionError, match="another program"):
        Result.load(tmp_path / "other.npz")


def test_a_newer_format_asks_for_a_newer_pinflex(tmp_path):
    header = json.dumps({"program": "pinflex", "format": FORMAT + 1, "meta": {}})
    np.savez(tmp_path / "new.npz", pinflex=np.array(header), t=np.zeros(1))
    with pytest.raises(DescriptionError, match=f"format {FORMAT + 1}.*Update pinflex"):
        Result.load(tmp_path / "new.npz")


def test_pickled_objects_are_never_loaded(tmp_path):
    header = json.dumps({"program": "pinflex", "format": FORMAT, "meta": {}})
    bomb = np.array([Path], dtype=object)
    np.savez(tmp_path / "bomb.npz", pinflex=np.array(header), t=np.zeros(1), torque=bomb)
    with pytest.raises(DescriptionError, match="truncated or damaged.*allow_pickle"):
        Result.load(tmp_path / "bomb.npz")


def test_the_csv_has_a_unit_in_every_header_and_every_digit(flexible, tmp_path):
    with flexible.to_csv(tmp_path / "run.csv").open() as stream:
        header, *rows = csv.reader(stream)
    assert all(column.endswith("]") for column in header)
    assert header[:3] == ["t [s]", "torque motor_1 [N m]", "torque motor_2 [N m]"]
    assert header[-2:] == ["max von Mises distal_2 [Pa]", "max von Mises distal_3 [Pa]"]
    table = np.array(rows, dtype=float)
    assert table.shape == (201, 1 + 3 + 6 + 7 + 6 + 3)
    assert np.array_equal(table[:, 2], flexible.torque[:, 1])
    speed = header.index("velocity motor_2 [rad/s]")
    assert np.array_equal(table[:, speed], flexible.joint("motor_2").velocity)
    assert header[speed + 1] == "acceleration motor_2 [rad/s^2]"
    x = header.index("platform x [m]")
    assert np.array_equal(table[:, x], flexible.frame("platform").position[:, 0])
    assert np.array_equal(table[:, -1], flexible.link("distal_3").von_mises.max(axis=1))


def test_the_summary_tells_what_matters(flexible):
    text = str(flexible)
    for part in ("coupled", "0 to 0.2 s", "400 (2.00 a step)", "2.00e-13", "2.10e-06", "pin_2"):
        assert part in text
    starts = {line.index(line[20:].split()[0], 20) for line in text.splitlines()[1:]}
    assert starts == {20}  # the values stand in one column
    stopped = replace(
        flexible, meta={**flexible.meta, "status": "stopped", "message": "Newton stopped"}
    )
    assert "stopped: Newton stopped" in str(stopped)


def test_the_summary_of_an_empty_run_does_not_fail():
    assert "not computed" in str(Result(np.array([0.0]), {}, {}))
