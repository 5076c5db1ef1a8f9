"""What is shared calls an absolute path by its last part, wherever in a run's settings or command it stands."""

import json
from collections import OrderedDict

import pytest
import torch as th
import yaml

from sb3_bruno.zoo.portable import copy_origin, copy_settings, without_places
from sb3_bruno.zoo.saved_yaml import read_saved

TEXTS = {
    "/home/me/logs": "logs",
    "/home/me/logs/": "logs",
    "/home/me/my logs": "my logs",
    "//home/me/logs": "logs",
    "~/logs": "logs",
    "~me/logs": "logs",
    r"C:\Users\me\logs": "logs",
    r"c:\Users\me\logs": "logs",
    "C:/Users/me/logs": "logs",
    r"\\server\me\logs": "logs",
    "--storage=/home/me/x.db": "--storage=x.db",
    "--storage=sqlite:////home/me/x.db": "--storage=sqlite:///x.db",
    "--storage=sqlite:///me/x.db": "--storage=sqlite:///x.db",
    "file:///home/me/robot.xml": "file://robot.xml",
    "file://localhost/home/me/robot.xml": "file://robot.xml",
    "-f/home/me/logs": "-flogs",
    "a:/home/me/x": "a:x",
    "xml_file:'/home/me/robot.xml'": "xml_file:'robot.xml'",
    'xml_file:"/home/me/my robots/robot.xml"': 'xml_file:"robot.xml"',
    r"xml_file:'C:\\Users\\me\\robot.xml'": "xml_file:'robot.xml'",
    "env_kwargs:{'xml_file': '/home/me/a.xml', 'n': 3}": "env_kwargs:{'xml_file': 'a.xml', 'n': 3}",
    "env_kwargs:dict(a='/home/me/a.xml',b=['/b/c','~/d'])": "env_kwargs:dict(a='a.xml',b=['c','d'])",
    "python /home/me/train.py -f /home/me/logs": "python train.py -f logs",
    "at /home/me/a /home/me/b": "at a b",
}
LEFT_ALONE = [
    *("", "/", "~", "logs/mine", "./logs", "../logs", "learning_rate:1e-3", "lin_7e-4", "a / b", "and/or", "-0.5/2"),
    *("https://hub.example/me/agent", "postgresql://db.example:5432/sweep", "my_envs:Mine-v0", "C:", "1:2"),
]


@pytest.mark.parametrize("said", TEXTS)
def test_an_absolute_path_is_called_by_its_last_part(said):
    assert without_places(said) == TEXTS[said]


@pytest.mark.parametrize("said", LEFT_ALONE)
def test_what_is_none_is_left_alone(said):
    assert without_places(said) == said


@pytest.mark.parametrize(
    ("held", "named"),
    [
        (3, 3),
        (None, None),
        (["a", "/b/c"], ["a", "c"]),
        (("a", ["/b/c"]), ("a", ["c"])),
        ({"/b/c", "d"}, {"c", "d"}),
        ({"a": {"b": ("/c/d", 1)}}, {"a": {"b": ("d", 1)}}),
        ({"/a/b": 1}, {"b": 1}),
    ],
)
def test_it_may_stand_in_anything(held, named):
    assert without_places(held) == named


def test_settings_keep_what_is_no_path(tmp_path):
    robot = "/home/me/secret/robot.xml"
    settings = OrderedDict(
        env_kwargs={"xml_file": robot, "sizes": (1, 2)},
        hyperparams=OrderedDict(env_kwargs={"xml_file": robot}, policy_kwargs={"activation_fn": th.nn.ReLU}),
        env_wrapper=[{"my.Wrapper": {"table": robot}}],
        log_folder="/home/me/logs",
    )
    (tmp_path / "config.yml").write_text(yaml.dump(settings))
    copy_settings(tmp_path / "config.yml", tmp_path / "shared.yml")
    assert (tmp_path / "shared.yml").read_text() == (
        (tmp_path / "config.yml").read_text().replace("/home/me/secret/", "").replace("/home/me/", "")
    )
    assert read_saved(tmp_path / "shared.yml")["env_kwargs"] == {"xml_file": "robot.xml", "sizes": (1, 2)}


def test_an_origin_keeps_its_command_and_versions(tmp_path):
    command = [
        "--env-kwargs",
        "xml_file:'/home/me/secret/robot.xml'",
        "-f",
        "/home/me/logs",
        "--conf-file=/home/me/c.yml",
    ]
    origin = {"command": command, "versions": [{"torch": "2.9", "sb3_bruno": "/home/me/sb3_bruno"}]}
    (tmp_path / "sb3_bruno_origin.json").write_text(json.dumps(origin))
    copy_origin(tmp_path / "sb3_bruno_origin.json", tmp_path / "shared.json")
    assert json.loads((tmp_path / "shared.json").read_text()) == {
        "command": ["--env-kwargs", "xml_file:'robot.xml'", "-f", "logs", "--conf-file=c.yml"],
        "versions": [{"torch": "2.9", "sb3_bruno": "sb3_bruno"}],
    }
