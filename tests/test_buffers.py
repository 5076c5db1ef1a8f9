"""The task buffer, filled with observation = number of the transition, so that a wrong row shows."""

import copy
import pickle

import numpy as np
import pytest
import torch as th
from gymnasium import spaces
from stable_baselines3.common.vec_env import VecNormalize

from sb3_bruno.buffers import _RING as RING
from sb3_bruno.buffers import TaskReplayBuffer
from sb3_bruno.encoders import BrunoEncoder, TaskEncoder
from sb3_bruno.extended_obs import ExtendedObs

SPACE = spaces.Dict(
    {
        "observation": spaces.Box(-np.inf, np.inf, (1,), np.float32),
        "action": spaces.Box(-1, 1, (1,), np.float32),
        "reward": spaces.Box(-np.inf, np.inf, (1,), np.float32),
        "episode_start": spaces.Box(0, 1, (1,), np.float32),
    }
)
ACTIONS = spaces.Box(-1, 1, (1,), np.float32)
LAYOUT = ExtendedObs(1, 2, 1)


class Recorder(TaskEncoder):
    """A stand-in whose belief tells what was absorbed: how many transitions, and the sum of their observations."""

    belief_dim, noise_dim = 2, 0

    def __init__(self):
        super().__init__()
        self.anchor = th.nn.Parameter(th.zeros(1))

    def prefixes(self, transitions, noise=None, weights=None):
        seen = th.cat([th.ones_like(transitions.observations), transitions.observations], dim=-1)
        if weights is not None:
            seen = seen * weights[..., None]
        return (th.nn.functional.pad(seen.cumsum(dim=-2), (0, 0, 1, 0)),)

    def belief(self, statistics):
        return statistics[0]

    empty = absorb = posterior = bound = outcomes = diagnostics = log_bayes_factor = None  # never asked for here


Recorder.__abstractmethods__ = frozenset()


class Stream:
    """Feeds a buffer numbered transitions: transition i goes from observation i to i + 0.5 with reward 10 i."""

    def __init__(self, n_envs=1, buffer_size=100, **kwargs):
        np.random.seed(0)  # noqa: NPY002  # which seeds the buffer
        self.buffer = TaskReplayBuffer(buffer_size, SPACE, ACTIONS, "cpu", n_envs, **kwargs)
        self.buffer.set_encoder(Recorder(), LAYOUT)
        self.n_envs, self.count = n_envs, 0
        self.task_of, self.episode_of, self.step_of = [], [], []
        self.running = [([], 0)] * n_envs
        self.steps = [0] * n_envs
        self.episodes = list(range(n_envs))

    def add(self, tasks, dones=None, timeouts=None, inner_ends=None):
        n = self.n_envs
        dones = [False] * n if dones is None else dones
        timeouts = [False] * n if timeouts is None else timeouts
        inner_ends = [False] * n if inner_ends is None else inner_ends
        numbers = np.arange(self.count, self.count + n, dtype=np.float32)[:, None]
        shown = np.where(np.reshape(inner_ends, (n, 1)), -9, numbers + 0.5)  # -9 begins another inner episode
        infos = [{"task": [tasks[i]], "TimeLimit.truncated": timeouts[i]} for i in range(n)]
        for i in np.flatnonzero(inner_ends):
            infos[i]["final_observation"] = numbers[i] + 0.5
        self.count += n
        for i in range(n):
            self.task_of.append(tasks[i])
            self.episode_of.append(self.episodes[i])
            self.step_of.append(self.steps[i])
            self.steps[i] = 0 if dones[i] else self.steps[i] + 1
            self.episodes[i] += n if dones[i] else 0
        self.buffer.add(
            {"observation": numbers},
            {"observation": shown},
            numbers / 1_000,
            10 * numbers[:, 0],
            np.array(dones),
            infos,
        )
        return self

    def check(self, samples):
        """Every part of every sampled transition belongs to the same transition, and its task is its own."""
        number = samples.observations[:, LAYOUT.observation].numpy()
        np.testing.assert_allclose(samples.next_observations[:, LAYOUT.observation], number + 0.5)
        np.testing.assert_allclose(samples.rewards, 10 * number)
        np.testing.assert_allclose(samples.actions, number / 1_000, rtol=1e-6)
        tasks = np.array([self.task_of[int(one)] for one in number[:, 0]])
        for observations in (samples.observations, samples.next_observations):
            np.testing.assert_array_equal(observations[:, LAYOUT.task][:, 0], tasks)
        seen, after = samples.observations[:, LAYOUT.belief], samples.next_observations[:, LAYOUT.belief]
        np.testing.assert_allclose(after[:, 0] - seen[:, 0], 1)  # one more transition: itself
        np.testing.assert_allclose(after[:, 1] - seen[:, 1], number[:, 0], atol=1e-3)
        return number[:, 0].astype(int), seen.numpy()


@pytest.mark.parametrize("context", ["iid", "recent", "episode"])
@pytest.mark.parametrize("n_envs", [1, 3])
@pytest.mark.parametrize("steps", [5, 33, 34, 90])  # before, at and after the ring of 100 // 3 rows is full
def test_samples_are_whole_transitions_of_their_task(context, n_envs, steps):
    stream = Stream(n_envs, context=context, n_sequences=4, sequence_length=8)
    for step in range(steps):
        tasks = [(step // 7 + env) % 3 for env in range(n_envs)]
        stream.add(tasks, dones=[step % 7 == 6] * n_envs)
    live = range(max(0, stream.count - stream.buffer.buffer_size * n_envs), stream.count)
    for _ in range(20):
        numbers, _ = stream.check(stream.buffer.sample(32))
        assert set(numbers) <= set(live)


def test_every_transition_can_be_drawn_and_none_is_lost():
    stream = Stream(2, n_sequences=4, sequence_length=8)
    for step in range(40):
        stream.add([step // 20, 2], dones=[step == 19, False])
    drawn = np.concatenate([stream.check(stream.buffer.sample(32))[0] for _ in range(150)])
    assert set(drawn) == set(range(80))


def test_tasks_are_equally_likely_and_transitions_uniform_within():
    stream = Stream(n_sequences=8, sequence_length=8)
    for step in range(90):
        stream.add([float(step >= 80)])
    drawn = np.concatenate([stream.check(stream.buffer.sample(64))[0] for _ in range(300)])
    assert 0.45 < np.mean(drawn >= 80) < 0.55
    counts = np.bincount(drawn[drawn < 80], minlength=80)
    assert counts.min() / counts.mean() > 0.6 and counts.max() / counts.mean() < 1.5


def test_context_sizes_of_exchangeable_sequences_are_uniform_from_nothing():
    stream = Stream(n_sequences=8, sequence_length=8)
    for _ in range(50):
        stream.add([0])
    sizes = np.concatenate([stream.check(stream.buffer.sample(64))[1][:, 0] for _ in range(20)])
    np.testing.assert_array_equal(np.bincount(sizes.astype(int)), [160] * 8)


def test_recent_context_reaches_back_so_far_and_no_further():
    stream = Stream(context="recent", n_recent=10, n_sequences=4, sequence_length=16)
    for step in range(60):
        stream.add([step % 2])
    numbers = np.concatenate([stream.check(stream.buffer.sample(64))[0] for _ in range(20)])
    assert set(numbers) == set(range(40, 60))


@pytest.mark.parametrize("n_envs", [1, 3])
def test_episode_context_is_what_the_agent_itself_had_seen(n_envs):
    stream = Stream(n_envs, 150, context="episode", n_sequences=4)
    for step in range(40):
        phases = [step + 2 * env for env in range(n_envs)]  # episodes of 9 steps that end at different times
        stream.add([env + phase // 9 for env, phase in enumerate(phases)], dones=[phase % 9 == 8 for phase in phases])
    drawn = set()
    for _ in range(60):
        numbers, seen = stream.check(stream.buffer.sample(32))
        drawn |= set(numbers)
        for number, (size, total) in zip(numbers, seen, strict=True):
            before = [other for other in range(number) if stream.episode_of[other] == stream.episode_of[number]]
            assert size == len(before) == stream.step_of[number]
            assert total == sum(before)
    assert drawn == set(range(stream.count))


def test_an_episode_that_lost_its_first_rows_begins_at_the_first_that_is_left():
    stream = Stream(buffer_size=10, context="episode", n_sequences=4)
    for _ in range(25):
        stream.add([0])
    for _ in range(20):
        numbers, seen = stream.check(stream.buffer.sample(16))
        np.testing.assert_array_equal(seen[:, 0], numbers - 15)


def test_running_episodes_are_those_since_the_last_reset():
    stream = Stream(2)
    for step in range(7):
        stream.add([0, 1], dones=[step == 3, False])
    slots, lengths = stream.buffer.episodes.running()
    assert lengths.tolist() == [3, 7]
    observed = stream.buffer.transitions(slots).observations[..., 0].numpy()
    assert observed[0, :3].tolist() == [8, 10, 12]
    assert observed[1].tolist() == [1, 3, 5, 7, 9, 11, 13]
    stream.add([0, 1], dones=[True, True])
    assert stream.buffer.episodes.running()[1].tolist() == [0, 0]
    stream.add([0, 1])
    stream.buffer.episodes.cut()
    assert stream.buffer.episodes.running()[1].tolist() == [0, 0]


@pytest.mark.parametrize("context", ["iid", "recent"])
def test_an_inner_end_leads_to_its_final_observation_and_is_not_done(context):
    stream = Stream(2, context=context, n_sequences=4, sequence_length=8)
    for step in range(30):
        stream.add([0, 1], dones=[step % 15 == 14] * 2, inner_ends=[step % 15 in (4, 9), step % 15 == 7])
    for _ in range(5):
        samples = stream.buffer.sample(32)
        numbers, _ = stream.check(samples)
        np.testing.assert_array_equal(samples.dones[:, 0], numbers // 2 % 15 == 14)


def test_the_caller_keeps_the_observations_that_it_gave():
    stream, shown = Stream(), np.full((1, 1), 7.0, np.float32)
    info = {"task": [0], "final_observation": np.float32([3.0])}
    stream.buffer.add({"observation": shown}, {"observation": shown}, shown, shown[0], np.array([False]), [info])
    assert shown == 7.0
    assert stream.buffer.next_observations[0] == 3.0


@pytest.mark.parametrize("buffer_size", [200, 51])  # with all of the trials, and with the first rows of one lost
def test_episode_context_is_the_whole_trial_without_the_transitions_whose_end_was_not_shown(buffer_size):
    stream, inner = Stream(context="episode", buffer_size=buffer_size, n_sequences=4), set()
    for step in range(97):  # trials of 20 steps with inner ends after 5 and 12, the last one still running
        inner |= {step} if step % 20 in (4, 11) else set()
        stream.add([step // 20], dones=[step % 20 == 19], inner_ends=[step in inner])
    for _ in range(20):
        samples = stream.buffer.sample(32)
        for number, before, after in zip(
            samples.observations[:, 0].numpy().astype(int),
            samples.observations[:, LAYOUT.belief].numpy(),
            samples.next_observations[:, LAYOUT.belief].numpy(),
            strict=True,
        ):
            start = max(number - number % 20, 97 - buffer_size)
            for belief, end in ((before, number), (after, number + 1)):
                seen = set(range(start, end)) - inner
                np.testing.assert_allclose(belief, [len(seen), sum(seen)])


def test_running_trials_go_on_over_inner_ends():
    stream = Stream(2)
    for step in range(7):
        stream.add([0, 1], inner_ends=[step == 3, step == 6])
    slots, lengths = stream.buffer.episodes.running()
    assert lengths.tolist() == [7, 7]
    assert stream.buffer.absorbed(slots).tolist() == [[1, 1, 1, 0, 1, 1, 1], [1, 1, 1, 1, 1, 1, 0]]


def test_a_time_limit_is_no_termination():
    stream = Stream(n_sequences=1)
    stream.add([0], dones=[True], timeouts=[True]).add([0], dones=[True])
    samples = stream.buffer.sample(64)
    numbers, _ = stream.check(samples)
    np.testing.assert_array_equal(samples.dones[:, 0], numbers == 1)


def test_an_evicted_task_is_no_longer_drawn():
    stream = Stream(buffer_size=10, n_sequences=4)
    for step in range(25):
        stream.add([step // 5])
    assert len(stream.buffer.tasks) == 2
    numbers, _ = stream.check(stream.buffer.sample(64))
    assert numbers.min() >= 15


def test_minus_zero_is_zero():
    stream = Stream()
    stream.add([0.0]).add([-0.0])
    assert len(stream.buffer.tasks) == 1


@pytest.mark.parametrize("batch_size", [1, 3, 16, 50, 200])
def test_batch_size_is_the_number_of_transitions(batch_size):
    stream = Stream(n_sequences=16, sequence_length=8)
    for _ in range(30):
        stream.add([0])
    assert len(stream.check(stream.buffer.sample(batch_size))[0]) == batch_size


def copy_of(stream, buffer):
    """The same stream into another buffer."""
    other = copy.copy(stream)
    other.buffer = buffer
    return other


def test_pickling_keeps_everything_but_the_encoder():
    stream = Stream(2, context="episode")
    for step in range(30):
        stream.add([step // 10, 5], dones=[step % 10 == 9, False], inner_ends=[False, step % 8 == 3])
    copied = pickle.loads(pickle.dumps(stream.buffer))
    with pytest.raises(RuntimeError, match="set_encoder"):
        copied.sample(4)
    copied.set_encoder(Recorder(), LAYOUT)
    for _ in range(5):
        for one, two in zip(stream.buffer.sample(32), copied.sample(32), strict=True):
            if one is not None:
                assert th.equal(one, two)
    for one in (stream, copy_of(stream, copied)):  # and both go on alike, over the end of the ring
        for step in range(60):
            one.add([step, 5], dones=[step % 7 == 0, False], inner_ends=[step % 7 == 3, False])
    for name in RING:
        np.testing.assert_array_equal(getattr(stream.buffer, name), getattr(copied, name))


def test_an_empty_ring_takes_no_room_in_a_file():
    small = Stream(buffer_size=1_000_000)
    small.add([0])
    assert len(pickle.dumps(small.buffer)) < 5_000_000  # the index knows every slot; the ring would take 40 MB more


def test_samples_are_normalised_as_the_agent_observes():
    class Normalize(VecNormalize):
        def __init__(self):
            self.norm_obs = self.norm_reward = True
            self.norm_obs_keys = ["observation", "reward"]
            rms = {"observation": (2.0, 4.0), "reward": (30.0, 100.0)}
            self.obs_rms = {key: type("Rms", (), {"mean": mean, "var": var}) for key, (mean, var) in rms.items()}
            self.ret_rms = type("Rms", (), {"var": 25.0})
            self.epsilon, self.clip_obs, self.clip_reward = 0.0, 1e6, 1e6

    stream = Stream()
    for _ in range(5):
        stream.add([0])
    slots = np.arange(5)
    transitions = stream.buffer.transitions(slots, Normalize())
    np.testing.assert_allclose(transitions.observations[:, 0], (slots - 2) / 2)
    np.testing.assert_allclose(transitions.next_observations[:, 0], (slots + 0.5 - 2) / 2)
    np.testing.assert_allclose(transitions.rewards[:, 0], (10 * slots - 30) / 10)
    np.testing.assert_allclose(transitions.actions[:, 0], slots / 1_000)  # not among the keys
    samples = stream.buffer.sample(32, Normalize())
    number = samples.observations[:, 0] * 2 + 2
    np.testing.assert_allclose(samples.rewards[:, 0], number * 10 / 5, rtol=1e-5)


def test_samples_rest_on_the_encoder_of_the_moment():
    stream = Stream(n_sequences=2)
    for _ in range(20):
        stream.add([0])
    encoder = BrunoEncoder(1, 1)
    layout = ExtendedObs(1, encoder.belief_dim, 1)
    stream.buffer.set_encoder(encoder, layout)
    before = stream.buffer.sample(64).next_observations[:, layout.belief]
    with th.no_grad():
        encoder.process.log_var.add_(3.0)
    stream.buffer.forget_beliefs()
    after = stream.buffer.sample(64).next_observations[:, layout.belief]
    assert after[:, -1].mean() > 5 * before[:, -1].mean()


def test_one_encode_serves_samples_until_its_steps_are_used_up_or_the_data_change():
    stream = Stream(n_sequences=4, sequence_length=8)
    for _ in range(50):
        stream.add([0])
    encodes = []
    encode = stream.buffer._encode
    stream.buffer._encode = lambda *args: encodes.append(args) or encode(*args)
    sizes = np.concatenate([stream.check(stream.buffer.sample(16))[1][:, 0] for _ in range(2)])
    assert len(encodes) == 1
    assert np.bincount(sizes.astype(int)).tolist() == [4] * 8  # every step of the four sequences, once
    stream.buffer.sample(16)
    assert len(encodes) == 2
    stream.add([0]).buffer.sample(16)
    assert len(encodes) == 3


def test_a_step_without_a_task_is_refused():
    stream = Stream()
    with pytest.raises(ValueError, match='no "task"'):
        stream.buffer.add(
            {"observation": np.zeros((1, 1))},
            {"observation": np.zeros((1, 1))},
            *[np.zeros((1, 1))] * 2,
            [False],
            [{}],
        )
    assert stream.buffer.size() == 0 and len(stream.buffer.tasks) == 0


def test_an_empty_buffer_says_so():
    stream = Stream()
    with pytest.raises(RuntimeError, match="empty"):
        stream.buffer.sample(4)
    stream.add([0])
    stream.buffer.reset()
    with pytest.raises(RuntimeError, match="empty"):
        stream.buffer.sample_sequences(4)


@pytest.mark.parametrize(
    "bad",
    [
        {"n_sequences": 0},
        {"sequence_length": 0},
        {"n_recent": 0},
        {"context": "last"},
        {"optimize_memory_usage": True},
    ],
)
def test_bad_arguments_are_named(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        Stream(**bad)
