"""An agent or a buffer that would not be what it was is refused, and the model that refuses it stays as it was."""

import copy
import io
import pickle
import re

import gymnasium as gym
import numpy as np
import pytest
import torch as th
from stable_baselines3 import SAC
from stable_baselines3.common.env_util import make_vec_env

from sb3_bruno import BrunoSAC, BrunoTD3, BrunoTQC, RecurrentSAC
from support.tiny_models import POINT, assert_same, tiny


def make(algorithm=BrunoSAC, env=POINT, **kwargs):
    return algorithm("MlpPolicy", make_vec_env(env, 2, seed=0), **tiny(algorithm, **kwargs))


@pytest.fixture(scope="module")
def trained():
    return make().learn(60)


def saved(model):
    file = io.BytesIO()
    model.save(file)
    return file


class OwnSAC(BrunoSAC):
    """A user's own class."""


@pytest.mark.parametrize("other", [BrunoTQC, BrunoTD3, RecurrentSAC])
def test_another_algorithm_does_not_load_it(trained, other):
    with pytest.raises(ValueError, match=r"BrunoSAC.load|class that saved it"):
        other.load(saved(trained))


def test_a_recurrent_agent_is_not_loaded_as_another():
    with pytest.raises(ValueError, match=r"saved by RecurrentSAC, not by BrunoSAC: use `RecurrentSAC.load`"):
        BrunoSAC.load(saved(make(RecurrentSAC)))
    with pytest.raises(ValueError, match="class that saved it"):
        BrunoSAC.load(saved(SAC("MlpPolicy", "Pendulum-v1")))


def test_a_class_made_from_another_loads_what_that_saved_and_the_reverse(trained):
    assert isinstance(OwnSAC.load(saved(trained)), OwnSAC)
    assert isinstance(BrunoSAC.load(saved(make(OwnSAC))), BrunoSAC)


@pytest.mark.parametrize("part", ["actor", "critic_target", "encoder", "log_ent_coef", "encoder_optimizer"])
@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_numbers_that_are_not_finite_are_refused_at_load(trained, part, number):
    model = BrunoSAC.load(saved(trained), make_vec_env(POINT, 2, seed=0))
    if part == "log_ent_coef":
        model.log_ent_coef.data.fill_(number)
    elif part == "encoder_optimizer":
        next(iter(model.encoder_optimizer.state.values()))["exp_avg"].fill_(number)
    else:
        next(getattr(model.policy, part).parameters()).data[0] = number
    with pytest.raises(ValueError, match=rf"parameter `.*{part}.*` holds a number that is not finite"):
        BrunoSAC.load(saved(model))


def is_learned(name, value):
    return isinstance(value, th.Tensor) and name != "readout.tasks"


def test_refused_parameters_leave_the_model_as_it_was(trained):
    model = BrunoSAC.load(saved(trained), make_vec_env(POINT, 2, seed=0))
    before = copy.deepcopy(model.get_parameters())
    other = {
        name: {key: value + 1 if is_learned(key, value) else value for key, value in part.items()}
        for name, part in copy.deepcopy(before).items()
    }
    broken = {
        "a missing part": {name: part for name, part in other.items() if name != "encoder_optimizer"},
        "an unknown part": {**other, "nothing": {}},
        "a missing key": {**other, "policy": dict(list(other["policy"].items())[:-1])},
        "another shape": {**other, "policy": {key: th.zeros(3, 3) for key in other["policy"]}},
        "NaN": {**other, "policy": {key: value * th.nan for key, value in other["policy"].items()}},
    }
    for name, parameters in broken.items():
        with pytest.raises(ValueError, match=r"\. |expected|not finite|invalid object name|of the same tasks"):
            model.set_parameters(parameters)
        assert_same(model.get_parameters(), before)
        assert name
    model.set_parameters(other)
    assert_same(model.get_parameters()["policy"], other["policy"])


LEFT, RIGHT, UP = [-1.0, 0.0], [1.0, 0.0], [0.0, 1.0]
MANY = [[float(np.cos(angle)), float(np.sin(angle))] for angle in np.linspace(0, 3, 12)]


def of_tasks(*tasks, **kwargs):
    """An untrained agent of these tasks."""
    return BrunoSAC("MlpPolicy", gym.make(POINT, tasks=list(tasks)), **tiny(BrunoSAC, **kwargs))


def test_tasks_in_another_order_bring_their_names_along(tmp_path):
    source, target = of_tasks(LEFT, RIGHT), of_tasks(RIGHT, LEFT)
    with th.no_grad():
        source.policy.readout.logits.bias.copy_(th.tensor([3.0, -3.0]))
    target.set_parameters(source.get_parameters())
    target.save(tmp_path / "target")
    state = source.predict(source.get_env().reset())[1]
    expected = source.task_estimate(state)
    assert expected.texts()[0].startswith("left")
    for model in (target, BrunoSAC.load(tmp_path / "target")):
        estimate = model.task_estimate(state)
        assert estimate.texts() == expected.texts() and estimate.labels == expected.labels
        assert_same(estimate.mean, expected.mean)


@pytest.mark.parametrize(
    ("given", "own", "told"),
    [
        ([LEFT, RIGHT], [LEFT, UP], "of the same tasks"),
        ([LEFT, RIGHT], [LEFT, RIGHT, UP], "of the same tasks"),
        ([LEFT, RIGHT], MANY, "read-out of the tasks .*, and the agent's is of many tasks"),
        (MANY, [LEFT, RIGHT], "read-out of many tasks, and the agent's is of the tasks"),
        ([LEFT, RIGHT], None, "the agent has no read-out of the task: .*`task_readout=True`"),
        (None, [LEFT, RIGHT], "they have no read-out of the task: .*`task_readout=False`"),
    ],
)
def test_parameters_of_a_readout_of_other_tasks_are_refused(given, own, told):
    source, target = (
        of_tasks(LEFT, RIGHT, task_readout=False) if tasks is None else of_tasks(*tasks) for tasks in (given, own)
    )
    before = copy.deepcopy(target.get_parameters())
    with pytest.raises(ValueError, match=told):
        target.set_parameters(source.get_parameters())
    assert_same(target.get_parameters(), before)


@pytest.mark.parametrize("fill", [{"env": "sb3_bruno_envs:CheetahDir-v0"}, {"env": POINT, "algorithm": RecurrentSAC}])
def test_a_buffer_that_cannot_serve_leaves_the_models_own(trained, tmp_path, fill):
    other = make(**fill).learn(50)
    other.save_replay_buffer(tmp_path / "buffer.pkl")
    model = make(RecurrentSAC) if fill["env"] != POINT else make(replay_buffer_kwargs={"context": "episode"})
    own = model.replay_buffer
    if fill["env"] == POINT:
        model.load_replay_buffer(tmp_path / "buffer.pkl")  # episodes serve both
        return
    with pytest.raises(ValueError, match=r"replay buffer .*load its own buffer"):
        model.load_replay_buffer(tmp_path / "buffer.pkl")
    assert model.replay_buffer is own


def test_a_buffer_of_another_family_of_equal_sizes_is_refused(trained, tmp_path):
    trained.save_replay_buffer(tmp_path / "buffer.pkl")
    model = make(env="sb3_bruno_envs:SparsePointGoal-v0")
    assert model.observation_space["observation"].shape == trained.observation_space["observation"].shape
    with pytest.raises(ValueError, match="filled in PointDir-v0, and the env is SparsePointGoal-v0"):
        model.load_replay_buffer(tmp_path / "buffer.pkl")
    assert model.replay_buffer.size() == 0
    model.learn(50)


@pytest.mark.parametrize(
    ("given", "line"),
    [
        ({"learnig_rate": 1e-3}, "`BrunoSAC.load` has no `learnig_rate`: did you mean `learning_rate`"),
        ({"batch_size": "3"}, "`batch_size='3'` is no whole number"),
        ({"gamma": None}, "`gamma=None` is no value of it"),
        ({"device": "tpu"}, "`device='tpu'` is no device"),
    ],
    ids=str,
)
def test_an_argument_that_would_change_nothing_or_break_the_model_is_refused(trained, given, line):
    with pytest.raises((TypeError, ValueError), match=re.escape(line)):
        BrunoSAC.load(saved(trained), **given)


@pytest.mark.parametrize("algorithm", [BrunoSAC, BrunoTQC, BrunoTD3])
def test_the_policy_kwargs_that_the_constructor_got_are_taken_and_others_refused(algorithm):
    given = {"net_arch": [16], "log_std_init": -2} if algorithm is not BrunoTD3 else {"net_arch": [16]}
    model = make(algorithm, policy_kwargs=given)
    assert algorithm.load(saved(model), policy_kwargs=given).policy.net_arch == [16]
    assert algorithm.load(saved(model), policy_kwargs={**given, "forget_threshold": None}).policy.net_arch == [16]
    for other in ({}, None, {"net_arch": [8]}, {**given, "n_critics": 3}, {**given, "forget_threshold": 3.0}):
        with pytest.raises(ValueError, match=r"`policy_kwargs=.* is not what the agent was saved with, .*: leave it"):
            algorithm.load(saved(model), policy_kwargs=other)


def test_a_gpu_that_is_missing_is_warned_of(trained, monkeypatch):
    monkeypatch.setattr(th.cuda, "is_available", lambda: False)
    for make_one in (lambda: make(device="cuda"), lambda: BrunoSAC.load(saved(trained), device=th.device("cuda:0"))):
        with pytest.warns(UserWarning, match=r"`device='cuda.*'`: torch finds no GPU here, so the CPU is used") as told:
            assert make_one().device.type == "cpu"
        assert len(told) == 1


def test_files_that_were_cut_short_are_named(trained, tmp_path):
    trained.save(tmp_path / "model.zip")
    trained.save_replay_buffer(tmp_path / "buffer.pkl")
    own = trained.replay_buffer
    for name, load in (("model.zip", BrunoSAC.load), ("buffer.pkl", trained.load_replay_buffer)):
        whole = (tmp_path / name).read_bytes()
        for part in (0, len(whole) // 2):
            (tmp_path / name).write_bytes(whole[:part])
            with pytest.raises(ValueError, match=name.split(".")[0]):
                load(tmp_path / name)
    (tmp_path / "buffer.pkl").write_bytes(pickle.dumps({"a": 1}))
    with pytest.raises(ValueError, match=r"buffer.pkl'` holds no replay buffer"):
        trained.load_replay_buffer(tmp_path / "buffer.pkl")
    assert trained.replay_buffer is own


@pytest.mark.parametrize("algorithm", [BrunoSAC, RecurrentSAC])
def test_a_loaded_buffer_is_trained_on_without_learn(algorithm, tmp_path):
    make(algorithm).learn(60).save_replay_buffer(tmp_path / "buffer.pkl")
    model = make(algorithm)
    model.load_replay_buffer(tmp_path / "buffer.pkl")
    model.train(2, 16)
    assert model._n_updates == 2 and model._n_encoder_updates > 0
    model.learn(50)
