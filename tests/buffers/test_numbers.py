"""A number that is not finite, or whose products are not, never gets into a buffer, nor does the rest of its step."""

import numpy as np
import pytest

from sb3_bruno.buffers.numbers import LARGEST, check_numbers
from support.stream import Stream

BAD = [np.nan, np.inf, -np.inf, 1e30, -2e9]


@pytest.mark.parametrize("number", BAD)
@pytest.mark.parametrize("what", ["observation", "next observation", "action", "reward", "task", "inner end"])
def test_a_bad_number_is_named_and_its_step_is_not_stored(what, number):
    stream = Stream(n_envs=3).add([1, 2, 3]).add([1, 2, 3], dones=[False, True, False])
    buffer = stream.buffer
    step = {
        "obs": {"observation": np.ones((3, 1))},
        "next_obs": {"observation": np.ones((3, 1))},
        "action": np.ones((3, 1)),
        "reward": np.ones(3),
        "done": np.zeros(3, dtype=bool),
        "infos": [{"task": np.float32([i])} for i in (1, 2, 3)],
    }
    if what == "observation":
        step["obs"]["observation"][1] = number
    elif what == "next observation":
        step["next_obs"]["observation"][1] = number
    elif what == "task":
        step["infos"][1]["task"] = [number]
    elif what == "inner end":
        step["infos"][1]["trial_final_observation"] = [number]
    else:
        step[what][1] = number
    named = "next observation" if what == "inner end" else what
    before = {name: np.copy(getattr(buffer, name)) for name in ("observations", "rewards", "inner_ends")}
    with pytest.raises(ValueError, match=rf"`{named}` is \S+ in env 1.*, at step 0 of its episode: numbers must be"):
        buffer.add(**step)
    assert buffer.pos == 2 and len(buffer.tasks) == 3 and buffer.episodes.lengths.tolist() == [2, 0, 2]
    for name, array in before.items():
        np.testing.assert_array_equal(getattr(buffer, name), array)


def test_what_is_large_and_finite_is_taken():
    check_numbers({"reward": np.array([LARGEST, -LARGEST, 0.0])}, str)
    assert np.isfinite(np.float32(LARGEST**2) ** 2)


def test_a_vector_envs_final_observation_means_nothing_here():
    stream = Stream()
    info = {"task": [0], "final_observation": None, "final_obs": np.float32([7.0])}
    stream.buffer.add(
        {"observation": np.ones((1, 1))}, {"observation": 2 * np.ones((1, 1))}, np.ones((1, 1)), [0.0], [False], [info]
    )
    assert stream.buffer.next_observations[0].item() == 2 and not stream.buffer.inner_ends.any()


def test_a_task_of_another_size_is_refused():
    stream = Stream().add([1])
    with pytest.raises(ValueError, match=r"The task of env 0 is \[1. 2.\], and others have 1 numbers"):
        stream.add([[1, 2]])


@pytest.mark.parametrize(
    "wrong",
    [
        {"obs": {"observation": np.ones((1, 1))}},
        {"next_obs": {"observation": np.ones((2, 3))}},
        {"action": np.ones((2, 3))},
        {"action": np.ones(1)},
        {"action": [["a"], ["b"]]},
        {"reward": 0.0},
        {"reward": np.zeros(1)},
        {"reward": np.zeros((2, 1))},
        {"done": np.array(["no", "no"])},
        {"done": False},
        {"infos": [{"task": [1.0]}]},
        {"infos": [{"task": [1.0]}] * 3},
    ],
    ids=str,
)
def test_what_is_not_of_every_env_is_named_and_nothing_of_it_is_stored(wrong):
    buffer = Stream(n_envs=2).add([1, 2]).buffer
    step = {
        "obs": {"observation": np.ones((2, 1))},
        "next_obs": {"observation": np.ones((2, 1))},
        "action": np.ones((2, 1)),
        "reward": np.zeros(2),
        "done": np.zeros(2, dtype=bool),
        "infos": [{"task": [1.0]}, {"task": [2.0]}],
    }
    ((name, _),) = wrong.items()
    with pytest.raises(ValueError, match=rf"`{name}.*` (is of type|has) .*: give "):
        buffer.add(**{**step, **wrong})
    assert buffer.pos == 1 and buffer.episodes.lengths.tolist() == [1, 1]
    assert [buffer.tasks.counts(buffer.tasks.number_of(slot)) for slot in (0, 1)] == [1, 1]
    buffer.add(**{**step, "action": [[1.0], [1.0]]})
    assert buffer.pos == 2


@pytest.mark.parametrize("final", [7.0, [1.0, 2.0], None, "home"])
def test_an_inner_end_of_another_shape_is_refused(final):
    stream = Stream().add([1])
    here, info = {"observation": np.ones((1, 1))}, {"task": [1], "trial_final_observation": final}
    with pytest.raises(
        ValueError, match=r"`info\['trial_final_observation'\]` is of type .* give numbers of shape \(1,\)"
    ):
        stream.buffer.add(here, here, np.ones((1, 1)), [0.0], [False], [info])
    assert stream.buffer.pos == 1
