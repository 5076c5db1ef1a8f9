"""Encoders that learn from the critics or the actor: when, how often, in which mode, and what is saved of it."""

from copy import deepcopy

import pytest
import torch as th
from stable_baselines3.common.save_util import load_from_zip_file
from torch.utils._pytree import tree_leaves

from sb3_bruno import BrunoSAC, RecurrentSAC
from sb3_bruno.encoders.base import map_memory
from support.taught import ALGORITHMS, POINT, Stop, make_model, stop


def test_one_update_per_encode_and_none_is_lost(monkeypatch):
    """Episodes of up to 30 steps in 4 rows: 4 samples of 4 x 2 are read from one encode until its steps are used up."""
    model = make_model(batch_size=8)
    encodes, updates = [], []
    encode, step = model.replay_buffer._encode, model.encoder_optimizer.step
    monkeypatch.setattr(model.replay_buffer, "_encode", lambda *args: encodes.append(1) or encode(*args))
    monkeypatch.setattr(model.encoder_optimizer, "step", lambda: updates.append(len(encodes)) or step())
    model.train(40, 8)
    assert updates == list(range(1, len(encodes) + 1)) and 1 < len(encodes) < 40
    assert model._n_encoder_updates == len(encodes)
    assert model.replay_buffer.gradient is None  # nothing is left that a later round could take twice


@pytest.mark.parametrize("teacher", ["critic", "actor"])
def test_a_copied_model_teaches_its_own_encoder(teacher):
    model = make_model(encoder_kwargs={"hidden_size": 8, "learns_from": teacher}, encoder_tau=0.5)
    twin = deepcopy(model)
    twin.bind_buffer()
    twin.set_logger(model.logger)
    before = deepcopy(model.get_parameters()["policy"])
    twin.train(4, 16)
    after = twin.get_parameters()["policy"]
    for part in ("encoder.", "encoder_target."):
        assert not any(th.equal(before[name], after[name]) for name in before if name.startswith(part))
    for name, parameter in model.get_parameters()["policy"].items():
        assert th.equal(parameter, before[name])


@pytest.mark.parametrize("teacher", ["critic", "actor"])
@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_every_algorithm_teaches_its_encoder_also_after_loading(tmp_path, algorithm, teacher):
    model = make_model(algorithm, encoder_kwargs={"hidden_size": 8, "learns_from": teacher, "cell": "lstm"})
    model.save(tmp_path / "model.zip")
    model.save_replay_buffer(tmp_path / "buffer.pkl")
    loaded = algorithm.load(tmp_path / "model.zip", env=model.get_env(), device="cpu")
    loaded.load_replay_buffer(tmp_path / "buffer.pkl")
    loaded.set_logger(model.logger)
    before = [parameter.clone() for parameter in loaded.encoder.parameters()]
    loaded.train(6, 16)
    changed = [not th.equal(old, new) for old, new in zip(before, loaded.encoder.parameters(), strict=True)]
    assert all(changed)


def test_a_saved_model_holds_no_tensor_of_some_device(tmp_path):
    model = make_model()
    model.train(4, 16)
    model.save(tmp_path / "model.zip")
    data, _, _ = load_from_zip_file(tmp_path / "model.zip")
    assert not [leaf for leaf in tree_leaves(data) if isinstance(leaf, th.Tensor)]


def test_an_update_that_fails_does_not_leave_the_encoder_in_training_mode(monkeypatch):
    taught, by_itself = make_model(), BrunoSAC("MlpPolicy", POINT, device="cpu", learning_starts=20).learn(10)
    for model, method in ((taught, "prefixes"), (by_itself, "loss")):
        monkeypatch.setattr(model.encoder, method, stop)
        with pytest.raises(Stop):
            model.train(1, 16) if model is taught else model.learn(100, reset_num_timesteps=False)
        assert not model.encoder.training


def test_it_is_encoded_in_training_mode_where_it_learns_and_acts_in_the_other(monkeypatch):
    model = make_model(encoder_tau=0.5)
    modes = {model.encoder: [], model.policy.encoder_target: []}
    for encoder, seen in modes.items():
        prefixes = encoder.prefixes
        watched = lambda *args, encoder=encoder, seen=seen, prefixes=prefixes: (  # noqa: E731
            seen.append((encoder.training, th.is_grad_enabled())) or prefixes(*args)
        )
        monkeypatch.setattr(encoder, "prefixes", watched)
    model.train(1, 16)
    assert modes[model.encoder] == [(True, True), (False, False)]  # its samples, then the running episodes
    assert modes[model.policy.encoder_target] == [(False, False)]
    assert not model.encoder.training


def test_running_episodes_are_encoded_again_after_each_round_of_updates():
    model = make_model(steps=86, encoder_learning_rate=0.1)
    model.train(8, 16)
    buffer = model.replay_buffer
    slots, lengths = buffer.episodes.running()
    with th.no_grad():
        prefixes = model.encoder.prefixes(buffer.transitions(slots))
        for env, length in enumerate(lengths):
            expected = map_memory(lambda states, i=env, n=length: states[i, n - 1], prefixes)
            carried = map_memory(lambda states, i=env: states[i], model._carried.memory)
            th.testing.assert_close(carried, expected)
    assert (lengths > 1).all()


def test_a_long_episode_is_encoded_again_less_often(monkeypatch):
    model = make_model(steps=30)
    recalled = []
    monkeypatch.setattr("sb3_bruno.algorithms.encoder_training.RECALLED", 5)  # of 15 transitions: every third round
    prefixes = model.encoder.prefixes
    for round_ in range(9):
        monkeypatch.setattr(model.encoder, "prefixes", lambda *args: recalled.append(round_) or prefixes(*args))  # noqa: B023
        model._recall_running_episodes()
    assert recalled == [2, 5, 8]


def test_the_target_encoder_follows_slowly_and_makes_the_next_beliefs():
    model = make_model(encoder_tau=0.25, encoder_learning_rate=0.05)
    target = model.policy.encoder_target
    before = [parameter.clone() for parameter in target.parameters()]
    for old, new in zip(before, model.encoder.parameters(), strict=True):
        assert th.equal(old, new)
    model.train(1, 16)
    for old, fast, slow in zip(before, model.encoder.parameters(), target.parameters(), strict=True):
        th.testing.assert_close(slow, 0.75 * old + 0.25 * fast)
        assert not slow.requires_grad
    (slots, *_), _ = drawn = model.replay_buffer.episode_rows(1, bounded=False)
    model.replay_buffer.episode_rows = lambda n, bounded: drawn
    samples = model.replay_buffer.sample(slots.shape[1])
    layout, transitions = model.policy.layout, model.replay_buffer.transitions(slots)
    order = samples.observations[:, :2].detach()
    for found, encoder, first in ((samples.observations, model.encoder, 0), (samples.next_observations, target, 1)):
        with th.no_grad():
            beliefs = encoder.belief(encoder.prefixes(transitions))[0, first : first + slots.shape[1]]
        for row, here in zip(found, order, strict=True):
            step = (transitions.observations[0] - here).abs().sum(dim=1).argmin()
            th.testing.assert_close(row[layout.belief].detach(), beliefs[step])


def test_a_saved_model_keeps_its_target_encoder_or_its_lack_of_one(tmp_path):
    for tau, other, told in ((None, 0.1, "without a target encoder"), (0.1, None, "with a target encoder")):
        model = make_model(steps=4, encoder_tau=tau)
        model.save(tmp_path / "model.zip")
        loaded = RecurrentSAC.load(tmp_path / "model.zip", device="cpu")
        assert (loaded.policy.encoder_target is None, loaded.encoder_tau) == (tau is None, tau)
        with pytest.raises(ValueError, match=told):
            RecurrentSAC.load(tmp_path / "model.zip", device="cpu", encoder_tau=other)


def test_without_a_target_encoder_there_is_none():
    assert make_model(steps=4).policy.encoder_target is None


@pytest.mark.parametrize(
    ("settings", "remedy"),
    [
        ({"critic_input": "task"}, "use 'belief' or 'both'"),
        ({"replay_buffer_kwargs": {"context": "iid"}}, r"dict\(context='episode'\)"),
        ({"encoder_batch_size": 8}, "leave it out"),
        ({"encoder_update_ratio": 0.5}, "leave it out"),
        ({"encoder_learning_starts": 10}, "leave it out"),
        ({"encoder_tau": 0.0}, r"in \(0, 1\]"),
        ({"encoder_kwargs": {"cell": "rnn"}}, "'gru', 'lstm'"),
        ({"encoder_kwargs": {"hidden_size": 0}}, "at least 1"),
        ({"encoder_kwargs": {"learns_from": "own"}}, "'critic' or 'actor'"),
        ({"encoder_kwargs": {"max_grad_norm": 0.0}}, "None never clips"),
        ({"encoder_kwargs": {"hiden_size": 8}}, "did you mean `hidden_size`"),
        ({"encoder_class": "bruno", "encoder_kwargs": {"cell": "gru"}}, "has no `cell`: it takes modelled,"),
        ({"replay_buffer_kwargs": {"sequences_length": 8}}, "did you mean `sequence_length`"),
        ({"policy_kwargs": {"forget_threshold": 5.0}}, "ability `Predicts`"),
    ],
)
def test_what_cannot_work_is_refused_with_a_remedy(settings, remedy):
    with pytest.raises(ValueError, match=remedy):
        make_model(steps=0, **settings)


def test_an_encoder_that_learns_from_the_actor_leaves_the_critics_their_task():
    assert make_model(steps=0, encoder_kwargs={"learns_from": "actor"}).policy.critic_input == "task"
    assert make_model(steps=0).policy.critic_input == "belief"
    assert BrunoSAC("MlpPolicy", POINT).policy.critic_input == "task"


def test_a_belief_without_a_distribution_says_what_is_missing():
    model = make_model(steps=4)
    _, state = model.predict(model.get_env().reset())
    with pytest.raises(ValueError, match=r"`HasPosterior`, and `RecurrentEncoder` has no `posterior`"):
        model.belief(state)
