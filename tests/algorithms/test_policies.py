"""The policy: who reads what, and how the belief travels through predict."""

import numpy as np
import pytest
import torch as th
import zuko
from gymnasium import spaces
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import VecNormalize

from sb3_bruno.algorithms.sac import TaskSACPolicy
from sb3_bruno.encoders import Transitions

SMALL = {
    "process": "gaussian",  # whose memory begins with the number of transitions
    "flow_class": zuko.flows.MAF,
    "flow_kwargs": {"transforms": 2, "hidden_features": (16,)},
}


def make_env(n_envs=3, name="PointDir-v0", **kwargs):
    return make_vec_env(f"sb3_bruno_envs:{name}", n_envs, seed=0, env_kwargs=kwargs)


def make_policy(**kwargs):
    th.manual_seed(0)
    env = make_env()
    task_space = env.get_attr("task_space")[0]
    return TaskSACPolicy(
        env.observation_space,
        env.action_space,
        lambda _: 1e-3,
        net_arch=[16],
        task_space=task_space,
        **{"encoder_kwargs": SMALL, **kwargs},
    )


def rollout(policy, env, steps, deterministic=True):
    """The Dicts that the agent saw, and its states."""
    observation, state, start = env.reset(), None, np.ones(env.num_envs, dtype=bool)
    seen, states = [], []
    for _ in range(steps):
        action, state = policy.predict(observation, state, start, deterministic)
        seen.append(observation)
        states.append(state)
        observation, _, start, _ = env.step(action)
    return seen, states


def gradient_reads(net, policy):
    """Which entries of the extended observation change what ``net`` returns."""
    x = th.randn(8, policy.layout.dim, requires_grad=True)
    net(x).sum().backward()
    return (x.grad.abs().sum(dim=0) > 0).tolist()


@pytest.mark.parametrize(
    ("critic_input", "reads"), [("task", (True, False, True)), ("belief", (True, True, False)), ("both", (True,) * 3)]
)
def test_the_actor_never_reads_the_task_and_critics_read_what_they_should(critic_input, reads):
    policy = make_policy(critic_input=critic_input)
    observation, belief, task = 2, policy.encoder.belief_dim, 2
    assert gradient_reads(lambda x: policy.actor(x, deterministic=True), policy) == (
        [True] * (observation + belief) + [False] * task
    )
    for critic in (policy.critic, policy.critic_target):
        found = gradient_reads(lambda x, critic=critic: th.cat(critic(x, th.zeros(8, 2))), policy)
        assert found == [reads[0]] * observation + [reads[1]] * belief + [reads[2]] * task


def test_carried_belief_is_that_of_the_transitions_seen_in_any_order():
    policy = make_policy()
    seen, states = rollout(policy, make_env(), 20)
    arrays = [{key: np.stack([shown[key] for shown in seen], axis=1) for key in seen[0]}]
    dicts = {key: th.as_tensor(value) for key, value in arrays[0].items()}
    history = Transitions(
        dicts["observation"][:, :-1], dicts["action"][:, 1:], dicts["reward"][:, 1:], dicts["observation"][:, 1:]
    )
    order = th.randperm(19)
    shuffled = Transitions(*(column[:, order] for column in history))
    with th.no_grad():
        whole = [prefixes[:, -1] for prefixes in policy.encoder.prefixes(shuffled)]
    for carried, expected in zip(states[-1], whole, strict=False):
        np.testing.assert_allclose(carried, expected, rtol=1e-4, atol=1e-5)


def test_an_episode_start_begins_from_the_prior_for_that_env_alone():
    policy = make_policy()
    seen, states = rollout(policy, make_env(), 5)
    _, fresh = policy.predict(seen[-1], states[-2], np.array([False, True, False]))
    _, carried = policy.predict(seen[-1], states[-2], np.zeros(3, dtype=bool), deterministic=True)
    assert fresh[0][:, 0].tolist() == [4, 0, 4]
    assert carried[0][:, 0].tolist() == [4, 4, 4]
    for begun, gone_on in zip(fresh, carried, strict=True):  # where the others' transition began is not forgotten
        np.testing.assert_allclose(begun[[0, 2]], gone_on[[0, 2]], rtol=1e-6)


def test_the_dicts_own_flag_says_that_no_transition_led_here_and_the_belief_goes_on():
    policy = make_policy()
    seen, states = rollout(policy, make_env(), 5)
    inner_reset = {**seen[-1], "episode_start": np.full((3, 1), 0.5, np.float32)}
    _, state = policy.predict(inner_reset, states[-2], np.zeros(3, dtype=bool))
    assert state[0][:, 0].tolist() == [3, 3, 3]
    np.testing.assert_array_equal(state[3], seen[-1]["observation"])


def test_predict_changes_nothing_and_repeats_itself():
    policy = make_policy()
    seen, states = rollout(policy, make_env(), 4)
    before = {name: one.clone() for name, one in policy.state_dict().items()}
    kept = [array.copy() for array in states[-2]]
    results = [policy.predict(seen[-1], states[-2], np.zeros(3, dtype=bool), deterministic=True) for _ in range(2)]
    np.testing.assert_array_equal(results[0][0], results[1][0])
    for one, two in zip(results[0][1], results[1][1], strict=True):
        np.testing.assert_array_equal(one, two)
    assert all(th.equal(one, before[name]) for name, one in policy.state_dict().items())
    assert all(np.array_equal(one, two) for one, two in zip(kept, states[-2], strict=True))


def test_the_belief_is_a_function_of_the_transitions_however_actions_are_chosen():
    policy = make_policy()
    seen, states = rollout(policy, make_env(), 3)
    totals = [policy.predict(seen[-1], states[-2], None, deterministic=flag)[1][1] for flag in (True, False, False)]
    np.testing.assert_array_equal(totals[0], totals[1])
    np.testing.assert_array_equal(totals[1], totals[2])


def test_without_state_in_mid_episode_it_warns_and_at_a_start_it_does_not(recwarn):
    policy = make_policy()
    env = make_env()
    policy.predict(env.reset())
    assert not recwarn
    observation, *_ = env.step(np.zeros((3, 2), dtype=np.float32))
    with pytest.warns(UserWarning, match="without `state`"):
        policy.predict(observation)


def test_a_single_env_gives_a_single_action():
    policy = make_policy()
    env = make_env(1).envs[0]
    observation, _ = env.reset(seed=0)
    action, state = policy.predict(observation)
    assert action.shape == (2,)
    observation, *_ = env.step(action)
    action, state = policy.predict(observation, state)
    assert action.shape == (2,) and state[0].tolist() == [[1.0]]


def test_normalised_dicts_keep_the_meaning_of_the_flag():
    policy, env = make_policy(), VecNormalize(make_env())
    _, states = rollout(policy, env, 45)
    assert [int(state[0][0, 0]) for state in states] == [*range(30), *range(15)]


@pytest.mark.parametrize("wrap", [lambda env: env, VecNormalize])
def test_a_belief_goes_on_over_inner_resets_and_absorbs_no_transition_that_has_no_end(wrap):
    policy, env = make_policy(), wrap(make_env(2, "SparsePointGoal-v0"))
    _, states = rollout(policy, env, 65)  # a trial of three episodes of 20 steps, and the start of another
    assert [int(state[0][1, 0]) for state in states] == [*range(20), *range(19, 39), *range(38, 58), *range(5)]


RECURRENT = {"encoder_class": "recurrent", "encoder_kwargs": {"hidden_size": 4}}
LSTM = {"encoder_class": "recurrent", "encoder_kwargs": {"hidden_size": 4, "cell": "lstm"}}
WIDER = {"encoder_class": "recurrent", "encoder_kwargs": {"hidden_size": 8}}


@pytest.mark.parametrize(
    ("own", "other"),
    [(RECURRENT, LSTM), (LSTM, RECURRENT), (RECURRENT, WIDER), (RECURRENT, {}), ({}, LSTM)],
    ids=["lstm for gru", "gru for lstm", "wider", "BRUNO for gru", "lstm for BRUNO"],
)
def test_the_state_of_another_encoder_is_refused(own, other):
    observation = make_env().reset()
    _, state = make_policy(**other).predict(observation)
    with pytest.raises(ValueError, match=r"`state` .*pass back the state that `predict` returned"):
        make_policy(**own).predict(observation, state)


def test_the_state_of_other_envs_is_refused():
    policy = make_policy()
    _, state = policy.predict(make_env().reset())
    with pytest.raises(ValueError, match=r"`state` is of 3 envs .* of 2 and 2: pass back the state"):
        policy.predict(make_env(2).reset(), state)
    longer = (*state[:3], np.zeros((3, 5), np.float32))
    with pytest.raises(ValueError, match=r"`state` is of 3 envs and observations of 5 numbers"):
        policy.predict(make_env().reset(), longer)


def test_an_extended_observation_is_acted_on_as_it_is():
    policy = make_policy()
    observation = make_env().reset()
    extended, _ = policy.extend(observation)
    assert extended.shape == (3, policy.layout.dim)
    np.testing.assert_array_equal(
        policy.predict(extended, deterministic=True)[0], policy.predict(observation, deterministic=True)[0]
    )


@pytest.mark.parametrize("wrong", [np.zeros((3, 2), dtype=np.float32), np.zeros(2)])
def test_a_bare_observation_is_refused(wrong):
    with pytest.raises(ValueError, match="TransitionObservation"):
        make_policy().predict(wrong)


def test_save_and_load_take_the_encoder_along(tmp_path):
    policy = make_policy(critic_input="both")
    policy.save(tmp_path / "policy.pkl")
    loaded = TaskSACPolicy.load(tmp_path / "policy.pkl", device=policy.device)
    assert isinstance(loaded.observation_space, spaces.Dict)
    _, states = rollout(policy, make_env(), 4)
    for one, two in zip(states, rollout(loaded, make_env(), 4)[1], strict=True):
        for carried, again in zip(one, two, strict=True):
            np.testing.assert_array_equal(carried, again)


@pytest.mark.parametrize(
    "bad",
    [
        {"features_extractor_class": object},
        {"features_extractor_kwargs": {"features_dim": 3}},
        {"share_features_extractor": True},
        {"critic_input": "reward"},
    ],
)
def test_what_would_be_dropped_silently_raises(bad):
    if "features_extractor_class" in bad:
        bad = {"features_extractor_class": type("Mine", (), {})}
    with pytest.raises(ValueError, match=next(iter(bad))):
        make_policy(**bad)


def test_forgetting_is_off_by_default_and_never_at_a_threshold_out_of_reach():
    plain, patient = make_policy(), make_policy(forget_threshold=1e9)
    assert plain.forget_threshold is None and patient._get_constructor_parameters()["forget_threshold"] == 1e9
    for one, two in zip(rollout(plain, make_env(), 20)[1], rollout(patient, make_env(), 20)[1], strict=True):
        assert (len(one), len(two)) == (4, 8)  # memory, observation; the memory since a suspicion began, its evidence
        for a, b in zip(one, two[:4], strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-6)


def test_a_trained_policy_may_be_told_to_forget_in_mid_episode():
    policy = make_policy()
    seen, states = rollout(policy, make_env(), 20)
    policy.forget_threshold = 0.01  # nats: the first doubt will do
    state = states[9]
    for observation in seen[10:]:
        elsewhere = {**observation, "reward": 20 - observation["reward"]}  # as no transition before
        _, state = policy.predict(elsewhere, state, np.zeros(3, dtype=bool))
    assert (state[0] < states[-1][0]).any() and (state[0] >= 1).all()
    began = {**seen[-1], "episode_start": np.full((3, 1), 0.5, np.float32)}  # no transition led here: nothing to doubt
    for one, two in zip(policy.predict(began, state, np.zeros(3, dtype=bool))[1][:-1], state[:-1], strict=True):
        np.testing.assert_array_equal(one, two)


def test_a_policy_may_be_told_not_to_forget_any_more():
    policy = make_policy(forget_threshold=0.01)
    seen, states = rollout(policy, make_env(), 10)
    policy.forget_threshold = None
    for begins in (False, True):
        _, state = policy.predict(seen[-1], states[-1], np.full(3, begins))
        assert len(state) == 4


def test_a_threshold_of_no_nats_is_refused():
    with pytest.raises(ValueError, match="forget_threshold"):
        make_policy(forget_threshold=0.0)
    with pytest.raises(ValueError, match="forget_threshold"):
        make_policy().forget_threshold = -1.0
