//! `[correction]`: what the answers of a coarse cloud lack against those of a finer one, learnt offline along the scene's own path
//! (`needle_twin tune --correct`), depth by depth. How it is applied: [`crate::twin::Similarity`].

use xxhash_rust::xxh3::xxh3_64;

use super::check::Check;
use super::section::{Scope, Section as _, section};
use super::values::Values;
use super::{Key, Range, Sample, Scene, SceneError, Value, keys};

/// Most depths.
const MOST_DEPTHS: usize = 100;
/// Most numbers of a list.
const MOST_NUMBERS: usize = 100_000;
/// Between which they can be written; what they can be: scales and turns ([`Correction::SCALES`], [`Correction::LARGEST_TURN`]).
const NUMBER: Range = Range::closed(-10.0, 10.0);
/// Sections whose keys make the problem and the cloud.
const OF_CLOUD: [&str; 5] = ["sample", "regions", "instrument", "discretisation", "targets"];
/// What may be changed in a correction.
const APPLY: &str = "correction.apply";
const CHECKSUM: &str = "correction.checksum";
/// What to do with one that is none.
const REMEDY: &str = "learn it again with `needle_twin tune --correct`, or set correction.apply = false";
/// A mesh may be moved with its scene.
const MOVABLE: &str = "sample.mesh";
/// How deep the cloud is made for.
const DEPTH: &str = "motion.depth_m";

section! {
    /// What force and targets of a coarse cloud lack, by depth.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Correction when |values| values.has_section("correction") => {
        /// Whether it is applied; without it the answers are the cloud's own.
        apply: bool = Key::boolean(APPLY).or("true"),
        /// What it was learnt from, in a few words.
        learnt_from: String = Key::text("correction.learnt_from").or("a finer cloud"),
        /// What was left in a run that it was not learnt from, of the force or of a target's motion; 0: not known.
        left: f64 = Key::real("correction.left", Range::closed(0.0, 1.0), "").or("0.0"),
        /// Digest of the keys of sample, regions, instrument, discretisation and targets that it was learnt with, less those that change while
        /// running.
        of: String = Key::text("correction.of"),
        /// Digest of the mesh file that it was learnt with, if there was one.
        mesh: String = Key::text("correction.mesh").or(""),
        /// Depths for which it is known, rising; between two it is their mean, beyond the last the last.
        depths: Vec<f64> = Key::list("correction.depths_m", Range::above(0.0, 1.0), MOST_DEPTHS, "m"),
        /// Of the force, for each depth its scale and the vector of its rotation (axis times angle, rad): 4 numbers.
        force: Vec<f64> = Key::list("correction.force", NUMBER, MOST_NUMBERS, ""),
        /// The same of the displacement of each target in turn, for each depth.
        targets: Vec<f64> = Key::list("correction.targets", NUMBER, MOST_NUMBERS, "").or("[]"),
        /// Digest of all of the section but `apply`. `tune --correct` writes it; a section that was changed by hand or `--set` does not match it.
        checksum: String = Key::text(CHECKSUM).or(""),
    }
}

impl Correction {
    /// Numbers of a similarity: its scale, and the vector of its rotation.
    pub const NUMBERS: usize = 4;
    /// Scales that a correction can have: a cloud that is off by more is no model of the finer one, and `tune --correct` refuses to learn from it.
    pub const SCALES: std::ops::RangeInclusive<f64> = 0.5..=2.0;
    /// Largest angle that it can turn a vector by, rad.
    pub const LARGEST_TURN: f64 = 0.5;

    /// Why a sample is not of the mesh file that the correction was learnt with, if it is not.
    #[must_use]
    pub(crate) fn of_another_mesh(&self, sample: &Sample) -> Option<String> {
        let reason = || {
            format!(
                "it was learnt with another content of {}: {REMEDY}",
                sample.shape.mesh().map_or("a mesh", |m| &m.path)
            )
        };
        (self.apply && self.mesh != sample.mesh_digest()).then(reason)
    }

    /// With the checksum of what it says.
    #[must_use]
    pub fn sealed(mut self) -> Self {
        self.checksum = self.digest();
        self
    }

    fn digest(&self) -> String {
        let mut values = Values::new("");
        self.write(&mut values, Scope::Once);
        let counts = |path: &str, _: &Value| path != APPLY && path != CHECKSUM;
        format!("{:016x}", xxh3_64(values.lines(counts).as_bytes()))
    }
}

impl Scene {
    /// Digest of what a [`Correction`] holds for: the problem and the cloud, whatever the constants of the tissue, what changes while running,
    /// and the pace.
    #[must_use]
    pub fn correction_digest(&self) -> String {
        let mut values = Values::new("");
        self.write(&mut values, Scope::Once);
        // a default says nothing, so that a key that a later version adds changes no digest
        let counts = |path: &str, value: &Value| {
            let of_cloud =
                path == "accuracy" || path.split_once('.').is_some_and(|(section, _)| OF_CLOUD.contains(&section));
            let key = keys::find(path);
            let default = key.and_then(|key| key.parse(key.default?, path).ok());
            let live = key.is_some_and(|key| key.live);
            path == DEPTH || of_cloud && !live && path != MOVABLE && default.as_ref() != Some(value)
        };
        format!("{:016x}", xxh3_64(values.lines(counts).as_bytes()))
    }
}

impl Check<'_> {
    /// The lists of a correction fit each other, and it is one of this cloud.
    pub(super) fn correction(&self) -> Result<(), SceneError> {
        let Some(correction) = self.scene.correction.as_ref().filter(|c| c.apply) else { return Ok(()) };
        let depths = correction.depths.len();
        if depths == 0 || correction.depths.windows(2).any(|w| w[0] >= w[1]) {
            return self.refuse("correction.depths_m", "it needs one depth at least, and they have to rise".to_owned());
        }
        let targets = self.scene.targets.len();
        for (key, list, each) in [("force", &correction.force, 1), ("targets", &correction.targets, targets)] {
            let wanted = Correction::NUMBERS * depths * each;
            if list.len() != wanted {
                let key = format!("correction.{key}");
                let reason = format!("{depths} depths and {targets} targets make {wanted}");
                let value = format!("{} numbers", list.len());
                return Err(SceneError::Inconsistent { place: self.values.place(&key), key, value, reason });
            }
        }
        let own = self.scene.correction_digest();
        if correction.of != own {
            let reason = format!(
                "it was learnt for other keys of sample, regions, instrument, discretisation, targets or motion.depth_m (this scene has {own}): \
                 {REMEDY}"
            );
            return self.refuse("correction.of", reason);
        }
        self.similarities("correction.force", &correction.force)?;
        self.similarities("correction.targets", &correction.targets)?;
        if correction.checksum != correction.digest() {
            let what = if correction.checksum.is_empty() { "it is not there" } else { "it is not that of the section" };
            let reason = format!(
                "{what}, so the section is not as `needle_twin tune --correct` wrote it: {REMEDY}; nothing else of [correction] may be changed, by \
                 hand or with --set"
            );
            return self.refuse(CHECKSUM, reason);
        }
        Ok(())
    }

    /// Scales and turns are those of a cloud that is a model.
    fn similarities(&self, key: &str, list: &[f64]) -> Result<(), SceneError> {
        for numbers in list.chunks_exact(Correction::NUMBERS) {
            let turn = numbers[1..].iter().map(|w| w * w).sum::<f64>().sqrt();
            if !Correction::SCALES.contains(&numbers[0]) || turn > Correction::LARGEST_TURN {
                let (from, to, most) = (Correction::SCALES.start(), Correction::SCALES.end(), Correction::LARGEST_TURN);
                let reason = format!(
                    "scale {} and a turn by {turn} rad: a correction has scales from {from} to {to} and turns up to {most} rad, since a cloud that \
                     is off by more is no model of the finer one: {REMEDY}",
                    numbers[0]
                );
                let place = self.values.place(key);
                let value = format!("[.. {numbers:?} ..]");
                return Err(SceneError::Inconsistent { place, key: key.to_owned(), value, reason });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::scene::{Base, MeshFile, Shape};

    /// No key says what is in a mesh file.
    #[test]
    fn another_content_of_the_mesh_file_is_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("organ.msh");
        std::fs::write(&path, "one mesh").unwrap();
        let file = MeshFile {
            path: path.to_string_lossy().into_owned(),
            unit_m: 1.0,
            base_group: "base".to_owned(),
            contact_group: "contact".to_owned(),
        };
        let sample = Sample { shape: Shape::Outline(file), base: Base::Bonded };
        let correction = Correction {
            apply: true,
            learnt_from: String::new(),
            left: 0.0,
            of: String::new(),
            mesh: sample.mesh_digest(),
            depths: vec![1e-3],
            force: vec![1.0, 0.0, 0.0, 0.0],
            targets: Vec::new(),
            checksum: String::new(),
        };
        assert_eq!(correction.of_another_mesh(&sample), None);
        std::fs::write(&path, "another mesh").unwrap();
        let said = correction.of_another_mesh(&sample).unwrap();
        assert!(said.contains("organ.msh") && said.contains("tune --correct"), "{said}");
        assert_eq!(Correction { apply: false, ..correction }.of_another_mesh(&sample), None);
    }
}
