// Any bytes as a mesh: shared by the fuzz targets in `fuzz/` and by `tests/fuzz.rs`.

use std::path::Path;

use needle_core::mesh::{self, Wanted};

/// A cloud that comes out is one: finite points, cells of its own nodes, positive volumes.
pub fn exercise(name: &str, data: &[u8]) {
    let wanted = Wanted { unit_m: 0.001, base: "base", contact: Some("contact") };
    match mesh::from_bytes(Path::new(name), data, &wanted) {
        Ok((cloud, _)) => {
            assert!(cloud.points.iter().flatten().all(|x| x.is_finite()));
            assert!(cloud.cells.iter().flatten().all(|i| (*i as usize) < cloud.points.len()));
            assert!(cloud.volumes().iter().all(|v| *v > 0.0 && v.is_finite()));
        }
        Err(error) => assert!(error.to_string().contains(name), "{error}"),
    }
}
