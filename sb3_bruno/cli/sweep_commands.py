"""What each command of ``sb3-bruno sweep`` does, once ``sweep.py`` has read its flags."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from json import JSONDecodeError
from pathlib import Path
from typing import Any

import optuna
import rl_zoo3
import torch as th
import yaml
from optuna.exceptions import StorageInternalError
from optuna.trial import TrialState
from sqlalchemy.exc import SQLAlchemyError

from sb3_bruno.cli.mistake import Mistake, told_as_mistake
from sb3_bruno.cli.shown_command import env_flags, shown_command
from sb3_bruno.cli.trial_bar import trial_bar
from sb3_bruno.runs.denormals import flushed_denormals
from sb3_bruno.zoo.another_encoder import fitted_to_encoder
from sb3_bruno.zoo.configs import config_file, find_config, merged, read_configs
from sb3_bruno.zoo.one_line import in_one_line
from sb3_bruno.zoo.plain_text import check_texts
from sb3_bruno.zoo.registry import check_searchable, converter_of, import_packages
from sb3_bruno.zoo.storage import is_journal, without_password
from sb3_bruno.zoo.study import SETTINGS, SweepSettings, check_config, create_study, load_study, other_code
from sb3_bruno.zoo.sweep import SweepExperiment
from sb3_bruno.zoo.work import GaveUp, tell_of_lost_trials, work
from sb3_bruno.zoo.workers import GIVEN_BACK, OWNER


def init(options: argparse.Namespace) -> None:
    """Create the study: once, before the workers start."""
    with told_as_mistake():
        check_searchable(options.algo)
    package, _, env = options.env.rpartition(":")  # as in my_package:My-v0
    packages = [*options.gym_packages, package] if package else options.gym_packages
    given = options.hyperparams or {}
    config = read_config(options.algo, env, options.conf)
    with told_as_mistake():
        import_packages(packages)  # which may name the encoder
        config = merged(fitted_to_encoder(options.algo, config, given), given)
        config = {"n_timesteps": options.n_timesteps, **config}  # where it has none, `best` writes a trial's
        check_config(config)
    settings: SweepSettings = {
        "algo": options.algo,
        "env": env,
        "gym_packages": packages,
        "config": config,
        "n_timesteps": options.n_timesteps,
        "n_evaluations": options.n_evaluations,
        "n_startup_trials": options.n_startup_trials,
        "seed": options.seed,
    }
    with told_as_mistake(Exception):  # config and -params are Python, which may raise anything
        SweepExperiment(settings).check()
    with told_as_mistake(), told_as_lost(options):
        create_study(options.storage, options.study_name, settings)
    storage = without_password(options.storage)
    start = shown_command("sweep run", "--storage", storage, "--study-name", options.study_name)
    print(f"Made {options.study_name} in {storage}: start workers with {start}")


def read_config(algo: str, env: str, conf: str | None) -> dict[str, Any]:
    """Read the hyperparameters that are not drawn.

    Raises:
        Mistake: if there are none for this algorithm and environment.
    """
    with told_as_mistake(OSError), told_as_mistake(ValueError):
        path = config_file(algo, conf) or str(Path(rl_zoo3.__file__).parent / "hyperparams" / f"{algo}.yml")
        configs = read_configs(path)
    config = find_config(configs, env)
    if config is None:
        raise Mistake(f"{path} has no {env}: give another file by -conf")
    return config


def find_study(options: argparse.Namespace) -> optuna.Study:
    """Load the study that ``--storage`` and ``--study-name`` name.

    Raises:
        Mistake: if there is none.
    """
    with told_as_mistake(), told_as_lost(options):
        return load_study(options.storage, options.study_name)


def run(options: argparse.Namespace) -> None:
    """Work on the study until it has --max-total-trials, or for --n-trials. Start any number of workers."""
    th.set_num_threads(1)
    study = find_study(options)
    with told_as_mistake(Exception):
        experiment = SweepExperiment(study.user_attrs[SETTINGS])
    warning = other_code(study)
    if warning is not None:
        print(f"Warning: {warning}", file=sys.stderr)

    def objective(trial: optuna.Trial) -> float:
        with flushed_denormals():
            return experiment.objective(trial)

    limits = {"n_trials": options.n_trials, "max_total": options.max_total_trials}
    gave_up = None
    with told_as_mistake(), told_as_lost(options), trial_bar(study, **limits) as advance:
        try:
            work(study, objective, **limits, after_trial=advance)
        except GaveUp as error:
            gave_up = error
    status(options)
    if gave_up is not None:
        raise Mistake(str(gave_up))


@contextmanager
def told_as_lost(options: argparse.Namespace) -> Iterator[None]:
    """Tell in one line that the storage cannot be reached or written any more.

    Raises:
        Mistake: if so.
    """
    try:
        yield
    except (OSError, JSONDecodeError, StorageInternalError, SQLAlchemyError) as error:
        given = without_password(options.storage)
        cause = in_one_line(error.__cause__ if isinstance(error.__cause__, Exception) else error)
        raise Mistake(f"--storage {given} is lost: {cause}: start again when it can be read and written") from error


def status(options: argparse.Namespace) -> None:
    """Count the trials by state; show who works on which, and the best so far."""
    study = find_study(options)
    with told_as_mistake(), told_as_lost(options):
        tell_of_lost_trials(study)
        trials = study.get_trials(deepcopy=False)
    counts = Counter("given back" if GIVEN_BACK in trial.user_attrs else trial.state.name.lower() for trial in trials)
    print(f"{options.study_name}: {len(trials)} trials " + ", ".join(f"{n} {name}" for name, n in counts.items()))
    for trial in trials:
        if trial.state == TrialState.RUNNING:
            owner = trial.user_attrs.get(OWNER, {"host": "?", "pid": "?"})
            print(f"  trial {trial.number} runs on {owner['host']} as process {owner['pid']}")
    if counts["complete"]:
        print(f"  best: trial {study.best_trial.number}, return {study.best_value:.2f}, {study.best_params}")


def best(options: argparse.Namespace) -> None:
    """Write the best hyperparameters as a config that sb3-bruno train takes as it is."""
    if options.out.suffix not in (".yml", ".yaml"):
        raise Mistake(f"--out {options.out} is no name of a config, which -conf would take: let it end in .yml")
    study = find_study(options)
    if not study.get_trials(deepcopy=False, states=[TrialState.COMPLETE]):
        raise Mistake(f"no trial of {options.study_name} is complete: start workers with sb3-bruno sweep run")
    settings, trial = study.user_attrs[SETTINGS], study.best_trial
    base = settings["config"]
    with told_as_mistake():
        import_packages(settings.get("gym_packages", []))  # which may name the config's encoder
        check_texts(base)
        convert = converter_of(settings["algo"], base)
    drawn = convert({**trial.params, "n_envs": base.get("n_envs", 1)})
    config = {settings["env"]: {**merged(base, drawn), **merged_texts(base, drawn)}}
    made_by = f"# Trial {trial.number} of {len(study.trials)} of {options.study_name}: return {trial.value:.2f} after "
    made_by += f"{settings['n_timesteps']:,} env steps, on training tasks held out.\n"
    try:
        text = made_by + yaml.safe_dump(config, sort_keys=False)
    except yaml.representer.RepresenterError as error:
        raise Mistake(f"--algo {settings['algo']} draws what YAML cannot hold: {error}") from error
    save(text, options)
    train = ["--algo", settings["algo"], *env_flags(settings["env"], settings.get("gym_packages", []))]
    print(text + f"\nSaved {options.out}: {shown_command('train', *train, '-conf', options.out)}")


def merged_texts(base: Mapping[str, Any], drawn: Mapping[str, Any]) -> dict[str, str]:
    """Merge drawn dicts into those that a config has as text, as Python that rl_zoo3 evaluates.

    Example: "dict(activation_fn=nn.ELU)" and {"net_arch": [64]} become
    "{**dict(activation_fn=nn.ELU), **{'net_arch': [64]}}".
    """
    return {
        name: f"{{**{base[name]}, **{value}}}"
        for name, value in drawn.items()
        if isinstance(value, dict) and isinstance(base.get(name), str)
    }


def export(options: argparse.Namespace) -> None:
    """Write every trial as CSV: its state, return, duration and drawn values."""
    study = find_study(options)
    table = study.trials_dataframe(attrs=("number", "state", "value", "duration", "params"))
    save(table.to_csv(index=False), options)
    print(f"Saved {len(study.trials)} trials in {options.out}")


def save(text: str, options: argparse.Namespace) -> None:
    """Write the file ``--out``, and make its folder if there is none.

    Raises:
        Mistake: if it cannot be written, or is the study's own.
    """
    path: Path = options.out
    if is_journal(options.storage) and path.resolve() == Path(options.storage).resolve():
        raise Mistake(f"--out {path} is the --storage, which holds the study: give another")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8", newline="")  # a CSV table has its own line ends
    except OSError as error:
        raise Mistake(f"--out {path} cannot be written, give another: {error.strerror}") from error
