//! Refuses features that have no room in a body, or come too close to each other.

use super::domain::Domain;
use super::error::CloudError;
use super::path::Axis;
use super::spacing::{Feature, MAX_GROWTH, Spacing};
use super::vector::length2;

impl Spacing {
    /// A needle path must keep clear of contact rings and of other paths, at the top face at least.
    pub(crate) fn validate_pairs(&self) -> Result<(), CloudError> {
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
pub(crate) fn validate_feature(f: &Feature, domain: &Domain) -> Result<(), CloudError> {
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
