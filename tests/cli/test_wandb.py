"""A run tracked by Weights & Biases, offline, down to what its file holds."""

import json
import math
import os
import struct
import subprocess
import sys

import pytest
from wandb.proto.wandb_internal_pb2 import Record

from sb3_bruno.cli.main import main
from support.tiny_runs import TINY, TINY_ENCODER

BLOCK = 32_768  # bytes, of a LevelDB log, in which wandb keeps its records
FIRST, FULL, LAST = 7, 1, 4  # bytes of wandb's own header; kinds of chunk that end a record
TRACK = ["train", "--env", "PointDir-v0", "-n", "480", "--seed", "1", "--eval-freq", "240", "--eval-episodes", "2"]


def records(path):
    """The records of a .wandb file: chunks of (checksum, length, kind), of which a record may span several."""
    data, place, record = path.read_bytes(), FIRST, b""
    while place + 7 <= len(data):
        if BLOCK - place % BLOCK < 7:  # no chunk begins so late in a block
            place += BLOCK - place % BLOCK
            continue
        length, kind = struct.unpack_from("<HB", data, place + 4)
        record += data[place + 7 : place + 7 + length]
        place += 7 + length
        if kind in (FULL, LAST):
            yield Record.FromString(record)
            record = b""


def test_an_offline_run_holds_what_our_algorithm_logs(tmp_path):
    script = "from sb3_bruno.cli import console; console()"
    command = [sys.executable, "-c", script, *TRACK, "--track", "-params", *TINY, *TINY_ENCODER]
    env = {**os.environ, "WANDB_MODE": "offline", "WANDB_SILENT": "true"}
    subprocess.run(command, cwd=tmp_path, env=env, stdout=subprocess.DEVNULL, check=True)
    (path,) = tmp_path.glob("wandb/offline-run-*/run-*.wandb")
    lines, config = [], {}
    for record in records(path):
        if record.WhichOneof("record_type") == "history":
            items = {item.key or "/".join(item.nested_key): item.value_json for item in record.history.item}
            lines.append({key: json.loads(value) for key, value in items.items()})
        for item in (*record.config.update, *record.run.config.update):
            config[item.key or "/".join(item.nested_key)] = json.loads(item.value_json)
    shown = {key: value for line in lines for key, value in line.items()}
    assert math.isfinite(shown["encoder/bound_nats"]) and shown["belief/var"] > 0
    assert {"eval/mean_reward", "train/actor_loss", "rollout/ep_rew_mean"} <= shown.keys()
    assert [line["global_step"] for line in lines][-1] == 480
    assert config["algo"] == "bruno_sac" and config["env"] == "PointDir-v0"


@pytest.mark.parametrize("missing", ["wandb", "tensorboard"])
def test_what_is_missing_is_told_in_one_line(missing, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(SystemExit, match=rf"--track needs {missing}.*sb3_bruno\[wandb\]") as end:
        main([*TRACK, "--track"])
    assert "\n" not in str(end.value) and not list(tmp_path.iterdir())
