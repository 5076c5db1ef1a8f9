"""A study is made whole or not at all, and says what is wrong with it before any worker starts."""

import optuna
import pytest

from sb3_bruno.zoo import study as study_module
from sb3_bruno.zoo.plain_text import check_texts
from sb3_bruno.zoo.storage import open_storage, without_password
from sb3_bruno.zoo.study import CODE, SETTINGS, check_config, create_study, load_study, other_code

SETTINGS_OF_A_STUDY = {
    "algo": "bruno_sac",
    "env": "PointDir-v0",
    "config": {"policy": "MlpPolicy"},
    "n_timesteps": 9,
    "n_evaluations": 2,
    "n_startup_trials": 2,
    "seed": 0,
}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("storage", ["x.log", "new/x.log"])
def test_no_file_is_made_by_looking_for_a_study(storage, folder):
    with pytest.raises(ValueError, match=f"no study s in {storage}, which is no file: make it with sb3-bruno sweep"):
        load_study(storage, "s")
    assert list(folder.iterdir()) == []


def test_an_unknown_study_is_told_with_those_there():
    open_storage("x.log")
    with pytest.raises(ValueError, match=r"no study s in x.log: make it with sb3-bruno sweep init"):
        load_study("x.log", "s")
    for name in ("point", "cheetah dir/ü'\"%s"):
        create_study("x.log", name, SETTINGS_OF_A_STUDY)
        assert load_study("x.log", name).study_name == name
    with pytest.raises(ValueError, match=r"did you mean point\? It has cheetah dir/ü'\"%s, point: give one of them"):
        load_study("x.log", "piont")


@pytest.mark.parametrize("name", ["", "a\nb", "a\0b", "\udcff", "n" * 513], ids=ascii)
def test_a_name_that_no_storage_can_keep_is_refused_and_makes_no_file(name, folder):
    with pytest.raises(ValueError, match=r"--study-name .*: give 1 to 512 printable characters"):
        create_study("x.log", name, SETTINGS_OF_A_STUDY)
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize(
    "value",
    [dict, {1, 2}, {"a": {1: 2}}, float("nan"), [object()], b"x", {(1, 2): 3}],
    ids=lambda value: type(value).__name__,
)
def test_a_value_that_json_cannot_hold_makes_no_study(value, folder):
    with pytest.raises(ValueError, match=r"policy_kwargs=.* cannot be stored as JSON"):
        create_study("x.log", "s", {**SETTINGS_OF_A_STUDY, "config": {"policy_kwargs": value}})
    assert list(folder.iterdir()) == []


def test_values_that_json_holds_are_kept():
    check_config(
        {"a": (1, "episode"), "b": {"c": [1, (2.5, None)]}, "d": True, "e": float("inf"), "f": "text", "g": 1e5}
    )


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('touch pwned')",
        "open('pwned', 'w')",
        "dict(a=open('pwned', 'w'))",
        "(lambda: open('pwned', 'w'))()",
        "dict(activation_fn=lambda x: x)",
        "dict(a=nn.Module.__subclasses__())",
        "nn.__dict__",
        "nn.functional.relu",
        "dict(a=[x for x in (1,)])",
        "dict()()",
        "''.join(['a'])",
        "f'{open(1)}'",
        "dict(a=(b := 1))",
        "exec('1')",
        "1 +",
        "(" * 500,
        "",
    ],
)
@pytest.mark.parametrize("name", ["policy_kwargs", "replay_buffer_class", "replay_buffer_kwargs", "normalize"])
def test_text_that_says_more_than_values_is_refused(name, text):
    with pytest.raises(ValueError, match=f"{name}=.* is more than plain values, dict"):
        check_texts({name: text})


@pytest.mark.parametrize(
    "config",
    [
        {"policy_kwargs": "dict(net_arch=[400, 300], log_std_init=-3.5, use_expln=True, a=None)"},
        {"policy_kwargs": " dict(\n  activation_fn=nn.ReLU,\n  net_arch=dict(pi=[64], qf=[64])\n )\n"},
        {"policy_kwargs": "dict(activation_fn=lambda: nn.LeakyReLU(0.2))"},
        {"policy_kwargs": "dict(optimizer_class=RMSpropTFLike, optimizer_kwargs=dict(eps=1e-5))"},
        {"policy_kwargs": "{**dict(activation_fn=nn.ELU), **{'net_arch': [64]}}"},
        {"replay_buffer_class": "HerReplayBuffer", "normalize": "{'norm_obs': True, 'norm_reward': False}"},
        {"policy_kwargs": {"net_arch": [64]}, "policy": "open", "normalize": True},
        {
            "env_wrapper": [
                {"gymnasium.wrappers.TimeLimit": {"max_episode_steps": 9}},
                "rl_zoo3.wrappers.HistoryWrapper",
            ]
        },
        {"env_wrapper": None, "callback": "stable_baselines3.common.callbacks.CheckpointCallback"},
    ],
    ids=str,
)
def test_the_texts_of_rl_zoos_own_configs_are_taken(config):
    check_texts(config)


@pytest.mark.parametrize("name", ["env_wrapper", "vec_env_wrapper", "callback"])
@pytest.mark.parametrize("path", ["os.system", "subprocess.Popen", "nowhere.Wrapper", "Wrapper", 7, "gymnasium.make"])
def test_what_is_no_wrapper_or_callback_is_not_called(name, path):
    for given in (path, [path], [{path: {"args": ["touch", "pwned"]}}]):
        with pytest.raises(ValueError, match=f"{name}=.*{path}.* is no .* that can be imported: name another"):
            check_texts({name: given})


def test_a_study_knows_the_code_that_it_was_begun_with(monkeypatch):
    monkeypatch.setattr(study_module, "library_versions", lambda: {"commit": "abc-dirty"})
    study = create_study("x.log", "s", SETTINGS_OF_A_STUDY)
    assert study.user_attrs[CODE] == {"version": "0.1.0", "commit": "abc-dirty"} and other_code(study) is None
    monkeypatch.setattr(study_module, "library_versions", dict)
    assert other_code(study).startswith(
        "study s was begun with sb3_bruno 0.1.0 at commit abc-dirty, and this is 0.1.0: "
    )
    before_it_was_noted = optuna.create_study(study_name="t", storage=open_storage("x.log"))
    before_it_was_noted.set_user_attr(SETTINGS, SETTINGS_OF_A_STUDY)
    assert other_code(load_study("x.log", "t")).startswith("study t was begun with sb3_bruno ?, and this is 0.1.0: ")


def test_a_password_is_not_shown():
    assert without_password("postgresql://me:secret@host/base") == "postgresql://me:***@host/base"
    assert without_password("sweeps/x.log") == "sweeps/x.log"
    with pytest.raises(ValueError, match=r"--storage postgresql://me:\*\*\*@localhost:1/x cannot be opened") as told:
        open_storage("postgresql://me:secret@localhost:1/x")
    assert "secret" not in str(told.value)
    for mistaken in ("mysql://me:secret@host/x", "postgresql://me:secret@h:i/x", "://me:secret@h"):
        with pytest.raises(ValueError, match="--storage") as told:
            open_storage(mistaken)
        assert "secret" not in str(told.value)
