//! Contract of `examples/cluster`: the engines run the same shards, and what they make is what one machine makes.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::path::Path;
use std::process::Command;

use crate::batch::{Lab, files};
use testkit::python::{environment, run};

/// At the versions that were tried.
const DASK: [&str; 1] = ["distributed==2026.8.0"];
const HYPERQUEUE: [&str; 1] = ["hyperqueue==0.27.0"];

fn examples() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/cluster")
}

/// Tables, page and rows of one machine, with the rows beside as the engines leave them.
fn one_machine(lab: &Lab) -> std::collections::BTreeMap<String, Vec<u8>> {
    lab.batch("whole", &[]);
    files(&lab.path("whole"))
}

#[test]
fn dask_loses_nothing_when_a_worker_is_killed() {
    let lab = Lab::new();
    let python = environment("dask-venv", &DASK);
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cluster/kill_one.py");
    let mut command = Command::new(python);
    command.arg(script).arg(examples()).arg(env!("CARGO_BIN_EXE_needle_twin"));
    run(command.arg(lab.path("manifest.toml")).arg(lab.path("dask")).arg("6"), "dask");
    let mut merged = files(&lab.path("dask"));
    let rows = merged.keys().filter(|name| name.starts_with("rows/recordings/")).count();
    assert_eq!(rows, 6, "every recording has one row: {:?}", merged.keys());
    merged.retain(|name, _| !name.starts_with("rows/"));
    assert!(merged == one_machine(&lab), "bit for bit");
}

#[test]
fn the_tasks_of_a_slurm_array_are_the_shards() {
    let lab = Lab::new();
    for task in ["2", "1", "3"] {
        let mut command = Command::new("sh");
        command.arg(examples().join("slurm.sbatch")).arg(lab.path("manifest.toml")).arg(lab.path("slurm"));
        command.env("SLURM_ARRAY_TASK_ID", task).env("SLURM_ARRAY_TASK_COUNT", "3");
        run(command.env("NEEDLE_TWIN", env!("CARGO_BIN_EXE_needle_twin")), "slurm");
    }
    let mut merge = Command::new(env!("CARGO_BIN_EXE_needle_twin"));
    merge.args(["batch", "merge"]).arg(lab.path("slurm/rows")).arg("--out").arg(lab.path("merged"));
    assert_eq!(merge.output().unwrap().status.code(), Some(3), "one recording can't be read");
    assert!(files(&lab.path("merged")) == one_machine(&lab), "bit for bit");
}

#[test]
fn the_runs_of_an_ensemble_go_through_the_same_door() {
    let folder = tempfile::tempdir().unwrap();
    let options = [
        "--scene=indentation",
        "--members=4",
        "--set=discretisation.spacing_m=0.003",
        "--set=motion.depth_m=0.0005",
        "--set=motion.speed_m_per_s=0.02",
        "--set=uncertainty.material.poisson_ratio={uniform=[0.45, 0.49]}",
    ];
    let program = env!("CARGO_BIN_EXE_needle_twin");
    let study = |out: &Path| {
        run(Command::new(program).args(["study", "sensitivity"]).args(options).arg("--out").arg(out), "study");
        std::fs::read(out.join("sensitivity.json")).unwrap()
    };
    for task in ["2", "1"] {
        let mut command = Command::new("sh");
        command.arg(examples().join("slurm.sbatch")).arg("sensitivity").arg(folder.path()).args(options);
        command.env("SLURM_ARRAY_TASK_ID", task).env("SLURM_ARRAY_TASK_COUNT", "2");
        run(command.env("NEEDLE_TWIN", program), "slurm");
    }
    assert!(study(&folder.path().join("rows")) == study(&folder.path().join("whole")), "bit for bit");
}

#[test]
fn hyperqueue_makes_what_one_machine_makes() {
    let lab = Lab::new();
    let mut command = Command::new(environment("hyperqueue-venv", &HYPERQUEUE));
    command.arg(examples().join("hyperqueue_batch.py")).arg(lab.path("manifest.toml")).arg(lab.path("hq"));
    command.args(["--shards", "4", "--program", env!("CARGO_BIN_EXE_needle_twin")]);
    let output = command.output().unwrap();
    assert_eq!(output.status.code(), Some(3), "one recording can't be read: {output:?}");
    let mut merged = files(&lab.path("hq"));
    merged.retain(|name, _| !name.starts_with("rows/") && !name.starts_with("logs/"));
    assert!(merged == one_machine(&lab), "bit for bit");
}
