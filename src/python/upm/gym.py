"""Gymnasium environments: a plate moves all its parts at once, without pixels.

`gymnasium.make("upm.gym:upm/Arrange-v0")`, `Sort` and `Stream` alike; `gymnasium.make_vec` steps many plates on all
cores.

- Observation: for each part x and y of its position, then of each target, in halves of the plate's side; then of each
  mean velocity over the last step, in halves of the side a second; as the camera sees them.
  With `render_mode="rgb_array"` there are pictures, too, with a cross at each target, which Gymnasium's
  `AddRenderObservation` makes observations.
- Action, numbers from -1 to 1, by `action`: "motion" are shares of the spans of a synthesised motion's coefficients (x, y
  and spin; for each in turn cos and sin of every harmonic), then its length; "pulse" stands for the number of a rotation
  in the library and its signed distance; "steps" are the wanted steps of all parts, x and y, in sides of the plate, with
  our planner below them, which learns how far each part goes.
- Reward: the decrease of the parts' mean distance from their targets, in halves of the plate's side, plus 1 for success
  (in a stream, for each arrival); -1 for a part that falls off.
"""

import json

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode

from upm._shipped import shipped
from upm._upm import Plates

_BINS = [
    {"kinds": ["penny"], "region_mm": {"min": [-130, -60], "max": [-30, 60]}},
    {"kinds": ["quarter"], "region_mm": {"min": [30, -60], "max": [130, 60]}},
]
_SEEN = (-4.0, 4.0)
# of a cross at a target
_ARM_PX = 10
_TASKS = {
    "arrange": ({"type": "arrange"}, 4, "Move every part to its target."),
    "sort": ({"type": "sort", "bins": _BINS}, 8, "Move every part into the bin of its kind."),
    "stream": ({"type": "stream"}, 8, "Move every part to its target; each that arrives gets a new one."),
}


def _plates(task, number, *, parts=None, action="motion", tolerance_mm=0.5, plate_time_s=60.0, threads=0, **keys):
    """`number` plates of a task. Further keywords are keys of a job file, such as `rig`."""
    asked, usual, _ = _TASKS[task]
    parts = usual if parts is None else parts
    kinds = [{"kind": "penny", "count": parts}]
    if task == "sort":
        kinds = [{"kind": "penny", "count": parts // 2}, {"kind": "quarter", "count": parts - parts // 2}]
    described = {
        "name": task,
        "parts": kinds,
        "task": asked,
        "tolerance_mm": tolerance_mm,
        "limits": {"plate_time_s": plate_time_s},
        "action": action,
        **keys,
    }
    return Plates(json.dumps(described), str(shipped() / "configs"), task, (number, 0, threads))


class _Spaces:
    """Spaces of one plate, and the way between them and the numbers of the compiled half."""

    def __init__(self, plates, action):
        self.least, self.most = plates.action_bounds().T
        self.is_pulse = action == "pulse"
        self.half_side_mm = plates.plate_side_mm / 2
        self.action = spaces.Box(-1, 1, self.least.shape, np.float32)
        # a part that has fallen off is seen beside the plate, and a fast one blurred
        self.observation = spaces.Box(*_SEEN, (6 * plates.parts,), np.float32)

    def native(self, actions):
        """Actions of all plates, one after another."""
        shares = np.clip(np.asarray(actions, np.float64).reshape(-1, len(self.least)), -1, 1)
        actions = self.least + (self.most - self.least) * (shares + 1) / 2
        if self.is_pulse:
            actions[:, 0] = np.round(actions[:, 0])
        return actions.ravel()

    def shares(self, actions):
        """Actions of the space, from those of the compiled half."""
        shares = 2 * (actions - self.least) / (self.most - self.least) - 1
        return np.clip(shares, -1, 1).astype(np.float32)

    def observed(self, observations):
        """Observations of the space."""
        return np.clip(observations / self.half_side_mm, *_SEEN).astype(np.float32)


def _painted(picture, targets_px):
    painted = np.repeat(picture[:, :, None], 3, axis=2)
    for x, y in np.clip(np.rint(targets_px).astype(int), 0, picture.shape[::-1]):
        for dx, dy in ((_ARM_PX, 1), (1, _ARM_PX)):
            painted[max(y - dy, 0) : y + dy + 1, max(x - dx, 0) : x + dx + 1] = (255, 0, 0)
    return painted


class PlateEnv(gymnasium.Env):
    """One plate. Keywords as in the module's text: `task`, `parts`, `action`, `tolerance_mm`, `plate_time_s`, `rig`."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 3}

    def __init__(self, task="arrange", *, action="motion", render_mode=None, **how):
        self.render_mode = render_mode
        self._plates = _plates(task, 1, action=action, threads=1, **how)
        self._spaces = _Spaces(self._plates, action)
        self.action_space, self.observation_space = self._spaces.action, self._spaces.observation
        self.task, self.task_description = task, _TASKS[task][2]

    def reset(self, *, seed=None, options=None):
        """A new plate; equal seeds and actions give equal episodes."""
        super().reset(seed=seed)
        self._plates.reset(seed)
        return self._observation(), {"is_success": False}

    def step(self, action):
        """Plays an action until the parts rest."""
        outcome = self._plates.step(self._spaces.native(action))
        info = {key: outcome[key][0].item() for key in _INFO}
        ends = (bool(outcome[key][0]) for key in ("terminated", "truncated"))
        return self._observation(), float(outcome["reward"][0]), *ends, info

    def expert(self, obs=None):
        """Our planner's action in the present state, which it knows better than `obs`."""
        return self._spaces.shares(self._plates.expert()[0])

    def render(self):
        """The camera's picture, a red cross at each target: (height, width, 3), uint8, with `render_mode="rgb_array"`."""
        return _painted(*self._plates.picture(0)) if self.render_mode else None

    def journal_hash(self):
        """Hash of seed, actions and true places since the last seed was given."""
        return self._plates.journal_hashes()[0]

    def _observation(self):
        return self._spaces.observed(self._plates.observe()[0])


class PlateVectorEnv(gymnasium.vector.VectorEnv):
    """Many plates, stepped on all cores that the process may use; the step after an end begins a new episode.

    Plate i of seed s is the plate of seed s + i, whatever the number of plates and threads.
    """

    metadata = PlateEnv.metadata | {"autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(self, num_envs=1, task="arrange", *, action="motion", render_mode=None, **how):
        self.num_envs, self.render_mode = num_envs, render_mode
        self._plates = _plates(task, num_envs, action=action, **how)
        self._spaces = _Spaces(self._plates, action)
        self.single_action_space, self.single_observation_space = self._spaces.action, self._spaces.observation
        self.action_space = gymnasium.vector.utils.batch_space(self.single_action_space, num_envs)
        self.observation_space = gymnasium.vector.utils.batch_space(self.single_observation_space, num_envs)

    def reset(self, *, seed=None, options=None):
        """New plates, with the seeds from `seed` on."""
        super().reset(seed=seed)
        self._plates.reset(seed)
        return self._observation(), {}

    def step(self, actions):
        """Plays an action on every plate."""
        outcome = self._plates.step(self._spaces.native(actions))
        ends = (outcome[key] for key in ("terminated", "truncated"))
        return self._observation(), outcome["reward"], *ends, {key: outcome[key] for key in _INFO}

    def expert(self, obs=None):
        """Our planner's actions, a row for each plate."""
        return self._spaces.shares(self._plates.expert())

    def render(self):
        """The picture of each plate, as that of a plate alone."""
        return tuple(_painted(*self._plates.picture(i)) for i in range(self.num_envs)) if self.render_mode else None

    def journal_hashes(self):
        """Hash of each plate's seeds, actions and true places."""
        return self._plates.journal_hashes()

    def _observation(self):
        return self._spaces.observed(self._plates.observe())


_INFO = ("is_success", "collisions", "arrived", "mean_distance_mm", "plate_time_s")


def register_envs():
    """Registers `upm/Arrange-v0`, `upm/Sort-v0` and `upm/Stream-v0`, once."""
    for task in _TASKS:
        name = f"upm/{task.capitalize()}-v0"
        if name not in gymnasium.registry:
            kinds = {"entry_point": f"{__name__}:PlateEnv", "vector_entry_point": f"{__name__}:PlateVectorEnv"}
            gymnasium.register(name, **kinds, kwargs={"task": task})


register_envs()
