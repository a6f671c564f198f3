//! A way that is too long to be made within one answer: the twin goes it in parts, between which its thread can do other things.

use super::{Halt, Prediction, StampedPose, Twin};
use crate::instrument::Tip;

/// A way from where the instrument is in the tissue to a pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Length {
    /// Length below the surface, m.
    pub way_m: f64,
    /// Strides that it is made in.
    pub strides: u32,
    /// Length of one of them, m.
    pub stride_m: f64,
}

/// What came of a part of a way.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(clippy::large_enum_variant)] // one of them at a time, and a box would be allocated for each pose
pub enum Part {
    /// So many strides are left.
    Left(u32),
    /// The instrument is there: the answer to the pose.
    There(Prediction),
}

impl Twin {
    /// How long the way to a pose is.
    ///
    /// # Errors
    /// [`Halt::Pose`] if the pose can't be used.
    pub fn way_to(&self, pose: &StampedPose) -> Result<Length, Halt> {
        let way = self.way(&self.admit(pose)?);
        let strides = way.strides();
        Ok(Length { way_m: way.length, strides, stride_m: way.length / f64::from(strides.max(1)) })
    }

    /// As [`Twin::step`], but no further than so many strides of a length in m: those of the whole way, which [`Twin::way_to`] says. The next
    /// call goes on from there, to the same pose or to another one.
    ///
    /// # Errors
    /// As [`Twin::step`].
    pub fn step_in_part(&mut self, pose: StampedPose, stride_m: f64, strides: u32) -> Result<Part, Halt> {
        let tip = self.admit(&pose)?;
        self.try_again(&tip)?;
        match self.walk_in_part(pose, tip, stride_m, strides) {
            Ok(Part::Left(left)) => Ok(Part::Left(left)),
            Ok(Part::There(answer)) => self.close(pose.time_s, tip.depth, Ok(answer)).map(Part::There),
            Err(halt) => self.close(pose.time_s, tip.depth, Err(halt)).map(Part::There),
        }
    }

    fn walk_in_part(&mut self, pose: StampedPose, tip: Tip, stride_m: f64, strides: u32) -> Result<Part, Halt> {
        let mut steps = 0_u32;
        self.happened.begin();
        let way = self.way(&tip).in_strides(stride_m);
        self.time(pose.time_s, &tip, way.moves());
        // a jump in parts: its strides are long, and each is worth the steps of a pose
        let most = self.progress.pace.most();
        for (made, between) in (0..).zip(way.places()) {
            if made == strides {
                return Ok(Part::Left(way.strides().saturating_sub(made)));
            }
            steps = steps.saturating_add(self.go(pose, between, most)?.steps);
        }
        let last = self.go(pose, tip, most)?;
        Ok(Part::There(Prediction { steps: steps.saturating_add(last.steps), event: self.happened.first(), ..last }))
    }
}
