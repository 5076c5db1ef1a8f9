"""Agents with encoders other than BRUNO and RL^2: by class, by name in any algorithm, and what they may know."""

from copy import deepcopy

import gymnasium as gym
import numpy as np
import pytest
import torch as th
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv

from sb3_bruno import BeliefSAC, TaskCrossQ, TaskSAC, TaskTD3, TaskTQC, Transitions, VaribadSAC
from sb3_bruno.encoders import RecurrentVae, SupervisedBelief
from sb3_bruno_envs import MetaTask, TaskSet, TransitionObservation
from support.own_encoders import BayesianLinear, MeanReward
from support.tiny_models import POINT, TINY, TRIAL, assert_same, make_pendulum, make_point, rollout, tiny

CLASSES = {VaribadSAC: RecurrentVae, BeliefSAC: SupervisedBelief}
BY_NAME = {
    "recurrent_vae": {"hidden_size": 8},
    "supervised_belief": {"hidden_size": 8, "belief": "moments"},
    "mean_embedding": {"net_arch": (16,)},
}


@pytest.fixture(scope="module", params=CLASSES, ids=lambda algorithm: algorithm.__name__)
def model(request):
    """A tiny model after 80 steps of PointDir."""
    return request.param("MlpPolicy", make_vec_env(POINT, 2, seed=0), **tiny(request.param)).learn(80)


def test_a_class_has_its_encoder_and_reads_whole_episodes(model):
    assert type(model.encoder) is CLASSES[type(model)]
    assert model.replay_buffer.context == "episode" and model._n_encoder_updates > 0


@pytest.mark.parametrize("algorithm", [TaskTQC, TaskCrossQ, TaskTD3])
@pytest.mark.parametrize("name", BY_NAME)
def test_any_algorithm_takes_the_encoder_by_its_name(algorithm, name, tmp_path):
    env = make_vec_env(TRIAL, 2, seed=0)
    model = algorithm("MlpPolicy", env, **TINY, encoder_class=name, encoder_kwargs=BY_NAME[name]).learn(70)
    model.save(tmp_path / "model")
    loaded = algorithm.load(tmp_path / "model", env=env)
    for agent in (model, loaded):
        env.seed(3)
        agent.found = rollout(agent, env, 5)
    assert_same(model.found, loaded.found)


@pytest.mark.parametrize("learns_from", ["critic", "actor"])
@pytest.mark.parametrize("name", ["recurrent_vae", "mean_embedding"])
def test_the_actor_critic_may_teach_the_encoder(name, learns_from):
    kwargs = {"encoder_class": name, "encoder_kwargs": {**BY_NAME[name], "learns_from": learns_from}}
    model = TaskTD3("MlpPolicy", POINT, **TINY, **kwargs)
    before = deepcopy(model.encoder.state_dict())
    model.learn(70)
    changed = {
        key.split(".")[0] for key, value in model.encoder.state_dict().items() if not th.equal(value, before[key])
    }
    assert "variables" in changed and len(changed) > 1
    assert model.policy.critic_input == ("belief" if learns_from == "critic" else "task")


def test_the_task_is_not_read_where_the_agent_acts(model):
    """The extended observation keeps a place for the task, and the buffer knows it. NaN there must change nothing."""
    steps = rollout(model, model.get_env(), 3)
    extended, _ = model.policy.extend(steps[0][0])
    poisoned = extended.clone()
    poisoned[:, model.policy.layout.task] = th.nan
    with th.no_grad():
        assert th.equal(model.actor(extended, deterministic=True), model.actor(poisoned, deterministic=True))


def test_the_task_is_not_read_where_beliefs_are_made(model):
    buffer = deepcopy(model.replay_buffer)
    buffer.set_encoder(model.encoder, model.policy.layout)
    np.random.seed(0)  # noqa: NPY002  # what SB3 draws from
    beliefs = buffer.sample(16).observations[:, model.policy.layout.belief]
    assert beliefs.isfinite().all()
    sequences = buffer.sample_sequences(4)
    assert th.isfinite(model.encoder.loss(sequences).total)
    told = model.encoder.loss(sequences._replace(tasks=th.full_like(sequences.tasks, th.nan))).total
    assert th.isfinite(told) == (not isinstance(model.encoder, SupervisedBelief))  # which is privileged, there alone


def test_the_posterior_of_a_supervised_belief_is_of_the_task_itself():
    model = BeliefSAC("MlpPolicy", POINT, **tiny(BeliefSAC)).learn(60)
    columns = (np.zeros((4, 7, dim)) for dim in (2, 2, 1, 2))
    belief = model.infer(Transitions(*columns))
    assert belief.mean.shape == belief.var.shape == (4, model.replay_buffer.tasks.task_dim)
    probabilities = model.task_probabilities(belief, [[-1.0, 0.0], [1.0, 0.0]])
    np.testing.assert_allclose(probabilities.sum(axis=-1), 1, rtol=1e-5)


class OneHotEnv(gym.Env):
    """Pays the number of the hidden task, which comes as a one-hot vector."""

    observation_space = gym.spaces.Box(-1.0, 1.0, (1,))
    action_space = gym.spaces.Box(-1.0, 1.0, (1,))
    task = np.zeros(3)

    def set_task(self, task):
        self.task = task

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return np.zeros(1, np.float32), {}

    def step(self, action):
        return np.zeros(1, np.float32), float(self.task.argmax()), False, False, {}


def three_numbers(tasks, **kwargs):
    """An env whose reward names the largest of a task's three numbers."""
    env = gym.wrappers.TimeLimit(OneHotEnv(), 10)
    return TransitionObservation(MetaTask(env, OneHotEnv.set_task, tasks, **kwargs))


def test_one_hot_tasks_have_probabilities():
    kwargs = {"hidden_size": 8, "head": "one_hot"}
    model = BeliefSAC("MlpPolicy", three_numbers(np.eye(3)), **tiny(BeliefSAC, encoder_kwargs=kwargs))
    model.learn(80)
    seen, actions = np.zeros((3, 9, 1)), np.zeros((3, 9, 1))
    rewards = np.broadcast_to(np.arange(3.0)[:, None, None], (3, 9, 1))
    belief = model.infer(Transitions(seen, actions, rewards, seen))
    assert model.task_probabilities(belief, np.eye(3)).shape == (3, 3)


NOT_ONE_HOT = {
    "one number": (make_pendulum, "tasks of size 1"),
    "directions": (make_point, r"\[-?1.0, "),
    "goals, more than are listed one by one": (lambda: gym.make("sb3_bruno_envs:PointGoal-v0"), r"\[-?0\."),
    "one among others": (lambda: three_numbers([*np.eye(3), [0.5, 0.5, 0.0]]), r"\[0.5, 0.5, 0.0\]"),
    "those of the split": (
        lambda: three_numbers(TaskSet(np.eye(3), 2 * np.eye(3)), split="test"),
        r"\[2.0, 0.0, 0.0\]",
    ),
    "endless": (
        lambda: three_numbers(lambda rng: rng.uniform(size=3), task_space=gym.spaces.Box(0.0, 1.0, (3,))),
        r"\[0\.",
    ),
}


@pytest.mark.parametrize(("env", "got"), NOT_ONE_HOT.values(), ids=NOT_ONE_HOT)
def test_tasks_that_are_not_one_hot_are_refused_where_the_model_is_made(env, got):
    with pytest.raises(ValueError, match=f"needs tasks that are one-hot vectors, got {got}"):
        BeliefSAC("MlpPolicy", env(), **tiny(BeliefSAC, encoder_kwargs={"head": "one_hot"}))


@pytest.mark.parametrize("vec_env", [DummyVecEnv, SubprocVecEnv])
def test_tasks_of_every_env_are_looked_at(vec_env):
    envs = vec_env([lambda: three_numbers(np.eye(3)), lambda: three_numbers(1 - np.eye(3))])
    with pytest.raises(ValueError, match=r"one-hot vectors, got \[0.0, 1.0, 1.0\]"):
        BeliefSAC("MlpPolicy", envs, **tiny(BeliefSAC, encoder_kwargs={"head": "one_hot"}))
    envs.close()


@pytest.mark.parametrize("batch_shape", [(), (2,), (2, 3)])
@pytest.mark.parametrize("time", [1, 3, 5])
def test_what_is_inferred_by_an_encoder_that_keeps_a_matrix_is_what_it_absorbs(time, batch_shape):
    model = TaskSAC("MlpPolicy", POINT, encoder_class=BayesianLinear, **TINY)
    rng = np.random.default_rng(0)
    transitions = Transitions(*(rng.uniform(-0.9, 0.9, (*batch_shape, time, dim)) for dim in (2, 2, 1, 2)))
    memory = model.encoder.empty(batch_shape)
    for t in range(time):
        step = Transitions(*(th.tensor(column[..., t, :], dtype=th.float32) for column in transitions))
        memory = model.encoder.absorb(memory, step)
    assert np.abs(model.infer(transitions).mean - model.encoder.belief(memory).detach().numpy()).max() < 1e-5


def test_an_encoder_without_parameters_serves_as_any_other(tmp_path):
    model = TaskSAC("MlpPolicy", POINT, encoder_class=MeanReward, critic_input="belief", **TINY).learn(70)
    model.save(tmp_path / "model")
    env = make_vec_env(POINT, 2, seed=0)
    loaded = TaskSAC.load(tmp_path / "model", env=env)
    found = []
    for agent in (model, loaded):
        env.seed(3)
        found.append(rollout(agent, env, 5))
    assert_same(*found)
    loaded.learn(70)


@pytest.mark.parametrize("teacher", ["critic", "actor"])
def test_an_encoder_with_nothing_to_learn_is_not_taught(teacher):
    encoder_class = type("Untaught", (MeanReward,), {"learns_from": teacher})
    with pytest.raises(ValueError, match=r"Untaught has no parameter to learn: give it one, or set `learns_from"):
        TaskSAC("MlpPolicy", POINT, encoder_class=encoder_class, critic_input="both", **TINY)


def test_an_encoder_that_is_frozen_stays_as_it_is():
    model = VaribadSAC("MlpPolicy", POINT, **tiny(VaribadSAC))
    model.encoder.requires_grad_(False)
    before = deepcopy(model.encoder.state_dict())
    model.learn(70)
    assert_same(model.encoder.state_dict(), before)
