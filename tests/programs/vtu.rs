//! `final.vtu` and the time series: what VTK's readers find in them is what the run held.
#![allow(clippy::unwrap_used, clippy::panic)]

use crate::synthetic_run;
use base64::{Engine as _, engine::general_purpose::STANDARD};
use std::{fs, path::Path, process::Command};

/// Bytes of an inline array, its length header checked and removed.
fn array(vtu: &str, name: &str) -> Option<Vec<u8>> {
    let start = vtu.find(&format!("Name=\"{name}\""))?;
    let text = vtu[start..].lines().nth(1).unwrap();
    let bytes = STANDARD.decode(text).unwrap();
    let (header, body) = bytes.split_at(8);
    assert_eq!(u64::from_le_bytes(header.try_into().unwrap()), body.len() as u64, "{name}: length header");
    Some(body.to_vec())
}

fn floats(bytes: &[u8]) -> Vec<f64> {
    bytes.chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().unwrap())).collect()
}

#[test]
fn arrays_hold_the_run_bit_by_bit() {
    let run = synthetic_run::needle(10.0);
    let vtu = needle_report::final_vtu(&run).unwrap();
    let state = &run.final_state;
    assert_eq!(floats(&array(&vtu, "reference").unwrap()), state.points.as_flattened());
    assert_eq!(floats(&array(&vtu, "displacement").unwrap()), state.displacement.as_flattened());
    assert_eq!(floats(&array(&vtu, "jacobian").unwrap()), state.jacobian);
    assert_eq!(floats(&array(&vtu, "von_mises_pa").unwrap()), state.von_mises_pa);
    let connectivity = array(&vtu, "connectivity").unwrap();
    let indices: Vec<i64> = connectivity.chunks_exact(8).map(|b| i64::from_le_bytes(b.try_into().unwrap())).collect();
    assert!(indices.iter().eq(state.cells.as_flattened().iter().map(|&i| i64::from(i)).collect::<Vec<_>>().iter()));
    assert_eq!(array(&vtu, "finite"), None, "only a run that diverged needs the mask");
}

#[test]
fn cells_have_their_regions_where_there_are_any() {
    let mut run = synthetic_run::needle(10.0);
    assert_eq!(array(&needle_report::final_vtu(&run).unwrap(), "region"), None);
    run.final_state.region = (0..run.final_state.cells.len()).map(|i| (i % 3) as u8).collect();
    assert_eq!(array(&needle_report::final_vtu(&run).unwrap(), "region").unwrap(), run.final_state.region);
    run.final_state.region.pop();
    let message = needle_report::final_vtu(&run).unwrap_err().to_string();
    assert!(message.contains("region") && message.contains("final.vtu"), "{message}");
}

#[test]
fn a_diverged_field_is_masked_and_never_written() {
    let mut run = synthetic_run::needle(10.0);
    run.final_state.displacement[7] = [0.0, f64::NAN, 1.0];
    run.final_state.von_mises_pa[9] = f64::INFINITY;
    let vtu = needle_report::final_vtu(&run).unwrap();
    for name in ["displacement", "von_mises_pa"] {
        assert!(floats(&array(&vtu, name).unwrap()).iter().all(|v| v.is_finite()), "{name}");
    }
    let finite = array(&vtu, "finite").unwrap();
    let bad: Vec<usize> = (0..finite.len()).filter(|&i| finite[i] == 0).collect();
    assert_eq!(bad, [7, 9]);
}

#[test]
fn a_run_that_contradicts_itself_is_an_error_that_names_the_field() {
    let mut run = synthetic_run::needle(10.0);
    run.final_state.jacobian.pop();
    let message = needle_report::final_vtu(&run).unwrap_err().to_string();
    assert!(message.contains("jacobian") && message.contains("final.vtu"), "{message}");
    let mut run = synthetic_run::needle(10.0);
    run.final_state.cells[0][2] = 999_999;
    let message = needle_report::final_vtu(&run).unwrap_err().to_string();
    assert!(message.contains("999999"), "{message}");
}

#[test]
fn an_empty_run_gives_an_empty_grid() {
    let vtu = needle_report::final_vtu(&needle_estimate::compare::Run::default()).unwrap();
    assert!(vtu.contains("NumberOfPoints=\"0\" NumberOfCells=\"0\""));
}

#[test]
fn meshio_reads_the_grid_and_the_series() {
    let out = tempfile::tempdir().unwrap();
    let run = synthetic_run::needle(10.0);
    fs::write(out.path().join("final.vtu"), needle_report::final_vtu(&run).unwrap()).unwrap();
    let series = needle_report::write_series(out.path(), &run).unwrap();
    assert_eq!(series.len(), run.snapshots.len() + 1);
    let program = "
import sys, meshio, pathlib, xml.etree.ElementTree as E
import numpy as np
out = pathlib.Path(sys.argv[1])
m = meshio.read(out / 'final.vtu')
t = m.cells_dict['tetra']
a, b, c, d = (m.points[t[:, i]] for i in range(4))
volume = np.abs(np.einsum('ij,ij->i', np.cross(b - a, c - a), d - a)).sum() / 6
print(m.points.shape[0], t.shape[0], repr(float(volume)), repr(float(m.point_data['displacement'][:, 2].min())))
sets = E.parse(out / 'series.pvd').getroot().findall('Collection/DataSet')
times = [float(s.get('timestep')) for s in sets]
assert times == sorted(times)
print(len([meshio.read(out / s.get('file')) for s in sets]), repr(times[-1]))
";
    let output = Command::new(python()).args(["-c", program]).arg(out.path()).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    let seen: Vec<f64> = text.split_whitespace().map(|w| w.parse().unwrap()).collect();
    let state = &run.final_state;
    let deepest = state.displacement.iter().map(|u| u[2]).fold(f64::INFINITY, f64::min);
    assert_eq!((seen[0], seen[1]), (state.points.len() as f64, state.cells.len() as f64));
    assert_eq!(seen[3], deepest);
    assert_eq!((seen[4], seen[5]), (run.snapshots.len() as f64, run.snapshots.last().unwrap().time_s));
    // A prism of 32 sectors: its cells fill it exactly once.
    let area = 16.0 * (std::f64::consts::TAU / 32.0).sin() * synthetic_run::RADIUS_M.powi(2);
    assert!((seen[2] / (area * synthetic_run::HEIGHT_M) - 1.0).abs() < 1e-12, "volume {}", seen[2]);
}

/// A Python with meshio, in a virtual environment of this test's own.
fn python() -> std::path::PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("meshio-5.3.5");
    let python = folder.join("bin/python");
    if !folder.join("ready").exists() {
        run(Command::new("python3").args(["-m", "venv", "--clear"]).arg(&folder));
        run(Command::new(&python).args(["-m", "pip", "install", "--quiet", "meshio==5.3.5", "numpy"]));
        fs::write(folder.join("ready"), "").unwrap();
    }
    python
}

fn run(command: &mut Command) {
    let output = command.output().unwrap_or_else(|e| panic!("{command:?}: {e}"));
    assert!(output.status.success(), "{command:?}: {}", String::from_utf8_lossy(&output.stderr));
}
