"""No file makes ``load_agent`` run code, hang, take much memory, or end in anything but a ValueError that names it."""

import contextlib
import json
import os
import resource

import numpy as np
import pytest

from sb3_bruno import PearlSAC
from sb3_bruno.export import load_agent, save_agent
from sb3_bruno.export.archive import AGENT
from support.agent_zips import members_of, put, with_json, with_tensors
from support.hostile_files import FILES, MOST_MEMORY
from support.tiny_models import make_point, normalized, tiny


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    """The bytes of a good file."""
    path = tmp_path_factory.mktemp("good") / "point.agent"
    save_agent(PearlSAC("MlpPolicy", normalized(make_point), **tiny(PearlSAC)), path)
    return path.read_bytes()


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.timeout(20)
@pytest.mark.parametrize("name", FILES)
def test_a_hostile_file_is_refused(name, good, tmp_path, monkeypatch):
    path = tmp_path / "hostile.agent"
    path.write_bytes(FILES[name](good))
    monkeypatch.chdir(tmp_path)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(ValueError, match=r"hostile\.agent' cannot be loaded as an agent: .+\.") as refusal:
        load_agent(path, device="cpu")
    assert len(str(refusal.value)) < 1_000 and str(refusal.value).isprintable()
    assert 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) < MOST_MEMORY
    assert [entry.name for entry in tmp_path.iterdir()] == ["hostile.agent"]


VALUES = (None, True, -1, 0, 5, 1e308, 10**400, "x", "", [], {}, "nested deep")


def places(nested, path=()):
    """Yield the path to every value in JSON."""
    entries = nested.items() if isinstance(nested, dict) else enumerate(nested) if isinstance(nested, list) else ()
    for key, value in entries:
        yield (*path, key)
        yield from places(value, (*path, key))


def with_value(good, path, value):
    """A file with another value at a place in its JSON."""

    def change(plain):
        put(*path, value=value)(plain)
        return json.dumps(plain).replace('"nested deep"', "[" * 1_000 + "]" * 1_000)

    return with_json(good, change)


@pytest.mark.timeout(60)
@pytest.mark.parametrize("number", range(len(VALUES)))
def test_whatever_stands_in_the_json_is_refused_or_acts(number, good, tmp_path):
    path = tmp_path / "hostile.agent"
    everywhere = list(places(json.loads(members_of(good)[AGENT])))
    for place in everywhere[number::40]:
        path.write_bytes(with_value(good, place, VALUES[number]))
        with contextlib.suppress(ValueError):
            model = load_agent(path, device="cpu")
            observation = {key: np.zeros(space.shape, space.dtype) for key, space in model.observation_space.items()}
            action, _ = model.predict({**observation, "episode_start": np.ones(1, np.float32)})
            assert action.shape == model.action_space.shape


def test_the_good_file_loads_from_the_parts_that_the_tests_change(good, tmp_path):
    for number, data in enumerate(
        (good, with_json(good, lambda plain: None), with_tensors(good, lambda tensors: None))
    ):
        path = tmp_path / f"{number}.agent"
        path.write_bytes(data)
        assert load_agent(path).num_timesteps == 0


@pytest.mark.parametrize("make", [os.mkdir, os.mkfifo, lambda path: None, lambda path: os.symlink("/dev/zero", path)])
def test_what_is_no_file_is_refused(make, tmp_path):
    make(tmp_path / "hostile.agent")
    with pytest.raises(ValueError, match=r"hostile\.agent' cannot be loaded as an agent: (it is a|there is no)"):
        load_agent(tmp_path / "hostile.agent")
