//! Options of the commands that take a recording, one adapter for bags and tables alike.

use std::path::PathBuf;

use clap::Args;

use super::options::SetOptions;
use super::{CliError, scene_file};
use needle_core::scene::Scene;
use needle_recording::Reading;
use needle_recording::{Quantity, Recording, Selection, TableLayout, TopicNames};

/// Scene of a recording that doesn't say which it was made for.
pub(super) const DEFAULT_SCENE: &str = "needle_insertion";

/// A recording and the scene that it is run with.
#[derive(Debug, Args)]
pub(super) struct RecordedOptions {
    /// rosbag2 folder or .mcap file; or a table (CSV, TSV, .xlsx, .npy, .npz)
    #[arg(value_name = "BAG|TABLE")]
    bag: PathBuf,

    /// The force's table, where it is a file of its own with its own clock
    #[arg(long, value_name = "TABLE", help_heading = "Table")]
    force_file: Option<PathBuf>,

    /// Preset or scene file [default: the one that the bag names, needle_insertion if it names none]
    #[arg(long, value_name = "NAME|FILE", help_heading = "Scene")]
    scene: Option<String>,

    #[command(flatten)]
    set: SetOptions,

    #[command(flatten)]
    pub topics: TopicOptions,

    #[command(flatten)]
    pub sources: SourceOptions,

    /// Go on where units, signs or scene of the recording look wrong; of `calibrate`, write a rejected model's scene as well
    #[arg(long, help_heading = "Run")]
    pub force: bool,
}

impl RecordedOptions {
    /// Reads both; the recording as it lies to the scene.
    pub(super) fn load(&self) -> Result<(Recording, Scene), CliError> {
        let files: Vec<PathBuf> = [&self.bag].into_iter().chain(&self.force_file).cloned().collect();
        let recording = Recording::open(&files, &self.selection())?;
        let name = self.scene.as_deref().or(recording.scene.as_deref()).unwrap_or(DEFAULT_SCENE);
        let scene = self.set.apply(&scene_file::load(name)?, [])?;
        Ok((recording.into_aligned(&scene), scene))
    }

    /// What was said of the recording.
    pub(super) fn selection(&self) -> Selection {
        self.topics.selection(&self.sources)
    }
}

/// Which topics of the bag are taken.
#[derive(Debug, Args)]
#[command(next_help_heading = "Bag")]
pub(super) struct TopicOptions {
    /// Joint whose position is the depth; of transforms of several tools, the frame of the tip
    #[arg(long, value_name = "NAME", default_value = "insertion")]
    joint: String,

    /// Frame of the tip's poses: origin at the centre of the sample's bottom face, z up
    #[arg(long, value_name = "NAME", default_value = "sample")]
    frame_id: String,

    /// Topic of the displacement sensor, sensor_msgs/JointState [default: a measured_js]
    #[arg(long, value_name = "TOPIC", conflicts_with = "position_topic")]
    measured_js: Option<String>,

    /// Topic of the tip's pose, geometry_msgs/PoseStamped [default: a measured_cp, where there is no measured_js]
    #[arg(long, value_name = "TOPIC")]
    measured_cp: Option<String>,

    /// Topic of the load cell, geometry_msgs/WrenchStamped [default: a measured_cf]
    #[arg(long, value_name = "TOPIC", conflicts_with = "force_topic")]
    measured_cf: Option<String>,

    /// Use at most N readings of a series, in less memory: every second, fourth, eighth ... of a longer one [default: all]
    #[arg(long, value_name = "N", help_heading = "Recording")]
    most_readings: Option<usize>,
}

impl TopicOptions {
    fn names(&self) -> TopicNames {
        TopicNames {
            joint_state: self.measured_js.clone(),
            pose: self.measured_cp.clone(),
            wrench: self.measured_cf.clone(),
            joint: self.joint.clone(),
            frame_id: self.frame_id.clone(),
        }
    }

    /// What was said of a recording that is run.
    pub(super) fn selection(&self, sources: &SourceOptions) -> Selection {
        Selection { most_readings: self.most_readings, ..sources.selection(self.names()) }
    }

    /// The depths, unless there are none or the pose was asked for by name.
    pub(super) fn readings(&self, recording: &Recording) -> Vec<Reading> {
        recording.readings(self.by_pose())
    }

    /// Whether the pose was asked for by name.
    pub(super) const fn by_pose(&self) -> bool {
        self.measured_cp.is_some() && self.measured_js.is_none()
    }
}

/// What the numbers of a recording mean.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Recording")]
pub(super) struct SourceOptions {
    /// What the position is: a topic (JointState, Range, Float64, Float32; /daq[0] of a Float64MultiArray; PoseStamped,
    /// TransformStamped, PointStamped), or a column by its header or its number from 1
    #[arg(long, value_name = "TOPIC|COLUMN", visible_alias = "position")]
    pub position_topic: Option<String>,

    /// Unit of the depth: m, cm, mm, um, in [default: as the column's header says; m of a topic]
    #[arg(long, value_name = "UNIT")]
    pub position_unit: Option<String>,

    /// -1 where the number falls as the instrument goes in
    #[arg(long, value_name = "SIGN", value_parser = reversed, allow_negative_numbers = true)]
    pub position_sign: Option<bool>,

    /// Recorded number of the position at first contact: depth 0 is there
    #[arg(long, value_name = "V", value_parser = finite, default_value_t = 0.0, allow_negative_numbers = true)]
    pub position_zero: f64,

    /// What one of the recorded numbers of the position is, in its unit: 0.001 for an encoder with 1000 counts per mm
    #[arg(long, value_name = "V", value_parser = positive)]
    pub position_scale: Option<f64>,

    /// What the force is: a topic (WrenchStamped, Wrench, Float64, Float32; /daq[1] of a Float64MultiArray), or a column
    #[arg(long, value_name = "TOPIC|COLUMN", visible_alias = "force-column")]
    pub force_topic: Option<String>,

    /// Unit of the force: N, mN, kN, gf, kgf, lbf [default: as the column's header says; N of a topic]
    #[arg(long, value_name = "UNIT")]
    pub force_unit: Option<String>,

    /// -1 where the load cell counts the force on the tissue
    #[arg(long, value_name = "SIGN", value_parser = reversed, allow_negative_numbers = true)]
    pub force_sign: Option<bool>,

    /// What the load cell reads without load, in the force's unit: one number, or three of a force with three components
    #[arg(long, value_name = "V|X,Y,Z", value_parser = zero, allow_hyphen_values = true)]
    pub force_zero: Option<Zero>,

    /// Turns the force from the frame of the sensor into that of the sample: a quaternion
    #[arg(long, value_name = "W,X,Y,Z", value_parser = quaternion, allow_hyphen_values = true)]
    pub sensor_rotation: Option<[f64; 4]>,

    /// Pose of the sample in the frame of the recorded poses: the centre of its bottom face in m and its orientation (z up, out of the
    /// surface)
    #[arg(long, value_name = "X,Y,Z,QX,QY,QZ,QW", value_parser = pose, allow_hyphen_values = true)]
    pub sample_pose: Option<[f64; 7]>,

    /// How late the force's stamps are against the position's: taken off them
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0, allow_negative_numbers = true)]
    pub time_offset_s: f64,

    #[command(flatten)]
    pub table: TableOptions,
}

/// How a table is read.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Table")]
pub(super) struct TableOptions {
    /// Column of the time; once for each file where they differ
    #[arg(long, value_name = "COLUMN")]
    pub time: Vec<String>,

    /// Unit of the time: s, ms, us, ns, min, h; once for each file where they differ [default: as the column's header says]
    #[arg(long, value_name = "UNIT")]
    pub time_unit: Vec<String>,

    /// Rows per second, of a table without time
    #[arg(long, value_name = "R", value_parser = positive, conflicts_with = "time")]
    pub rate_hz: Option<f64>,

    /// Columns of the tip in the sample's frame, in place of a depth; the instrument points down, or as the quaternion of four more
    /// columns says
    #[arg(long, value_name = "X,Y,Z[,QX,QY,QZ,QW]", value_parser = pose_columns)]
    pub pose_columns: Option<PoseColumns>,

    /// Columns of the force's three components, in place of one force; an empty column: not measured
    #[arg(long, value_name = "X,Y,Z", value_parser = columns::<3>, conflicts_with = "force_topic")]
    pub force_columns: Option<[String; 3]>,

    /// Which of several recordings that stand one after the other in the file, from 1
    #[arg(long, value_name = "N")]
    pub block: Option<usize>,

    /// Sheet of a workbook (.xlsx) [default: the first with rows of numbers]
    #[arg(long, value_name = "NAME")]
    pub sheet: Option<String>,

    /// Columns of tracked points in the sample's frame, x, y and z of each, in the position's unit; an empty cell: not seen
    #[arg(long, value_name = "X,Y,Z,...", value_delimiter = ',')]
    pub marker_columns: Vec<String>,

    /// The position is a strain, a share of this length
    #[arg(long, value_name = "L", value_parser = positive)]
    pub gauge_length_m: Option<f64>,

    /// Character between cells, or `tab` or `blank` [default: seen from the text]
    #[arg(long, value_name = "CHARACTER", value_parser = separator)]
    pub separator: Option<char>,

    /// Numbers are written 0,5 [default: seen from the text]
    #[arg(long, value_name = "BOOL", num_args = 0..=1, default_missing_value = "true")]
    pub decimal_comma: Option<bool>,

    /// Number of the line with the headers, from 1; 0 where there are none
    #[arg(long, value_name = "N")]
    pub header_line: Option<usize>,

    /// What lines to be left out begin with [default: # or // or %]
    #[arg(long, value_name = "TEXT")]
    pub comment: Option<String>,
}

fn reversed(text: &str) -> Result<bool, String> {
    match text {
        "1" | "+1" | "+" => Ok(false),
        "-1" | "-" => Ok(true),
        _ => Err("1 or -1".to_owned()),
    }
}

pub(super) fn positive(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|x: &f64| x.is_finite() && *x > 0.0).ok_or_else(|| "a positive number".to_owned())
}

/// Columns of a tip and, where there are such, of its orientation.
type PoseColumns = ([String; 3], Option<[String; 4]>);

fn finite(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|x: &f64| x.is_finite()).ok_or_else(|| "a finite number".to_owned())
}

fn columns<const N: usize>(text: &str) -> Result<[String; N], String> {
    let names: Vec<String> = text.split(',').map(str::to_owned).collect();
    let named = names.iter().all(|name| !name.is_empty());
    let word = if N == 3 { "three columns, `X,Y,Z`" } else { "four columns" };
    <[String; N]>::try_from(names).ok().filter(|_| named).ok_or_else(|| word.to_owned())
}

fn pose_columns(text: &str) -> Result<PoseColumns, String> {
    match text.match_indices(',').nth(2) {
        Some((end, _)) if text.matches(',').count() == 6 => {
            Ok((columns(&text[..end])?, Some(columns(&text[end + 1..])?)))
        }
        _ => Ok((columns(text).map_err(|e| format!("{e}, or seven with a quaternion"))?, None)),
    }
}

fn numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    let numbers = text.split(',').map(|part| finite(part.trim())).collect::<Result<Vec<f64>, _>>().ok()?;
    numbers.try_into().ok()
}

/// What a load cell reads without load.
#[derive(Clone, Copy, Debug)]
pub(super) enum Zero {
    One(f64),
    Three([f64; 3]),
}

fn zero(text: &str) -> Result<Zero, String> {
    let one = numbers(text).map(|[number]: [f64; 1]| Zero::One(number));
    one.or_else(|| numbers(text).map(Zero::Three)).ok_or_else(|| "a number, or three, `X,Y,Z`".to_owned())
}

fn quaternion(text: &str) -> Result<[f64; 4], String> {
    numbers(text).ok_or_else(|| "four numbers, `W,X,Y,Z`".to_owned())
}

fn pose(text: &str) -> Result<[f64; 7], String> {
    numbers(text).ok_or_else(|| "seven numbers, `X,Y,Z,QX,QY,QZ,QW`".to_owned())
}

fn separator(text: &str) -> Result<char, String> {
    match text {
        "tab" | "\\t" => return Ok('\t'),
        "blank" | "space" => return Ok(' '),
        _ => {}
    }
    let mut characters = text.chars();
    let one = characters.next().filter(|c| c.is_ascii() && characters.next().is_none());
    one.ok_or_else(|| "one character, or `tab` or `blank`".to_owned())
}

impl SourceOptions {
    /// What was said, with the names of the topics.
    pub(super) fn selection(&self, names: TopicNames) -> Selection {
        let quantity = |place: &Option<String>, unit: &Option<String>, reversed: Option<bool>| Quantity {
            place: place.clone(),
            unit: unit.clone(),
            reversed: reversed.unwrap_or(false),
            ..Quantity::default()
        };
        let position = quantity(&self.position_topic, &self.position_unit, self.position_sign);
        let table = &self.table;
        Selection {
            names,
            position: Quantity { zero: self.position_zero, factor: self.position_scale, ..position },
            force: Quantity {
                zero: if let Some(Zero::One(zero)) = self.force_zero { zero } else { 0.0 },
                ..quantity(&self.force_topic, &self.force_unit, self.force_sign)
            },
            force_zeros: if let Some(Zero::Three(zeros)) = self.force_zero { Some(zeros) } else { None },
            time_offset_s: self.time_offset_s,
            time: table.time.clone(),
            time_unit: table.time_unit.clone(),
            rate_hz: table.rate_hz,
            pose: table.pose_columns.as_ref().map(|(tip, _)| tip.clone()),
            orientation: table.pose_columns.as_ref().and_then(|(_, orientation)| orientation.clone()),
            forces: table.force_columns.clone(),
            sensor_rotation: self.sensor_rotation,
            sample_pose: self.sample_pose,
            markers: table.marker_columns.clone(),
            gauge_length_m: table.gauge_length_m,
            layout: TableLayout {
                separator: table.separator,
                decimal_comma: table.decimal_comma,
                header_line: table.header_line,
                comment: table.comment.clone(),
                block: table.block,
                sheet: table.sheet.clone(),
            },
            most_readings: None,
        }
    }
}
