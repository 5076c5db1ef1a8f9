"""Agent files that somebody has tampered with, by what is wrong with them: each is made from a good one."""

import copy
import json
import math
import pickle
import stat
import struct
import zipfile

import safetensors.torch
import torch as th

from sb3_bruno.export.archive import AGENT, SUMS, TENSORS
from support.agent_zips import (
    Bomb,
    bomb,
    drop,
    fill,
    first_weight,
    header,
    info,
    members_of,
    patched,
    put,
    renamed,
    replace_first,
    saved_by_torch,
    stuffed,
    with_info,
    with_json,
    with_local_extra,
    with_tensors,
    with_zip64,
    zipped,
)

MOST_MEMORY = 100 * 2**20  # bytes
MANY = 10**12
FOR_A_TERMINAL = "\x1b]0;owned\x07\n" * 1_000
"""A name that would set a terminal's title, and fill it."""
LARGE = {"kind": "Box", "low": 0, "high": 1, "shape": [100_000], "dtype": "float64"}
SPACES = ("observation_space", "spaces", "observation")
NESTED = "[" * 100_000 + "]" * 100_000
ARCHIVES = {
    "empty": lambda good: b"",
    "text": lambda good: b"this is no agent",
    "pickle": lambda good: pickle.dumps(Bomb()),
    "pickle of torch": lambda good: saved_by_torch(),
    "cut in half": lambda good: good[: len(good) // 2],
    "without its last byte": lambda good: good[:-1],
    "with something behind": lambda good: good + b"PK",
    "with something before": lambda good: b"#!/bin/sh\n" + good,
    "with something before, told right": lambda good: stuffed(good, 0),
    "with something between": lambda good: stuffed(good, 1),
    "with something before the table": lambda good: stuffed(good, 3),
    "with something that the table does not tell": with_local_extra,
    "one bit flipped": lambda good: good[:300] + bytes([good[300] ^ 1]) + good[301:],
    "a bit of a tensor flipped": lambda good: good[:-500] + bytes([good[-500] ^ 1]) + good[-499:],
    "a huge comment": lambda good: good[:-2] + struct.pack("<H", 65_535) + b"x" * 65_535,
    "told by zip64": with_zip64,
    "no members": lambda good: zipped({}),
    "a member missing": lambda good: zipped({name: data for name, data in members_of(good).items() if name != SUMS}),
    "a further member": lambda good: zipped({**members_of(good), "more.txt": b"more"}),
    "many members": lambda good: zipped({**members_of(good), **{f"{number}": b"" for number in range(10_000)}}),
    "a pickle beside": lambda good: zipped({**members_of(good), "data.pkl": pickle.dumps(Bomb())}),
    "a member twice": lambda good: zipped([*members_of(good).items(), (AGENT, b"{}")]),
    "a member twice in place of another": lambda good: zipped(
        [(AGENT, members_of(good)[AGENT]), (AGENT, b"{}"), (SUMS, members_of(good)[SUMS])]
    ),
    "a path upwards": lambda good: renamed(good, AGENT, "../agent.json"),
    "an absolute path": lambda good: renamed(good, AGENT, "/tmp/agent.json"),
    "a path of Windows": lambda good: renamed(good, AGENT, "..\\agent.json"),
    "a name with a null": lambda good: good.replace(AGENT.encode(), b"agent.jso\0"),
    "a folder as a member": lambda good: renamed(good, AGENT, "agent.json/"),
    "a symbolic link": lambda good: with_info(good, AGENT, info(AGENT, stat.S_IFLNK | 0o777)),
    "a device": lambda good: with_info(good, AGENT, info(AGENT, stat.S_IFCHR | 0o777)),
    "encrypted": lambda good: patched(good, 8, b"\x01\x00"),
    "a member with a comment": lambda good: with_info(good, AGENT, info(AGENT, comment=b"x" * 100)),
    "a member with more": lambda good: with_info(good, AGENT, info(AGENT, extra=struct.pack("<2H", 0xCAFE, 0))),
    "compressed": lambda good: zipped(members_of(good), zipfile.ZIP_DEFLATED),
    "a bomb": lambda good: bomb(good),
    "a size that is not there": lambda good: patched(good, 20, struct.pack("<2L", 2**31, 2**31)),
    "two sizes that differ": lambda good: patched(good, 24, struct.pack("<L", 2**31)),
    "a place that is not there": lambda good: patched(good, 42, struct.pack("<L", 2**31)),
    "wrong checksums": lambda good: zipped({**members_of(good), SUMS: members_of(good)[SUMS].replace(b"a", b"b")}),
    "no checksums": lambda good: zipped({**members_of(good), SUMS: b""}),
    "another's tensors": lambda good: zipped({**members_of(good), TENSORS: header({})}),
}
JSONS = {
    "empty": lambda plain: "",
    "no UTF-8": lambda plain: b"\xff\xfe",
    "a list": lambda plain: "[]",
    "a number": lambda plain: "1",
    "deeply nested": lambda plain: NESTED,
    "deep arguments": lambda plain: json.dumps(plain).replace('"gamma": 0.99', f'"gamma": {NESTED[50_000:-50_000]}'),
    "NaN": put("arguments", "gamma", value=math.nan),
    "infinity": put("arguments", "gamma", value=math.inf),
    "too large a float": lambda plain: json.dumps(plain).replace('"gamma": 0.99', '"gamma": 1e999'),
    "too many digits": lambda plain: json.dumps(plain).replace('"gamma": 0.99', f'"gamma": {"9" * 100_000}'),
    "too large a whole number": put("num_timesteps", value=10**400),
    "a key twice": lambda plain: json.dumps(plain)[:-1] + ', "version": 1}',
    "a newer version": put("version", value=2),
    "a version that is text": put("version", value="1"),
    "a version that is true": put("version", value=True),
    "a version of 0": put("version", value=0),
    "no version": drop("version"),
    "another format": put("format", value="sb3"),
    "a key too few": drop("task_space"),
    "a key too many": put("command", value="rm"),
    "an unknown algorithm": put("algorithm", value="OwnSAC"),
    "an algorithm by its module": put("algorithm", value="sb3_bruno.algorithms.sac.PearlSAC"),
    "an algorithm of the system": put("algorithm", value="os.system"),
    "an algorithm that is no text": put("algorithm", value=["PearlSAC"]),
    "an algorithm of another kind": put("algorithm", value="BrunoTD3"),
    "a policy that is no text": put("policy", value={}),
    "a policy of another kind": put("policy", value="TaskTD3Policy"),
    "an encoder by its module": put("arguments", "encoder_class", value={"$encoder": "os.path"}),
    "an encoder of another kind": put("arguments", "encoder_class", value={"$encoder": "bruno"}),
    "an encoder that is none": put("arguments", "encoder_class", value={"$module": "ReLU"}),
    "an encoder that is text of a module": put("arguments", "encoder_class", value="os.system"),
    "an unknown tag": put("arguments", "gamma", value={"$import": "os"}),
    "a tag of an algorithm": put("arguments", "gamma", value={"$algorithm": "PearlSAC"}),
    "two tags": put("arguments", "gamma", value={"$float": "inf", "$tuple": []}),
    "a tag with a list": put("arguments", "gamma", value={"$module": ["ReLU"]}),
    "an object that is unknown": put("arguments", "gamma", value={"$object": "Popen", "args": "ls"}),
    "an object with other parts": put("arguments", "learning_rate", value={"$object": "ConstantSchedule", "x": 1}),
    "a schedule of text": put("arguments", "learning_rate", value={"$object": "ConstantSchedule", "val": "fast"}),
    "a huge array": put("arguments", "gamma", value={"$array": [0], "dtype": "float64", "shape": [MANY]}),
    "a schedule of nothing": put(
        "arguments", "learning_rate", value={"$object": "LinearSchedule", "start": None, "end": 0, "end_fraction": 1}
    ),
    "an array of objects": put("arguments", "gamma", value={"$array": [0], "dtype": "object", "shape": [1]}),
    "arguments that are a list": put("arguments", value=[]),
    "an unknown argument": put("arguments", "env", value="PointDir-v0"),
    "a folder to log in": put("arguments", "tensorboard_log", value="/tmp"),
    "a seed among the arguments": put("arguments", "seed", value=0),
    "no encoder_kwargs": drop("arguments", "encoder_kwargs"),
    "a buffer_size of 0": put("arguments", "buffer_size", value=0),
    "noise of text": put("arguments", "action_noise", value={"$object": "NormalActionNoise", "mean": "x", "sigma": 1}),
    "no buffer_size": drop("arguments", "buffer_size"),
    "a buffer_size that is true": put("arguments", "buffer_size", value=True),
    "text in place of a number": put("arguments", "gamma", value="0.99"),
    "true in place of a whole number": put("arguments", "batch_size", value=True),
    "a negative size of a layer": put("arguments", "policy_kwargs", "net_arch", value=[-16]),
    "text as a size": put("arguments", "encoder_kwargs", "net_arch", value=["16"]),
    "true as a size": put("arguments", "encoder_kwargs", "net_arch", value=[True]),
    "another layer": put("arguments", "policy_kwargs", "net_arch", value=[16, 16]),
    "a huge layer": put("arguments", "policy_kwargs", "net_arch", value=[MANY]),
    "two large layers": put("arguments", "policy_kwargs", "net_arch", value=[900_000, 900_000]),
    "large layers of an encoder": put("arguments", "encoder_kwargs", "net_arch", value=[900_000, 900_000]),
    "very many layers": put("arguments", "policy_kwargs", "net_arch", value=[1] * 100_000),
    "a layer that is wider than any": put("arguments", "policy_kwargs", "net_arch", value=[5_000]),
    "a polynomial of a flow": put("arguments", "encoder_kwargs", "flow_kwargs", value={"degree": 2_000}),
    "very many critics": put("arguments", "policy_kwargs", "n_critics", value=1_000_000),
    "a large latent": put("arguments", "encoder_kwargs", "latent_dim", value=1_000_000),
    "an unknown argument of the policy": put("arguments", "policy_kwargs", "command", value="rm"),
    "a large threshold as text": put("arguments", "policy_kwargs", "forget_threshold", value="5"),
    "insane dimensions": put(*SPACES, "shape", value=[MANY]),
    "large dimensions": put(*SPACES, "shape", value=[100_000]),
    "very many dimensions": put(*SPACES, "shape", value=[1] * 100_000),
    "no numbers, but huge": put(*SPACES, "shape", value=[0, MANY]),
    "negative dimensions": put(*SPACES, "shape", value=[-2]),
    "dimensions that are text": put(*SPACES, "shape", value=["2"]),
    "dimensions that are true": put("task_space", "shape", value=[True, True]),
    "dimensions that are no list": put(*SPACES, "shape", value=2),
    "bounds of another shape": put(*SPACES, "low", value=[0.0, 0.0, 0.0]),
    "bounds that are text": put(*SPACES, "low", value="low"),
    "bounds that are true": put(*SPACES, "low", value=True),
    "bounds upside down": put("action_space", "low", value=3.0),
    "endless actions": put("action_space", "high", value={"$float": "inf"}),
    "a space of objects": put(*SPACES, "dtype", value="object"),
    "a space of another kind": put("action_space", value={"kind": "Discrete", "n": 2}),
    "a space that is a number": put("task_space", value=3),
    "many large spaces": put(
        "observation_space",
        value={"kind": "Dict", "spaces": {f"k{i}": dict(LARGE) for i in range(90)}},
    ),
    "a Dict of many spaces": put(
        "observation_space",
        value={"kind": "Dict", "spaces": {f"k{i}": {**LARGE, "shape": [1]} for i in range(9_000)}},
    ),
    "an observation that is no Dict": lambda plain: put("observation_space", value=plain["action_space"])(plain),
    "a Dict in a Dict": lambda plain: put(*SPACES, value=copy.deepcopy(plain["observation_space"]))(plain),
    "a key of the observation missing": drop("observation_space", "spaces", "reward"),
    "negative env steps": put("num_timesteps", value=-1),
    "env steps that are text": put("num_timesteps", value="1"),
    "a seed that is text": put("seed", value="1"),
    **{
        f"a name for a terminal {'.'.join(place) or 'at the top'}": put(*place, FOR_A_TERMINAL, value=1)
        for place in (
            (),
            ("arguments",),
            ("arguments", "policy_kwargs"),
            ("arguments", "encoder_kwargs"),
            ("arguments", "replay_buffer_kwargs"),
            ("observation_space", "spaces"),
            ("normalization",),
            ("normalization", "counts"),
        )
    },
    **{
        f"a value for a terminal {'.'.join(place)}": put(*place, value=FOR_A_TERMINAL)
        for place in (
            ("algorithm",),
            ("policy",),
            ("arguments", "critic_input"),
            ("arguments", "encoder_class"),
            ("arguments", "ent_coef"),
            ("arguments", "policy_kwargs", "activation_fn"),
            ("action_space", "dtype"),
            ("readout", "called_tasks"),
        )
    },
    "half a read-out": drop("readout", "tasks"),
    "a read-out that is text": put("readout", value="all"),
    "another read-out": put("readout", value=None),
    "very many tasks": put("readout", "tasks", value=[[0.0, 0.0]] * 1_000),
    "tasks of another size": put("readout", "tasks", value=[[0.0], [1.0]]),
    "tasks that are text": put("readout", "tasks", value=[["0", "0"], ["1", "1"]]),
    "tasks that are true": put("readout", "tasks", value=[[True, True], [True, False]]),
    "tasks in another order than their names": lambda plain: plain["readout"]["tasks"].reverse(),
    "a task twice": put("readout", "tasks", value=[[1.0, 0.0], [1.0, 0.0]]),
    "huge tasks": put("readout", "tasks", value=[[1e300, 0.0], [0.0, 1e300]]),
    "a name for a terminal": put("readout", "called_tasks", value=["\x1b]0;owned\x07", "left"]),
    "a name too few": put("readout", "called_tasks", value=["left"]),
    "names that are a number": put("readout", "called_units", value=3),
    "no normalisation": put("normalization", value=None),
    "half a normalisation": drop("normalization", "epsilon"),
    "an epsilon of 0": put("normalization", "epsilon", value=0.0),
    "an epsilon that is text": put("normalization", "epsilon", value="small"),
    "a flag that is 1": put("normalization", "norm_obs", value=1),
    "a key that is no text": put("normalization", "norm_obs_keys", value=[["action"]]),
    "keys that are not there": put("normalization", "norm_obs_keys", value=["image"]),
    "a clip of a huge number": put("normalization", "clip_obs", value=10**400),
    "a clip of nothing": put("normalization", "clip_obs", value=0.0),
    "an endless epsilon": put("normalization", "epsilon", value={"$float": "inf"}),
    "endless counts": put("normalization", "counts", "returns", value={"$float": "inf"}),
    "counts below 0": put("normalization", "counts", "returns", value=-1.0),
}
TENSOR_FILES = {
    "a pickle": lambda tensors: pickle.dumps(Bomb()),
    "a pickle of torch": lambda tensors: saved_by_torch(),
    "empty": lambda tensors: b"",
    "a header that is too long": lambda tensors: struct.pack("<Q", 2**63) + b"{}",
    "a header that is longer than the file": lambda tensors: struct.pack("<Q", MOST_MEMORY) + b"{}",
    "a header that is no JSON": lambda tensors: header(b"{" * 100),
    "a header deeply nested": lambda tensors: header(NESTED.encode()),
    "a huge shape": lambda tensors: header({"a": {"dtype": "F32", "shape": [MANY], "data_offsets": [0, 4 * MANY]}}),
    "a shape that overflows": lambda tensors: header(
        {"a": {"dtype": "F32", "shape": [2**62, 4], "data_offsets": [0, 0]}}
    ),
    "a shape that is negative": lambda tensors: header({"a": {"dtype": "F32", "shape": [-1], "data_offsets": [0, 0]}}),
    "offsets upside down": lambda tensors: header(
        {"a": {"dtype": "F32", "shape": [1], "data_offsets": [4, 0]}}, b"0000"
    ),
    "data that nobody names": lambda tensors: safetensors.torch.save(tensors) + b"more",
    "an unknown type": lambda tensors: header({"a": {"dtype": "O", "shape": [1], "data_offsets": [0, 4]}}, b"0000"),
    "NaN": lambda tensors: fill(first_weight(tensors), math.nan)(tensors),
    "infinity": lambda tensors: fill(first_weight(tensors), -math.inf)(tensors),
    "NaN in the normalisation": fill("normalization.observations.reward.mean", math.nan),
    "infinity in the normalisation": fill("normalization.returns.var", math.inf),
    "a huge mean": fill("normalization.observations.reward.mean", 1e200),
    "a negative variance": fill("normalization.observations.reward.var", -1.0),
    "a mean of another shape": lambda tensors: tensors.update(
        {"normalization.returns.mean": th.zeros(3, dtype=th.float64)}
    ),
    "no mean": lambda tensors: tensors.pop("normalization.returns.mean"),
    "a tensor missing": lambda tensors: tensors.pop(first_weight(tensors)),
    "a further tensor": lambda tensors: tensors.update({"policy.more": th.zeros(1)}),
    "no tensors": lambda tensors: tensors.clear(),
    "many tensors": lambda tensors: header(
        {f"{number}": {"dtype": "F32", "shape": [0], "data_offsets": [0, 0]} for number in range(10_000)}
    ),
    "very many tensors": lambda tensors: header(
        {f"{number}": {"dtype": "F32", "shape": [0], "data_offsets": [0, 0]} for number in range(100_000)}
    ),
    "a name for a terminal": lambda tensors: tensors.update({FOR_A_TERMINAL: th.zeros(1)}),
    "a name for a terminal of what is not finite": lambda tensors: tensors.update(
        {FOR_A_TERMINAL: th.tensor([math.nan])}
    ),
    "another name": lambda tensors: tensors.update({"../policy": tensors.pop(first_weight(tensors))}),
    "another type": replace_first(lambda tensor: tensor.double()),
    "whole numbers": replace_first(lambda tensor: tensor.long()),
    "another shape": replace_first(lambda tensor: tensor.T.contiguous()),
    "one number for all": replace_first(lambda tensor: tensor.flatten()[0].clone()),
    "one layer more": replace_first(lambda tensor: th.cat([tensor, tensor])),
}
FILES = {
    **{f"archive: {name}": make for name, make in ARCHIVES.items()},
    **{f"json: {name}": lambda good, change=change: with_json(good, change) for name, change in JSONS.items()},
    **{
        f"tensors: {name}": lambda good, change=change: with_tensors(good, change)
        for name, change in TENSOR_FILES.items()
    },
}
