"""A training prints few tables, and logs as much as before."""

import sys

import pandas as pd
import pytest
from stable_baselines3.common.logger import CSVOutputFormat, HumanOutputFormat, Logger

from sb3_bruno.zoo.seldom import SeldomTables


class Model:
    """What the callback needs of a model."""

    num_timesteps = 0

    def __init__(self, logger):
        self.logger = logger

    def get_env(self):
        return None


@pytest.mark.parametrize(("n_timesteps", "steps"), [(1_200, [0, 2_000, 4_000]), (30_000, [0, 3_200])])
def test_stdout_gets_a_table_per_tenth_of_the_run_and_files_get_all(tmp_path, capsys, n_timesteps, steps):
    table, csv = HumanOutputFormat(sys.stdout), CSVOutputFormat(str(tmp_path / "log.csv"))
    logger = Logger(None, [table, csv])
    callback = SeldomTables(n_timesteps)
    callback.init_callback(Model(logger))
    callback.on_training_start({}, {})
    for step in range(0, 6_000, 400):
        logger.record("env/step", step)
        logger.dump(step)
    logger.close()
    printed = [int(line.split("|")[2]) for line in capsys.readouterr().out.splitlines() if "step " in line]
    assert printed == steps
    assert pd.read_csv(tmp_path / "log.csv")["env/step"].tolist() == list(range(0, 6_000, 400))


def test_a_log_file_that_is_no_stdout_gets_all(tmp_path):
    logger = Logger(None, [HumanOutputFormat(str(tmp_path / "log.txt"))])
    callback = SeldomTables(1_200)
    callback.init_callback(Model(logger))
    callback.on_training_start({}, {})
    for step in range(3):
        logger.record("env/step", step)
        logger.dump(step)
    logger.close()
    assert (tmp_path / "log.txt").read_text().count("step") == 3
