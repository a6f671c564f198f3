//! `final.vtu` and time series: VTK's XML format for unstructured grids, for ParaView, PyVista and meshio.
//!
//! Arrays are inline, base64, uncompressed, little endian, each preceded by its length in bytes as a UInt64.

use super::{
    ReportError,
    files::{self, Rendered},
};
use base64::{Engine as _, engine::general_purpose::STANDARD};
use needle_estimate::compare::{FinalState, Run};
use std::{
    fmt::Write as _,
    path::{Path, PathBuf},
};

/// VTK's cell type of a linear tetrahedron.
const VTK_TETRA: u8 = 10;

/// VTK's cell type of a line through several points.
const VTK_POLY_LINE: u8 = 4;

/// One field at the points, with `C` components each.
struct Field<'a, const C: usize> {
    name: &'static str,
    values: &'a [[f64; C]],
}

/// Content of `final.vtu`: reference points and background tetrahedra, with the point data `displacement` (m),
/// `jacobian` (volume ratio) and `von_mises_pa`. For a sample with regions there is the cell data `region`: 0 for
/// `[material]`, 1 for the scene's first region, and so on. "Warp by vector" with `displacement` shows the deformed
/// sample.
///
/// A field that the run doesn't have is left out. Where a value is not finite (a diverged run), 0 is written and the
/// point datum `finite` is 0.
///
/// # Errors
/// [`ReportError::Length`] or [`ReportError::Index`] if the run's fields and cells don't match its points.
pub fn final_vtu(run: &Run) -> Result<String, ReportError> {
    let state = &run.final_state;
    let jacobian: Vec<[f64; 1]> = state.jacobian.iter().map(|&j| [j]).collect();
    let stress: Vec<[f64; 1]> = state.von_mises_pa.iter().map(|&s| [s]).collect();
    let scalars = [Field { name: "jacobian", values: &jacobian }, Field { name: "von_mises_pa", values: &stress }];
    grid("final.vtu", state, &state.displacement, &scalars)
}

/// Content of `needle.vtu`: the line of a needle that bends at the last snapshot, from its clamp to its tip, in the coordinates of the deformed
/// sample, m; `None` for another instrument.
#[must_use]
pub(super) fn needle_vtu(run: &Run) -> Option<String> {
    let places = run.snapshots.last().map(|snapshot| &snapshot.needle).filter(|places| places.len() > 1)?;
    let coordinates: String = places.iter().map(|[x, y, z]| format!("{x:?} {y:?} {z:?}\n")).collect();
    let count = places.len();
    let numbers: String = (0..count).map(|i| format!("{i} ")).collect();
    Some(format!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\">\n<UnstructuredGrid>\n\
         <Piece NumberOfPoints=\"{count}\" NumberOfCells=\"1\">\n\
         <Points>\n<DataArray type=\"Float64\" NumberOfComponents=\"3\" format=\"ascii\">\n{coordinates}</DataArray>\n</Points>\n<Cells>\n\
         <DataArray type=\"Int64\" Name=\"connectivity\" format=\"ascii\">{numbers}</DataArray>\n\
         <DataArray type=\"Int64\" Name=\"offsets\" format=\"ascii\">{count}</DataArray>\n\
         <DataArray type=\"UInt8\" Name=\"types\" format=\"ascii\">{VTK_POLY_LINE}</DataArray>\n\
         </Cells>\n</Piece>\n</UnstructuredGrid>\n</VTKFile>\n"
    ))
}

/// Removes the series of an earlier run from a folder: `series.pvd` and the frames in `series/`, nothing else.
///
/// # Errors
/// [`ReportError::File`] if one can't be removed.
pub fn clear_series(out: &Path) -> Result<(), ReportError> {
    let is_frame = |name: &str| name.starts_with("frame_") && name.ends_with(".vtu");
    let folder = out.join("series");
    for entry in std::fs::read_dir(&folder).into_iter().flatten().flatten() {
        if entry.file_name().to_str().is_some_and(is_frame) {
            files::remove_file(&entry.path())?;
        }
    }
    let _ = std::fs::remove_dir(&folder); // removes only an empty folder
    files::remove_file(&out.join("series.pvd"))
}

/// Writes the run's snapshots as `series/frame_0000.vtu`, ... with `series.pvd`, which ParaView opens as an animation
/// over time.
///
/// # Errors
/// As [`final_vtu`], and [`ReportError::File`] if a file can't be written.
pub fn write_series(out: &Path, run: &Run) -> Result<Vec<PathBuf>, ReportError> {
    let mut rendered = Vec::with_capacity(run.snapshots.len() + 1);
    let mut entries = String::new();
    for (i, snapshot) in run.snapshots.iter().enumerate() {
        let name = format!("series/frame_{i:04}.vtu");
        let jacobian: Vec<[f64; 1]> = snapshot.jacobian.iter().map(|&j| [j]).collect();
        let scalars = [Field { name: "jacobian", values: &jacobian }];
        let content = grid("series/frame.vtu", &run.final_state, &snapshot.displacement, &scalars)?;
        let _ = writeln!(entries, r#"    <DataSet timestep="{:?}" file="{name}"/>"#, snapshot.time_s);
        rendered.push(Rendered::new(name, content));
    }
    let pvd = format!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\" byte_order=\"LittleEndian\">\n  \
         <Collection>\n{entries}  </Collection>\n</VTKFile>\n"
    );
    rendered.push(Rendered::new("series.pvd", pvd));
    files::write(out, &rendered)
}

fn grid(
    file: &'static str,
    state: &FinalState,
    displacement: &[[f64; 3]],
    scalars: &[Field<'_, 1>],
) -> Result<String, ReportError> {
    let FinalState { points, cells, .. } = state;
    if let Some(&index) = cells.iter().flatten().find(|&&i| i as usize >= points.len()) {
        return Err(ReportError::Index { file, index, points: points.len() });
    }
    let mut finite = vec![1u8; points.len()];
    let mut data = String::new();
    point_data(&mut data, file, &Field { name: "displacement", values: displacement }, &mut finite)?;
    for field in scalars {
        point_data(&mut data, file, field, &mut finite)?;
    }
    let mut coordinates = String::new();
    point_data(&mut coordinates, file, &Field { name: "reference", values: points }, &mut finite)?;
    if finite.contains(&0) {
        data_array(&mut data, "UInt8", "finite", 1, &finite);
    }
    Ok(format!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" \
         header_type=\"UInt64\">\n<UnstructuredGrid>\n<Piece NumberOfPoints=\"{}\" NumberOfCells=\"{}\">\n\
         <PointData Vectors=\"displacement\">\n{data}</PointData>\n{}<Points>\n{coordinates}</Points>\n<Cells>\n{}\
         </Cells>\n</Piece>\n</UnstructuredGrid>\n</VTKFile>\n",
        points.len(),
        cells.len(),
        cell_data(file, state)?,
        topology(cells),
    ))
}

/// Regions of the cells, if there are any.
fn cell_data(file: &'static str, state: &FinalState) -> Result<String, ReportError> {
    if state.region.is_empty() {
        return Ok(String::new());
    }
    let (found, expected) = (state.region.len(), state.cells.len());
    if found != expected {
        return Err(ReportError::Length { file, field: "region", found, expected });
    }
    let mut text = String::from("<CellData Scalars=\"region\">\n");
    data_array(&mut text, "UInt8", "region", 1, &state.region);
    text.push_str("</CellData>\n");
    Ok(text)
}

fn topology(cells: &[[u32; 4]]) -> String {
    let mut text = String::new();
    let connectivity: Vec<u8> = cells.iter().flatten().flat_map(|&i| i64::from(i).to_le_bytes()).collect();
    let offsets: Vec<u8> = (1..=cells.len() as i64).flat_map(|i| (4 * i).to_le_bytes()).collect();
    data_array(&mut text, "Int64", "connectivity", 1, &connectivity);
    data_array(&mut text, "Int64", "offsets", 1, &offsets);
    data_array(&mut text, "UInt8", "types", 1, &vec![VTK_TETRA; cells.len()]);
    text
}

/// Appends a field if the run has it; clears `finite` where its value is not finite.
fn point_data<const C: usize>(
    text: &mut String,
    file: &'static str,
    field: &Field<'_, C>,
    finite: &mut [u8],
) -> Result<(), ReportError> {
    if field.values.is_empty() && !finite.is_empty() && field.name != "reference" {
        return Ok(());
    }
    if field.values.len() != finite.len() {
        let (found, expected) = (field.values.len(), finite.len());
        return Err(ReportError::Length { file, field: field.name, found, expected });
    }
    let mut bytes = Vec::with_capacity(8 * C * field.values.len());
    for (value, finite) in field.values.iter().zip(finite) {
        for &component in value {
            *finite &= u8::from(component.is_finite());
            bytes.extend_from_slice(&if component.is_finite() { component } else { 0.0 }.to_le_bytes());
        }
    }
    data_array(text, "Float64", field.name, C, &bytes);
    Ok(())
}

fn data_array(text: &mut String, kind: &str, name: &str, components: usize, bytes: &[u8]) {
    let _ =
        writeln!(text, r#"<DataArray type="{kind}" Name="{name}" NumberOfComponents="{components}" format="binary">"#);
    let mut block = (bytes.len() as u64).to_le_bytes().to_vec();
    block.extend_from_slice(bytes);
    STANDARD.encode_string(&block, text);
    text.push_str("\n</DataArray>\n");
}
