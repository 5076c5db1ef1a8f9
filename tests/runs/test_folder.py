"""One process at a time trains in a run's folder, which a dead one does not keep."""

import os
import shlex
import time

import pytest
from filelock import FileLock

from sb3_bruno.runs.folder import UNFINISHED, RunFolder, is_unfinished, latest_finished, resuming_command


def in_child(act):
    """Act in a child process; return its id, once it has acted. It stays until it is killed."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            held = act()  # noqa: F841  # a lock that nobody holds would be let go
            os.write(write, b".")
            while True:
                time.sleep(0.01)
        finally:
            os._exit(1)  # after an error, too: the child must not go on with the parent's tests
    os.read(read, 1)
    return child


def test_a_folder_is_made_once_and_only_its_maker_discards_it(tmp_path):
    path = tmp_path / "logs" / "PointDir-v0_1"
    made = RunFolder.make(path)
    with pytest.raises(FileExistsError):
        RunFolder.make(path)
    made.release()
    (path / "agent.zip").touch()
    RunFolder(path).discard()
    assert (path / "agent.zip").exists(), "which another process had made"
    made.discard()
    assert not path.exists()


def test_of_its_parents_those_go_that_it_made_and_nobody_else_uses(tmp_path):
    (tmp_path / "logs").mkdir()
    first = RunFolder.make(tmp_path / "logs" / "mine" / "bruno_sac" / "PointDir-v0_1")
    second = RunFolder.make(tmp_path / "logs" / "mine" / "pearl_sac" / "PointDir-v0_1")
    first.discard()
    assert [path.name for path in (tmp_path / "logs" / "mine").iterdir()] == ["pearl_sac"]
    second.discard()
    assert [path.name for path in (tmp_path / "logs" / "mine").iterdir()] == [], "which the first had made"
    RunFolder.make(tmp_path / "logs" / "PointDir-v0_1").discard()
    assert (tmp_path / "logs").is_dir(), "which was there before"
    RunFolder.make(tmp_path / "new" / "bruno_sac" / "PointDir-v0_1").discard()
    assert [path.name for path in tmp_path.iterdir()] == ["logs"]


def test_a_held_folder_names_its_holder_until_that_dies(tmp_path):
    child = in_child(lambda: RunFolder(tmp_path))
    try:
        for _ in range(2):
            with pytest.raises(ValueError, match=rf"{tmp_path} is in use: process {child} on .* trains there"):
                RunFolder(tmp_path)
    finally:
        os.kill(child, 9)
        os.waitpid(child, 0)
    RunFolder(tmp_path).release()
    RunFolder(tmp_path).release()


def run(folder, number, unfinished=False, env="PointDir-v0"):
    path = folder / f"{env}_{number}"
    path.mkdir(parents=True)
    (path / f"{env}.zip").touch()
    if unfinished:
        (path / UNFINISHED).touch()


def test_the_mark_comes_and_goes(tmp_path):
    folder = RunFolder(tmp_path)
    assert not is_unfinished(tmp_path)
    folder.begin()
    assert is_unfinished(tmp_path) and "--resume" in (tmp_path / UNFINISHED).read_text()
    folder.finish()
    folder.finish()
    assert not is_unfinished(tmp_path)


def test_the_latest_finished_run_is_found_among_others(tmp_path):
    assert latest_finished(tmp_path, "PointDir-v0") == latest_finished(tmp_path / "none", "PointDir-v0") == 0
    run(tmp_path, 2, env="PointDir-v01")
    (tmp_path / "PointDir-v0_12").mkdir()  # died before it saved an agent, or was a search
    run(tmp_path, 3, unfinished=True)
    with pytest.raises(ValueError, match=r"PointDir-v0_3 is unfinished: .*--resume .*PointDir-v0_3`, .*`--exp-id 3`"):
        latest_finished(tmp_path, "PointDir-v0")
    run(tmp_path, 9)
    run(tmp_path, 10)
    assert latest_finished(tmp_path, "PointDir-v0") == 10
    run(tmp_path, 11, unfinished=True)
    with pytest.warns(UserWarning, match=r"PointDir-v0_11 is unfinished: .* Taken instead: .*PointDir-v0_10"):
        assert latest_finished(tmp_path, "PointDir-v0") == 10


def test_the_command_that_resumes_names_a_folder_as_a_shell_reads_it(tmp_path):
    run(tmp_path / "my logs", 1, unfinished=True)
    folder = tmp_path / "my logs" / "PointDir-v0_1"
    assert shlex.split(resuming_command(folder)) == ["sb3-bruno", "train", "--resume", str(folder)]
    with pytest.raises(ValueError, match=f"go on with it by `sb3-bruno train --resume '{folder}'`"):
        latest_finished(tmp_path / "my logs", "PointDir-v0")


def test_a_file_system_without_locks_is_warned_of_and_no_obstacle(tmp_path, monkeypatch):
    def refuse(*_, **__):
        raise OSError("No locks available")

    monkeypatch.setattr(FileLock, "acquire", refuse)
    with pytest.warns(UserWarning, match="cannot be locked .No locks available"):
        folder = RunFolder.make(tmp_path / "PointDir-v0_1")
    folder.release()
