//! What the twin needs of a recording: depths or poses, and measured forces, each over time.

use super::Adapter;
use super::foreign::ForeignError;
use super::selection::{Selection, UnknownUnit};
use super::series::{Reading, Series, in_order};
use super::table::{Table, TableError};
use super::topics::{describe, find, force, force_source, no_motion, position_source, topic_error};
use crate::twin::Pose;
use ros2_messages::RosMessage;
use ros2_messages::geometry_msgs::{PoseArray, PoseStamped, WrenchStamped};
use ros2_messages::sensor_msgs::JointState;
use rosbag2_mcap::{BagError, Loss};
use rosbag2_mcap::{BagReader, Topic};
use std::path::{Path, PathBuf};

/// Which topics to take, and which joint. Left out, they are found: by the last part of the name
/// (`/rig/measured_js` is a `measured_js`), or by the type if only one topic has it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TopicNames {
    /// sensor_msgs/JointState: the displacement sensor. Default: a `measured_js`.
    pub joint_state: Option<String>,
    /// geometry_msgs/PoseStamped: the tip's pose. Default: a `measured_cp`.
    pub pose: Option<String>,
    /// geometry_msgs/WrenchStamped: the load cell. Default: a `measured_cf`.
    pub wrench: Option<String>,
    /// The joint whose position is the depth. Default: `insertion`.
    pub joint: String,
    /// Frame that the poses must be in. Default: `sample`.
    pub frame_id: String,
}

impl Default for TopicNames {
    fn default() -> Self {
        Self {
            joint_state: None,
            pose: None,
            wrench: None,
            joint: "insertion".to_owned(),
            frame_id: "sample".to_owned(),
        }
    }
}

/// A depth and when it was measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthSample {
    /// s since [`Recording::origin_ns`].
    pub time_s: f64,
    /// Depth of the tip below the undeformed top surface, m; negative above it.
    pub depth_m: f64,
}

/// A tip pose and when it was measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseSample {
    /// s since [`Recording::origin_ns`].
    pub time_s: f64,
    /// Position of the tip in the frame of the topic, m.
    pub tip: [f64; 3],
    /// Unit vector along the instrument into the sample: the z axis of the tip's frame.
    pub axis: [f64; 3],
}

impl PoseSample {
    /// The pose as the twin takes it.
    #[must_use]
    pub fn pose(&self) -> Pose {
        Pose { tip: self.tip, axis: self.axis }
    }
}

/// Tracked points inside the sample and when they were seen.
#[derive(Clone, Debug, PartialEq)]
pub struct MarkerSample {
    /// s since [`Recording::origin_ns`].
    pub time_s: f64,
    /// Position of each marker in frame `sample`, m; NaN where it was not seen.
    pub positions: Vec<[f64; 3]>,
}

/// A force and when it was measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ForceSample {
    /// s since [`Recording::origin_ns`].
    pub time_s: f64,
    /// Force of the tissue on the instrument as recorded, N.
    pub force_n: [f64; 3],
}

/// The series of a recording. Each is in the order of time, with finite values only.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// What the force is and where it comes from, for reports: the bag, and what it says of itself.
    pub source: String,
    /// Scene that the recording was made for, if the bag says so.
    pub scene: Option<String>,
    /// Time 0 of all series, ns since 1970: the earliest stamp.
    pub origin_ns: i64,
    /// From the displacement sensor; empty without one.
    pub depths: Vec<DepthSample>,
    /// From the tip's pose; empty without one.
    pub poses: Vec<PoseSample>,
    /// From the load cell; empty without one.
    pub forces: Vec<ForceSample>,
    /// Tracked points; empty without them.
    pub markers: Vec<MarkerSample>,
    /// Whether force and position were stamped by one clock, as the rows of one table are.
    pub one_clock: bool,
    /// Topics of the three series, where there are such.
    pub topics: TopicNames,
    /// Frame of the forces, "" where it is not said.
    pub force_frame: String,
    /// What of the bag is lost; not empty: exit code 3.
    pub losses: Vec<Loss>,
    /// What is odd but cost nothing.
    pub warnings: Vec<String>,
}

/// Why a recording can't be had.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordingError {
    /// The bag can't be read, or lacks something.
    #[error(transparent)]
    Bag(#[from] BagError),
    /// A topic is not what the user says it is.
    #[error(transparent)]
    Foreign(#[from] ForeignError),
    /// A unit is none.
    #[error(transparent)]
    Unit(#[from] UnknownUnit),
    /// The table can't be read, or lacks something.
    #[error(transparent)]
    Table(#[from] TableError),
    /// Bags can't be put together.
    #[error("{} is a bag: one bag is a whole recording, and only tables can be several files", .0.display())]
    SeveralBags(PathBuf),
}

/// Series with their stamps in ns, before they have a common origin.
struct Stamped {
    depths: Series<f64>,
    poses: Series<Pose>,
    forces: Series<[f64; 3]>,
    markers: Series<Vec<[f64; 3]>>,
}

impl Recording {
    /// Reads a bag (folder or .mcap), or a recording in one or several tables as text, each with its own clock.
    ///
    /// # Errors
    /// [`RecordingError`]: what can't be opened or told, with what there is and what to do.
    pub fn open(paths: &[PathBuf], said: &Selection) -> Result<Self, RecordingError> {
        match paths {
            [bag] if is_bag(bag) => Self::of_bag(&BagReader::open(bag)?, said),
            _ => match paths.iter().find(|path| is_bag(path)) {
                Some(bag) => Err(RecordingError::SeveralBags(bag.clone())),
                None => Ok(Self::of_tables(&tables(paths, said)?, said)?),
            },
        }
    }

    /// Reads the series of a bag (folder or .mcap).
    ///
    /// # Errors
    /// [`BagError`] if the bag can't be opened, has no topic for depth or pose (the message lists what it has), or
    /// has several that would do.
    pub fn load(path: impl AsRef<Path>, names: &TopicNames) -> Result<Self, BagError> {
        Self::from_reader(&BagReader::open(path)?, names)
    }

    /// As [`Recording::load`], from an opened bag.
    ///
    /// # Errors
    /// As [`Recording::load`].
    pub fn from_reader(bag: &BagReader, names: &TopicNames) -> Result<Self, BagError> {
        let said = Selection { names: names.clone(), ..Selection::default() };
        Self::of_bag(bag, &said).map_err(|error| match error {
            RecordingError::Bag(error) => error,
            // nothing is said that could be wrong
            other => BagError::NotABag { path: bag.name().into(), found: other.to_string(), remedy: String::new() },
        })
    }

    /// As [`Recording::open`], from an opened bag.
    ///
    /// # Errors
    /// As [`Recording::open`].
    pub fn of_bag(bag: &BagReader, said: &Selection) -> Result<Self, RecordingError> {
        let names = &said.names;
        let position = position_source(bag, said)?;
        let force_source = force_source(bag, said)?;
        let joint_state = match &position {
            Some(source) => Some(source.check(bag)?),
            None => find::<JointState>(bag, names.joint_state.as_deref(), "measured_js", &[])?,
        };
        let pose = find::<PoseStamped>(bag, names.pose.as_deref(), "measured_cp", &[])?;
        let wrench = match &force_source {
            Some(source) => Some(source.check(bag)?),
            None => find::<WrenchStamped>(bag, names.wrench.as_deref(), "measured_cf", &["predicted_cf"])?,
        };
        let measured = |t: &Topic| t.type_name == PoseArray::TYPE && t.name.ends_with("measured_targets");
        let targets = bag.topics().iter().position(measured);
        if joint_state.is_none() && pose.is_none() {
            return Err(no_motion(bag).into());
        }
        let mut reading = Reading { bag, losses: bag.losses().to_vec(), warnings: bag.warnings().to_vec() };
        let adapter = Adapter { joint: &names.joint, frame_id: &names.frame_id };
        let depth = |m: JointState| (adapter.depth(&m), m.header);
        let stamped = Stamped {
            depths: match &position {
                Some(source) => reading.series(joint_state, |m| Ok(depth(source.convert(bag, m)?))),
                None => reading.series(joint_state, |m| Ok(depth(bag.decode(m)?))),
            },
            poses: reading.series(pose, |m| {
                let m: PoseStamped = bag.decode(m)?;
                Ok((adapter.pose(&m), m.header))
            }),
            forces: match &force_source {
                Some(source) => reading.series(wrench, |m| Ok(force(source.convert(bag, m)?))),
                None => reading.series(wrench, |m| Ok(force(bag.decode(m)?))),
            },
            markers: reading.series(targets, |m| {
                let m: PoseArray = bag.decode(m)?;
                Ok((marked(&m, &names.frame_id), m.header))
            }),
        };
        if let Some((last, _)) = stamped.markers.0.split_last() {
            let odd = stamped.markers.0.iter().filter(|m| m.1.len() != last.1.len()).count();
            if odd > 0 {
                reading
                    .warnings
                    .push(format!("measured_targets: {odd} messages have another number of markers; left out"));
            }
        }
        let name = |topic: Option<usize>| topic.map(|t| bag.topics()[t].name.clone());
        let mut recording = Self {
            source: describe(bag),
            scene: bag.custom_data("scene").map(str::to_owned),
            one_clock: bag.custom_data("one_clock") == Some("true"),
            topics: TopicNames {
                joint_state: name(joint_state),
                pose: name(pose),
                wrench: name(wrench),
                joint: names.joint.clone(),
                frame_id: names.frame_id.clone(),
            },
            losses: reading.losses,
            warnings: reading.warnings,
            ..Self::of(stamped, said.time_offset_s)
        };
        recording.check(bag, joint_state.or(pose))?;
        Ok(recording)
    }

    /// The recording that one or several tables hold.
    ///
    /// # Errors
    /// [`TableError::Missing`] if none of them has the position.
    pub fn of_tables(read: &[Table], said: &Selection) -> Result<Self, TableError> {
        let columns =
            || read.iter().map(|t| format!("{} has {}", t.file, t.all_columns)).collect::<Vec<_>>().join("; ");
        let missing = |what, option| TableError::Missing { what, option, columns: columns() };
        let moves = |t: &&Table| t.columns.position.is_some() || t.columns.pose.is_some();
        let motion = read.iter().find(moves).ok_or_else(|| missing("position", "--position"))?;
        let cell = read.iter().find(|t| t.columns.force.is_some());
        if [Some(motion), cell].iter().flatten().any(|t| t.columns.time.is_none() && said.rate_hz.is_none()) {
            return Err(missing("time (or give --rate-hz)", "--time"));
        }
        let (mut losses, mut warnings) = (Vec::new(), Vec::new());
        for table in read.iter().filter(|t| t.bad > 0) {
            let first = table.first_bad.as_deref().unwrap_or_default();
            let reason = format!("a cell that is needed is no number, first in {first}");
            losses.push(Loss::Samples { topic: table.file.clone(), count: table.bad, reason });
        }
        let stamped = Stamped {
            depths: (in_order(&motion.file, motion.depths.clone(), &mut losses, &mut warnings), String::new()),
            poses: (in_order(&motion.file, motion.poses.clone(), &mut losses, &mut warnings), String::new()),
            markers: (in_order(&motion.file, motion.markers.clone(), &mut losses, &mut warnings), String::new()),
            forces: cell.map_or_else(Default::default, |t| {
                (in_order(&t.file, t.forces.clone(), &mut losses, &mut warnings), String::new())
            }),
        };
        let files: Vec<&str> = read.iter().map(|t| t.file.rsplit(['/', '\\']).next().unwrap_or(&t.file)).collect();
        let mut recording = Self {
            source: format!("table {}", files.join(" and ")),
            one_clock: cell.is_some_and(|cell| std::ptr::eq(cell, motion)) && said.time_offset_s == 0.0,
            topics: said.names.clone(),
            losses,
            warnings,
            ..Self::of(stamped, said.time_offset_s)
        };
        recording.check_times();
        Ok(recording)
    }

    /// Series with a common origin; the force's stamps are late by so much.
    fn of(stamped: Stamped, late_s: f64) -> Self {
        let Stamped {
            depths: (depths, _),
            poses: (poses, _),
            forces: (mut forces, force_frame),
            markers: (markers, _),
        } = stamped;
        let late_ns = (late_s * 1e9).round() as i64;
        forces.iter_mut().for_each(|(time, _)| *time = time.saturating_sub(late_ns));
        let firsts = [depths.first().map(|s| s.0), poses.first().map(|s| s.0), forces.first().map(|s| s.0)];
        let origin_ns = firsts.into_iter().flatten().min().unwrap_or(0);
        let seconds = |ns: i64| ns.saturating_sub(origin_ns) as f64 * 1e-9;
        let count = markers.last().map_or(0, |m| m.1.len());
        let whole = markers.into_iter().filter(|m| m.1.len() == count);
        let markers = whole.map(|(t, positions)| MarkerSample { time_s: seconds(t), positions }).collect();
        let depth = |&(t, depth_m): &(i64, f64)| DepthSample { time_s: seconds(t), depth_m };
        let pose = |&(t, Pose { tip, axis }): &(i64, Pose)| PoseSample { time_s: seconds(t), tip, axis };
        Self {
            source: String::new(),
            scene: None,
            origin_ns,
            depths: depths.iter().map(depth).collect(),
            poses: poses.iter().map(pose).collect(),
            forces: forces.iter().map(|&(t, force_n)| ForceSample { time_s: seconds(t), force_n }).collect(),
            markers,
            one_clock: false,
            topics: TopicNames::default(),
            force_frame,
            losses: Vec::new(),
            warnings: Vec::new(),
        }
    }

    /// Nothing to drive the twin with is an error; a load cell from another time is said.
    fn check(&mut self, bag: &BagReader, motion: Option<usize>) -> Result<(), BagError> {
        if let (true, true, Some(topic)) = (self.depths.is_empty(), self.poses.is_empty(), motion) {
            let lost: Vec<String> = self.losses.iter().map(ToString::to_string).collect();
            let reason = if lost.is_empty() { "it has no messages".to_owned() } else { lost.join("; ") };
            return Err(topic_error(bag, &bag.topics()[topic], format!("nothing of it can be used: {reason}")));
        }
        self.check_times();
        Ok(())
    }

    /// A load cell from another time is said.
    fn check_times(&mut self) {
        let motion = span(self.depths.iter().map(|s| s.time_s).chain(self.poses.iter().map(|s| s.time_s)));
        let force = span(self.forces.iter().map(|s| s.time_s));
        if let (Some(motion), Some(force)) = (motion, force)
            && (force.0 > motion.1 || motion.0 > force.1)
        {
            self.warnings.push(format!(
                "the load cell ({:.3} to {:.3} s) and the motion ({:.3} to {:.3} s) have no time in common: their stamps are \
                 from different clocks, so there is nothing to compare",
                force.0, force.1, motion.0, motion.1
            ));
        }
    }
}

fn span(times: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    times.fold(None, |span, t| Some(span.map_or((t, t), |(a, b): (f64, f64)| (a.min(t), b.max(t)))))
}

/// Positions of tracked points; one that is not finite was not seen.
fn marked(m: &PoseArray, frame_id: &str) -> Result<Vec<[f64; 3]>, String> {
    let frame = m.header.frame_id.trim_start_matches('/');
    if !frame.is_empty() && frame != frame_id.trim_start_matches('/') {
        return Err(format!(
            "it is in frame `{frame}`, the twin needs `{frame_id}`: transform it, or name the frame (--frame-id)"
        ));
    }
    Ok(m.poses.iter().map(|pose| pose.position.into()).collect())
}

/// Whether a path is a bag: a folder, or an MCAP file.
fn is_bag(path: &Path) -> bool {
    let ends = |end: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(end));
    path.is_dir() || ends("mcap") || ends("db3") || !path.exists()
}

/// Reads the files of a recording.
///
/// # Errors
/// [`TableError`].
pub fn tables(paths: &[PathBuf], said: &Selection) -> Result<Vec<Table>, TableError> {
    paths.iter().enumerate().map(|(number, path)| Table::read(path, said, number)).collect()
}
