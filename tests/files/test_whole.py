"""A file is whole or as it was, at whatever moment of its writing the process dies or the disk is full."""

import os
import pickle
import tracemalloc

import numpy as np
import pytest

from sb3_bruno.files.sealed import Damaged, sealing, unsealed
from sb3_bruno.files.whole import whole_file, whole_files
from support.dying import dies_at

FORMAT = "thing 1"


def write(path, text="new"):
    with whole_file(path) as part:
        part.write_text(text)


@pytest.mark.parametrize("moment", ["fsync", "replace"])
def test_a_kill_leaves_the_old_file_and_the_next_writing_clears_up(tmp_path, moment):
    path = tmp_path / "thing.json"
    write(path, "old")
    dies_at(moment, lambda: write(path))
    assert path.read_text() == "old" and len(list(tmp_path.iterdir())) == 2
    write(path)
    assert path.read_text() == "new" and list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("moment", ["fsync", "replace"])
def test_a_full_disk_leaves_the_old_file_alone(tmp_path, monkeypatch, moment):
    path = tmp_path / "thing.json"
    write(path, "old")

    def full(*_):
        raise OSError("no space left")

    monkeypatch.setattr(os, moment, full)
    with pytest.raises(OSError, match="no space"):
        write(path)
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]


def test_an_error_of_the_writer_leaves_no_file(tmp_path):
    with pytest.raises(ZeroDivisionError), whole_files(tmp_path / "new", "all") as part:
        (part / "thing").write_text(str(1 / 0))
    assert list((tmp_path / "new").iterdir()) == []


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "disk").mkdir()
    path = tmp_path / "link.json"
    path.symlink_to(tmp_path / "disk" / "thing.json")
    write(path)
    assert path.is_symlink() and (tmp_path / "disk" / "thing.json").read_text() == "new"


def test_every_flipped_bit_and_every_cut_of_a_sealed_file_is_found(tmp_path):
    path = tmp_path / "sealed"
    with sealing(path, FORMAT) as file:
        file.write(b"one")
        file.write(memoryview(b"two"))
    with unsealed(path, FORMAT) as file:
        assert file.read() == b"onetwo"
    whole = path.read_bytes()
    flipped = [
        whole[:at] + bytes([whole[at] ^ 1 << bit]) + whole[at + 1 :] for at in range(len(whole)) for bit in range(8)
    ]
    for damaged in [*flipped, *(whole[:end] for end in range(len(whole))), whole + b"\0"]:
        path.write_bytes(damaged)
        with pytest.raises(Damaged), unsealed(path, FORMAT):
            pass


def test_a_large_array_is_sealed_and_unsealed_without_a_second_copy(tmp_path):
    large = np.ones(5_000_000)  # 40 MB
    tracemalloc.start()
    with sealing(tmp_path / "sealed", FORMAT) as file:
        pickle.dump({"large": large}, file, protocol=5)
    assert tracemalloc.get_traced_memory()[1] < 4e6
    with unsealed(tmp_path / "sealed", FORMAT) as file:
        assert pickle.load(file)["large"].sum() == 5_000_000
    assert tracemalloc.get_traced_memory()[1] < 44e6
    tracemalloc.stop()
