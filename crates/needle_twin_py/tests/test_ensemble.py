import needle_twin
import numpy as np
import pytest

MODULUS, ZERO, WIDTH = "material.shear_modulus_pa", "align.force_zero_n", "instrument.diameter_m"
PRIORS = {
    f"uncertainty.{MODULUS}": {"normal": [1500, 150]},
    f"uncertainty.{WIDTH}": {"uniform": [0.8e-3, 1e-3]},
    f"uncertainty.{ZERO}": {"normal": [0, 1e-3]},
}


@pytest.fixture
def needle():
    return needle_twin.Scene("needle_insertion", {"discretisation.spacing_m": 0.003, "motion.depth_m": 1e-3, "motion.pose_hz": 20})


def test_each_member_is_a_twin_with_its_values(needle):
    scene = needle.changed(PRIORS)
    ensemble = needle_twin.Ensemble(scene, 4, seed=1)
    assert len(ensemble) == 4 and set(ensemble.keys) == {MODULUS, ZERO, WIDTH}
    values = ensemble.values
    assert values.shape == (4, 3) and np.isnan(ensemble.predicted_n).all()
    times, depths = scene.motion()
    bands = [ensemble.step(t, d) for t, d in zip(times, depths)]
    forces = ensemble.predicted_n
    band = bands[-1]
    assert band.members == 4 and band.low_n <= band.mean_n <= band.high_n
    assert band.mean_n == pytest.approx(forces.mean()) and band.standard_deviation_n == pytest.approx(forces.std(ddof=1))
    of = dict(zip(ensemble.keys, values[2]))
    alone = needle_twin.solve(needle, changes={MODULUS: of[MODULUS], WIDTH: of[WIDTH]})
    assert forces[2] == pytest.approx(alone.predicted_n[-1] + of[ZERO], rel=1e-3)


def test_the_same_seed_draws_the_same(needle):
    scene = needle.changed({f"uncertainty.{MODULUS}": {"lognormal": [1500, 0.1]}})
    a, b, c = (needle_twin.Ensemble(scene, 3, seed=seed).values for seed in (5, 5, 6))
    assert np.array_equal(a, b) and not np.array_equal(a, c)


def test_targets_have_a_mean_and_a_covariance(needle):
    scene = needle.changed({"uncertainty.material.poisson_ratio": {"uniform": [0.4, 0.49]}})
    ensemble = needle_twin.Ensemble(scene, 3)
    means, covariances = ensemble.targets()
    assert means.shape == (0, 3) and covariances.shape == (0, 3, 3)
    for i in range(1, 11):
        ensemble.step(0.05 * i, 1e-4 * i)
    means, covariances = ensemble.targets()
    k = len(needle_twin.Twin(needle).target_names)
    assert means.shape == (k, 3) and covariances.shape == (k, 3, 3)
    assert np.all(np.linalg.eigvalsh(covariances) > -1e-18) and covariances[:, 2, 2].max() > 0.0


def test_a_pose_that_no_member_can_use_is_refused(needle):
    ensemble = needle_twin.Ensemble(needle.changed(PRIORS), 2)
    with pytest.raises(needle_twin.PoseRefused):
        ensemble.step(0.1, 1e300)
    with pytest.raises(ValueError, match="either"):
        ensemble.step(0.1)
    assert ensemble.step(0.1, 1e-4).members == 2
    ensemble.reset()
    assert np.isnan(ensemble.predicted_n).all()


def test_what_is_missing_is_said_in_python(needle):
    with pytest.raises(needle_twin.SceneError, match=r'scene\["uncertainty\.material\.shear_modulus_pa"\] = '):
        needle_twin.Ensemble(needle)
    with pytest.raises(needle_twin.SceneError, match="time_offset"):
        needle_twin.Ensemble(needle.changed({"uncertainty.align.time_offset_s": {"normal": [0, 0.01]}}), 4)
    with pytest.raises(ValueError, match="at least 2"):
        needle_twin.Ensemble(needle.changed(PRIORS), 1)
    with pytest.raises(needle_twin.SceneError, match="normal"):
        needle["uncertainty.material.shear_modulus_pa"] = {"norml": [1500, 150]}


def test_runs_with_members_have_a_band(needle, bag):
    scene = needle.changed({f"uncertainty.{MODULUS}": {"normal": [1500, 150]}})
    run = needle_twin.solve(scene, members=8, seed=2)
    assert run.predicted_low_n.shape == run.predicted_n.shape
    assert np.all(run.predicted_low_n <= run.predicted_high_n) and run.metrics["ensemble"]["members"] == 8
    assert needle_twin.solve(scene).predicted_low_n is None
    found = needle_twin.replay(bag, scene.changed({"discretisation.spacing_m": 0.004}), members=8)
    assert np.isfinite(found.predicted_high_n).any()


def test_keys_that_go_with_each_other_are_drawn_so(needle):
    other = {"normal": [0.0, 0.01], "correlation": {MODULUS: -0.95}}
    scene = needle.changed({f"uncertainty.{MODULUS}": {"lognormal": [1500, 0.1]}, f"uncertainty.{ZERO}": other})
    moduli, zeros = needle_twin.Ensemble(scene, 32).values.T
    assert np.corrcoef(np.log(moduli), zeros)[0, 1] < -0.85
