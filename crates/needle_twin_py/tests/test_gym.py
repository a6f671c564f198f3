import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")
from gymnasium.utils.env_checker import check_env  # noqa: E402

import needle_twin  # noqa: E402
import needle_twin.gym  # noqa: E402


@pytest.fixture(scope="module")
def env():
    scene = needle_twin.Scene("needle_insertion", {"discretisation.spacing_m": 0.003})
    return gymnasium.make("needle_twin/NeedleInsertion-v0", scene=scene, max_steps=400).unwrapped


def test_it_keeps_gymnasiums_rules(env):
    check_env(env, skip_render_check=True)


def test_a_controller_that_follows_the_target_arrives(env):
    seen, _ = env.reset(seed=3)
    start = -seen["target_m"][2]
    for _ in range(400):
        ahead = -seen["target_m"][2]  # what is left, the tissue's own motion included
        seen, _, reached, cut, info = env.step(np.array([np.clip(200.0 * ahead, -1.0, 1.0), 0.0]))
        if reached or cut:
            break
    assert reached, info
    assert seen["depth_m"][0] - seen["target_m"][2] > start, "the target was pushed ahead of the needle"
    assert seen["force_n"][2] > 0.0


def test_the_same_seed_is_the_same_episode(env):
    def episode():
        env.reset(seed=7)
        return [env.step(np.array([1.0, 0.0]))[1] for _ in range(20)]

    assert episode() == episode()


def test_every_target_of_the_default_task_can_be_reached():
    scene = needle_twin.Scene("needle_insertion", {"discretisation.spacing_m": 0.003})
    for lateral in [False, True]:
        env = needle_twin.gym.NeedleInsertion(scene=scene if not lateral else "needle_insertion", lateral=lateral)
        for seed in range(40 if not lateral else 3):
            seen, _ = env.reset(seed=seed)
            beside, deep = seen["target_m"][:2], seen["target_m"][2]
            # on the path, or along the one direction that an action has
            assert abs(beside[1]) <= env._tolerance and (lateral or abs(beside[0]) <= env._tolerance)
            assert -deep < env._twin.reach_m


@pytest.mark.parametrize("seed", range(5))
def test_a_controller_arrives_at_the_default_targets(seed):
    env = needle_twin.gym.NeedleInsertion(scene=needle_twin.Scene("needle_insertion", {"discretisation.spacing_m": 0.003}))
    seen, _ = env.reset(seed=seed)
    reached = cut = False
    while not (reached or cut):
        seen, _, reached, cut, info = env.step(np.array([np.clip(-200.0 * seen["target_m"][2], -1.0, 1.0), 0.0]))
    assert reached, info


def test_targets_that_no_action_reaches_are_refused():
    with pytest.raises(ValueError, match="lateral=True"):
        needle_twin.gym.NeedleInsertion(target_offset_m=1e-3)
