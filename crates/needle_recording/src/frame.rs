//! Recorded frames other than the sample's: those of the sensor and the robot.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::selection::Selection;
use needle_core::twin::Pose;

/// Norms of a quaternion that counts as a rotation, with a tolerance for rounding.
const ROTATION: std::ops::RangeInclusive<f64> = 0.9..=1.1;

/// An option that does not describe a frame.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{option} {values:?}: {reason}")]
pub struct FrameError {
    /// The option.
    pub option: &'static str,
    /// Its values.
    pub values: Vec<f64>,
    /// What is wrong with it.
    pub reason: &'static str,
}

/// Transforms recorded quantities to frame `sample`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Frames {
    sensor: Option<UnitQuaternion<f64>>,
    /// Position and orientation of the sample in the recorded frame.
    sample: Option<(Vector3<f64>, UnitQuaternion<f64>)>,
}

impl Frames {
    pub(crate) fn of(said: &Selection) -> Result<Self, FrameError> {
        let turned = |option, [w, x, y, z]: [f64; 4], values: &[f64]| {
            let q = Quaternion::new(w, x, y, z);
            let reason = "a quaternion of norm 1 is needed";
            let error = FrameError { option, values: values.to_vec(), reason };
            if ROTATION.contains(&q.norm()) { Ok(UnitQuaternion::new_normalize(q)) } else { Err(error) }
        };
        let sensor = said.sensor_rotation.map(|q| turned("--sensor-rotation", q, &q)).transpose()?;
        let sample = said.sample_pose.map(|pose| {
            let [x, y, z, qx, qy, qz, qw] = pose;
            let orientation = turned("--sample-pose", [qw, qx, qy, qz], &pose)?;
            let reason = "three finite coordinates in m and a quaternion are needed";
            let error = FrameError { option: "--sample-pose", values: pose.to_vec(), reason };
            if pose.iter().all(|v| v.is_finite()) { Ok((Vector3::new(x, y, z), orientation)) } else { Err(error) }
        });
        Ok(Self { sensor, sample: sample.transpose()? })
    }

    /// A pose in the frame of the sample.
    pub(crate) fn pose(&self, pose: Pose) -> Pose {
        let Some((origin, orientation)) = &self.sample else { return pose };
        let tip = orientation.inverse_transform_vector(&(Vector3::from(pose.tip) - origin));
        let [axis, x] =
            [pose.axis, pose.x_axis()].map(|v| orientation.inverse_transform_vector(&Vector3::from(v)).into());
        Pose::with_x_axis(tip.into(), axis, x)
    }

    /// A point in the frame of the sample.
    pub(crate) fn point(&self, point: [f64; 3]) -> [f64; 3] {
        self.pose(Pose { tip: point, axis: [0.0, 0.0, -1.0], roll_rad: 0.0 }).tip
    }

    /// A force in the frame of the sample. `with_poses`: it was recorded in the frame of the poses.
    pub(crate) fn force(&self, force_n: [f64; 3], with_poses: bool) -> [f64; 3] {
        let force = Vector3::from(force_n);
        match (&self.sensor, &self.sample) {
            (Some(sensor), _) => sensor.transform_vector(&force).into(),
            (None, Some((_, sample))) if with_poses => sample.inverse_transform_vector(&force).into(),
            _ => force_n,
        }
    }

    /// Whether the user gave the pose of the sample.
    pub(crate) const fn knows_sample(&self) -> bool {
        self.sample.is_some()
    }

    /// Whether the user gave the frame of the sensor.
    pub(crate) const fn knows_sensor(&self) -> bool {
        self.sensor.is_some()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn near(a: [f64; 3], b: [f64; 3]) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12)
    }

    #[test]
    fn poses_and_forces_come_into_the_frame_of_the_sample() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        // the sample's x axis is the robot's y axis
        let said = Selection {
            sample_pose: Some([0.4, -0.1, 0.3, 0.0, 0.0, half, half]),
            sensor_rotation: Some([0.0, 1.0, 0.0, 0.0]),
            ..Selection::default()
        };
        let frames = Frames::of(&said).unwrap();
        let pose = frames.pose(Pose { tip: [0.4, -0.09, 0.31], axis: [0.0, 1.0, 0.0], roll_rad: 0.0 });
        assert!(near(pose.tip, [0.01, 0.0, 0.01]) && near(pose.axis, [1.0, 0.0, 0.0]), "{pose:?}");
        assert!(near(frames.force([1.0, 2.0, -3.0], false), [1.0, -2.0, 3.0]), "half a turn about x");
        let robot = Frames { sensor: None, ..frames };
        assert!(near(robot.force([0.0, 2.0, 1.0], true), [2.0, 0.0, 1.0]));
        assert!(near(robot.force([0.0, 2.0, 1.0], false), [0.0, 2.0, 1.0]));
        for wrong in [[0.0; 4], [f64::NAN, 0.0, 0.0, 1.0]] {
            let error = Frames::of(&Selection { sensor_rotation: Some(wrong), ..Selection::default() }).unwrap_err();
            assert!(error.to_string().contains("--sensor-rotation"), "{error}");
        }
    }
}
