//! Regions on the instrument's path: where its tip is.

use crate::scene::{Instrument, InstrumentKind, Scene};
use mtled::cloud::Axis;

use super::body::Body;
use super::tissue::Tissue;
use crate::instrument::{Contact, Phase, Resistance};

/// What lies in no region: of `[material]`.
pub const REST: &str = "sample";
/// Shortest stretch over the height of the body: below, it is round-off.
const SHORTEST: f64 = 1e-6;

/// The regions that an instrument's tip comes through, by depth in the undeformed sample. A needle's tip stands before the
/// material that lay at its depth; plate and indenter stay outside, before what lay at the surface.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Along {
    names: Vec<String>,
    /// Depth at which each stretch begins, m, and its region; ascending.
    stretches: Vec<(f64, u8)>,
    /// Depth at which the tip would come to what is rigid, m, and its region.
    rigid: Option<(f64, u8)>,
}

impl Along {
    /// Of a scene's path through its cells.
    pub(super) fn of(scene: &Scene, tissue: &Tissue, top: f64) -> Self {
        let names = std::iter::once(REST.to_owned()).chain(scene.regions.iter().map(|r| r.name.clone())).collect();
        let Some(instrument) = scene.instrument.as_ref().filter(|_| !tissue.region.is_empty()) else {
            return Self { names, stretches: vec![(0.0, 0)], rigid: None };
        };
        let mut stretches = stretches(instrument, (&tissue.points, &tissue.cells, &tissue.region), top);
        if !matches!(instrument.kind, InstrumentKind::Needle(_)) {
            stretches.truncate(1);
        }
        let rigid = rigid_of(scene, &stretches);
        Self { names, stretches, rigid }
    }

    /// Depth at which the tip would come to a rigid region, m, and its name: no instrument goes further.
    #[must_use]
    pub(crate) fn rigid(&self) -> Option<(f64, &str)> {
        self.rigid.map(|(depth, region)| (depth, self.names[usize::from(region)].as_str()))
    }

    /// Names of the regions, [`REST`] first.
    #[must_use]
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Region that the tip is in, by its place among the [`Along::names`]; `None` outside of the sample. A needle that hasn't
    /// punctured the surface yet stands before it.
    #[must_use]
    pub fn region(&self, depth_m: f64, phase: Phase) -> Option<u8> {
        let depth = match phase {
            Phase::Approach => return None,
            Phase::Indentation => 0.0,
            Phase::Penetration | Phase::Retraction => depth_m,
        };
        let after = self.stretches.partition_point(|(from, _)| *from <= depth);
        self.stretches.get(after.saturating_sub(1)).map(|(_, region)| *region)
    }

    /// What to say of membranes on the path that a needle with friction can't meet, since no layer of its nodes begins there.
    pub(super) fn missed(&self, scene: &Scene, contact: &Contact) -> Vec<String> {
        let Contact::Frictional(needle) = contact else { return Vec::new() };
        let closed = |region: u8| Resistance::of(scene, region, 0.0).puncture > 0.0;
        let missed = self.stretches.iter().filter(|(from, region)| closed(*region) && !needle.meets(*from, *region));
        missed
            .map(|(from, region)| {
                format!(
                    "the membrane of \"{}\" at {from:.6} m on the needle's path is left out: no layer of nodes begins there, \
                     {:.6} m apart as they are; use a smaller discretisation.edge_refinement",
                    self.name_of(*region),
                    needle.layer()
                )
            })
            .collect()
    }

    /// Boundaries below one depth down to another, m, each with the region that begins there.
    pub(crate) fn boundaries(&self, above_m: f64, to_m: f64) -> impl Iterator<Item = (f64, u8)> + '_ {
        self.stretches.iter().copied().filter(move |(from, _)| *from > above_m && *from <= to_m)
    }

    /// Name of each region that the path comes into, and the depth at which it does in the undeformed sample, m.
    pub fn stretches(&self) -> impl Iterator<Item = (&str, f64)> {
        self.stretches.iter().map(|(from, region)| (self.name_of(*region), *from))
    }

    /// Name of a region by its place among the [`Along::names`].
    #[must_use]
    pub fn name_of(&self, region: u8) -> &str {
        self.names.get(usize::from(region)).map_or(REST, String::as_str)
    }

    /// Name of the region that the tip is in; empty outside of the sample.
    #[must_use]
    pub fn name(&self, depth_m: f64, phase: Phase) -> &str {
        self.region(depth_m, phase).map_or("", |region| &self.names[usize::from(region)])
    }
}

/// The first of some stretches that is rigid.
fn rigid_of(scene: &Scene, stretches: &[(f64, u8)]) -> Option<(f64, u8)> {
    let of_rigid = |region: u8| {
        let name = usize::from(region).checked_sub(1).map(|r| &scene.regions[r].material);
        name.is_some_and(|name| scene.materials.iter().any(|m| m.rigid && m.name == *name))
    };
    stretches.iter().copied().find(|(_, region)| of_rigid(*region))
}

/// What to say of a scene whose own motion goes into what is rigid, seen from the cells of its mesh.
pub(super) fn meets_rigid(scene: &Scene, body: &Body) -> Option<String> {
    let (instrument, depth) = (scene.instrument.as_ref()?, scene.motion.as_ref()?.depth.get());
    let stretches = stretches(instrument, (&body.cloud.points, &body.cloud.cells, &body.regions(scene)), body.top);
    let (begins, region) = rigid_of(scene, &stretches).filter(|(begins, _)| *begins < depth)?;
    let needle = matches!(instrument.kind, InstrumentKind::Needle(_));
    Some(Scene::said_of_rigid(&scene.regions[usize::from(region) - 1].name, begins, depth, needle))
}

/// Regions whose boundaries are followed.
pub const FOLLOWED: usize = 8;

/// Where the path passes from one region to another: lengths along its axis from the top, m.
fn stretches(
    instrument: &Instrument,
    (points, cells, region): (&[[f64; 3]], &[[u32; 4]], &[u8]),
    top: f64,
) -> Vec<(f64, u8)> {
    let axis = Axis { entry: instrument.entry.map(|m| m.get()), slope: instrument.slope() };
    let shortest = SHORTEST * top.abs();
    let mut within: Vec<([f64; 2], u8)> = cells
        .iter()
        .zip(region)
        .filter_map(|(c, region)| Some((within(&c.map(|n| points[n as usize]), &axis, top)?, *region)))
        .filter(|([from, to], _)| to - from > shortest && *to > 0.0)
        .collect();
    within.sort_by(|(a, _), (b, _)| a[0].total_cmp(&b[0]));
    let mut found: Vec<(f64, u8)> = Vec::new();
    let mut end = f64::NEG_INFINITY;
    for ([from, to], region) in within {
        if found.last().is_none_or(|(_, last)| *last != region) && to > end + shortest {
            found.push((axis.secant() * from.max(0.0), region));
        }
        end = end.max(to);
    }
    found
}

/// Vertical depths between which an axis is in a tetrahedron, m; `None` if it misses it.
fn within(corners: &[[f64; 3]; 4], axis: &Axis, top: f64) -> Option<[f64; 2]> {
    let at = |depth: f64| {
        let [x, y] = axis.at(depth);
        [x, y, top - depth]
    };
    let span = corners.iter().map(|p| top - p[2]);
    let (mut from, mut to) = span.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), d| (a.min(d), b.max(d)));
    let scale = corners[1..].iter().flat_map(|p| (0..3).map(|k| (p[k] - corners[0][k]).abs())).fold(0.0, f64::max);
    for k in 0..4 {
        let face: [[f64; 3]; 3] = std::array::from_fn(|i| corners[(k + 1 + i) % 4]);
        // of one sign inside: the volume with a point against that with the fourth corner
        let inward = six_volumes(&face, corners[k]).signum();
        let slack = 1e-9 * scale.powi(3);
        let [a, b] = [from, to].map(|depth| inward * six_volumes(&face, at(depth)) + slack);
        match (a < 0.0, b < 0.0) {
            (true, true) => return None,
            (true, false) => from += (to - from) * a / (a - b),
            (false, true) => to = from + (to - from) * a / (a - b),
            (false, false) => {}
        }
    }
    (from < to).then_some([from, to])
}

fn six_volumes([a, b, c]: &[[f64; 3]; 3], p: [f64; 3]) -> f64 {
    let [u, v, w] = [b, c, &p].map(|q| [0, 1, 2].map(|k| q[k] - a[k]));
    u[0] * (v[1] * w[2] - v[2] * w[1]) + u[1] * (v[2] * w[0] - v[0] * w[2]) + u[2] * (v[0] * w[1] - v[1] * w[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_axis_is_in_a_tetrahedron_between_its_faces() {
        let corners = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let [from, to] = within(&corners, &Axis::vertical([0.25, 0.25]), 2.0).unwrap_or_default();
        assert!((from - 1.5).abs() < 1e-6 && (to - 2.0).abs() < 1e-6, "{from} {to}");
        assert_eq!(within(&corners, &Axis::vertical([0.6, 0.6]), 2.0), None);
        let along_an_edge = within(&corners, &Axis::vertical([0.0, 0.0]), 2.0).unwrap_or_default();
        assert!((along_an_edge[0] - 1.0).abs() < 1e-6 && (along_an_edge[1] - 2.0).abs() < 1e-6);
    }
}
