"""A worker is gone when its process has ended, whatever the clock says and whoever has its number now."""

import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from sb3_bruno.zoo import processes
from sb3_bruno.zoo.processes import is_gone, started, this_process


@pytest.fixture(params=["linux", "elsewhere"])
def system(request, monkeypatch):
    """Linux, and a system without its /proc."""
    if request.param == "elsewhere":
        monkeypatch.setattr(processes, "BOOT_ID", Path("/nowhere"))
    return request.param


@pytest.fixture
def child():
    """A process that waits, whose name looks like the fields after it."""
    process = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    yield process
    process.kill()
    process.wait()
    process.stdin.close()


def test_a_process_is_there_until_it_ends(system, child):
    owner = {**this_process(), "pid": child.pid, "started": started(child.pid)}
    assert not is_gone(this_process()) and not is_gone(owner)
    assert not is_gone({**owner, "host": "elsewhere", "started": None})
    child.kill()
    while child.poll() is None and psutil.Process(child.pid).status() != psutil.STATUS_ZOMBIE:
        pass
    assert is_gone(owner)


def test_a_process_that_nobody_waited_for_is_gone(system, child):
    owner = {**this_process(), "pid": child.pid, "started": started(child.pid)}
    psutil.Process(child.pid).kill()  # its parent has not asked for its end: a zombie
    while psutil.Process(child.pid).status() != psutil.STATUS_ZOMBIE:
        pass
    assert is_gone(owner)


def test_a_later_process_with_the_number_of_another_is_none_of_its(child):
    assert is_gone({**this_process(), "pid": child.pid})


def test_after_a_boot_the_same_number_and_ticks_are_another_process(monkeypatch, tmp_path):
    before = this_process()
    (tmp_path / "boot_id").write_text("another boot\n")
    monkeypatch.setattr(processes, "BOOT_ID", tmp_path / "boot_id")
    assert is_gone(before) and not is_gone(this_process())


def test_a_step_of_the_clock_changes_nothing(system, monkeypatch):
    before = this_process()
    plain = psutil.Process.create_time
    monkeypatch.setattr(psutil.Process, "create_time", lambda self: plain(self) + 3600)  # as psutil would tell it
    assert not is_gone(before) and this_process() == before


def test_a_name_with_brackets_and_spaces_is_read_over(monkeypatch):
    stat = "7 (a) Z 1 (b) ) S 1 " + " ".join(map(str, range(5, 53)))
    monkeypatch.setattr(Path, "read_text", lambda self, **kwargs: stat if self.name == "stat" else "boot\n")
    assert started(7) == "boot 22"  # the fields are numbered from 1
