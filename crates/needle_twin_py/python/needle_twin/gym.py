"""An environment for controllers: steer a needle to a target that the needle itself pushes away.

    import gymnasium, needle_twin.gym
    env = gymnasium.make("needle_twin/NeedleInsertion-v0")

One step is one control period. The tissue is the twin's, with all of its time stepping; nothing is random but the place of the target,
which `reset(seed=...)` draws.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from ._needle_twin import Diverged, PoseRefused, Scene, Twin

__all__ = ["NeedleInsertion"]


class NeedleInsertion(gymnasium.Env):
    """Insert a needle until its tip is at a point of the tissue.

    Action, shape (2,), each from -1 to 1: velocity along the axis (1: `max_speed_m_per_s` into the sample) and sideways along x (only with
    `lateral=True`, else ignored; it takes the model to three dimensions).

    Observation, a dict: `depth_m` (1,), `lateral_m` (1,), `force_n` (3,) in frame `sample`, `target_m` (3,): the present position of the point that is to be
    reached, minus the tip's.

    Reward: how much nearer the tip came, in mm, less `force_weight` times the force's size in N. An episode ends where the tip is within
    `tolerance_m` of the target, and is cut off after `max_steps` or where the twin refuses to go on (info["halt"] says why).

    Targets lie between `target_depth_m` on the needle's path, and with `lateral=True` up to `target_offset_m` to its side along x, where the needle
    can go. `target_offset_m` without `lateral=True` must be within the tolerance: no action would reach more.
    """

    metadata: dict[str, Any] = {"render_modes": []}

    def __init__(
        self,
        scene: Scene | str = "needle_insertion",
        *,
        target_depth_m: tuple[float, float] = (3e-3, 7e-3),
        target_offset_m: float | None = None,
        period_s: float = 0.01,
        max_speed_m_per_s: float = 5e-3,
        tolerance_m: float = 3e-4,
        force_weight: float = 0.1,
        max_steps: int = 500,
        lateral: bool = False,
        threads: int = 0,
    ) -> None:
        if target_offset_m is None:
            target_offset_m = 5e-4 if lateral else 0.0
        if not lateral and target_offset_m > tolerance_m:
            raise ValueError(
                f"target_offset_m = {target_offset_m}: without lateral=True the needle stays on its path and comes no nearer than that to a "
                f"target at its side; at most tolerance_m = {tolerance_m}"
            )
        base = scene if isinstance(scene, Scene) else Scene(scene)
        changes: dict[str, Any] = {"discretisation.dimension": "full"} if lateral else {}
        self._scene = base.changed(changes) if changes else base
        self._depths = target_depth_m
        self._offset = target_offset_m
        self._period = period_s
        self._speed = max_speed_m_per_s
        self._tolerance = tolerance_m
        self._weight = force_weight
        self._max_steps = max_steps
        self._lateral = lateral
        self._twin = Twin(self._scene, threads=threads)
        self._points = self._twin.reference_points
        reach = self._twin.height_m
        self.action_space = spaces.Box(-1.0, 1.0, (2,), np.float64)
        self.observation_space = spaces.Dict(
            {
                "depth_m": spaces.Box(-reach, reach, (1,), np.float64),
                "lateral_m": spaces.Box(-reach, reach, (1,), np.float64),
                "force_n": spaces.Box(-np.inf, np.inf, (3,), np.float64),
                "target_m": spaces.Box(-np.inf, np.inf, (3,), np.float64),
            }
        )

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        """Back to undeformed tissue, with another target; `seed` makes it the same again."""
        super().reset(seed=seed)
        self._twin.reset()
        self._depth = self._sideways = self._time = 0.0
        self._steps = 0
        self._force = np.zeros(3)
        tip, _ = self._twin.pose_at_depth(self.np_random.uniform(*self._depths))
        # sideways the needle goes along x alone
        wanted = np.array(tip) + self.np_random.uniform(-self._offset, self._offset) * np.array([1.0, 0.0, 0.0])
        # the point of the tissue that lies there at rest: of the nearest of those that the twin shows, weighed by distance
        near = np.argsort(np.linalg.norm(self._points - wanted, axis=1))[:4]
        weight = 1.0 / (np.linalg.norm(self._points[near] - wanted, axis=1) + 1e-9)
        self._near, self._weights = near, (weight / weight.sum())[:, None]
        self._wanted = wanted
        self._distance = float(np.linalg.norm(self._towards()))
        return self._observation(), {}

    def step(self, action):
        """One control period."""
        along, across = np.clip(np.asarray(action, dtype=np.float64), -1.0, 1.0)
        depth = max(self._depth + along * self._speed * self._period, 0.0)
        sideways = self._sideways + (across * self._speed * self._period if self._lateral else 0.0)
        self._time += self._period
        self._steps += 1
        halt = None
        try:
            if self._lateral:
                tip, axis = self._twin.pose_at_depth(depth)
                prediction = self._twin.step(self._time, tip=[tip[0] + sideways, tip[1], tip[2]], axis=axis)
            else:
                prediction = self._twin.step(self._time, depth)
            self._depth, self._sideways, self._force = depth, sideways, prediction.force_n
        except (PoseRefused, Diverged) as error:
            halt = str(error)
        distance = float(np.linalg.norm(self._towards()))
        reward = 1e3 * (self._distance - distance) - self._weight * float(np.linalg.norm(self._force))
        self._distance = distance
        reached = distance <= self._tolerance
        info = {"distance_m": distance} | ({"halt": halt} if halt else {})
        return self._observation(), reward, reached, halt is not None or self._steps >= self._max_steps, info

    def _towards(self) -> np.ndarray:
        """From the tip to where the target is now."""
        tip, _ = self._twin.pose_at_depth(self._depth)
        moved = (self._weights * self._twin.displacements()[self._near]).sum(axis=0)
        return self._wanted + moved - (np.array(tip) + np.array([self._sideways, 0.0, 0.0]))

    def _observation(self) -> dict[str, np.ndarray]:
        return {
            "depth_m": np.array([self._depth]),
            "lateral_m": np.array([self._sideways]),
            "force_n": np.array(self._force),
            "target_m": self._towards(),
        }


gymnasium.register(id="needle_twin/NeedleInsertion-v0", entry_point=NeedleInsertion)
