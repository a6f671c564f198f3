import pickle

import needle_twin
import numpy as np
import pytest


def test_keys_are_read_and_changed_by_their_paths():
    scene = needle_twin.Scene("needle_insertion", {"material.poisson_ratio": 0.48})
    assert scene["material.poisson_ratio"] == 0.48
    scene["material.shear_modulus_pa"] = np.float32(2000)
    assert scene["material.shear_modulus_pa"] == 2000.0
    assert scene.to_dict()["sample.diameter_m"] == 0.03
    assert "instrument.diameter_m" in scene and "instrument.nonsense" not in scene
    assert needle_twin.Scene.from_toml(scene.to_toml()) == scene
    assert pickle.loads(pickle.dumps(scene)) == scene


def test_a_change_makes_a_copy():
    scene = needle_twin.Scene("compression")
    other = scene.changed({"motion.depth_m": 1e-3, "motion.speed_m_per_s": 2e-3})
    assert (scene["motion.depth_m"], other["motion.depth_m"]) == (2.5e-3, 1e-3)
    times, depths = other.motion()
    assert times.shape == depths.shape and depths[-1] == pytest.approx(1e-3) and times[-1] == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("material.poisson_ratio", 0.7, "allowed"),
        ("material.shear_modulus", 1.0, "material.shear_modulus_pa"),
        ("instrument.kind", "plough", "needle"),
        ("material.shear_modulus_pa", "soft", "number"),
    ],
)
def test_an_error_says_what_where_and_what_to_do(key, value, says):
    scene = needle_twin.Scene("needle_insertion")
    before = scene.to_toml()
    with pytest.raises(needle_twin.SceneError) as error:
        scene[key] = value
    assert key in str(error.value) and says in str(error.value)
    assert scene.to_toml() == before


def test_what_is_not_there_is_said():
    with pytest.raises(needle_twin.SceneError, match="needle_insertion"):
        needle_twin.Scene("needle_insertoin")
    with pytest.raises(KeyError, match="shear_modulus_pa"):
        needle_twin.Scene("compression")["material.shear_modulus"]
    with pytest.raises(TypeError, match="list of numbers"):
        needle_twin.Scene("compression")["motion.depth_m"] = {}


def test_presets_are_listed():
    names = [name for name, description in needle_twin.presets() if description]
    assert {"compression", "indentation", "needle_insertion"} <= set(names)
