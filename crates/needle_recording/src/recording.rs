//! A recording: depths or poses, and measured forces, each over time.

use super::Adapter;
use super::Refusal;
use super::clocks::{self, Census};
use super::error::RecordingError;
use super::foreign::{Posed, WRENCHES, poses_of, wrench_of};
use super::frame::Frames;
use super::holes::Holes;
use super::order::Spread;
use super::sample::{DepthSample, ForceSample, MarkerSample, PoseSample, Sample, first};
use super::selection::{Selection, TopicNames};
use super::series::{self, Held, Reading, Series, in_order};
use super::table::{Survey, Table, TableError, refuse_options};
use super::topics::{self, describe, force_source, no_motion, position_source, topic_error};
use super::unit::Dimension;
use super::zigzag::Zigzag;
use needle_core::instrument::reading::MeasuredAxes;
use needle_core::twin::Pose;
use ros2_messages::RosMessage;
use ros2_messages::geometry_msgs::PoseArray;
use ros2_messages::std_msgs::Header;
use rosbag2_mcap::{BagError, Loss};
use rosbag2_mcap::{BagReader, Topic};
use std::cell::RefCell;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// A force this many times as large as all others is no reading.
const SENTINEL: f64 = 100.0;
/// Readings of two sources that are nearer to each other are as good as one.
const LEAST_JUMP_M: f64 = 5e-6;
const LEAST_JUMP_N: f64 = 1e-4;
/// Forces that jump by less of their range may be one cell's, with the hum of the mains.
const HUM: f64 = 0.1;
/// Readings of a series in which these are sought.
const LOOKED_AT: usize = 1 << 20;
/// Share of the time of a motion without a force that is worth a warning.
const MUCH: f64 = 0.1;

/// The series of a recording. Each is in order of time, with finite values only.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// Source of the force, for reports: the bag and its description.
    pub source: String,
    /// Scene that the recording was made for, if the bag names one.
    pub scene: Option<String>,
    /// Time 0 of all series, ns since 1970: the earliest stamp.
    pub origin_ns: i64,
    /// Displacement sensor; empty without one.
    pub depths: Vec<DepthSample>,
    /// Tip's pose; empty without one.
    pub poses: Vec<PoseSample>,
    /// Load cell; empty without one.
    pub forces: Vec<ForceSample>,
    /// Tracked points; empty without them.
    pub markers: Vec<MarkerSample>,
    /// Whether force and position were stamped by one clock, like the rows of one table.
    pub one_clock: bool,
    /// Topics of the three series, if they exist.
    pub topics: TopicNames,
    /// Frame of the forces, "" if it is unknown.
    pub force_frame: String,
    /// Depth in m per unit of the recorded position, and the recorded number at depth 0.
    pub position_scale: [f64; 2],
    /// Intervals without recorded data during which the instrument may have moved, from and to, s.
    pub holes: Vec<[f64; 2]>,
    /// Losses of data; if there are any, the exit code is 3.
    pub losses: Vec<Loss>,
    /// Irregularities without a loss of data.
    pub warnings: Vec<String>,
}

/// Series with their stamps in ns, before the common origin is subtracted.
#[derive(Default)]
struct Stamped {
    depths: Series<f64>,
    poses: Series<Pose>,
    forces: Series<[f64; 3]>,
    markers: Series<Vec<[f64; 3]>>,
}

impl Stamped {
    /// Whether depths (0), poses (1) or forces (2) are those of two sources.
    fn zigzag(&self, series: usize) -> Option<Zigzag> {
        match series {
            0 => Zigzag::of_axes(&[self.depths.0.iter().take(LOOKED_AT).map(|s| s.1).collect()], LEAST_JUMP_M),
            1 => {
                let axis = |k: usize| self.poses.0.iter().take(LOOKED_AT).map(|s| s.1.tip[k]).collect();
                Zigzag::of_axes(&[0, 1, 2].map(axis), LEAST_JUMP_M)
            }
            _ => {
                let axis = |k: usize| self.forces.0.iter().take(LOOKED_AT).map(|s| s.1[k]).collect();
                Zigzag::of_axes(&[0, 1, 2].map(axis), LEAST_JUMP_N)
            }
        }
    }
}

impl Recording {
    /// Reads a bag (folder or .mcap), or a recording in one or several text tables, each with its own clock.
    ///
    /// # Errors
    /// [`RecordingError`] if the input can't be opened or is ambiguous. The message lists what it contains and says
    /// what to do.
    pub fn open(paths: &[PathBuf], said: &Selection) -> Result<Self, RecordingError> {
        match paths {
            [bag] if is_bag(bag) => Self::of_bag(&BagReader::open(bag)?, said),
            _ => match paths.iter().find(|path| is_bag(path)) {
                Some(bag) => Err(RecordingError::SeveralBags(bag.clone())),
                None => Self::of_tables(&mut tables(paths, said)?, said),
            },
        }
    }

    /// Reads the series of a bag (folder or .mcap).
    ///
    /// # Errors
    /// [`BagError`] if the bag can't be opened, has no topic for depth or pose (the message lists its topics), or has
    /// several suitable ones.
    pub fn load(path: impl AsRef<Path>, names: &TopicNames) -> Result<Self, BagError> {
        Self::from_reader(&BagReader::open(path)?, names)
    }

    /// Same as [`Recording::load`], from an opened bag.
    ///
    /// # Errors
    /// As [`Recording::load`].
    pub fn from_reader(bag: &BagReader, names: &TopicNames) -> Result<Self, BagError> {
        let said = Selection { names: names.clone(), ..Selection::default() };
        Self::of_bag(bag, &said).map_err(|error| match error {
            RecordingError::Bag(error) => error,
            // unreachable: the default selection has no options that could be wrong
            other => BagError::NotABag { path: bag.name().into(), found: other.to_string(), remedy: String::new() },
        })
    }

    /// Same as [`Recording::open`], from an opened bag.
    ///
    /// # Errors
    /// As [`Recording::open`].
    pub fn of_bag(bag: &BagReader, said: &Selection) -> Result<Self, RecordingError> {
        let names = &said.names;
        let by_pose = said.position.place.as_deref().is_some_and(|name| topics::is_pose(bag, name));
        let named = said.position.place.is_some();
        let joint_state = if by_pose || named { None } else { topics::joint_state(bag, said)? };
        let pose = match topics::pose(bag, said, joint_state.is_none() && !named) {
            // poses of which none stands out matter only where nothing else gives the motion
            Err(_) if joint_state.is_some() && names.pose.is_none() => None,
            found => found?,
        };
        // poses are used if they are requested, or if there is no depth
        let by_pose = pose.is_some()
            && (by_pose || said.position.place.is_none() && names.joint_state.is_none())
            && (joint_state.is_none() || names.pose.is_some());
        said.fits_a_bag(by_pose)?;
        let position = if by_pose { None } else { position_source(bag, said)? };
        let force_source = force_source(bag, said)?;
        let joint_state = position.as_ref().map_or(Ok(joint_state), |source| source.check(bag).map(Some))?;
        let wrench = match &force_source {
            Some(source) => Some(source.check(bag)?),
            None => topics::wrench(bag, said)?,
        };
        let measured = |t: &Topic| t.type_name == PoseArray::TYPE && t.name.ends_with("measured_targets");
        let targets = bag.topics().iter().position(measured);
        if joint_state.is_none() && pose.is_none() {
            return Err(no_motion(bag).into());
        }
        let frames = Frames::of(said)?;
        let m_per_unit = if by_pose { said.position.scale(Dimension::Length, "--position-unit")? } else { 1.0 };
        let mut reading =
            Reading { bag, losses: bag.losses().to_vec(), warnings: bag.warnings().to_vec(), most: said.most_readings };
        let adapter = Adapter { joint: &names.joint, frame_id: &names.frame_id };
        let depths = reading.gather(joint_state, |message| {
            let m = position.as_ref().map_or_else(|| bag.decode(message), |source| source.convert(bag, message))?;
            let held = match adapter.depth(&m) {
                Err(other @ Refusal::NoSuchJoint { .. }) => Held::Nothing(other),
                depth => depth.into(),
            };
            Ok((held, m.header))
        });
        // a tracker may publish all its tools on one topic
        let tools = RefCell::new(BTreeSet::new());
        let tip = (names.joint != TopicNames::default().joint).then_some(names.joint.as_str());
        let poses = reading.gather(pose, |message| {
            let all = poses_of(bag, message)?;
            let names: Vec<String> = all.iter().map(|m| m.tool.clone()).filter(|tool| !tool.is_empty()).collect();
            let is_tip = |m: &Posed| tip.is_none_or(|tip| m.tool.is_empty() || m.tool == tip);
            let Some(Posed { pose: m, .. }) = all.into_iter().find(is_tip) else {
                let (found, wanted) = (names.join(", "), tip.unwrap_or_default().to_owned());
                return Ok((Held::Nothing(Refusal::OtherTool { found, wanted }), Header::default()));
            };
            tools.borrow_mut().extend(names);
            // any frame is accepted if the user gave the sample's pose in it
            let frame_id = if said.sample_pose.is_some() { &m.header.frame_id } else { adapter.frame_id };
            let in_m = |pose: Pose| frames.pose(Pose { tip: pose.tip.map(|x| m_per_unit * x), ..pose });
            Ok((Adapter { frame_id, ..adapter }.pose(&m).map(in_m).into(), m.header))
        });
        let tools = tools.into_inner();
        if let (Some(topic), None, 2..) = (pose, tip, tools.len()) {
            let all = tools.into_iter().collect::<Vec<_>>().join(", ");
            let reason = format!("it has the poses of several frames, {all}: name that of the tip with --joint");
            return Err(topic_error(bag, &bag.topics()[topic], reason).into());
        }
        if depths.samples.is_empty() && poses.samples.is_empty() {
            reading.lose(&depths.topic, depths.nothing.clone());
            reading.lose(&poses.topic, poses.nothing.clone());
        }
        let mut forces = reading.gather(wrench, |message| {
            let m = match &force_source {
                Some(source) => source.convert(bag, message)?,
                None => wrench_of(bag, message)?,
            };
            Ok((Held::<_, String>::Value(<[f64; 3]>::from(m.wrench.force)), m.header))
        });
        let taken = measured_axes(&forces.topic, &mut reading, forces.samples.iter().map(|s| s.1));
        said.zero_of_a_force(wrench.is_some())?;
        if said.has_force_zero() {
            let across = forces.samples.iter().any(|(_, [x, y, _])| [x, y].iter().any(|f| f.is_finite() && **f != 0.0));
            let is_number = wrench.is_some_and(|t| !WRENCHES.contains(&bag.topics()[t].type_name.as_str()));
            let zero = said.zero_in_a_bag(taken.only(), across, is_number)?;
            let n_per_unit = said.force.scale(Dimension::Force, "--force-unit")?;
            forces.samples.iter_mut().for_each(|(_, force)| (0..3).for_each(|k| force[k] -= n_per_unit * zero[k]));
        }
        forces.samples.retain_mut(|(_, force)| {
            taken.force(*force).is_some_and(|measured| {
                *force = measured;
                true
            })
        });
        let markers = reading.gather(targets, |message| {
            let m: PoseArray = bag.decode(message)?;
            let frame_id = if said.sample_pose.is_some() { &m.header.frame_id } else { &names.frame_id };
            let places =
                marked(&m, frame_id).map(|places| places.into_iter().map(|p| frames.point(p)).collect::<Vec<_>>());
            Ok((places.into(), m.header))
        });
        let last = |samples: &[(clocks::Arrival, Vec<[f64; 3]>)]| samples.last().map(|m| m.1.len());
        let odd = markers.samples.iter().filter(|m| Some(m.1.len()) != last(&markers.samples)).count();
        if odd > 0 {
            let text = format!("measured_targets: {odd} messages have another number of markers; left out");
            reading.warnings.push(text);
        }
        let (of_depth, of_pose, of_force) = (Census::of(&depths), Census::of(&poses), Census::of(&forces));
        let of_motion = if depths.samples.is_empty() || by_pose { &of_pose } else { &of_depth };
        let Reading { losses, warnings, .. } = &mut reading;
        let base = clocks::choose([of_motion, &of_force], warnings);
        let clocks_differ = base == clocks::Base::Stamps && said.time_offset_s == 0.0;
        let ahead_ns = if clocks_differ { clocks::ahead(of_motion, &of_force, warnings) } else { 0 };
        let with_poses = forces.frame == poses.frame && by_pose;
        let stamped = Stamped {
            depths: ordered(depths, base, losses, warnings),
            poses: ordered(poses, base, losses, warnings),
            forces: ordered(forces, base, losses, warnings),
            markers: ordered(markers, base, losses, warnings),
        };
        for (topic, series, what, unit, hum) in [
            (joint_state, stamped.zigzag(0), "depths", "m", 0.0),
            (pose, stamped.zigzag(1), "positions", "m", 0.0),
            (wrench, stamped.zigzag(2), "forces", "N", HUM),
        ] {
            if let Some((topic, Zigzag { jumps, apart, share })) = topic.zip(series) {
                let reason = format!(
                    "its {what} jump to and fro between two courses some {apart:.6} {unit} apart ({jumps} times), as if two nodes publish \
                     it: record one of them alone, or remap the topic of the other"
                );
                if share < hum {
                    let name = &bag.topics()[topic].name;
                    reading
                        .warnings
                        .push(format!("{name}: {reason}. Hum at half of the rate of readings looks the same"));
                    continue;
                }
                return Err(topic_error(bag, &bag.topics()[topic], reason).into());
            }
        }
        let name = |topic: Option<usize>| topic.map(|t| bag.topics()[t].name.clone());
        let late_ns = ((said.time_offset_s * 1e9).round() as i64).saturating_add(ahead_ns);
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
            position_scale: position.map_or([m_per_unit, 0.0], |source| [source.m_per_unit, said.position.zero]),
            ..Self::of(stamped, late_ns)
        };
        recording.turn(&frames, taken, with_poses);
        if let Some(topic) = wrench.filter(|_| recording.forces.is_empty() && recording.losses.is_empty()) {
            let topic = bag.topics()[topic].name.clone();
            let reason = "the topic of the force has no message, so there is nothing to compare: were publisher and recorder of one QoS?";
            recording.losses.push(Loss::Samples { topic, count: 0, reason: reason.to_owned() });
        }
        recording.check(bag, joint_state.or(pose))?;
        Ok(recording)
    }

    /// The recording in one or several tables. The samples are moved out of them.
    ///
    /// # Errors
    /// [`TableError::Missing`] if none of them has the position.
    pub fn of_tables(read: &mut [Table], said: &Selection) -> Result<Self, RecordingError> {
        let plan = Plan::of(read, said)?;
        let (mut losses, mut warnings) = told(read);
        let mut axes = MeasuredAxes::default();
        let mut forces = plan.feeling.map(|k| std::mem::take(&mut read[k].forces)).unwrap_or_default();
        let depths = std::mem::take(&mut read[plan.moving].depths);
        let poses = std::mem::take(&mut read[plan.moving].poses);
        let markers = std::mem::take(&mut read[plan.moving].markers);
        let (motion, cell, frames) = (&read[plan.moving], plan.feeling.map(|k| &read[k]), &plan.frames);
        forces.iter().for_each(|(_, force)| axes.note(force));
        let all = forces.len();
        forces.retain_mut(|(_, force)| {
            axes.force(*force).is_some_and(|measured| {
                *force = measured;
                true
            })
        });
        if let Some(cell) = cell {
            warnings.extend(axes.missing());
            lose_unmeasured(&cell.file, all - forces.len(), all == 0, &mut losses);
        }
        let poses = poses.into_iter().map(|(t, pose)| (t, frames.pose(pose))).collect();
        let places = |p: &Vec<[f64; 3]>| p.iter().map(|p| frames.point(*p)).collect();
        let markers = markers.iter().map(|(t, p)| (*t, places(p))).collect();
        let stamped = Stamped {
            depths: (in_order(&motion.file, depths, &mut losses, &mut warnings), String::new()),
            poses: (in_order(&motion.file, poses, &mut losses, &mut warnings), String::new()),
            markers: (in_order(&motion.file, markers, &mut losses, &mut warnings), String::new()),
            forces: cell.map_or_else(Default::default, |t| {
                (in_order(&t.file, forces, &mut losses, &mut warnings), String::new())
            }),
        };
        if let Some(Zigzag { jumps, apart, .. }) = stamped.zigzag(0).or_else(|| stamped.zigzag(1)) {
            let reason = format!(
                "the positions jump to and fro by some {apart:.6} m ({jumps} times): rows of two sources, or of a sensor that drops out. Leave \
                 those of the other out"
            );
            return Err(TableError::Contents { path: PathBuf::from(&motion.file), reason }.into());
        }
        if let (Some(Zigzag { jumps, apart, .. }), Some(cell)) = (stamped.zigzag(2), cell) {
            warnings.push(format!(
                "{}: the forces jump to and fro by some {apart:.6} N ({jumps} times): rows of two sources, or of a cell that drops out",
                cell.file
            ));
        }
        let late_ns = plan.late_ns;
        let mut recording = Self { losses, warnings, ..Self::of(stamped, late_ns).told_by(read, said, &plan) };
        recording.warnings.dedup();
        recording.turn(&plan.frames, axes, false);
        recording.check_times();
        Ok(recording)
    }

    /// A recording in tables that are only surveyed: all of it but the samples, and how each of them is to be changed. `None` if
    /// its samples must be in memory to be understood: their stamps are not in order, or a force is not finite.
    pub(super) fn of_surveys(read: &[Table], said: &Selection) -> Result<Option<(Self, Changes)>, RecordingError> {
        let plan = Plan::of(read, said)?;
        let nothing = Survey::default();
        let survey = |k: usize| read[k].survey.as_ref().unwrap_or(&nothing);
        let motion = survey(plan.moving);
        let cell = plan.feeling.map_or(&nothing, survey);
        let mut axes = MeasuredAxes::default();
        let of = |bits: usize| [0, 1, 2].map(|k| if bits >> k & 1 == 1 { 0.0 } else { f64::NAN });
        let seen: Vec<[f64; 3]> = (0..8).filter(|bits| cell.finite[*bits] > 0).map(of).collect();
        seen.iter().for_each(|force| axes.note(force));
        let (depths, poses, forces, markers) = (&motion.depths, &motion.poses, &cell.forces, &motion.markers);
        let is_plain = [motion, cell].iter().all(|survey| !survey.rows.disordered)
            && [depths.have_room(), poses.have_room(), forces.have_room(), markers.have_room()] == [true; 4]
            && seen.iter().all(|force| axes.force(*force).is_some());
        if !is_plain {
            return Ok(None);
        }
        let (mut losses, mut warnings) = told(read);
        let ordered = [depths.ordered(), poses.ordered(), markers.ordered(), forces.ordered()];
        let file = |k: usize| read[k].file.as_str();
        if let Some(cell) = plan.feeling {
            warnings.extend(axes.missing());
            lose_unmeasured(file(cell), 0, forces.count == 0, &mut losses);
        }
        let files = [plan.moving, plan.moving, plan.moving, plan.feeling.unwrap_or(plan.moving)].map(file);
        let each = files.into_iter().zip(&ordered);
        each.for_each(|(file, (ordered, _))| series::told(file, ordered, &mut losses, &mut warnings));
        let late = |ns: i64| ns.saturating_sub(plan.late_ns);
        let firsts = [depths.first(), poses.first(), forces.first().map(late)];
        let origin_ns = firsts.into_iter().flatten().min().unwrap_or(0);
        let nothing = Self::of(Stamped::default(), 0);
        let mut recording = Self { losses, warnings, origin_ns, ..nothing.told_by(read, said, &plan) };
        recording.warnings.dedup();
        let along = recording.turning(&plan.frames, axes);
        let [depth, pose, marker, force] = ordered.map(|(_, left)| left);
        let counts = [depth, pose, force, marker];
        let spreads = [depths.spread(), poses.spread(), forces.spread(), markers.spread()];
        Ok(Some((recording, Changes { plan, axes, along, counts, spreads })))
    }

    /// What the tables say beside their samples.
    fn told_by(self, read: &[Table], said: &Selection, plan: &Plan) -> Self {
        let motion = &read[plan.moving];
        let files: Vec<&str> = read.iter().map(|t| t.file.rsplit(['/', '\\']).next().unwrap_or(&t.file)).collect();
        Self {
            source: format!("table {}", files.join(" and ")),
            one_clock: plan.feeling == Some(plan.moving) && said.time_offset_s == 0.0,
            topics: said.names.clone(),
            position_scale: motion.columns.position.as_ref().map_or([1.0, 0.0], |c| [c.scale, c.zero]),
            ..self
        }
    }

    /// Subtracts the common origin, and the delay `late_ns` of the force's stamps.
    fn of(stamped: Stamped, late_ns: i64) -> Self {
        let Stamped {
            depths: (depths, _),
            poses: (poses, _),
            forces: (mut forces, force_frame),
            markers: (markers, _),
        } = stamped;
        forces.iter_mut().for_each(|(time, _)| *time = time.saturating_sub(late_ns));
        let firsts = [depths.first().map(|s| s.0), poses.first().map(|s| s.0), forces.first().map(|s| s.0)];
        let origin_ns = firsts.into_iter().flatten().min().unwrap_or(0);
        let seconds = |ns: i64| seconds(ns, origin_ns);
        let count = markers.last().map_or(0, |m| m.1.len());
        let whole = markers.into_iter().filter(|m| m.1.len() == count);
        let markers = whole.map(|(t, positions)| MarkerSample { time_s: seconds(t), positions }).collect();
        let depth = |(t, depth_m): (i64, f64)| DepthSample { time_s: seconds(t), depth_m };
        let pose =
            |(t, Pose { tip, axis, roll_rad }): (i64, Pose)| PoseSample { time_s: seconds(t), tip, axis, roll_rad };
        Self {
            source: String::new(),
            scene: None,
            origin_ns,
            // samples of one size become others where they lie
            depths: depths.into_iter().map(depth).collect(),
            poses: poses.into_iter().map(pose).collect(),
            forces: forces.into_iter().map(|(t, force_n)| ForceSample { time_s: seconds(t), force_n }).collect(),
            markers,
            one_clock: false,
            topics: TopicNames::default(),
            force_frame,
            position_scale: [1.0, 0.0],
            holes: Vec::new(),
            losses: Vec::new(),
            warnings: Vec::new(),
        }
    }

    /// Transforms forces to the frame of the sample. A cell with one axis measures along the instrument, whichever
    /// axis its driver uses.
    fn turn(&mut self, frames: &Frames, axes: MeasuredAxes, with_poses: bool) {
        let along = self.turning(frames, axes);
        if along.is_none() && with_poses && frames.knows_sample() {
            self.force_frame = self.topics.frame_id.clone();
        }
        self.forces.iter_mut().for_each(|s| s.force_n = turned(s.force_n, frames, along, with_poses));
    }

    /// The axis that is taken for z, if one is, with a warning; the frame of the forces once they are turned.
    fn turning(&mut self, frames: &Frames, axes: MeasuredAxes) -> Option<usize> {
        let along = axes.only().filter(|axis| *axis < 2 && !frames.knows_sensor());
        if let Some(axis) = along {
            let name = ["x", "y"][axis];
            self.warnings
                .push(format!("the force along {name} is taken as that along z; --sensor-rotation says otherwise"));
        } else if frames.knows_sensor() {
            self.force_frame = self.topics.frame_id.clone();
        }
        along
    }

    /// Checks that there is a motion; warns if the load cell's data are from another time.
    fn check(&mut self, bag: &BagReader, motion: Option<usize>) -> Result<(), BagError> {
        if let (true, true, Some(topic)) = (self.depths.is_empty(), self.poses.is_empty(), motion) {
            let lost: Vec<String> = self.losses.iter().map(ToString::to_string).collect();
            let reason = if lost.is_empty() { "it has no messages".to_owned() } else { lost.join("; ") };
            return Err(topic_error(bag, &bag.topics()[topic], format!("nothing of it can be used: {reason}")));
        }
        self.check_times();
        Ok(())
    }

    /// Adds a loss if the load cell's data are from another time than the motion's, and one for each hole.
    pub(super) fn lose_times(
        &mut self,
        motion: Option<(f64, f64)>,
        force: Option<(f64, f64)>,
        forces: usize,
        holes: Holes,
    ) {
        let both = motion.zip(force);
        let apart = both.is_some_and(|(motion, force)| force.0 > motion.1 || motion.0 > force.1);
        let in_part = |((from, to), (start, end)): &((f64, f64), (f64, f64))| {
            (start - from).max(0.0) + (to - end).max(0.0) > MUCH * (to - from)
        };
        if let Some((motion, force)) = both.filter(|both| !apart && in_part(both)) {
            self.warnings.push(format!(
                "the force was recorded from {:.3} to {:.3} s, and the motion from {:.3} to {:.3} s: outside of the force's times nothing is \
                 compared",
                force.0, force.1, motion.0, motion.1
            ));
        }
        if let Some((motion, force)) = both.filter(|_| apart) {
            let reason = format!(
                "their times ({:.3} to {:.3} s) and those of the motion ({:.3} to {:.3} s) have nothing in common: their stamps are from \
                 different clocks, so there is nothing to compare; --time-offset-s says how far they are apart ({:.3} more puts their beginnings \
                 together)",
                force.0,
                force.1,
                motion.0,
                motion.1,
                force.0 - motion.0
            );
            let topic = self.topics.wrench.clone().unwrap_or_else(|| "force".to_owned());
            self.losses.push(Loss::Samples { topic, count: forces as u64, reason });
        }
        self.holes = holes.found();
        let what =
            "nothing was recorded of the motion or of the force: what the tissue went through there is not known";
        let hole = |[from, to]: &[f64; 2]| {
            let [from, to, length] = [*from, *to, to - from].map(|s| format!("{s:.3}"));
            Loss::Hole { from, to, length, what }
        };
        self.losses.extend(self.holes.iter().map(hole));
    }

    /// A message about single forces that are far larger than all others and alike: a value that stands for none, as -9999.
    fn sentinels(&self) -> Option<String> {
        let size = |s: &ForceSample| s.force_n.iter().fold(0.0, |most: f64, f| most.max(f.abs()));
        let most = self.forces.iter().map(size).fold(0.0, f64::max);
        let of = |s: &&ForceSample| size(s) == most;
        let (count, first) = (self.forces.iter().filter(of).count(), self.forces.iter().find(of)?);
        let others = self.forces.iter().map(size).filter(|size| *size < most).fold(0.0, f64::max);
        (others > 0.0 && most > SENTINEL * others && 2 * count < self.forces.len()).then(|| {
            let largest = first.force_n.into_iter().max_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or_default();
            format!(
                "{count} of {} forces are {largest} N, and all others at most {others:.4} N, the first at {:.3} s: if that stands for no reading, \
                 leave it out of the recording",
                self.forces.len(),
                first.time_s
            )
        })
    }

    /// The same, of series in memory.
    fn check_times(&mut self) {
        let motion = span(self.depths.iter().map(|s| s.time_s).chain(self.poses.iter().map(|s| s.time_s)));
        let force = span(self.forces.iter().map(|s| s.time_s));
        self.warnings.extend(self.sentinels());
        let mut holes = Holes::new(self.depths.is_empty());
        self.in_time().for_each(|sample| holes.note(&sample));
        self.lose_times(motion, force, self.forces.len(), holes);
    }

    /// All samples in order of time; for equal times the motion's first.
    pub(super) fn in_time(&self) -> impl Iterator<Item = Sample<'_>> {
        let mut next = [0_usize; 4];
        std::iter::from_fn(move || {
            let [d, p, f, m] = next;
            let (depth, pose, force) = (self.depths.get(d), self.poses.get(p), self.forces.get(f));
            let markers = self.markers.get(m);
            let which = first([
                depth.map(|s| s.time_s),
                pose.map(|s| s.time_s),
                force.map(|s| s.time_s),
                markers.map(|s| s.time_s),
            ])?;
            next[which] += 1;
            match which {
                0 => depth.copied().map(Sample::Depth),
                1 => pose.copied().map(Sample::Pose),
                2 => force.copied().map(Sample::Force),
                _ => markers.map(Sample::Markers),
            }
        })
    }
}

/// What the tables of a recording are for.
pub(super) struct Plan {
    /// Number of the table with the position or the poses, and of that with the force.
    pub moving: usize,
    pub feeling: Option<usize>,
    pub frames: Frames,
    /// Delay of the force's stamps, ns.
    pub late_ns: i64,
}

impl Plan {
    fn of(read: &[Table], said: &Selection) -> Result<Self, RecordingError> {
        let columns =
            || read.iter().map(|t| format!("{} has {}", t.file, t.all_columns)).collect::<Vec<_>>().join("; ");
        if let Some((option, name)) = in_no_file(read) {
            return Err(TableError::NoColumn { option, name, columns: columns() }.into());
        }
        let missing = |what, option| TableError::Missing { what, option, columns: columns() };
        let moves = |t: &Table| t.columns.position.is_some() || t.columns.pose.is_some();
        let moving = read.iter().position(moves).ok_or_else(|| missing("position", "--position"))?;
        // a column's number or header may fit both tables; then the force's own table was given for the force
        let feels = |k: &usize| read[*k].columns.force.is_some() || read[*k].columns.forces.is_some();
        let feeling = (0..read.len()).filter(|k| *k != moving).find(feels).or(Some(moving).filter(feels));
        let (motion, cell) = (&read[moving], feeling.map(|k| &read[k]));
        let timed = |t: &Table| t.columns.time.is_some() || t.rate_hz.is_some();
        if let Some(untimed) = [Some(motion), cell].into_iter().flatten().find(|t| !timed(t)) {
            return Err(match said.time.last() {
                Some(name) => {
                    let columns = format!("{} has {}", untimed.file, untimed.all_columns);
                    TableError::NoColumn { option: "--time", name: name.clone(), columns }.into()
                }
                None => missing("time (or give --rate-hz)", "--time").into(),
            });
        }
        let whole = said.pose.is_none() || motion.columns.pose.is_some();
        if !whole || (said.forces.is_some() && cell.is_none_or(|t| t.columns.forces.is_none())) {
            return Err(missing("three components in one file", "--pose-columns or --force-columns").into());
        }
        said.fits_a_table(motion.columns.pose.is_some())?;
        said.zero_of_a_force(cell.is_some())?;
        let frames = Frames::of(said)?;
        Ok(Self { moving, feeling, frames, late_ns: (said.time_offset_s * 1e9).round() as i64 })
    }
}

/// How the samples of surveyed tables become those of the recording.
pub(super) struct Changes {
    pub plan: Plan,
    axes: MeasuredAxes,
    along: Option<usize>,
    /// Number of depths, poses, forces and markers, and how those of one stamp are spread.
    pub counts: [usize; 4],
    pub spreads: [Option<Spread>; 4],
}

impl Changes {
    /// A force in the frame of the sample; `None` if it is not finite.
    pub(super) fn force(&self, force_n: [f64; 3]) -> Option<[f64; 3]> {
        self.axes.force(force_n).map(|force_n| turned(force_n, &self.plan.frames, self.along, false))
    }
}

/// A force in the frame of the sample; `along`: the axis that is taken for z.
fn turned(mut force_n: [f64; 3], frames: &Frames, along: Option<usize>, with_poses: bool) -> [f64; 3] {
    match along {
        Some(axis) => {
            force_n.swap(axis, 2);
            force_n
        }
        None => frames.force(force_n, with_poses),
    }
}

/// Time of a stamp, s from the origin.
pub(super) fn seconds(ns: i64, origin_ns: i64) -> f64 {
    ns.saturating_sub(origin_ns) as f64 * 1e-9
}

/// Losses and warnings of tables.
fn told(read: &[Table]) -> (Vec<Loss>, Vec<String>) {
    let loss = |table: &Table| {
        let first = table.first_bad.as_deref().unwrap_or_default();
        let reason = format!("a cell that is needed is missing or no number, first in {first}");
        Loss::Samples { topic: table.file.clone(), count: table.bad, reason }
    };
    let losses = read.iter().filter(|t| t.bad > 0).map(loss).collect();
    (losses, read.iter().flat_map(|t| t.warnings.iter().cloned()).collect())
}

/// Determines the measured axes from the readings of a bag, and reports the missing ones.
fn measured_axes(topic: &str, reading: &mut Reading, forces: impl Iterator<Item = [f64; 3]> + Clone) -> MeasuredAxes {
    let mut axes = MeasuredAxes::default();
    forces.clone().for_each(|force| axes.note(&force));
    reading.warnings.extend(axes.missing());
    let lost = forces.filter(|force| axes.force(*force).is_none()).count();
    lose_unmeasured(topic, lost, false, &mut reading.losses);
    axes
}

/// Adds a loss for readings that are not numbers, with another text if the force has no number at all.
fn lose_unmeasured(topic: &str, count: usize, none: bool, losses: &mut Vec<Loss>) {
    let mut lose = |count: usize, reason: &str| {
        losses.push(Loss::Samples { topic: topic.to_owned(), count: count as u64, reason: reason.to_owned() });
    };
    if count > 0 {
        lose(count, "their force is not finite; check the load cell");
    }
    if none {
        lose(0, "the column of the force has no number in any row: there is nothing to compare");
    }
}

/// A column that the user named and that none of the files has.
fn in_no_file(read: &[Table]) -> Option<(&'static str, String)> {
    let (first, rest) = read.split_first()?;
    let absent = |named: &&(&'static str, String)| rest.iter().all(|table| table.absent().contains(named));
    first.absent().iter().find(absent).cloned()
}

/// Values with their times, sorted.
fn ordered<V: PartialEq>(
    of: clocks::Gathered<V>,
    base: clocks::Base,
    losses: &mut Vec<Loss>,
    warnings: &mut Vec<String>,
) -> Series<V> {
    let (topic, frame) = (of.topic.clone(), of.frame.clone());
    let samples = clocks::timed(of, base, losses);
    (in_order(&topic, samples, losses, warnings), frame)
}

fn span(times: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    times.fold(None, |span, t| Some(span.map_or((t, t), |(a, b): (f64, f64)| (a.min(t), b.max(t)))))
}

/// Positions of tracked points; NaN coordinates mean that a point was not seen.
fn marked(m: &PoseArray, frame_id: &str) -> Result<Vec<[f64; 3]>, String> {
    let frame = m.header.frame_id.trim_start_matches('/');
    if !frame.is_empty() && frame != frame_id.trim_start_matches('/') {
        return Err(format!(
            "it is in frame `{frame}`, the twin needs `{frame_id}`: transform it, or name the frame (--frame-id)"
        ));
    }
    Ok(m.poses.iter().map(|pose| pose.position.into()).collect())
}

/// Whether a path is a bag: a folder, or an MCAP file, compressed or not. Other bag formats count too, and what does not exist and
/// has a name as of a folder; reading them gives an error that says what to do.
#[must_use]
pub fn is_bag(path: &Path) -> bool {
    let name = path.file_name().map(|n| n.to_string_lossy().to_lowercase()).unwrap_or_default();
    let ends = [".mcap", ".mcap.zstd", ".mcap.zst", ".mcap.lz4", ".db3", ".db3.zstd", ".bag"];
    path.is_dir()
        || ends.iter().any(|end| name.ends_with(end))
        || name == "metadata.yaml"
        || !path.exists() && path.extension().is_none()
}

/// Reads the files of a recording.
///
/// # Errors
/// [`TableError`].
pub fn tables(paths: &[PathBuf], said: &Selection) -> Result<Vec<Table>, TableError> {
    refuse_options(paths, said)?;
    paths.iter().enumerate().map(|(number, path)| Table::read(path, said, number)).collect()
}
