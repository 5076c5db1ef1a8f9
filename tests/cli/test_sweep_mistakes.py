"""What a user gets wrong about a sweep is one line, said before any worker starts."""

import re

import optuna
import pytest
import yaml

from sb3_bruno.cli.main import main
from sb3_bruno.zoo.storage import open_storage
from sb3_bruno.zoo.study import SETTINGS, load_study

CHOSEN = ["--storage", "x.log", "--study-name", "s"]
INIT = ["sweep", "init", *CHOSEN, "--env", "PointDir-v0", "-n", "120"]


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def study_of_another(with_settings=False):
    """A study with one finished trial, of a search that ``sweep init`` did not make unless it is to look so."""
    study = optuna.create_study(study_name="s", storage=open_storage("x.log"), direction="maximize")
    study.add_trial(optuna.create_trial(value=1.0))
    if with_settings:
        study.set_user_attr(SETTINGS, {"n_startup_trials": 2, "n_evaluations": 2})
    return study


@pytest.mark.parametrize("command", ["run", "status", "best", "export"])
def test_a_study_that_init_did_not_make_is_one_line(command):
    study_of_another()  # as train -optimize leaves it, or an init that was killed
    with pytest.raises(SystemExit, match=r"study s in x.log was not made by .*: make another --study-name with it"):
        main(["sweep", command, *CHOSEN])


@pytest.mark.parametrize(
    "storage",
    [
        "postgresql://localhost:1/x",
        "postgresql+psycopg://localhost:1/x",
        "postgresql:x",
        "postgresql://h:i/x",
        "at/x.log",
    ],
)
def test_a_storage_that_cannot_be_opened_is_one_line(storage, folder):
    (folder / "at").touch()
    with pytest.raises(SystemExit, match=f"--storage {re.escape(storage)} cannot be opened: ") as end:
        main(["sweep", "run", "--storage", storage, "--study-name", "s"])
    assert len(str(end.value).splitlines()) == 1


def test_a_config_that_train_would_not_take_is_not_written(folder):
    study_of_another(with_settings=True)
    with pytest.raises(SystemExit, match=r"--out best is no name of a config, .*: let it end in \.yml"):
        main(["sweep", "best", *CHOSEN, "--out", "best"])
    assert not (folder / "best").exists()


def test_the_folder_of_what_is_saved_is_made(folder):
    study_of_another(with_settings=True)
    main(["sweep", "export", *CHOSEN, "--out", "new/folder/trials.csv"])
    assert (folder / "new" / "folder" / "trials.csv").read_text().splitlines()[1].startswith("0,COMPLETE,1.0")


def test_where_nothing_can_be_saved_is_one_line(folder):
    study_of_another(with_settings=True)
    with pytest.raises(SystemExit, match=r"--out x.log/trials.csv cannot be written, give another: "):
        main(["sweep", "export", *CHOSEN, "--out", "x.log/trials.csv"])


@pytest.mark.parametrize(
    ("params", "line"),
    [
        ("learning_rate:high", "learning_rate='high' is no schedule: write lin_1e-3"),
        ("critic_input:beliefs", "`?critic_input"),
        ("foo", "-params foo: give NAME:VALUE"),
        ("gamma=1", "-params gamma=1: write gamma:1"),
        ("gamma:1/0", "-params gamma:1/0: ZeroDivisionError"),
        ("n_envs:0", "`n_envs=0` is too small"),
        ("n_envs:2.5", "`n_envs=2.5` is no whole number"),
        ("batch_size:many", "`batch_size='many'` is no whole number"),
        ("policy_kwargs:{1:2}", r"policy_kwargs=\{.*1: 2\} cannot be stored as JSON, which would make it"),
        ("gamma:float('nan')", "gamma=nan cannot be stored as JSON"),
        ("policy_kwargs:\"open('x')\"", "policy_kwargs=\"open\\('x'\\)\" is more than plain values, dict"),
    ],
)
def test_hyperparameters_that_cannot_be_are_one_line(params, line, folder):
    with pytest.raises(SystemExit, match=line):
        main([*INIT, "-params", params])
    assert not (folder / "x.log").exists()


@pytest.mark.parametrize("number", ["0", "-5"])
@pytest.mark.parametrize(
    ("command", "flag"),
    [
        (INIT, "-n"),
        (INIT, "--n-evaluations"),
        (INIT, "--n-startup-trials"),
        (["sweep", "run", *CHOSEN], "--n-trials"),
        (["sweep", "run", *CHOSEN], "--max-total-trials"),
    ],
    ids=lambda value: value if isinstance(value, str) else value[1],
)
def test_numbers_below_one_are_refused(command, flag, number, capsys, folder):
    with pytest.raises(SystemExit):
        main([*command, flag, number])
    assert f"'{number}' is not a whole number of 1 or more" in capsys.readouterr().err
    assert not (folder / "x.log").exists()


def test_a_hyperparameter_that_no_storage_can_hold_is_one_line_and_leaves_no_study(folder):
    line = r"policy_kwargs=\{.*ReLU.*\} cannot be stored as JSON: .*: give it as text in quotes"
    with pytest.raises(SystemExit, match=line):
        main([*INIT, "-params", "policy_kwargs:dict(activation_fn=nn.ReLU)"])
    assert not (folder / "x.log").exists()


@pytest.mark.parametrize("seed", ["-1", str(2**32)])
def test_a_seed_that_a_trial_cannot_have_is_one_line(seed, capsys, folder):
    with pytest.raises(SystemExit):
        main([*INIT, "--seed", seed])
    assert f"--seed: '{seed}' is not a whole number from 0 to 2147483647" in capsys.readouterr().err
    assert not (folder / "x.log").exists()


def test_an_entry_of_a_config_that_is_no_mapping_is_one_line(folder):
    (folder / "my.yml").write_text("PointDir-v0: 3\n")
    with pytest.raises(SystemExit, match=r"my.yml holds no hyperparameters of PointDir-v0: write the env"):
        main([*INIT, "-conf", "my.yml"])


def test_a_config_may_have_a_default_for_all_environments(folder):
    (folder / "my.yml").write_text(yaml.safe_dump({"default": {"policy": "MlpPolicy", "n_timesteps": 64}}))
    main([*INIT, "-conf", "my.yml"])
    assert load_study("x.log", "s").user_attrs[SETTINGS]["config"] == {"policy": "MlpPolicy", "n_timesteps": 64}


def test_a_config_without_a_number_of_steps_has_a_trials(folder):
    (folder / "my.yml").write_text(yaml.safe_dump({"default": {"policy": "MlpPolicy"}}))
    main([*INIT, "-conf", "my.yml"])
    assert load_study("x.log", "s").user_attrs[SETTINGS]["config"] == {"policy": "MlpPolicy", "n_timesteps": 120}


def test_an_environment_that_nobody_registered_is_one_line(folder):
    (folder / "my.yml").write_text(yaml.safe_dump({"Mine-v0": {"policy": "MlpPolicy", "n_timesteps": 64}}))
    own = ["sweep", "init", *CHOSEN, "--env", "Mine-v0", "-n", "120", "-conf", "my.yml"]
    with pytest.raises(SystemExit, match=r"--env Mine-v0 is not registered: .* --gym-packages"):
        main(own)
    with pytest.raises(SystemExit, match="--gym-packages no_such_package cannot be imported: No module named"):
        main([*own, "--gym-packages", "no_such_package"])
    assert not (folder / "x.log").exists()


def test_hyperparameters_are_given_as_in_train(folder):
    main([*INIT, "-params", "critic_input:belief", "--seed", "1e3", "-params", "use_sde:false"])
    settings = load_study("x.log", "s").user_attrs[SETTINGS]
    assert settings["config"]["critic_input"] == "belief" and settings["config"]["use_sde"] is False
    assert settings["seed"] == 1_000
    with pytest.raises(SystemExit, match="gamma is given twice"):
        main([*INIT, "-params", "gamma:0.9", "-params", "gamma:0.8"])


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        ([], "sb3-bruno sweep: the following arguments are required: init | run"),
        (["run", *CHOSEN, "--n-trails", "1"], "sb3-bruno sweep run: --n-trails is unknown: did you mean --n-trials?"),
        (
            [*INIT[1:], "--n-timestep5", "3"],
            "sb3-bruno sweep init: --n-timestep5 is unknown: did you mean --n-timesteps?",
        ),
        (["status", *CHOSEN, "--seed", "1"], "sb3-bruno sweep status: --seed is unknown: leave it out"),
    ],
)
def test_what_a_command_of_a_sweep_does_not_know_is_one_line(arguments, line, capsys):
    with pytest.raises(SystemExit):
        main(["sweep", *arguments])
    told = capsys.readouterr().err.strip()
    assert told.startswith(line) and "\n" not in told


def test_a_trial_too_short_for_its_evaluations_is_one_line(folder):
    line = "--n-evaluations 16: a trial of -n 120 has time for 15, one per step of 8 environments: give fewer"
    with pytest.raises(SystemExit, match=line):
        main([*INIT, "--n-evaluations", "16"])
    assert not (folder / "x.log").exists()
    main([*INIT, "--n-evaluations", "15"])


@pytest.mark.parametrize(("algo", "line"), [("bruno_sacc", "did you mean"), ("crossq", "has no search space")])
def test_an_algorithm_that_cannot_be_searched_is_one_line(algo, line):
    with pytest.raises(SystemExit, match=f"--algo {algo} .*{line}"):
        main([*INIT, "--algo", algo])


def test_a_study_is_not_overwritten_by_what_is_read_from_it(folder):
    study_of_another(with_settings=True)
    before = (folder / "x.log").read_bytes()
    with pytest.raises(SystemExit, match=r"--out x.log is the --storage, which holds the study: give another"):
        main(["sweep", "export", *CHOSEN, "--out", "./x.log"])
    assert (folder / "x.log").read_bytes() == before
