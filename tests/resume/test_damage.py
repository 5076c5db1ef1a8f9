"""A checkpoint that is not as it was written is refused before it is unpickled, with its path and a remedy."""

import io
import pickle
import re
import zipfile

import numpy as np
import pytest

from sb3_bruno import RecurrentSAC
from sb3_bruno.files.sealed import sealing
from sb3_bruno.resume import checkpoint, resume, save_checkpoint
from support.dying import dies_at
from support.tiny_models import make_point, tiny


@pytest.fixture(scope="module")
def model():
    return RecurrentSAC("MlpPolicy", make_point(), **tiny(RecurrentSAC, buffer_size=60)).learn(50)


@pytest.fixture(scope="module")
def whole(model, tmp_path_factory):
    path = tmp_path_factory.mktemp("whole") / "checkpoint.pkl"
    save_checkpoint(model, path)
    return path.read_bytes()


def flipped(at):
    def flip(whole):
        place = int(at * (len(whole) - 1))
        return whole[:place] + bytes([whole[place] ^ 4]) + whole[place + 1 :]

    return flip


def zipped(whole):
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as file:
        file.writestr("checkpoint.pkl", whole)
    return archive.getvalue()


def pickle_of(whole):
    return whole[whole.index(b"\x80\x05") :]


DAMAGES = {
    "empty": lambda whole: b"",
    "cut in the first line": lambda whole: whole[:10],
    "cut in the checksum": lambda whole: whole[:60],
    "cut": lambda whole: whole[: len(whole) // 2],
    "without its last byte": lambda whole: whole[:-1],
    "grown": lambda whole: whole + b"\0",
    "zeros at its end, as after a power failure": lambda whole: whole[:-4_096] + bytes(4_096),
    **{f"flipped at {at:.0%}": flipped(at) for at in (0, 0.001, 0.1, 0.5, 0.9, 1)},
    "a pickle of something else": lambda whole: pickle.dumps({"weights": np.zeros(3)}),
    "an older format, a bare pickle": pickle_of,
    "a later format": lambda whole: whole.replace(b"checkpoint 1", b"checkpoint 2", 1),
    "a zip": zipped,
    "text": lambda whole: b"checkpoint of Monday\n",
}


def refused(path):
    with pytest.raises(ValueError, match=re.escape(str(path)) + ".*train anew") as caught:
        resume(path, make_point())
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("damage", DAMAGES)
def test_damage_is_named_with_a_remedy_and_nothing_is_unpickled(tmp_path, monkeypatch, whole, damage):
    path = tmp_path / "checkpoint.pkl"
    path.write_bytes(DAMAGES[damage](whole))
    monkeypatch.setattr(checkpoint.cloudpickle, "load", lambda _: pytest.fail("unpickled"))
    refused(path)


def test_a_folder_is_no_checkpoint(tmp_path):
    refused(tmp_path)


@pytest.mark.parametrize("content", [{"weights": 1}, [1, 2], None], ids=str)
def test_neither_is_a_sealed_file_of_something_else(tmp_path, content):
    path = tmp_path / "checkpoint.pkl"
    with sealing(path, checkpoint.FORMAT) as file:
        pickle.dump(content, file)
    refused(path)


def test_a_class_that_is_gone_is_named(tmp_path):
    path = tmp_path / "checkpoint.pkl"
    with sealing(path, checkpoint.FORMAT) as file:
        file.write(b"csb3_bruno.resume\nGone\n.")
    with pytest.raises(ValueError, match=r"cannot be read.*Gone.*libraries or classes have changed"):
        resume(path, make_point())


@pytest.mark.parametrize("moment", ["fsync", "replace"])
def test_a_kill_leaves_the_last_checkpoint_whole(tmp_path, model, whole, moment):
    path = tmp_path / "checkpoint.pkl"
    path.write_bytes(whole)
    dies_at(moment, lambda: save_checkpoint(model, path))
    assert path.read_bytes() == whole and resume(path, make_point()).num_timesteps == 50
    save_checkpoint(model, path)
    assert list(tmp_path.iterdir()) == [path], "what the kill left unfinished is cleared away"
