//! Synthetic recordings of the rig: depth and force as its sensors would read them for a given motion.
//!
//! The force is that of the independent finite-element curves in `bags/reference/` at the true depth. Depth and force
//! then pass through the sensor models of [`crate::sensors`]. Nothing here is a measurement.

mod curve;
mod motion;

use crate::sensors::{DisplacementModel, DisplacementSensor, LoadCell, LoadCellModel};
pub use curve::Curve;
use motion::Motion;
use ros2_messages::builtin_interfaces::Time;
use ros2_messages::geometry_msgs::{Vector3, Wrench, WrenchStamped};
use ros2_messages::sensor_msgs::JointState;
use ros2_messages::std_msgs::Header;
use rosbag2_mcap::BagError;
use rosbag2_mcap::Qos;
use rosbag2_mcap::{BagWriter, WriterOptions, Written};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// Stamp of the first reading: 2026-01-01 00:00:00 UTC, ns since 1970.
const START_NS: i64 = 1_767_225_600_000_000_000;
/// The load cell is read this fraction of a period after the displacement sensor (2 ms at 200 Hz): they are not
/// synchronised.
const FORCE_DELAY: f64 = 0.4;
/// Delay between a reading and its reception and logging, ns.
const TRANSPORT_NS: i64 = 300_000;
/// Longest recording, s.
const LONGEST_S: f64 = 3600.0;

/// One of the source paper's three tests.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RigScene {
    /// Bonded plate.
    Compression,
    /// Bonded flat indenter.
    Indentation,
    /// Kinematic needle, capture radius 0.5 mm, incremental deformation coefficient 0.4.
    NeedleInsertion,
}

impl RigScene {
    /// All three.
    pub const ALL: [Self; 3] = [Self::Compression, Self::Indentation, Self::NeedleInsertion];

    /// Name of the preset scene.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Compression => "compression",
            Self::Indentation => "indentation",
            Self::NeedleInsertion => "needle_insertion",
        }
    }

    /// Force over depth during insertion, from the independent solutions in `bags/reference/`.
    #[must_use]
    pub fn curve(self) -> Curve {
        Curve::from_table(match self {
            Self::Compression => include_str!("../../bags/reference/compression_force.csv"),
            Self::Indentation => include_str!("../../bags/reference/indentation_force.csv"),
            Self::NeedleInsertion => include_str!("../../bags/reference/needle_force_capture_radius_0.50mm.csv"),
        })
    }
}

/// Settings of a synthetic recording. All depths are positive into the sample.
#[derive(Clone, Debug, PartialEq)]
pub struct RigRecording {
    /// The test.
    pub scene: RigScene,
    /// Depth to reach, m.
    pub depth_m: f64,
    /// Height above the surface at which the recording starts and ends, m.
    pub approach_m: f64,
    /// Speed of approach and insertion, m/s.
    pub speed_m_per_s: f64,
    /// Speed of retraction, m/s.
    pub retraction_speed_m_per_s: f64,
    /// Acceleration at the ends of every move, m/s^2.
    pub acceleration_m_per_s2: f64,
    /// Rest at depth, s.
    pub hold_s: f64,
    /// Rest at the start and at the end, s.
    pub rest_s: f64,
    /// Readings per second of each sensor.
    pub rate_hz: f64,
    /// Seed of the noise.
    pub seed: u64,
    /// Displacement sensor.
    pub displacement: DisplacementModel,
    /// Load cell; it measures along the instrument only.
    pub load_cell: LoadCellModel,
}

impl RigRecording {
    /// The settings of the recording in `bags/` for a scene.
    #[must_use]
    pub fn of(scene: RigScene) -> Self {
        let (depth_m, approach_m, retraction_speed_m_per_s, seed) = match scene {
            RigScene::Compression => (0.0025, 0.0005, 0.001, 1),
            // The reference is converged to 0.45 % up to here.
            RigScene::Indentation => (0.004, 0.0005, 0.001, 2),
            RigScene::NeedleInsertion => (0.010, 0.001, 0.005, 3),
        };
        Self {
            scene,
            depth_m,
            approach_m,
            speed_m_per_s: 0.001,
            retraction_speed_m_per_s,
            acceleration_m_per_s2: 0.01,
            hold_s: 1.0,
            rest_s: 0.5,
            rate_hz: 200.0,
            seed,
            displacement: DisplacementModel::MAGNETOSTRICTIVE,
            load_cell: LoadCellModel::SUBMINIATURE,
        }
    }

    fn motion(&self) -> Motion {
        let a = self.acceleration_m_per_s2;
        Motion::new()
            .rest(-self.approach_m, self.rest_s)
            .go(-self.approach_m, self.depth_m, self.speed_m_per_s, a)
            .rest(self.depth_m, self.hold_s)
            .go(self.depth_m, -self.approach_m, self.retraction_speed_m_per_s, a)
            .rest(-self.approach_m, self.rest_s)
    }

    /// Checks the range of every number.
    ///
    /// # Errors
    /// [`BagError::OutOfRange`] with the value's name and range.
    pub(crate) fn check(&self) -> Result<(), BagError> {
        let within = |what: &'static str, value: f64, least: f64, most: f64, why: &str| {
            if value >= least && value <= most {
                return Ok(());
            }
            let allowed = format!("{least} to {most}{why}");
            Err(BagError::OutOfRange { what, value: value.to_string(), allowed })
        };
        let deepest = self.scene.curve().max_depth_m();
        within("depth_m", self.depth_m, 1e-6, deepest, " (as deep as the reference force goes)")?;
        within("approach_m", self.approach_m, 0.0, 0.1, "")?;
        within("speed_m_per_s", self.speed_m_per_s, 1e-5, 1.0, "")?;
        within("retraction_speed_m_per_s", self.retraction_speed_m_per_s, 1e-5, 1.0, "")?;
        within("acceleration_m_per_s2", self.acceleration_m_per_s2, 1e-4, 100.0, "")?;
        within("hold_s", self.hold_s, 0.0, 600.0, "")?;
        within("rest_s", self.rest_s, 0.0, 600.0, "")?;
        within("rate_hz", self.rate_hz, 1.0, 10_000.0, "")?;
        within("duration of the recording in s", self.motion().duration_s, 0.0, LONGEST_S, "")
    }

    /// Force of the tissue on the instrument at a true depth, N, positive against the insertion.
    ///
    /// Insertion and retraction have the same curve: the material is elastic, and the needle's constraint is
    /// reversible (captured points follow the tip by a fraction of its displacement since their capture). A real
    /// needle would show friction.
    #[must_use]
    pub fn true_force_n(&self, depth_m: f64) -> f64 {
        self.scene.curve().force_n(depth_m)
    }

    /// True depth at a time since the first reading, m.
    #[must_use]
    pub fn true_depth_m(&self, time_s: f64) -> f64 {
        self.motion().depth_m(time_s)
    }

    /// Metadata in the bag.
    fn custom_data(&self) -> BTreeMap<String, String> {
        let description = format!(
            "synthetic {}: force from finite elements, sensors modelled, seed {}; not a measurement",
            self.scene.name(),
            self.seed
        );
        [
            ("synthetic", "true".to_owned()),
            ("description", description),
            ("scene", self.scene.name().to_owned()),
            ("seed", self.seed.to_string()),
        ]
        .map(|(key, value)| (key.to_owned(), value))
        .into()
    }

    /// Writes the recording as a rosbag2 folder. No files remain if that fails.
    ///
    /// # Errors
    /// [`BagError::OutOfRange`], [`BagError::Exists`], or an error of writing.
    pub fn write(&self, folder: impl AsRef<Path>) -> Result<Written, BagError> {
        self.check()?;
        let folder = folder.as_ref();
        let open = |path: &Path, source| BagError::Open { path: path.to_path_buf(), source };
        if fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_some()) || folder.is_file() {
            return Err(BagError::Exists { path: folder.to_path_buf() });
        }
        let Some(name) = folder.file_name().map(|n| n.to_string_lossy().into_owned()) else {
            return Err(BagError::Exists { path: folder.to_path_buf() });
        };
        // Written under a temporary name and renamed, so that the folder never exists incomplete.
        let aside = folder.with_file_name(format!(".{name}.new"));
        if aside.exists() {
            fs::remove_dir_all(&aside).map_err(|e| open(&aside, e))?;
        }
        let written = self.write_named(&aside, &name).and_then(|written| {
            if folder.is_dir() {
                fs::remove_dir(folder).map_err(|e| open(folder, e))?;
            }
            fs::rename(&aside, folder).map_err(|e| open(folder, e))?;
            Ok(Written { folder: folder.to_path_buf(), ..written })
        });
        // The message must name `folder`, since the user does not know the temporary one.
        let written = written.map_err(|error| match error {
            BagError::Open { path, source } if path.starts_with(&aside) => open(folder, source),
            other => other,
        });
        if written.is_err() {
            let _ = fs::remove_dir_all(&aside);
        }
        written
    }

    fn write_named(&self, folder: &Path, name: &str) -> Result<Written, BagError> {
        let (custom_data, library) = (self.custom_data(), needle_core::WRITER.to_owned());
        let options = WriterOptions {
            chunk_bytes: 128 << 10,
            flush_after: None,
            custom_data,
            library,
            ..WriterOptions::default()
        };
        let mut bag = BagWriter::create_named(folder, name, options)?;
        let depth_topic = bag.add_topic::<JointState>("/measured_js", &Qos::reliable(10))?;
        let force_topic = bag.add_topic::<WrenchStamped>("/measured_cf", &Qos::reliable(10))?;
        let (motion, curve) = (self.motion(), self.scene.curve());
        let mut sensor = DisplacementSensor::new(self.displacement, self.seed);
        let mut cell = LoadCell::new(self.load_cell, self.seed);
        let readings = (motion.duration_s * self.rate_hz).floor() as i64 + 1;
        for i in 0..readings {
            let since_ns = (i as f64 * 1e9 / self.rate_hz).round() as i64;
            let depth_m = sensor.read(motion.depth_m(since_ns as f64 * 1e-9));
            let (stamp, logged) = times(since_ns);
            let header = Header { stamp, frame_id: String::new() };
            let (name, position) = (vec!["insertion".to_owned()], vec![depth_m]);
            bag.write(depth_topic, logged, logged, &JointState { header, name, position, ..JointState::default() })?;

            let since_ns = since_ns + (FORCE_DELAY * 1e9 / self.rate_hz).round() as i64;
            let time_s = since_ns as f64 * 1e-9;
            let z = cell.read(curve.force_n(motion.depth_m(time_s)), time_s);
            let (stamp, logged) = times(since_ns);
            let header = Header { stamp, frame_id: "sample".to_owned() };
            let wrench = Wrench { force: Vector3 { x: 0.0, y: 0.0, z }, torque: Vector3::default() };
            bag.write(force_topic, logged, logged, &WrenchStamped { header, wrench })?;
        }
        bag.finish()
    }
}

/// Stamp and log time of a reading.
fn times(since_ns: i64) -> (Time, u64) {
    let stamp = START_NS + since_ns;
    (Time::from_nanos(stamp), (stamp + TRANSPORT_NS) as u64)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn values_out_of_range_are_named() {
        let good = RigRecording::of(RigScene::NeedleInsertion);
        good.check().unwrap();
        for (bad, name) in [
            (RigRecording { depth_m: 0.011, ..good.clone() }, "depth_m: 0.011"),
            (RigRecording { depth_m: f64::NAN, ..good.clone() }, "depth_m: NaN"),
            (RigRecording { depth_m: -0.001, ..good.clone() }, "depth_m: -0.001"),
            (RigRecording { speed_m_per_s: 0.0, ..good.clone() }, "speed_m_per_s: 0"),
            (RigRecording { rate_hz: 1e9, ..good.clone() }, "rate_hz: 1000000000"),
            (RigRecording { speed_m_per_s: 1e-5, depth_m: 0.01, approach_m: 0.1, ..good.clone() }, "duration"),
        ] {
            let error = bad.check().unwrap_err().to_string();
            assert!(error.starts_with(name) && error.contains("allowed is"), "{error}");
        }
    }

    #[test]
    fn force_is_that_of_the_reference() {
        let needle = RigRecording::of(RigScene::NeedleInsertion);
        assert!((needle.true_force_n(0.01) - 0.0674753).abs() < 1e-9);
        assert_eq!(needle.true_force_n(-0.001), 0.0);
        assert!((RigRecording::of(RigScene::Indentation).true_force_n(0.004) - 0.340319).abs() < 1e-9);
        assert!((RigRecording::of(RigScene::Compression).true_force_n(0.0025) - 0.847635).abs() < 1e-9);
    }
}
