//! Package `tf2_msgs`.

use super::{geometry_msgs::TransformStamped, ros_messages};
use serde::{Deserialize, Serialize};

/// Transforms on `/tf` and `/tf_static`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TFMessage {
    /// Each the pose of one frame in another.
    pub transforms: Vec<TransformStamped>,
}

ros_messages!("tf2_msgs": TFMessage);
