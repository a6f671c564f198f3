//! Consistency of a scene: whether its parts fit together, beyond the ranges of single keys.

use std::collections::BTreeSet;

use super::size::MEMORY_LIMIT;
use super::values::Values;
use super::{Dimension, Instrument, InstrumentKind, Motion, Needle, Scene, SceneError, Shape, Value};

/// Most poses that a scene's own motion may have.
const MOST_POSES: f64 = 1e7;

/// Largest Poisson's ratio for which the law's accuracy was shown (`docs/lab/verification.md`): up to there the force on plate,
/// indenter and needle goes on its flat way to that of an incompressible tissue. At 0.49999 the round-off of the pressure shows,
/// from 0.499999 on it governs.
pub const LARGEST_POISSON_RATIO: f64 = 0.4999;

/// Refuses a scene whose parts contradict each other.
pub(super) fn check(scene: &Scene, values: &Values) -> Result<(), SceneError> {
    let check = Check { scene, values };
    check.mesh()?;
    check.materials()?;
    check.regions()?;
    check.spacing()?;
    check.support()?;
    check.cells()?;
    check.support_nodes()?;
    check.instrument()?;
    check.dimension()?;
    check.stepping()?;
    check.motion()?;
    check.targets()?;
    check.correction()?;
    check.uncertainty()
}

pub(super) struct Check<'a> {
    pub(super) scene: &'a Scene,
    pub(super) values: &'a Values,
}

impl Check<'_> {
    pub(super) fn refuse<T>(&self, key: &str, reason: String) -> Result<T, SceneError> {
        let value = self.values.value(key).map_or_else(|_| "absent".to_owned(), |value: Value| value.to_string());
        Err(SceneError::Inconsistent { place: self.values.place(key), key: key.to_owned(), value, reason })
    }

    /// What can be checked of a mesh without reading it; the twin checks the rest.
    fn mesh(&self) -> Result<(), SceneError> {
        let Some(mesh) = self.scene.sample.shape.mesh() else { return Ok(()) };
        for (key, text) in [
            ("sample.mesh", &mesh.path),
            ("sample.base_group", &mesh.base_group),
            ("sample.contact_group", &mesh.contact_group),
        ] {
            if text.trim().is_empty() {
                return self.refuse(key, "it needs a name".to_owned());
            }
        }
        if mesh.base_group == mesh.contact_group {
            return self.refuse("sample.contact_group", "the base is held and can't be touched as well".to_owned());
        }
        Ok(())
    }

    fn spacing(&self) -> Result<(), SceneError> {
        const KEY: &str = "discretisation.spacing_m";
        let Some(grading) = &self.scene.grading() else { return Ok(()) };
        let spacing = grading.spacing.get();
        if !spacing.is_finite() {
            let reason = "an outline needs a number: its size is not known before its file is read. A seventh of its thickness is a start";
            return self.refuse(KEY, reason.to_owned());
        }
        let least = smallest_size(&self.scene.sample.shape);
        if spacing > 0.5 * least {
            return self.refuse(
                KEY,
                format!("too coarse: at most {} m, half of the sample's smallest size of {least} m", 0.5 * least),
            );
        }
        let size = self.scene.estimate();
        if let Some(size) = size.filter(|size| size.bytes > MEMORY_LIMIT) {
            return self.refuse(
                KEY,
                format!(
                    "too fine: about {:.1e} nodes and {:.1e} GB of memory, more than the {} GB allowed; \
                     this sample takes at least {:.1e} m",
                    size.nodes,
                    size.bytes / 1e9,
                    MEMORY_LIMIT / 1e9,
                    self.scene.least_spacing(grading).get() * 1.05 // the message rounds; what it says must be accepted
                ),
            );
        }
        Ok(())
    }

    fn support(&self) -> Result<(), SceneError> {
        match self.scene.discretisation.support_factor {
            factor if factor > 0.0 && factor <= 1.0 => self.refuse(
                "discretisation.support_factor",
                "must be above 1: a smaller support does not reach the next node; 0 takes the method's own".to_owned(),
            ),
            _ => Ok(()),
        }
    }

    fn instrument(&self) -> Result<(), SceneError> {
        let Some(instrument) = self.scene.instrument else { return Ok(()) };
        match instrument.kind {
            InstrumentKind::Plate => Ok(()),
            InstrumentKind::Indenter { diameter, .. } => {
                self.within_top_face("instrument.diameter_m", &instrument, 0.5 * diameter.get())
            }
            InstrumentKind::Needle(needle) => {
                let (diameter, radius) = (needle.diameter.get(), needle.capture_radius.get());
                if radius < 0.5 * diameter {
                    return self.refuse(
                        "instrument.capture_radius_m",
                        format!("less than the needle's radius of {} m (instrument.diameter_m / 2)", 0.5 * diameter),
                    );
                }
                if needle.capture_window.get() > 2.0 * radius {
                    let most = 2.0 * radius;
                    return self.refuse(
                        "instrument.capture_window_m",
                        format!("more than twice the capture radius, {most} m: tissue that it holds in part makes the force too small"),
                    );
                }
                self.within_top_face("instrument.capture_radius_m", &instrument, radius)?;
                self.tip(&instrument, &needle)?;
                self.bending(&needle)?;
                self.path(&instrument, radius)
            }
        }
    }

    /// A bevel's push is known.
    fn tip(&self, instrument: &Instrument, needle: &Needle) -> Result<(), SceneError> {
        let Some(bevel) = needle.bevel else { return Ok(()) };
        let cut =
            self.scene.materials.iter().any(|m| m.pierced.cutting_force > 0.0 || m.pierced.fracture_toughness > 0.0);
        if bevel.force.is_none() && !instrument.is_frictional() && !cut {
            let reason = "a kinematic needle has no cutting force of which that could be a part: give the force in N with which the \
                          bevel pushes the tip aside, or set instrument.interaction = \"frictional\" with instrument.cutting_force_n";
            return self.refuse("instrument.bevel_force_n", reason.to_owned());
        }
        Ok(())
    }

    /// A needle that bends is a tube which reaches from the driver, through a template, into the tissue.
    fn bending(&self, needle: &Needle) -> Result<(), SceneError> {
        let Some(flexible) = needle.flexible else { return Ok(()) };
        let outer = flexible.outer_diameter.unwrap_or(needle.diameter).get();
        if flexible.inner_diameter.get() >= outer {
            let reason = format!("the tube has no wall: its outer diameter is {outer} m");
            return self.refuse("instrument.inner_diameter_m", reason);
        }
        let depth = self.scene.motion.map_or(0.0, |m| m.depth.get());
        if flexible.length.get() <= depth {
            let reason = format!("the driver's clamp would come to the tissue: motion.depth_m is {depth}");
            return self.refuse("instrument.length_m", reason);
        }
        let (Some(guide), Some(height)) = (flexible.guide_z, self.scene.sample.shape.height()) else { return Ok(()) };
        let (guide, top) = (guide.get(), height.get());
        if guide < top {
            return self.refuse("instrument.guide_z_m", format!("within the sample, whose top is at {top} m"));
        }
        let clamp = top + flexible.length.get() - depth;
        if guide >= clamp {
            let reason = format!("the driver's clamp would come to the template: at motion.depth_m it is at {clamp} m");
            return self.refuse("instrument.guide_z_m", reason);
        }
        Ok(())
    }

    /// The disc of this radius round the entry point lies in the top face.
    fn within_top_face(&self, key: &str, instrument: &Instrument, radius: f64) -> Result<(), SceneError> {
        let (fits, face) = self.disc_fits(instrument.entry.map(|e| e.get()), radius);
        if fits {
            return Ok(());
        }
        self.refuse(
            key,
            format!(
                "the instrument's disc of radius {radius} m round its entry point ({}, {}) m reaches beyond the \
                 sample's top face {face}",
                instrument.entry[0].get(),
                instrument.entry[1].get()
            ),
        )
    }

    /// Whether a horizontal disc lies in the sample, and what the sample's face is.
    fn disc_fits(&self, centre: [f64; 2], radius: f64) -> (bool, String) {
        let [x, y] = centre.map(f64::abs);
        match &self.scene.sample.shape {
            Shape::Cylinder { diameter, .. } => (
                x.hypot(y) + radius <= 0.5 * diameter.get() * (1.0 + 1e-12),
                format!("of diameter {} m (sample.diameter_m)", diameter.get()),
            ),
            Shape::Box { size_x, size_y, .. } => (
                x + radius <= 0.5 * size_x.get() * (1.0 + 1e-12) && y + radius <= 0.5 * size_y.get() * (1.0 + 1e-12),
                format!("of {} m by {} m (sample.size_x_m, sample.size_y_m)", size_x.get(), size_y.get()),
            ),
            Shape::Mesh(_) | Shape::Outline(_) => (true, String::new()), // the twin looks at the contact group
        }
    }

    /// The path of an oblique needle stays in the sample as deep as the scene's own motion goes.
    fn path(&self, instrument: &Instrument, radius: f64) -> Result<(), SceneError> {
        let (slope, depth) = (instrument.slope(), self.scene.motion.map_or(0.0, |m| m.depth.get()));
        let secant = (1.0 + slope[0] * slope[0] + slope[1] * slope[1]).sqrt();
        let end: [f64; 2] = std::array::from_fn(|k| instrument.entry[k].get() + slope[k] * depth / secant);
        let (fits, _) = self.disc_fits(end, radius * secant);
        if fits {
            return Ok(());
        }
        let [x, y] = end;
        self.refuse(
            "instrument.tilt_rad",
            format!("the path leaves the sample: at motion.depth_m = {depth} it has come to ({x:.6}, {y:.6}) m"),
        )
    }

    fn dimension(&self) -> Result<(), SceneError> {
        const KEY: &str = "discretisation.dimension";
        let reason = match self.scene.discretisation.dimension {
            Dimension::Axisymmetric => self.scene.asymmetry(),
            Dimension::Mirrored => self.scene.plane_of_symmetry().err(),
            Dimension::Auto | Dimension::Full => None,
        };
        match reason {
            Some(reason) => self.refuse(KEY, format!("{reason}: use full or auto")),
            None => Ok(()),
        }
    }

    fn stepping(&self) -> Result<(), SceneError> {
        let stepping = &self.scene.stepping;
        if stepping.min_steps_per_pose > stepping.max_steps_per_pose {
            return self.refuse(
                "stepping.min_steps_per_pose",
                format!("more than stepping.max_steps_per_pose = {}", stepping.max_steps_per_pose),
            );
        }
        Ok(())
    }

    fn motion(&self) -> Result<(), SceneError> {
        let Some(motion) = &self.scene.motion else { return Ok(()) };
        if let Some(height) = self.scene.sample.shape.height()
            && motion.depth >= height
        {
            return self.refuse("motion.depth_m", format!("must be less than sample.height_m = {}", height.get()));
        }
        self.start(motion)?;
        if motion.pose_count() > MOST_POSES {
            return self.refuse(
                "motion.speed_m_per_s",
                format!(
                    "depth_m, speed_m_per_s, pose_hz and hold_s make {:.1e} poses; at most {MOST_POSES:.0e} are allowed",
                    motion.pose_count()
                ),
            );
        }
        Ok(())
    }

    /// Only a frictional needle can be in place before the first pose.
    fn start(&self, motion: &Motion) -> Result<(), SceneError> {
        const KEY: &str = "motion.start_depth_m";
        if motion.start_depth.get() == 0.0 {
            return Ok(());
        }
        if !self.scene.instrument.is_some_and(|i| i.is_frictional()) {
            return self.refuse(
                KEY,
                "only a needle with instrument.interaction = \"frictional\" can be in place at first".to_owned(),
            );
        }
        if motion.start_depth > motion.depth {
            return self.refuse(KEY, format!("must be at most motion.depth_m = {}", motion.depth.get()));
        }
        Ok(())
    }

    fn targets(&self) -> Result<(), SceneError> {
        let mut names = BTreeSet::new();
        for (i, target) in self.scene.targets.iter().enumerate() {
            if target.name.trim().is_empty() {
                return self.refuse(&format!("targets.{i}.name"), "a target needs a name".to_owned());
            }
            if !names.insert(target.name.as_str()) {
                return self.refuse(&format!("targets.{i}.name"), "two targets have this name".to_owned());
            }
            if !is_inside(&self.scene.sample.shape, target.position) {
                let extent = extent(&self.scene.sample.shape);
                return self.refuse(
                    &format!("targets.{i}.position_m"),
                    format!("target \"{}\" is outside the sample, which is {extent}", target.name),
                );
            }
        }
        Ok(())
    }
}

fn smallest_size(shape: &Shape) -> f64 {
    match shape {
        Shape::Cylinder { diameter, height } => diameter.get().min(height.get()),
        Shape::Box { size_x, size_y, height } => size_x.get().min(size_y.get()).min(height.get()),
        Shape::Mesh(_) | Shape::Outline(_) => f64::INFINITY,
    }
}

pub(super) fn is_inside(shape: &Shape, [x, y, z]: [f64; 3]) -> bool {
    let (within, height) = match shape {
        Shape::Cylinder { diameter, height } => (x.hypot(y) <= 0.5 * diameter.get(), height),
        Shape::Box { size_x, size_y, height } => {
            (x.abs() <= 0.5 * size_x.get() && y.abs() <= 0.5 * size_y.get(), height)
        }
        Shape::Mesh(_) | Shape::Outline(_) => return true, // the twin looks for the cell
    };
    within && (0.0..=height.get()).contains(&z)
}

fn extent(shape: &Shape) -> String {
    match shape {
        Shape::Cylinder { diameter, height } => {
            format!("x^2 + y^2 <= ({} m)^2 and z in [0, {}] m", 0.5 * diameter.get(), height.get())
        }
        Shape::Box { size_x, size_y, height } => {
            format!("|x| <= {} m, |y| <= {} m and z in [0, {}] m", 0.5 * size_x.get(), 0.5 * size_y.get(), height.get())
        }
        Shape::Mesh(mesh) | Shape::Outline(mesh) => format!("the mesh {}", mesh.path),
    }
}
