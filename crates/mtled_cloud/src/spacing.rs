//! How far apart nodes should be: h(x) = min(far, min over features (h_f + growth · distance to f)).

use crate::domain::Domain;
use crate::error::CloudError;
use crate::path::{Axis, path_shape};
use crate::solid::{Solid, changes};
use crate::vector::{Point, length2};
use std::f64::consts::{PI, SQRT_2};

/// Largest number of nodes that [`crate::generate`] takes on.
pub const MAX_NODES: usize = 2_000_000;
/// Steepest growth of the spacing: neighbouring cells stay within about a factor 1.5 of each other in size.
pub const MAX_GROWTH: f64 = 0.5;
/// Cells per node of a typical cloud.
pub const CELLS_PER_NODE: f64 = 5.5;
/// Memory per node of cloud, shape tables and solver state, in bytes (about 5.5 cells × 30 support nodes × 32 bytes).
pub const BYTES_PER_NODE: f64 = 6000.0;

/// Something that nodes conform to and near which they are dense. Lengths in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Feature {
    /// A ring of nodes exactly at this radius on the top face: edge of a bonded flat indenter.
    ContactRing {
        /// Centre in x, y.
        centre: [f64; 2],
        /// Radius of the ring.
        radius: f64,
        /// Spacing along the ring.
        spacing: f64,
    },
    /// Refines the circular (or rectangular) edge of the top or the base.
    Rim {
        /// Top edge, or that of the base.
        top: bool,
        /// Spacing along the rim.
        spacing: f64,
    },
    /// Refines a disc of the top face, as under the rounded tip of an indenter.
    Patch {
        /// Centre in x, y.
        centre: [f64; 2],
        /// Radius of the disc.
        radius: f64,
        /// Spacing within it.
        spacing: f64,
    },
    /// A needle path from the top face down: nodes in equal horizontal layers, on the axis and on concentric rings, the
    /// outermost at the capture radius. No other node lies within the capture radius.
    Path {
        /// The path's axis.
        axis: Axis,
        /// Radius of the captured cylinder.
        capture_radius: f64,
        /// From the top face to the lowest layer, along the axis.
        length: f64,
        /// Spacing along and across the path; half the capture radius resolves it.
        spacing: f64,
    },
    /// Refines a stretch of a needle's path, its layers and rings, and the cloud round it: where the path enters, or where its tip presses.
    FinePath {
        /// The path's axis.
        axis: Axis,
        /// Where the stretch begins and ends, below the top face.
        depths: [f64; 2],
        /// Radius of the cylinder about it within which the spacing depends on depth alone.
        radius: f64,
        /// Spacing between these depths.
        spacing: f64,
        /// Growth of the spacing per metre of depth from there.
        growth: f64,
    },
    /// A region of another material: nodes lie on its boundary, and no cell reaches across. Of several that hold a point the
    /// first one counts.
    Region {
        /// Its shape.
        solid: Solid,
        /// Spacing at its boundary.
        spacing: f64,
    },
}

impl Feature {
    /// Wanted spacing at the feature.
    pub fn spacing(&self) -> f64 {
        match *self {
            Feature::ContactRing { spacing, .. }
            | Feature::Rim { spacing, .. }
            | Feature::Path { spacing, .. }
            | Feature::Patch { spacing, .. }
            | Feature::FinePath { spacing, .. }
            | Feature::Region { spacing, .. } => spacing,
        }
    }

    /// Distance from a point to the feature in metres.
    pub fn distance(&self, domain: &Domain, p: Point) -> f64 {
        let height = domain.height();
        match *self {
            Feature::ContactRing { centre, radius, .. } => {
                let r = length2(p[0] - centre[0], p[1] - centre[1]);
                length2(r - radius, height - p[2])
            }
            Feature::Rim { top, .. } => {
                let z = if top { height - p[2] } else { p[2] };
                length2(domain.rim_distance([p[0], p[1]]), z)
            }
            Feature::Patch { centre, radius, .. } => {
                let r = length2(p[0] - centre[0], p[1] - centre[1]);
                length2((r - radius).max(0.0), height - p[2])
            }
            Feature::FinePath { axis, radius, depths, .. } => {
                length2((axis.distance(height, p) - radius).max(0.0), outside(depths, height - p[2]))
            }
            Feature::Path { axis, capture_radius, length, .. } => {
                let r = (axis.distance(height, p) - capture_radius).max(0.0);
                length2(r, (height - length / axis.secant() - p[2]).max(0.0))
            }
            Feature::Region { solid, .. } => solid.signed(p).abs(),
        }
    }

    /// Number of nodes that a path has within its capture radius (0 for other features).
    pub fn path_nodes(&self) -> usize {
        match *self {
            Feature::Path { capture_radius, length, spacing, .. } => {
                let (layers, rings) = path_shape(capture_radius, length, spacing);
                (layers + 1) * (1 + 3 * rings * (rings + 1))
            }
            _ => 0,
        }
    }

    /// Vertical distance between the layers of a path, m; `None` for other features.
    #[must_use]
    pub fn layer(&self) -> Option<f64> {
        match *self {
            Feature::Path { axis, capture_radius, length, spacing } => {
                let (layers, _) = path_shape(capture_radius, length, spacing);
                Some(length / axis.secant() / layers as f64)
            }
            _ => None,
        }
    }

    /// Area of the surface at distance s from the feature inside a body that is large: for the prediction of sizes.
    fn offset_area(&self, domain: &Domain, s: f64) -> f64 {
        match *self {
            Feature::ContactRing { radius, .. } => 2.0 * PI * radius * PI * s,
            Feature::Patch { radius, .. } => PI * radius * radius + PI * PI * radius * s + 2.0 * PI * s * s,
            Feature::FinePath { radius, depths: [from, to], .. } => {
                let cap = PI * radius * radius + PI * PI * radius * s + 2.0 * PI * s * s;
                cap + 2.0 * PI * (radius + s) * (to - from)
            }
            Feature::Rim { .. } => {
                let length = match *domain {
                    Domain::Cylinder { radius, .. } | Domain::HalfCylinder { radius, .. } => 2.0 * PI * radius,
                    Domain::Box { size } | Domain::HalfBox { size } => 2.0 * (size[0] + size[1]),
                    Domain::Outline(_) => 0.0,
                };
                length * 0.5 * PI * s
            }
            Feature::Path { capture_radius, length, .. } => {
                2.0 * PI * (capture_radius + s) * length + PI * (capture_radius + s).powi(2)
            }
            // both sides
            Feature::Region { solid, .. } => match solid {
                Solid::Layer { .. } => 4.0 * domain.volume() / domain.height(),
                Solid::Sphere { radius, .. } => 8.0 * PI * (radius + s).powi(2),
                Solid::Cylinder { radius, height, .. } => 4.0 * PI * (radius + s) * (radius + height + s),
                Solid::Box { size: [x, y, z], .. } => 4.0 * (x * y + y * z + z * x),
            },
        }
    }
}

/// Distance of a depth from a stretch of depths, m.
fn outside([from, to]: [f64; 2], depth: f64) -> f64 {
    (depth - to).max(from - depth).max(0.0)
}

/// The spacing of the nodes as a function of position.
#[derive(Clone, Debug, PartialEq)]
pub struct Spacing {
    /// Spacing far from every feature, in metres.
    pub far: f64,
    /// Growth of the spacing per metre of distance from a feature, the same in every direction; in (0, [`MAX_GROWTH`]].
    pub growth: f64,
    /// Features, each with its own spacing.
    pub features: Vec<Feature>,
}

impl Spacing {
    /// Wanted spacing at a point of the domain, in metres.
    pub fn at(&self, domain: &Domain, p: Point) -> f64 {
        let mut h = self.far;
        for f in &self.features {
            h = h.min(match *f {
                Feature::FinePath { .. } => self.refined(f, domain, p),
                _ => f.spacing() + self.growth * f.distance(domain, p),
            });
        }
        domain.outline().map_or(h, |outline| outline.spacing(p, self.growth, h))
    }

    /// Spacing wanted within the regions that hold a point, in metres, if it does not grow there from their boundaries on; infinite outside
    /// of all.
    pub(crate) fn within(&self, p: Point) -> f64 {
        let holding = self.features.iter().filter_map(|f| match f {
            Feature::Region { solid, spacing } if solid.signed(p) <= 0.0 => Some(*spacing),
            _ => None,
        });
        holding.fold(f64::INFINITY, f64::min)
    }

    /// Spacing of the nodes of a needle's path at a depth below the top face, in metres: `spacing`, or less where the path enters or a tip
    /// presses.
    pub(crate) fn along(&self, domain: &Domain, axis: &Axis, spacing: f64, depth: f64) -> f64 {
        let p = axis.section(domain.height(), depth, 0.0, 0.0);
        self.features.iter().map(|f| self.refined(f, domain, p)).fold(spacing, f64::min)
    }

    /// What a fine stretch of a path asks for; infinite for other features.
    fn refined(&self, f: &Feature, domain: &Domain, p: Point) -> f64 {
        let Feature::FinePath { axis, depths, radius, spacing, growth } = *f else { return f64::INFINITY };
        let height = domain.height();
        let r = axis.distance(height, p);
        spacing + growth * outside(depths, height - p[2]) + self.growth * (r - radius).max(0.0)
    }

    /// Depths below the top face at which a needle's path of a length enters the body or passes from one region to another, m.
    #[must_use]
    pub fn passages(&self, domain: &Domain, axis: &Axis, length: f64) -> Vec<f64> {
        let depth = length / axis.secant();
        let curve = |t: f64| axis.section(domain.height(), t * depth, 0.0, 0.0);
        std::iter::once(0.0).chain(self.crossings(&curve).into_iter().map(|t| t * depth)).collect()
    }

    /// Smallest spacing anywhere.
    pub fn finest(&self) -> f64 {
        self.features.iter().map(Feature::spacing).fold(self.far, f64::min)
    }

    /// Number of nodes that this spacing will take, to about 10%: √2 ∫ dV / h³, corrected for the surface.
    /// Absurd spacings are bounded by a formula, so that asking never takes long.
    pub fn predicted_nodes(&self, domain: &Domain) -> f64 {
        let coarse = self.bound(domain);
        if coarse > 20.0 * MAX_NODES as f64 { coarse } else { self.integral(domain) }
    }

    /// Sum of the far field and of every feature's own field.
    fn bound(&self, domain: &Domain) -> f64 {
        let mut sum = SQRT_2 * domain.volume() / self.far.powi(3);
        for f in &self.features {
            let reach = ((self.far - f.spacing()) / self.growth).max(0.0);
            let extent = reach.min(2.0 * domain.half_thickness());
            // Trapezoid rule on a geometric grid of distances: h changes by a tenth at each step.
            let (mut s, mut field) = (0.0, 0.0);
            while s < extent {
                let h = f.spacing() + self.growth * s;
                let step = (0.1 * h / self.growth).min(extent - s).max(1e-12 * extent);
                let mid = s + 0.5 * step;
                field += step * f.offset_area(domain, mid) / (f.spacing() + self.growth * mid).powi(3);
                s += step;
            }
            sum += SQRT_2 * field;
        }
        sum
    }

    /// Adaptive midpoint rule: a block is cut while the spacing varies within it.
    fn integral(&self, domain: &Domain) -> f64 {
        let (low, high) = domain.bounds();
        let mut stack = vec![(low, high, 0u32)];
        let (mut bulk, mut skin) = (0.0, 0.0);
        while let Some((a, b, level)) = stack.pop() {
            let mid = [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2])];
            let size = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
            let diagonal = crate::vector::norm(size);
            let h = self.at(domain, mid);
            let depth = domain.depth_to(mid, diagonal.max(h));
            if depth < -0.5 * diagonal {
                continue;
            }
            let rough = self.growth * diagonal > 0.6 * h && h < self.far + 0.5 * self.growth * diagonal;
            if level < 3 * 3 || (level < 45 && (rough || depth.abs() < 0.5 * diagonal && diagonal > h)) {
                let axis = (0..3).fold(0, |best, k| if size[k] > size[best] { k } else { best });
                let (mut upper, mut lower) = (b, a);
                upper[axis] = mid[axis];
                lower[axis] = mid[axis];
                stack.push((a, upper, level + 1));
                stack.push((lower, b, level + 1));
            } else if depth >= 0.0 {
                let volume = size[0] * size[1] * size[2];
                bulk += volume / h.powi(3);
                if depth < 0.5 * h {
                    // Half a layer more than the bulk's share: nodes sit on the surface itself.
                    skin += volume / h.powi(3);
                }
            }
        }
        SQRT_2 * bulk + skin
    }

    /// Number of nodes that it will take.
    ///
    /// # Errors
    /// A spacing, growth or feature out of its range, or more than [`MAX_NODES`] nodes.
    pub(crate) fn validate(&self, domain: &Domain) -> Result<f64, CloudError> {
        self.validate_features(domain)?;
        self.room_for(self.predicted_nodes(domain))
    }

    /// The number of nodes, if there is room for them.
    ///
    /// # Errors
    /// More than [`MAX_NODES`].
    pub fn room_for(&self, nodes: f64) -> Result<f64, CloudError> {
        self.room_for_cells(nodes, CELLS_PER_NODE, BYTES_PER_NODE)
    }

    /// The same for a kind of cloud with so many cells and bytes per node.
    pub(crate) fn room_for_cells(&self, nodes: f64, cells: f64, bytes: f64) -> Result<f64, CloudError> {
        if nodes.is_finite() && nodes <= MAX_NODES as f64 {
            return Ok(nodes);
        }
        let (cells, gigabytes) = (cells * nodes, bytes * nodes * 1e-9);
        Err(CloudError::TooManyNodes {
            finest: self.finest(),
            far: self.far,
            nodes,
            cells,
            gigabytes,
            limit: MAX_NODES,
        })
    }

    /// Checks spacing, growth and features.
    ///
    /// # Errors
    /// A spacing, growth or feature out of its range.
    pub fn validate_features(&self, domain: &Domain) -> Result<(), CloudError> {
        let fail = |key, value, rule: String| Err(CloudError::OutOfRange { key, value, rule });
        let thick = domain.half_thickness();
        if !(self.far.is_finite() && self.far > 0.0 && self.far <= thick) {
            return fail(
                "spacing",
                self.far,
                format!("give metres in (0, {thick}], half of the sample's smallest extent"),
            );
        }
        if !(self.growth.is_finite() && self.growth > 0.0 && self.growth <= MAX_GROWTH) {
            return fail(
                "growth",
                self.growth,
                format!("give metres per metre in (0, {MAX_GROWTH}]; 0.2 to 0.4 is usual"),
            );
        }
        for f in &self.features {
            let s = f.spacing();
            if !(s.is_finite() && s > 0.0 && s <= self.far) {
                return fail(
                    "edge spacing",
                    s,
                    format!("give metres in (0, {}], the spacing far from the edges", self.far),
                );
            }
            validate_feature(f, domain)?;
        }
        self.validate_pairs()
    }

    /// Region that a point lies in: 0, or one more than the place among the [`Feature::Region`]s of the first that holds it.
    #[must_use]
    pub fn region(&self, p: Point) -> u8 {
        self.solids().position(|solid| solid.signed(p) <= 0.0).map_or(0, |i| i as u8 + 1)
    }

    pub(crate) fn solids(&self) -> impl Iterator<Item = &Solid> {
        self.features.iter().filter_map(|f| match f {
            Feature::Region { solid, .. } => Some(solid),
            _ => None,
        })
    }

    /// Distance to the nearest boundary of a region within a body of this height, m; infinite without one.
    pub(crate) fn interface_distance(&self, height: f64, p: Point) -> f64 {
        self.solids().map(|solid| solid.open(height).signed(p).abs()).fold(f64::INFINITY, f64::min)
    }

    /// Parameters at which a curve passes from one region to another, ascending.
    pub(crate) fn crossings(&self, curve: &dyn Fn(f64) -> Point) -> Vec<f64> {
        changes(&|t| self.region(curve(t))).into_iter().map(|[a, b]| 0.5 * (a + b)).collect()
    }

    /// A needle path must keep clear of contact rings and of other paths, at the top face at least.
    fn validate_pairs(&self) -> Result<(), CloudError> {
        for (i, f) in self.features.iter().enumerate() {
            let Feature::Path { axis, capture_radius, spacing, .. } = *f else { continue };
            let centre = axis.entry;
            for (j, other) in self.features.iter().enumerate() {
                let gap = match *other {
                    Feature::ContactRing { centre: c, radius, .. } => {
                        (length2(c[0] - centre[0], c[1] - centre[1]) - radius).abs() - capture_radius
                    }
                    Feature::Path { axis: Axis { entry: c, .. }, capture_radius: r, .. } if j < i => {
                        length2(c[0] - centre[0], c[1] - centre[1]) - r - capture_radius
                    }
                    _ => continue,
                };
                if gap < spacing {
                    let rule = format!(
                        "the path at ({}, {}) m is {gap} m from a contact ring or another path; leave at least one spacing, {spacing} m",
                        centre[0], centre[1]
                    );
                    return Err(CloudError::OutOfRange { key: "capture radius", value: capture_radius, rule });
                }
            }
        }
        Ok(())
    }
}

/// Features must lie inside the top face and the body, with room for one spacing round them.
fn validate_feature(f: &Feature, domain: &Domain) -> Result<(), CloudError> {
    let positive = |key, value: f64| {
        if value.is_finite() && value > 0.0 {
            Ok(())
        } else {
            Err(CloudError::OutOfRange { key, value, rule: "give a positive length in metres".into() })
        }
    };
    let fits = |key, centre: [f64; 2], value: f64, spacing: f64| {
        let room = domain.rim_distance(centre) - spacing;
        if value <= room {
            Ok(())
        } else {
            let rule = format!(
                "at ({}, {}) m the sample leaves room for at most {room} m with this spacing",
                centre[0], centre[1]
            );
            Err(CloudError::OutOfRange { key, value, rule })
        }
    };
    match *f {
        Feature::ContactRing { centre, radius, spacing } => {
            positive("contact radius", radius)?;
            if spacing > radius {
                let rule = format!("a contact ring of radius {radius} m needs a spacing of at most that");
                return Err(CloudError::OutOfRange { key: "edge spacing", value: spacing, rule });
            }
            fits("contact radius", centre, radius, 0.7 * spacing)
        }
        Feature::Rim { .. } | Feature::Region { .. } => Ok(()),
        Feature::Patch { radius, .. } => positive("contact radius", radius),
        Feature::FinePath { radius, growth, .. } => {
            positive("entry radius", radius)?;
            if growth > 0.0 && growth <= MAX_GROWTH {
                return Ok(());
            }
            let rule = format!("give metres per metre in (0, {MAX_GROWTH}]");
            Err(CloudError::OutOfRange { key: "entry growth", value: growth, rule })
        }
        Feature::Path { axis, capture_radius, length, spacing } => {
            positive("capture radius", capture_radius)?;
            positive("path length", length)?;
            let secant = axis.secant();
            for end in [axis.entry, axis.at(length / secant)] {
                fits("capture radius", end, capture_radius * secant, 1.5 * spacing)?;
            }
            let deepest = domain.length_along(&axis) - spacing;
            if length > deepest {
                let rule = format!("the path may reach {deepest} m into this sample");
                return Err(CloudError::OutOfRange { key: "path length", value: length, rule });
            }
            Ok(())
        }
    }
}
