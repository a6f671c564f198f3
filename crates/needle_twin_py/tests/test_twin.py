import copy
import os
import pickle
import signal
import subprocess
import sys
import threading

import needle_twin
import numpy as np
import pytest


def test_a_twin_answers_pose_by_pose_what_solve_answers(small):
    run = needle_twin.solve(small)
    twin = needle_twin.Twin(small)
    times, depths = small.motion()
    forces = np.array([twin.step(t, d).force_n for t, d in zip(times, depths)])
    assert np.array_equal(forces, run.predicted_vector_n)
    assert np.array_equal(run.predicted_n, forces[:, 2])
    assert run.predicted_n[-1] > 0.05 and run.metrics["checksum"] == run.checksum


def test_a_puncture_is_an_event():
    twin = needle_twin.Twin(needle_twin.Scene("needle_insertion", {"discretisation.spacing_m": 0.003}))
    events = [twin.step(0.01 * i, 1e-5 * i).event for i in range(1, 20)]
    (kind, depth), = [event for event in events if event]
    assert kind == "puncture" and 0.0 < depth < 2e-4


def test_threads_change_no_bit(small):
    assert needle_twin.solve(small, threads=1).checksum == needle_twin.solve(small, threads=3).checksum


def test_a_pose_in_space_is_a_depth_along_the_axis(small):
    by_depth, by_pose = needle_twin.Twin(small), needle_twin.Twin(small)
    tip, axis = by_pose.pose_at_depth(2e-4)
    a, b = by_depth.step(0.1, depth_m=2e-4), by_pose.step(0.1, tip=np.array(tip), axis=axis)
    assert np.array_equal(a.force_n, b.force_n) and b.depth_m == pytest.approx(2e-4)


def test_fields_are_arrays_with_their_shapes(small):
    twin = needle_twin.Twin(small)
    twin.step(0.1, 4e-4)
    n = len(twin.reference_points)
    u = twin.displacements()
    jacobian, stress = twin.jacobian_and_stress()
    assert u.shape == twin.reference_points.shape == (n, 3) and u.dtype == np.float64
    assert jacobian.shape == stress.shape == (n,)
    assert twin.surface.shape[1] == 3 and twin.cells.shape[1] == 4 and twin.cells.max() < n
    top = np.isclose(twin.reference_points[:, 2], twin.height_m)
    assert np.allclose(u[top, 2], -4e-4, atol=1e-6), "the plate takes the top with it"
    assert 0.9 < jacobian.min() < 1.0 < 1.1
    u[:] = 0.0
    assert twin.displacements().any(), "an array is the caller's own"


def test_what_a_twin_refuses_leaves_it_as_it_was(small):
    twin = needle_twin.Twin(small)
    before = twin.step(0.1, 2e-4)
    with pytest.raises(needle_twin.PoseRefused, match="refused"):
        twin.step(0.2, 1e300)
    with pytest.raises(needle_twin.PoseRefused):
        twin.step(0.2, float("nan"))
    with pytest.raises(ValueError, match="unit vector"):
        twin.step(0.2, tip=[0, 0, 0.017], axis=[0, 0, -2])
    with pytest.raises(ValueError, match="either"):
        twin.step(0.2)
    after = twin.step(0.2, 2e-4)
    assert after.force_n[2] == pytest.approx(before.force_n[2], rel=0.02)


def test_looking_ahead_changes_nothing_and_agrees_with_going_there(small):
    twin = needle_twin.Twin(small)
    with pytest.raises(ValueError, match="step first"):
        twin.look_ahead(1e-4)
    twin.step(0.1, 2e-4)
    before = twin.displacements()
    ahead = twin.look_ahead(1e-4)
    assert np.array_equal(before, twin.displacements())
    assert ahead[-1].depth_m == pytest.approx(3e-4)
    there = twin.step(0.2, 3e-4)
    assert ahead[-1].predicted_n == pytest.approx(there.predicted_n, rel=0.05)


def test_reset_is_the_beginning(small):
    twin = needle_twin.Twin(small)
    first = twin.step(0.1, 2e-4).force_n
    twin.step(0.2, 4e-4)
    twin.reset()
    assert np.array_equal(first, twin.step(0.1, 2e-4).force_n)


def test_pythons_lock_is_released_while_a_twin_works(small):
    turns, done = [0], threading.Event()

    def count():
        while not done.is_set():
            turns[0] += 1

    # with the lock held for all of a call, the counter could not move during it
    counter = threading.Thread(target=count)
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-4)
    counter.start()
    try:
        before = turns[0]
        needle_twin.solve(small)
        assert turns[0] > before
    finally:
        done.set()
        counter.join()
        sys.setswitchinterval(interval)


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_ctrl_c_ends_a_long_run():
    code = """
import needle_twin
scene = needle_twin.Scene("compression", {"motion.speed_m_per_s": 1e-6, "motion.pose_hz": 1000})
print("ready", flush=True)
needle_twin.solve(scene)
"""
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as child:
        assert child.stdout.readline() == b"ready\n"
        # until it is heard: the first may come before the call begins
        for _ in range(600):
            child.send_signal(signal.SIGINT)
            try:
                child.wait(0.5)
                break
            except subprocess.TimeoutExpired:
                continue
        assert b"KeyboardInterrupt" in child.stderr.read()


def test_a_copy_goes_its_own_way(small):
    twin = needle_twin.Twin(small)
    [twin.step(0.01 * i, 1e-5 * i) for i in range(1, 21)]
    for other in [copy.copy(twin), copy.deepcopy(twin)]:
        a, b = other.step(0.21, 2.1e-4), copy.copy(twin).step(0.21, 2.1e-4)
        assert np.array_equal(a.force_n, b.force_n) and a.predicted_n > 0.0
    assert twin.steps < other.steps


def test_a_twin_is_pickled_as_its_scene(small):
    twin = needle_twin.Twin(small)
    other = pickle.loads(pickle.dumps(twin))
    assert other.scene == twin.scene and other.step(0.1, 1e-4).predicted_n == twin.step(0.1, 1e-4).predicted_n
    with pytest.raises(TypeError, match="before its first pose"):
        pickle.dumps(twin)
    twin.reset()
    assert pickle.loads(pickle.dumps(twin)).nodes == twin.nodes


def test_a_planned_needle_meets_its_target():
    coarse = {"discretisation.spacing_m": 0.004, "motion.speed_m_per_s": 0.01, "motion.pose_hz": 50}
    needle = needle_twin.Scene("needle_insertion", coarse)
    scene, told = needle_twin.plan(needle, "beside_path", tilt_rad=[0.0, 0.1], tolerance_m=1e-4)
    assert told["met"] and told["plan"]["miss_m"] <= min(1e-4, told["straight"]["miss_m"]) and told["runs"] >= 1
    assert scene["motion.depth_m"] == pytest.approx(told["plan"]["depth_m"])
    entry = [scene["instrument.entry_x_m"], scene["instrument.entry_y_m"]]
    assert entry == pytest.approx(told["plan"]["entry_m"], abs=1e-9)
    with pytest.raises(needle_twin.BuildError, match="no target is called"):
        needle_twin.plan(needle, "nothing")
    with pytest.raises(ValueError, match="radius_m = -1"):
        needle_twin.plan(needle, "beside_path", radius_m=-1.0)


def test_a_tolerance_that_is_none_is_refused(small):
    with pytest.raises(ValueError, match="0.02 for 2 %"):
        needle_twin.tune(small, tolerance=2.0)
    with pytest.raises(needle_twin.NeedleTwinError, match="motion"):
        needle_twin.tune(needle_twin.Scene.from_toml(small.to_toml().split("[motion]")[0]))
