import needle_twin
import numpy as np
import pytest


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    """A compression of a softer gel and its release, as a lab's CSV: mm and N, with a little noise. Without the release a drift of the load cell
    could not be told from stiffness."""
    scene = needle_twin.Scene(
        "compression",
        {"discretisation.spacing_m": 0.002, "material.shear_modulus_pa": 1500, "motion.pose_hz": 50, "motion.retract": True},
    )
    run = needle_twin.solve(scene)
    force = run.predicted_n + np.random.default_rng(1).normal(0.0, 0.002, len(run.time_s))
    path = tmp_path_factory.mktemp("lab") / "run.csv"
    rows = np.column_stack([run.time_s, 1e3 * run.depth_m, force])
    np.savetxt(path, rows, delimiter=",", header="Time (s),Compression (mm),Load (N)", comments="")
    return path


COARSE = {"discretisation.spacing_m": 0.002}


def test_a_table_is_read_with_its_units(table, tmp_path):
    recording = needle_twin.Recording(table)
    assert recording.depth_m.max() == pytest.approx(2.5e-3) and recording.force_n.shape == (len(recording.time_s), 3)
    recording.save(tmp_path / "bag", scene="compression")
    again = needle_twin.Recording(tmp_path / "bag")
    assert again.scene == "compression"
    assert np.allclose(again.depth_m, recording.depth_m) and np.allclose(again.force_n, recording.force_n)


def test_a_modulus_is_found_in_a_table(table):
    found = needle_twin.calibrate(table, ["material.shear_modulus_pa"], "compression", changes=COARSE)
    low, high = found.interval_95["material.shear_modulus_pa"]
    assert low < 1500 < high
    assert found.values["material.shear_modulus_pa"] == pytest.approx(1500, rel=0.02)
    assert not found.rejected and found.to_dict()["verdict"]["explains"] == "yes"
    assert found.scene["material.shear_modulus_pa"] == pytest.approx(found.values["material.shear_modulus_pa"])


def test_a_replay_is_judged_and_written(table, tmp_path):
    wrong = needle_twin.replay(table, "compression", changes=COARSE)
    assert wrong.metrics["verdict"]["explains"] != "yes", wrong.verdict
    right = needle_twin.replay(table, "compression", changes=COARSE | {"material.shear_modulus_pa": 1500})
    assert right.metrics["verdict"]["explains"] == "yes", right.verdict
    assert np.nanmax(np.abs(right.measured_n - right.predicted_n)) < 0.02
    written = {path.name for path in right.save(tmp_path)}
    assert {"metrics.json", "force.csv", "final.vtu", "report.html", "force.svg"} <= written


def test_a_bag_names_its_scene(bag):
    recording = needle_twin.Recording(bag)
    assert recording.scene == "needle_insertion" and len(recording.force_time_s) > 100 and not recording.losses


def test_what_is_wrong_with_a_recording_is_said(table, tmp_path):
    with pytest.raises(needle_twin.RecordingError, match="nowhere"):
        needle_twin.Recording(tmp_path / "nowhere")
    with pytest.raises(needle_twin.RecordingError, match="position=") as said:
        needle_twin.Recording(table, position="Depth")
    assert "--" not in str(said.value)
    with pytest.raises(needle_twin.RecordingError):
        needle_twin.replay(needle_twin.Recording(table, position_unit="m"), "compression", changes=COARSE)
    with pytest.raises(ValueError, match="1 or -1"):
        needle_twin.Recording(table, force_sign=2)
    with pytest.raises(ValueError, match="twice"):
        needle_twin.calibrate(table, ["material.shear_modulus_pa"] * 2, "compression")


def test_one_column_may_be_one_text(table):
    one = needle_twin.Recording(table, position="Compression (mm)", force="Load (N)", time="Time (s)")
    several = needle_twin.Recording(table, position="Compression (mm)", force="Load (N)", time=["Time (s)"])
    assert np.array_equal(one.time_s, several.time_s) and len(one.time_s) > 100


def test_a_contact_that_was_found_is_carried_over(table, tmp_path):
    shifted = tmp_path / "shifted.csv"
    rows = np.loadtxt(table, delimiter=",", skiprows=1)
    # 0.6 mm through air at the same speed: where nothing is touched yet, the contact is known
    (dt_s, step_mm), air = rows[2, :2] - rows[1, :2], np.random.default_rng(2)
    n = round(0.6 / step_mm)
    approach = np.column_stack([np.arange(n) * dt_s, np.arange(n) * step_mm, air.normal(0.0, 0.002, n)])
    rows = np.vstack([approach, rows + np.array([n * dt_s, n * step_mm, 0.0])]) + np.array([0.0, 0.0, 0.03])
    np.savetxt(shifted, rows, delimiter=",", header="Time (s),Compression (mm),Load (N)", comments="")
    found = needle_twin.calibrate(shifted, ["material.shear_modulus_pa"], "compression", changes=COARSE)
    assert found.scene["align.contact_depth_m"] == pytest.approx(6e-4, abs=5e-5)
    run = needle_twin.replay(shifted, found.scene)
    assert run.metrics["force"]["rmse_n"] == pytest.approx(found.rmse_n, rel=0.1) and run.metrics["verdict"]["explains"] == "yes"


def test_another_recording_is_predicted(table):
    found = needle_twin.calibrate(table, ["material.shear_modulus_pa"], "compression", changes=COARSE, predict=table)
    prediction = found.to_dict()["prediction"]
    assert prediction["carried"] == ["material.shear_modulus_pa"] and prediction["nrmse"] < 0.02 < prediction["nrmse_before"]


def test_layers_need_a_way_out(table):
    with pytest.raises(needle_twin.CalibrationError, match="needle"):
        needle_twin.layers(table, 1, "compression")
    with pytest.raises(ValueError, match="1 to 16"):
        needle_twin.layers(table, 0, "layered_tissue")


def columns(n=200):
    t = np.arange(n) * 0.01
    return t, np.maximum(0.0, t - 0.5), 0.31 * np.maximum(0.0, t - 0.5)


def test_arrays_and_frames_are_tables():
    t, d, f = columns()
    given = {"Time (s)": t, "Depth (mm)": d, "Load (N)": f, "State": ["in" if x else "out" for x in d]}
    of_columns = needle_twin.Recording(given)
    assert np.array_equal(of_columns.depth_m, 1e-3 * d) and np.array_equal(of_columns.force_n[:, 2], f)
    assert len(of_columns.losses) == 0 and of_columns.time_s[-1] == pytest.approx(t[-1])
    rows = np.column_stack([t, d, f])
    units = {"time_unit": "s", "position_unit": "mm", "force_unit": "N"}
    of_array = needle_twin.Recording(rows, time="1", position="2", force="3", **units)
    assert np.array_equal(of_array.depth_m, of_columns.depth_m) and np.array_equal(of_array.force_n[:, 2], f)
    named = np.rec.fromarrays([t, d, f], names="time_s,depth_mm,force_n")
    assert np.array_equal(needle_twin.Recording(named).depth_m, of_columns.depth_m)
    # a reading that was not taken is none
    f[7] = np.nan
    assert len(needle_twin.Recording({"Time (s)": t, "Depth (mm)": d, "Load (N)": f}).force_time_s) == len(t) - 1
    run = needle_twin.replay({"Time (s)": t, "Depth (mm)": d, "Load (N)": f}, "compression", changes={"discretisation.spacing_m": 0.004})
    assert len(run.depth_m) == len(t)
    with pytest.raises(ValueError, match="200 rows.*3 rows|3 rows.*200"):
        needle_twin.Recording({"Time (s)": t, "Depth (mm)": d[:3]})
    with pytest.raises(ValueError, match="two dimensions"):
        needle_twin.Recording(t)
    with pytest.raises(needle_twin.RecordingError, match="no such column"):
        needle_twin.Recording(given, force="NOPE")


def test_a_frame_of_pandas_is_a_table():
    pandas = pytest.importorskip("pandas")
    t, d, f = columns()
    frame = pandas.DataFrame({"Time (s)": t, "Depth (mm)": d, "Load (N)": f})
    assert np.array_equal(needle_twin.Recording(frame).depth_m, 1e-3 * d)
    at = pandas.Timestamp("2026-03-04 10:15") + pandas.to_timedelta(t, unit="s")
    by_time = pandas.DataFrame({"Depth (mm)": d, "Load (N)": f}, index=pandas.Index(at, name="time"))
    recording = needle_twin.Recording(by_time)
    assert np.array_equal(recording.depth_m, 1e-3 * d) and np.allclose(recording.time_s, t, atol=1e-9)


def test_position_force_and_frames_have_the_options_of_the_command_line():
    t, d, f = columns()
    counts = {"Time (s)": t, "Encoder": 51_200 + 2048 * d, "Load (N)": f}
    encoder = needle_twin.Recording(counts, position="Encoder", position_unit="mm", position_scale=1 / 2048, position_zero=51_200)
    assert np.allclose(encoder.depth_m, 1e-3 * d)
    turned = {"Time (s)": t, "Depth (mm)": d, "Fx (N)": f, "Fy (N)": 0 * f, "Fz (N)": 0 * f}
    half = np.sqrt(0.5)
    vector = needle_twin.Recording(turned, force_columns=["Fx", "Fy", "Fz"], sensor_rotation=[half, 0, -half, 0])
    assert np.allclose(vector.force_n, np.column_stack([0 * f, 0 * f, f]))


def test_the_console_script(table, tmp_path, capsys):
    from needle_twin.__main__ import main

    coarse = ["--set", "discretisation.spacing_m=0.004"]
    assert main(["scenes"]) == 0 and "needle_insertion" in capsys.readouterr().out
    assert main(["solve", "compression", "--out", str(tmp_path / "run"), *coarse]) == 0
    assert (tmp_path / "run" / "report.html").is_file() and "checksum" in capsys.readouterr().out
    assert main(["replay", str(table), "--scene", "compression", "--set", "material.shear_modulus_pa=900", *coarse]) == 3
    assert main(["replay", str(table), "--scene", "compression", "--force", "Laod"]) == 1
    assert "no such column" in capsys.readouterr().err
    assert main(["calibrate", str(table), "--scene", "compression", "--fit", "material.shear_modulus_pa", *coarse]) == 0
    assert "material.shear_modulus_pa = 1" in capsys.readouterr().out
