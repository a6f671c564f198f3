//! The deformed sample as messages for other programs: a point cloud, and a surface for RViz.

use super::answer::{Model, Snapshot};
use ros2_messages::sensor_msgs::{PointCloud2, PointField};
use ros2_messages::std_msgs::{ColorRGBA, Header};
use ros2_messages::visualization_msgs::Marker;

fn deformed(model: &Model, snapshot: &Snapshot) -> impl Iterator<Item = [f64; 3]> {
    model.points.iter().zip(&snapshot.displacements).map(|(x, u)| [x[0] + u[0], x[1] + u[1], x[2] + u[2]])
}

/// x, y, z, `displacement` (m), `jacobian` and `von_mises_pa` as 32-bit floats.
#[allow(clippy::cast_possible_truncation)] // for display
pub(super) fn cloud(header: Header, model: &Model, snapshot: &Snapshot) -> PointCloud2 {
    const FIELDS: [&str; 6] = ["x", "y", "z", "displacement", "jacobian", "von_mises_pa"];
    const STEP: u32 = 4 * FIELDS.len() as u32;
    let mut data = Vec::with_capacity(model.points.len() * STEP as usize);
    for (i, point) in deformed(model, snapshot).enumerate() {
        let [x, y, z] = snapshot.displacements[i];
        let magnitude = (x * x + y * y + z * z).sqrt();
        let jacobian = snapshot.jacobian.get(i).copied().unwrap_or(1.0);
        let stress = snapshot.von_mises_pa.get(i).copied().unwrap_or(0.0);
        for value in point.into_iter().chain([magnitude, jacobian, stress]) {
            data.extend_from_slice(&(value as f32).to_le_bytes());
        }
    }
    let width = (data.len() / STEP as usize) as u32;
    let field = |(i, name): (usize, &str)| PointField {
        name: name.to_owned(),
        offset: 4 * i as u32,
        datatype: PointField::FLOAT32,
        count: 1,
    };
    PointCloud2 {
        header,
        height: 1,
        width,
        fields: FIELDS.into_iter().enumerate().map(field).collect(),
        is_bigendian: false,
        point_step: STEP,
        row_step: data.len() as u32,
        data,
        is_dense: true,
    }
}

/// The deformed surface as one triangle list, coloured by displacement.
pub(super) fn marker(header: Header, model: &Model, snapshot: &Snapshot) -> Marker {
    let points: Vec<[f64; 3]> = deformed(model, snapshot).collect();
    let largest = snapshot.displacements.iter().map(|u| norm(*u)).fold(1e-9, f64::max);
    let corners =
        || model.surface.iter().flatten().filter_map(|i| usize::try_from(*i).ok()).filter(|i| *i < points.len());
    Marker {
        header,
        ns: "tissue".to_owned(),
        id: 0,
        r#type: Marker::TRIANGLE_LIST,
        action: Marker::ADD,
        scale: [1.0; 3].into(),
        color: ColorRGBA { r: 1.0, g: 1.0, b: 1.0, a: 1.0 },
        points: corners().map(|i| points[i].into()).collect(),
        colors: corners().map(|i| colour(norm(snapshot.displacements[i]) / largest)).collect(),
        ..Marker::default()
    }
}

fn norm([x, y, z]: [f64; 3]) -> f64 {
    (x * x + y * y + z * z).sqrt()
}

/// From a pale skin tone at zero to deep red.
#[allow(clippy::cast_possible_truncation)] // a colour
fn colour(fraction: f64) -> ColorRGBA {
    let t = fraction.clamp(0.0, 1.0) as f32;
    ColorRGBA { r: 0.95 - 0.35 * t, g: 0.85 - 0.80 * t, b: 0.78 - 0.70 * t, a: 1.0 }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::time::Duration;

    use super::*;

    #[test]
    fn cloud_has_the_fields_that_it_names() {
        let model = Model {
            id: 1,
            scene: String::new(),
            method: String::new(),
            dimension: String::new(),
            error: 0.0,
            nodes: 1,
            integration_points: 1,
            build: Duration::ZERO,
            effective_radius: None,
            points: vec![[1.0, 2.0, 3.0]],
            surface: vec![],
            cells: vec![],
            region: Vec::new(),
            target_names: vec![],
            target_references: vec![],
            instrument: serde_json::Value::Null,
            along: Arc::default(),
        };
        let snapshot = Snapshot { displacements: vec![[0.0, 3.0, 4.0]], jacobian: vec![0.5], ..Snapshot::default() };
        let cloud = cloud(Header::default(), &model, &snapshot);
        assert_eq!((cloud.width, cloud.point_step, cloud.row_step), (1, 24, 24));
        let floats: Vec<f32> =
            cloud.data.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
        assert_eq!(floats, [1.0, 5.0, 7.0, 5.0, 0.5, 0.0]);
    }
}
