//! One cloud for several depths of the layers: its nodes move with the interfaces.
//!
//! With z_i the heights of the interfaces in the body that the cloud was made for, and z'_i where the scene has them,
//!
//! ```text
//! z' = z'_i + s_i (z - z_i),   s_i = (z'_{i+1} - z'_i) / (z_{i+1} - z_i)      for z_i <= z <= z_{i+1}; top and base stay
//! phi'_j(X') = phi_j(X),   d phi'_j / dz' = 1/s_i d phi_j / dz,   V' = s_i V
//! ```
//!
//! Shape functions go with their nodes, as those of an isoparametric element do. Supports end at interfaces, and between two of them the
//! map is linear, so linear fields are met as before. Cells, supports, coarse nodes of the pressure and the order of everything stay, so
//! the force is a smooth function of the depths, which that of a cloud made anew for each is not.

use super::regions;
use crate::scene::{Region, RegionShape, Scene, Shape};
use mtled::approximation::ShapeTable;

/// A layer may become this many times as thick, or as thin: beyond, the cells are too flat.
const MOST_STRETCHED: f64 = 2.0;

/// How the nodes of a cloud move.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Moved {
    /// Heights of base, interfaces and top, m: in the cloud, and in the scene. Ascending.
    heights: Vec<[f64; 2]>,
}

impl Moved {
    /// From a body with other regions to a scene's own; `None` where there is no such map: other shapes than layers, another order of
    /// materials, or a layer that would become too thin or thick.
    pub(crate) fn new(scene: &Scene, made_for: &[Region]) -> Option<Self> {
        let upright = scene.instrument.is_none_or(|i| i.slope() == [0.0; 2]);
        let top = match scene.sample.shape {
            Shape::Cylinder { height, .. } | Shape::Box { height, .. } if upright => height.get(),
            _ => return None,
        };
        let made = Scene { regions: made_for.to_vec(), ..scene.clone() };
        let [(from, before), (to, now)] = [&made, scene].map(|s| interfaces(s, top));
        let heights: Vec<[f64; 2]> = from.into_iter().zip(to).map(|(from, to)| [from, to]).collect();
        let stretched = |h: &[[f64; 2]]| (1.0 / MOST_STRETCHED..=MOST_STRETCHED).contains(&stretch(h[0], h[1]));
        (before? == now? && heights.windows(2).all(stretched)).then_some(Self { heights })
    }

    /// How many times as thick or as thin a layer becomes at most.
    pub(crate) fn most(&self) -> f64 {
        self.heights.windows(2).map(|h| stretch(h[0], h[1])).map(|s| s.max(1.0 / s)).fold(1.0, f64::max)
    }

    /// The part of the body that a height in the cloud lies in.
    fn part(&self, z: f64) -> [[f64; 2]; 2] {
        let k = self.heights.partition_point(|[from, _]| *from <= z).clamp(1, self.heights.len() - 1);
        [self.heights[k - 1], self.heights[k]]
    }

    /// Where a height of the cloud is in the scene, m.
    pub(crate) fn height(&self, z: f64) -> f64 {
        let [a, b] = self.part(z);
        // an end keeps its own digits
        if z == b[0] { b[1] } else { a[1] + stretch(a, b) * (z - a[0]) }
    }

    /// The height of the cloud that is at one of the scene, m.
    pub(crate) fn back(&self, z: f64) -> f64 {
        let inverse = Self { heights: self.heights.iter().map(|[from, to]| [*to, *from]).collect() };
        inverse.height(z)
    }

    /// Moves points of the cloud.
    pub(crate) fn places(&self, points: &[[f64; 3]]) -> Vec<[f64; 3]> {
        points.iter().map(|&[x, y, z]| [x, y, self.height(z)]).collect()
    }

    /// Stretches the shape functions and volumes of a table over cells, in the cloud.
    pub(crate) fn stretch<const K: usize>(&self, table: &mut ShapeTable, points: &[[f64; 3]], cells: &[[u32; K]]) {
        for p in 0..table.volume.len() {
            let centre = cells[table.cell[p] as usize].iter().map(|&n| points[n as usize][2]).sum::<f64>() / K as f64;
            let [a, b] = self.part(centre);
            let s = stretch(a, b);
            table.volume[p] *= s;
            let row = table.start[p] as usize..table.start[p + 1] as usize;
            table.gradient[row].iter_mut().for_each(|g| g[2] /= s);
        }
    }
}

/// Where a point of the scene is in the cloud, m.
pub(super) fn back(moved: Option<&Moved>, [x, y, z]: [f64; 3]) -> [f64; 3] {
    [x, y, moved.map_or(z, |moved| moved.back(z))]
}

fn stretch(a: [f64; 2], b: [f64; 2]) -> f64 {
    (b[1] - a[1]) / (b[0] - a[0])
}

/// Heights of the base, of the interfaces between materials and of the top, ascending, and the materials between them; `None` of these
/// where there are other regions than layers.
fn interfaces(scene: &Scene, top: f64) -> (Vec<f64>, Option<Vec<&str>>) {
    let ends = scene.regions.iter().map(|r| match &r.shape {
        RegionShape::Layer { from_depth, to_depth } => Some([top - to_depth.get(), top - from_depth.get()]),
        _ => None,
    });
    let Some(ends) = ends.collect::<Option<Vec<_>>>() else { return (Vec::new(), None) };
    let mut heights: Vec<f64> = ends.into_iter().flatten().filter(|z| *z > 0.0 && *z < top).chain([0.0, top]).collect();
    heights.sort_by(f64::total_cmp);
    heights.dedup();
    let material = |z: f64| match regions::at(scene, top, [0.0, 0.0, z]) {
        0 => "",
        region => scene.regions[usize::from(region) - 1].material.as_str(),
    };
    let mut kept = vec![0.0];
    let mut materials = Vec::new();
    for part in heights.windows(2) {
        let own = material(0.5 * (part[0] + part[1]));
        if materials.last() == Some(&own) {
            kept.pop();
        } else {
            materials.push(own);
        }
        kept.push(part[1]);
    }
    (kept, Some(materials))
}
