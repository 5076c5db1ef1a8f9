"""Scalars that become numbers when the logger is dumped."""

import csv

import torch as th
from stable_baselines3.common.logger import CSVOutputFormat, Logger, TensorBoardOutputFormat
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from sb3_bruno.algorithms.late_log import log_late


def test_outputs_get_numbers_whoever_dumps(tmp_path):
    path = tmp_path / "progress.csv"
    logger = Logger(None, [CSVOutputFormat(str(path)), TensorBoardOutputFormat(str(tmp_path))])
    weight = th.tensor(0.5, requires_grad=True)
    for step in (1, 2):
        logger.record("plain", step)
        log_late(logger, {"late/twice": 2 * weight * step, "late/once": weight})
        assert logger.name_to_value["late/twice"].shape == () and not logger.name_to_value["late/twice"].requires_grad
        logger.dump(step)
    logger.record("plain", 3)
    logger.dump(3)  # nothing late this time
    logger.close()
    rows = list(csv.DictReader(path.open()))
    assert [(row["plain"], row["late/twice"], row["late/once"]) for row in rows] == [
        ("1", "1.0", "0.5"),
        ("2", "2.0", "0.5"),
        ("3", "", ""),
    ]
    events = EventAccumulator(str(tmp_path)).Reload()
    assert [event.value for event in events.Scalars("late/twice")] == [1, 2]


def test_what_others_record_is_left_alone():
    logger = Logger(None, [])
    histogram, scalar = th.zeros(3), th.ones(())
    logger.record("theirs", histogram)
    logger.record("their scalar", scalar)
    log_late(logger, {"ours": th.ones(())})
    values = logger.name_to_value
    logger.output_formats[0].write(values, {})
    assert values["theirs"] is histogram and values["their scalar"] is scalar
    assert values["ours"] == 1 and isinstance(values["ours"], float)
