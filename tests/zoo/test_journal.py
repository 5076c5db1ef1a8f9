"""A journal outlives workers that die in mid-write or with its lock, and damage is told without making more."""

import fcntl
import gc
import itertools
import os
from types import SimpleNamespace

import optuna
import pytest
from optuna.storages.journal import _file as optunas

from sb3_bruno.zoo.journal import GRACE, JournalLock
from sb3_bruno.zoo.storage import open_storage


@pytest.fixture
def journal(tmp_path, monkeypatch):
    """A study with one finished trial, in a file named relative to the working directory."""
    monkeypatch.chdir(tmp_path)
    study = optuna.create_study(study_name="s", storage=open_storage("in/x.log"))
    study.tell(study.ask(), 1.0)
    return tmp_path / "in" / "x.log"


def trials():
    return optuna.load_study(study_name="s", storage=open_storage("in/x.log")).trials


@pytest.mark.parametrize("torn", [b"{", b'{"op_c', b'{"op_code":5,"worker_id":"a-1', b"\0\0\0", b'{"op_code":4\0\0'])
def test_a_torn_last_entry_is_cut_off_by_whoever_writes_next(torn, journal):
    whole = journal.read_bytes()
    open_before = optuna.load_study(study_name="s", storage=open_storage("in/x.log"))
    with journal.open("ab") as file:
        file.write(torn)
    assert len(trials()) == 1 and journal.read_bytes() == whole + torn  # who only reads changes nothing
    open_before.tell(open_before.ask(), 2.0)
    assert journal.read_bytes().startswith(whole + b'{"op_code":4,')
    assert [trial.value for trial in trials()] == [1.0, 2.0]


def test_every_place_to_die_in_leaves_a_study_that_goes_on(journal):
    entries = journal.read_bytes().splitlines(keepends=True)
    before, last = b"".join(entries[:-1]), entries[-1]  # which finishes the trial
    for end in range(len(last)):
        journal.write_bytes(before + last[:end])
        study = optuna.load_study(study_name="s", storage=open_storage("in/x.log"))
        study.tell(0, 3.0)
        assert [trial.value for trial in trials()] == [3.0]


def test_a_worker_that_died_in_its_first_entry_leaves_an_empty_journal(journal):
    journal.write_bytes(b'{"op_code":0,"worker')
    assert optuna.create_study(study_name="s", storage=open_storage("in/x.log")).trials == []


@pytest.mark.parametrize(
    "damage",
    [
        b'{"op_code":5,"wor{"op_code":4}\n',
        b"garbage\n",
        b"[]\n",
        b"7\n",
        b"{}\n",
        b"\n",
        b'{"op_code":99}\n',
        b'{"op_code":true}\n',
        b'{"op_code":[]}\n',
    ],
)
@pytest.mark.parametrize("where", ["middle", "end"])
def test_damage_elsewhere_is_told_with_its_line(where, damage, journal):
    entries = journal.read_bytes().splitlines(keepends=True)
    number = {"middle": 2, "end": len(entries)}[where]
    journal.write_bytes(b"".join([*entries[:number], damage, *entries[number:]]))
    damaged = journal.read_bytes()
    remedy = f"keep the lines before it by `head -n {number} x.log > repaired.log`"
    with pytest.raises(
        ValueError, match=rf"--storage in/x.log cannot be opened: line {number + 1} is damaged, {remedy}"
    ):
        open_storage("in/x.log")
    assert journal.read_bytes() == damaged
    journal.write_bytes(b"".join(damaged.splitlines(keepends=True)[:number]))  # what head does
    assert len(trials()) == 1


@pytest.mark.parametrize("text", [b"step 1: loss 0.3\nstep 2", b"step 1", b'["op_code"]', b"\x80\x02\n", b"{}"])
def test_a_file_that_is_no_journal_is_left_alone(text, journal):
    journal.write_bytes(text)
    with pytest.raises(ValueError, match=r"--storage in/x.log cannot be opened: it is no journal of a study"):
        open_storage("in/x.log")
    assert journal.read_bytes() == text


def test_what_appears_at_the_end_of_an_open_journal_is_not_cut_off_unless_it_is_an_entry(journal):
    study = optuna.load_study(study_name="s", storage=open_storage("in/x.log"))
    with journal.open("ab") as file:
        file.write(b"a note of somebody's")
    with pytest.raises(ValueError, match="ends in what is no entry of a journal: remove its last line"):
        study.ask()
    assert journal.read_bytes().endswith(b"a note of somebody's") and not journal.with_suffix(".log.lock").is_symlink()


def test_a_lock_that_a_dead_worker_left_is_removed_at_once(journal, monkeypatch):
    lock = JournalLock(journal)
    lock.acquire()
    lock._held.pop_all().pop_all()  # its process is killed: the kernel closes the file, and nobody removes the link
    assert os.path.samefile(f"{journal}.lock", journal)  # other programs wait as for any lock of Optuna's
    gc.collect()
    monkeypatch.setattr(optunas.time, "sleep", None)  # nobody waits
    optuna.load_study(study_name="s", storage=open_storage("in/x.log")).ask()
    assert not os.path.lexists(f"{journal}.lock")


def test_a_lock_that_another_dead_process_left_is_taken_over(journal, monkeypatch):
    ticks = itertools.count()
    clock = SimpleNamespace(monotonic=lambda: next(ticks), sleep=lambda seconds: None)
    monkeypatch.setattr(optunas, "time", clock)  # a second passes whenever somebody looks
    os.symlink(journal, f"{journal}.lock")
    study = optuna.load_study(study_name="s", storage=open_storage("in/x.log"))
    study.ask()
    assert GRACE < next(ticks) < 100 and not journal.with_suffix(".log.lock").is_symlink()


def test_the_kernel_too_keeps_two_workers_apart(journal):
    lock = JournalLock(journal)
    with journal.open("rb+") as other:
        lock.acquire()
        with pytest.raises(BlockingIOError):
            fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
        lock.release()
        fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
