"""An agent tells the task in the task's own units and in words, and teaching that changes nothing else."""

import numpy as np
import pytest
import torch as th
from gymnasium.spaces import Box
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import SubprocVecEnv, VecNormalize

from sb3_bruno import BrunoSAC, Transitions
from sb3_bruno.algorithms.readout_training import LEARNING_RATE, N_STEPS, N_TO_SETTLE, _draw_columns
from sb3_bruno.algorithms.task_estimate import TaskEstimate, TaskLabels
from sb3_bruno_envs import TaskSampler
from support.tiny_models import EACH_KIND, POINT, TINY, TINY_ENCODER, TRIAL

GOAL = "sb3_bruno_envs:PointGoal-v0"


def learned(algorithm=BrunoSAC, env=POINT, steps=60, **kwargs):
    name = kwargs.pop("encoder", None) or _encoder_of(algorithm)
    settings = {**TINY, **TINY_ENCODER[name], "learning_starts": 52, "gradient_steps": 8, **kwargs}
    return algorithm("MlpPolicy", env, **settings).learn(steps)


def _encoder_of(algorithm):
    return next(name for name, encoder in _NAMES.items() if algorithm.__name__.startswith(encoder))


_NAMES = {
    "bruno": "Bruno",
    "recurrent": "Recurrent",
    "product_of_gaussians": "Pearl",
    "recurrent_vae": "Varibad",
    "supervised_belief": "Belief",
}


@pytest.mark.parametrize("algorithm", EACH_KIND, ids=lambda algorithm: algorithm.__name__)
def test_every_agent_estimates(algorithm, tmp_path):
    model = learned(algorithm)
    state = model.predict(model.get_env().reset())[1]
    estimate = model.task_estimate(state)
    assert estimate.mean.shape == estimate.std.shape == (1, 2)
    assert sorted(estimate.labels.tasks) == ["left", "right"]
    np.testing.assert_allclose(estimate.probabilities.sum(axis=-1), 1, rtol=1e-5)
    assert estimate.texts()[0].split()[0] in ("left", "right")
    assert {"readout/loss", "readout/error_after_1"} <= model.logger.name_to_value.keys()
    model.save(tmp_path / "model")
    again = algorithm.load(tmp_path / "model", device="cpu")
    np.testing.assert_array_equal(again.task_estimate(state).probabilities, estimate.probabilities)
    assert again.task_labels == model.task_labels and again.task_estimate(state).texts() == estimate.texts()


def test_when_learning_ends_the_readout_settles_by_as_many_updates_as_it_had(monkeypatch):
    rates = []
    update = BrunoSAC._update_readout

    def noted(self, readout):
        rates.append(self.readout_optimizer.param_groups[0]["lr"])
        return update(self, readout)

    monkeypatch.setattr(BrunoSAC, "_update_readout", noted)
    model = learned()
    n = len(rates) // 2
    assert n > 1 and rates == [LEARNING_RATE] * n + [LEARNING_RATE * (1 - i / n) for i in range(n)]
    model._readout_unsettled = 10 * N_TO_SETTLE  # of a long training
    rates.clear()
    monkeypatch.setattr(BrunoSAC, "_train_readout", lambda self, readout, n_updates: rates.append(n_updates))
    model._settle_readout()
    assert len(rates) == N_TO_SETTLE and model.readout_optimizer.param_groups[0]["lr"] == LEARNING_RATE
    model._settle_readout()
    assert len(rates) == N_TO_SETTLE  # at rest already


def test_what_is_inferred_is_what_is_carried():
    model = learned()
    env = make_vec_env(POINT, 1, seed=1)
    observation, state, rows = env.reset(), None, []
    for _ in range(4):
        action, state = model.predict(observation, state, np.array([state is None]), deterministic=True)
        rows.append((observation["observation"][0], action[0], observation["reward"][0]))
        observation = env.step(action)[0]
    arrays = [np.array(column) for column in zip(*rows, strict=True)]
    transitions = Transitions(arrays[0][:-1], arrays[1][:-1], arrays[2][1:], arrays[0][1:])
    inferred, carried = model.infer_task(transitions), model.task_estimate(state)
    np.testing.assert_allclose(inferred.probabilities, carried.probabilities[0], atol=1e-5)
    prior = model.infer_task(Transitions(*(array[:0] for array in transitions)))
    assert prior.probabilities.shape == (2,)


@pytest.mark.parametrize("encoder", ["bruno", "recurrent"])
def test_an_agent_is_the_same_with_and_without_a_readout(encoder):
    options = {"encoder_class": encoder, "encoder": encoder}
    one, other = (learned(task_readout=has, **options) for has in (True, False))
    assert other.policy.readout is None
    for name, value in other.policy.state_dict().items():
        th.testing.assert_close(one.policy.state_dict()[name], value, atol=0, rtol=0)


def test_an_agent_without_a_readout_says_so_and_can_be_given_one(tmp_path):
    model = learned(task_readout=False)
    state = model.predict(model.get_env().reset())[1]
    with pytest.raises(ValueError, match=r"no read-out.*fit_readout"):
        model.task_estimate(state)
    before = {name: value.clone() for name, value in model.policy.state_dict().items()}
    model.fit_readout(3)
    assert model.task_estimate(state).probabilities.shape == (1, 2)
    for name, value in before.items():
        th.testing.assert_close(model.policy.state_dict()[name], value, atol=0, rtol=0)
    model.save(tmp_path / "model")
    again = BrunoSAC.load(tmp_path / "model", env=model.get_env())
    np.testing.assert_array_equal(again.task_estimate(state).probabilities, model.task_estimate(state).probabilities)
    with pytest.raises(ValueError, match=r"task_readout=False.*leave it out"):
        BrunoSAC.load(tmp_path / "model", task_readout=False)


@pytest.mark.parametrize("n_updates", [0, -1, 1.5, True])
def test_fit_readout_refuses(n_updates):
    model = learned(steps=10)
    with pytest.raises((TypeError, ValueError), match="n_updates"):
        model.fit_readout(n_updates)


def test_fit_readout_needs_transitions_and_an_env(tmp_path):
    model = BrunoSAC("MlpPolicy", POINT, **TINY, **TINY_ENCODER["bruno"], task_readout=False)
    with pytest.raises(ValueError, match="replay buffer is empty"):
        model.fit_readout()
    model.learn(10)
    model.save(tmp_path / "model")
    model.save_replay_buffer(tmp_path / "buffer")
    alone = BrunoSAC.load(tmp_path / "model", device="cpu")
    alone.load_replay_buffer(tmp_path / "buffer")
    with pytest.raises(ValueError, match=r"env=\.\.\."):
        alone.fit_readout()


def test_many_tasks_are_told_by_numbers_with_their_names():
    model = learned(env=GOAL)
    estimate = model.task_estimate(model.predict(model.get_env().reset())[1])
    assert estimate.tasks is None and estimate.probabilities is None
    assert estimate.mean.shape == (1, 3) and (estimate.std > 0).all()
    assert estimate.texts()[0].startswith("goal x ") and " ± " in estimate.texts()[0]


@pytest.mark.parametrize(
    ("tasks", "are_few"),
    [
        ([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]], True),
        ([[1.0, 0.0]], False),  # nothing to tell apart
        ([[np.cos(a), np.sin(a)] for a in np.linspace(0, 6, 9)], False),
        (TaskSampler(lambda rng: np.array([rng.choice([-1.0, 1.0]), 0.0]), Box(-1, 1, (2,))), False),
    ],
)
def test_tasks_are_few_where_all_are_listed(tasks, are_few):
    env = make_vec_env(POINT, 1, env_kwargs={"tasks": tasks})
    model = BrunoSAC("MlpPolicy", env, **TINY, **TINY_ENCODER["bruno"])
    assert (model.task_labels.tasks != ()) == are_few
    if are_few:
        assert model.task_labels.tasks == ("right", "up", "left")


@pytest.mark.parametrize("vec_env", [None, SubprocVecEnv])
def test_trials_several_envs_and_normalisation(vec_env):
    env = VecNormalize(make_vec_env(TRIAL, 2, seed=0, vec_env_cls=vec_env))
    model = learned(env=env, steps=200, learning_starts=180)
    estimate = model.task_estimate(model.predict(env.reset())[1])
    assert estimate.mean.shape == (2, 2) and len(estimate.texts()) == 2
    assert np.isfinite(estimate.mean).all() and np.isfinite(estimate.std).all()
    env.close()


def test_it_says_as_much_as_is_known():
    labels = TaskLabels(("velocity", "mass"), ("m/s", ""), ())
    estimate = TaskEstimate(np.array([[1.9123, -20.4]]), np.array([[0.132, 12.0]]), None, None, labels)
    assert estimate.texts() == ["velocity 1.91 ± 0.13 m/s, mass -20 ± 12"]
    few = TaskLabels((), (), ("forward", "backward", "left", "right"))
    tasks, probabilities = np.eye(4, dtype=np.float32), np.array([[0.6, 0.001, 0.3, 0.099]])
    assert TaskEstimate(tasks[:1], tasks[:1], tasks, probabilities, few).texts() == [
        "forward 0.60, left 0.30, right 0.10"
    ]
    nameless = TaskEstimate(np.array([[2.0]]), np.array([[0.0]]), None, None, TaskLabels())
    assert nameless.texts() == ["task[0] 2 ± 0"]


@pytest.mark.parametrize(
    ("value", "spread", "said"),
    [
        (0.35, 0.0, "0.35 ± 0"),
        (9.80665, 0.0, "9.81 ± 0"),
        (0.35, np.inf, "0.35 ± inf"),
        (0.35, np.nan, "0.35 ± nan"),
        (np.nan, np.nan, "nan ± nan"),
        (np.inf, 0.1, "inf ± 0.10"),
        (0.35, 3e38, f"0 ± {3e38:.0f}"),
    ],
)
def test_it_says_what_is_not_finite_or_known_exactly(value, spread, said):
    assert str(TaskEstimate(np.array([[value]]), np.array([[spread]]), None, None, TaskLabels())) == f"task[0] {said}"


def test_columns_are_prefixes_that_the_row_has():
    rng = np.random.default_rng(0)
    is_read = np.zeros((3, 30), dtype=bool)
    is_read[0, :4] = is_read[1] = is_read[2, 10:20] = True  # short, long, and a window behind a sample
    drawn = np.concatenate([_draw_columns(is_read, rng)[0][:, 3:] for _ in range(200)], axis=1)
    assert drawn.shape == (3, 200 * N_STEPS)
    assert (drawn[0].min(), drawn[0].max()) == (0, 3)
    assert (drawn[1].min(), drawn[1].max()) == (0, 29) and np.median(drawn[1]) < 8
    assert (drawn[2].min(), drawn[2].max()) == (10, 19)
    columns, counts = _draw_columns(is_read, rng)
    assert columns[:, :3].tolist() == [[1, 5, 20]] * 3
    assert counts[:, :3].tolist() == [[1, 0, 0], [1, 1, 1], [0, 0, 0]]
    assert (counts[:, 3:] == 1).all()
