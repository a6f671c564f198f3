//! The user's selection: the columns or topics of depth and force, and the meaning of their numbers.

use super::unit::Dimension;

/// The topics to use, and the joint. If a topic is not given it is found by the last part of the name
/// (`/rig/measured_js` is a `measured_js`), or by the type if only one topic has it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TopicNames {
    /// sensor_msgs/JointState: the displacement sensor. Default: a `measured_js`.
    pub joint_state: Option<String>,
    /// geometry_msgs/PoseStamped: the tip's pose. Default: a `measured_cp`.
    pub pose: Option<String>,
    /// geometry_msgs/WrenchStamped: the load cell. Default: a `measured_cf`.
    pub wrench: Option<String>,
    /// The joint whose position is the depth, or of transforms the frame of the tip. Default: `insertion`.
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

/// A recorded quantity: its location and the meaning of its numbers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Quantity {
    /// Topic (`/load_cell`, `/daq[3]` for an element of an array), or column of a table by its header or by its
    /// number from 1. `None`: chosen automatically.
    pub place: Option<String>,
    /// Unit; `None`: that of the column's header, or SI for a topic.
    pub unit: Option<String>,
    /// Whether the number rises as the depth falls, or is the force on the tissue.
    pub reversed: bool,
    /// Recorded number at zero: the reading at first contact.
    pub zero: f64,
    /// Size of one count in the unit, such as 1 over an encoder's counts per unit. `None`: 1.
    pub factor: Option<f64>,
}

impl Quantity {
    /// Whether the recorded numbers are used unchanged.
    #[must_use]
    pub(crate) const fn is_plain(&self) -> bool {
        self.place.is_none() && self.unit.is_none() && !self.reversed && self.zero == 0.0 && self.factor.is_none()
    }

    /// +1 or -1.
    #[must_use]
    pub(crate) const fn sign(&self) -> f64 {
        if self.reversed { -1.0 } else { 1.0 }
    }

    /// Size of a topic's unit with the sign, in m or N.
    pub(super) fn scale(&self, dimension: Dimension, option: &'static str) -> Result<f64, UnknownUnit> {
        let unit = self.unit.as_deref().map_or(Ok(1.0), |text| {
            let unknown = || UnknownUnit { option, text: text.to_owned(), known: dimension.names() };
            dimension.unit(text).ok_or_else(unknown)
        });
        Ok(self.sign() * self.factor.unwrap_or(1.0) * unit?)
    }
}

/// An unknown unit.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{option} {text}: known are {known}")]
pub struct UnknownUnit {
    /// The option.
    pub option: &'static str,
    /// Its value.
    pub text: String,
    /// The known units.
    pub known: String,
}

/// An option that does not apply to the input.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{option} says nothing of {of}: {remedy}")]
pub struct NotHere {
    /// The option.
    pub option: &'static str,
    /// The kind of input.
    pub of: &'static str,
    /// What to do.
    pub remedy: &'static str,
}

/// Layout of a text table; options that are not given are detected.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TableLayout {
    /// Separator between cells.
    pub separator: Option<char>,
    /// Whether numbers are written with a decimal comma (0,5).
    pub decimal_comma: Option<bool>,
    /// Number of the line with the headers, from 1; 0: there are none.
    pub header_line: Option<usize>,
    /// Start of a comment line.
    pub comment: Option<String>,
    /// Index of the recording in a file with several, from 1.
    pub block: Option<usize>,
    /// Sheet of a workbook; `None`: the first that has rows of numbers.
    pub sheet: Option<String>,
}

/// All options for reading a recording, for bags and tables.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Selection {
    /// Topics with this project's own types, joint and frame.
    pub names: TopicNames,
    /// The displacement sensor.
    pub position: Quantity,
    /// The load cell.
    pub force: Quantity,
    /// Delay of the force's stamps relative to the position's, s; it is subtracted.
    pub time_offset_s: f64,
    /// Columns of time, one for all files or one for each.
    pub time: Vec<String>,
    /// Units of the time, one for all files or one for each.
    pub time_unit: Vec<String>,
    /// Rows per second, for a table without time.
    pub rate_hz: Option<f64>,
    /// Columns of the tip's x, y and z in the sample's frame, in the position's unit.
    pub pose: Option<[String; 3]>,
    /// Columns of the instrument's orientation in the sample's frame, a quaternion x, y, z, w; `None`: it points straight down.
    pub orientation: Option<[String; 4]>,
    /// Columns of the force's x, y and z.
    pub forces: Option<[String; 3]>,
    /// Reading of a load cell with three components without load, in the force's unit. With one component: `force.zero`.
    pub force_zeros: Option<[f64; 3]>,
    /// Rotates the force from the sensor's frame to the sample's: w, x, y, z.
    pub sensor_rotation: Option<[f64; 4]>,
    /// Pose of the sample in the frame of the recorded poses: x, y, z in m, and the quaternion x, y, z, w.
    pub sample_pose: Option<[f64; 7]>,
    /// Columns of markers, x, y and z of each, in the position's unit.
    pub markers: Vec<String>,
    /// Gauge length, m, if the position is given as a strain.
    pub gauge_length_m: Option<f64>,
    /// Layout of the text.
    pub layout: TableLayout,
    /// Readings of a series that are kept: of a longer one every second, fourth ... is taken. `None`: all.
    pub most_readings: Option<usize>,
}

impl Selection {
    fn refused(options: &[(&'static str, bool)], of: &'static str, remedy: &'static str) -> Result<(), NotHere> {
        let said = options.iter().find(|(_, said)| *said);
        said.map_or(Ok(()), |&(option, _)| Err(NotHere { option, of, remedy }))
    }

    fn of_poses(&self) -> Result<(), NotHere> {
        let options = [("--position-sign -1", self.position.reversed), ("--position-zero", self.position.zero != 0.0)];
        Self::refused(&options, "poses", "their frame is given by --sample-pose")
    }

    fn of_depths(&self) -> Result<(), NotHere> {
        let remedy = "a depth is counted from the sample's surface; --position-zero shifts it";
        Self::refused(&[("--sample-pose", self.sample_pose.is_some())], "depths", remedy)
    }

    /// Whether it was said what the load cell reads without load.
    pub(super) fn has_force_zero(&self) -> bool {
        self.force.zero != 0.0 || self.force_zeros.is_some()
    }

    /// Refuses a zero of a force where there is none.
    pub(super) fn zero_of_a_force(&self, is_there: bool) -> Result<(), NotHere> {
        let options = [("--force-zero", self.has_force_zero() && !is_there)];
        Self::refused(
            &options,
            "a recording without a force",
            "name the force with --force-column (--force-topic of a bag)",
        )
    }

    /// What a force of a bag reads without load, in the recorded unit. `only`: the one axis that is measured; `across`: whether there is a
    /// force along x or y; `is_number`: it was recorded as one number.
    pub(super) fn zero_in_a_bag(
        &self,
        only: Option<usize>,
        across: bool,
        is_number: bool,
    ) -> Result<[f64; 3], NotHere> {
        let one = [("--force-zero with one number", self.force.zero != 0.0 && only.is_none() && across)];
        Self::refused(&one, "a force with three components", "give what each of them reads without load, X,Y,Z")?;
        let three = [("--force-zero X,Y,Z", self.force_zeros.is_some() && is_number)];
        Self::refused(&three, "a force that is one number", "give one number")?;
        let mut zero = self.force_zeros.unwrap_or_default();
        if self.force.zero != 0.0 {
            zero[only.unwrap_or(2)] = self.force.zero;
        }
        Ok(zero)
    }

    /// Rejects options that do not apply to a bag.
    pub(super) fn fits_a_bag(&self, by_pose: bool) -> Result<(), NotHere> {
        let options = [
            ("--time", !self.time.is_empty()),
            ("--time-unit", !self.time_unit.is_empty()),
            ("--rate-hz", self.rate_hz.is_some()),
            ("--pose-columns", self.pose.is_some()),
            ("--force-columns", self.forces.is_some()),
            ("--gauge-length-m", self.gauge_length_m.is_some()),
            ("--block", self.layout.block.is_some()),
            ("--sheet", self.layout.sheet.is_some()),
        ];
        Self::refused(&options, "a bag", "leave it out")?;
        if by_pose { self.of_poses() } else { self.of_depths() }
    }

    /// Rejects options that do not apply to tables.
    pub(super) fn fits_a_table(&self, by_pose: bool) -> Result<(), NotHere> {
        let options = [("--force-column", self.forces.is_some() && self.force.place.is_some())];
        Self::refused(&options, "a force of --force-columns", "give one of them")?;
        let vector = [("--force-zero with one number", self.forces.is_some() && self.force.zero != 0.0)];
        Self::refused(&vector, "a force of three columns", "give what each of them reads without load, X,Y,Z")?;
        let scalar = [("--force-zero X,Y,Z", self.forces.is_none() && self.force_zeros.is_some())];
        Self::refused(&scalar, "a force of one column", "give one number")?;
        if by_pose { self.of_poses() } else { self.of_depths() }
    }
}
