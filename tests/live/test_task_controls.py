"""Buttons and sliders change the task, show one that was changed elsewhere, and never fight a visitor's hand."""

from contextlib import nullcontext
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.spaces import Box

import sb3_bruno_envs
from sb3_bruno.live.task_controls import add_task_controls
from sb3_bruno_envs import MetaTask, PointDirEnv

VISITOR, NOBODY = SimpleNamespace(client="a visitor"), SimpleNamespace(client=None)


class Control(SimpleNamespace):
    """A button or slider, which a visitor may use."""

    def on_click(self, call):
        self.call = call

    on_update = on_click

    def drag(self, value):
        self.value = value
        self.call(VISITOR)


class Gui:
    """Keeps the controls that are added, by their labels."""

    def __init__(self):
        self.controls = {}

    def add_folder(self, label):
        return nullcontext()

    def add_button(self, label, color=None):
        return self.controls.setdefault(label, Control(color=color))

    def add_slider(self, label, low, high, step, value):
        return self.controls.setdefault(label, Control(min=low, max=high, step=step, value=value))


class Session:
    """Keeps the task, and refuses one whose first number is above 2.9."""

    def __init__(self, env):
        assert sb3_bruno_envs
        self.env = gym.make(env) if isinstance(env, str) else env
        self.task = np.asarray(self.env.reset(seed=0)[1]["task"])

    def set_task(self, task):
        if task[0] > 2.9:
            raise ValueError("too fast")
        self.task = np.asarray(task, dtype=np.float32)

    def draw_task(self):
        self.task = np.array([1.5], dtype=np.float32)


@pytest.fixture
def page():
    """Make the controls of an environment; what they ask for waits in a list."""

    def make(env):
        gui, session, asked = Gui(), Session(env), []
        return gui.controls, session, asked, add_task_controls(gui, session, asked.append)

    return make


def test_a_button_sets_its_task_and_is_coloured(page):
    controls, session, asked, show = page("PointDir-v0")
    assert list(controls) == ["left", "right"]
    controls["left"].call(VISITOR)
    asked.pop()()
    show(session.task)
    assert session.task.tolist() == [-1.0, 0.0]
    assert [control.color for control in controls.values()] == ["blue", "gray"]


@pytest.mark.mujoco
def test_a_slider_sets_its_number_and_shows_a_task_that_was_set_elsewhere(page):
    controls, session, asked, show = page("CheetahVel-v0")
    slider = controls["velocity (m/s)"]
    slider.drag(2.5)
    asked.pop()()
    assert session.task.tolist() == [2.5]
    controls["Draw a test task"].call(VISITOR)
    asked.pop()()
    show(session.task)
    assert slider.value == 1.5
    slider.call(NOBODY)  # as viser does where the page moves it
    assert asked == []


@pytest.mark.mujoco
def test_a_slider_stays_in_the_visitors_hand_until_it_is_obeyed(page):
    controls, session, asked, show = page("CheetahVel-v0")
    slider = controls["velocity (m/s)"]
    slider.drag(2.0)
    slider.drag(2.2)
    asked.pop(0)()
    show(session.task)
    assert session.task.tolist() == [2.0] and slider.value == 2.2
    asked.pop()()
    show(session.task)
    assert slider.value == 2.2 == pytest.approx(session.task[0])


@pytest.mark.mujoco
def test_a_slider_goes_back_where_the_task_is_refused(page):
    controls, session, asked, show = page("CheetahVel-v0")
    slider = controls["velocity (m/s)"]
    slider.drag(1.0)
    asked.pop()()
    slider.drag(2.95)
    with pytest.raises(ValueError, match="too fast"):
        asked.pop()()
    show(session.task)
    assert slider.value == 1.0


@pytest.mark.mujoco
@pytest.mark.parametrize(("typed", "counts"), [(0.0, 0.01), (-7.0, 0.01), (9.0, 2.9)])
def test_a_number_that_is_typed_counts_up_to_the_bounds(page, typed, counts):
    controls, session, asked, _ = page("CheetahVel-v0")
    controls["velocity (m/s)"].max = 2.9
    controls["velocity (m/s)"].drag(typed)
    asked.pop()()
    assert session.task[0] == pytest.approx(counts, abs=0.01)


@pytest.mark.mujoco
def test_a_direction_is_dragged_round(page):
    controls, session, asked, show = page("AntDir2D-v0")
    slider = controls["Direction (degrees)"]
    slider.drag(90.0)
    asked.pop()()
    np.testing.assert_allclose(session.task, [0.0, 1.0], atol=1e-6)
    show(np.array([-1.0, 0.0]))
    assert slider.value == 180.0


def test_sliders_have_round_steps_and_bounds(page):
    controls, *_ = page("CartpoleSwingUp-v0")
    cart, pole = controls["cart (kg)"], controls["pole (m)"]
    assert (cart.min, cart.max, cart.step) == (0.5, 2.5, 0.01)
    assert (pole.min, pole.max, pole.step) == (0.25, 0.75, 0.001)


def test_a_number_that_is_the_same_in_all_tasks_has_no_slider(page):
    tasks = np.stack([np.linspace(0.5, 2.0, 12), np.full(12, 0.35), np.linspace(-1.0, 0.0, 12)], axis=1)
    env = MetaTask(PointDirEnv(), lambda env, task: None, tasks, task_entries=[("a", ""), ("b", ""), ("c", "")])
    controls, session, asked, show = page(env)
    assert list(controls) == ["a", "c", "Draw a test task"]
    controls["c"].drag(-0.25)
    asked.pop()()
    np.testing.assert_allclose(session.task, [controls["a"].value, 0.35, -0.25])
    show(np.array([1.5, 0.35, -0.5]))
    assert (controls["a"].value, controls["c"].value) == (1.5, -0.5)


class Own(gym.Env):
    """Draws its hidden task itself."""

    observation_space = action_space = Box(-1.0, 1.0, (1,))

    def __init__(self, high):
        self.task_space = Box(0.0, high, (1,))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return np.zeros(1, np.float32), {"task": self.np_random.uniform(0.0, 2.0, 1)}


@pytest.mark.parametrize(("high", "labels"), [(2.0, ["task[0]"]), (np.inf, [])])
def test_what_draws_its_task_itself_has_no_button_for_it(page, high, labels):
    controls, *_ = page(Own(high))
    assert list(controls) == labels


def test_what_has_no_task_has_no_controls():
    session = SimpleNamespace(env=gym.make("Pendulum-v1"), task=None)
    gui = Gui()
    add_task_controls(gui, session, [].append)(np.zeros(1))
    assert gui.controls == {}
