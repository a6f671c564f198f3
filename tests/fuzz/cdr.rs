// Any bytes as a message: shared by the fuzz target in `fuzz/` and by `tests/fuzz.rs`.

use ros2_messages::RosMessage;
use ros2_messages::diagnostic_msgs::DiagnosticArray;
use ros2_messages::geometry_msgs::{PoseArray, PoseStamped, WrenchStamped};
use ros2_messages::needle_twin::{
    ForceBand, ForceComparison, Outlook, Safety, TissueEvent, TissueModel, TissueState, TwinStatus,
};
use ros2_messages::rosgraph_msgs::Clock;
use ros2_messages::sensor_msgs::{JointState, PointCloud2};
use ros2_messages::visualization_msgs::Marker;
use ros2_messages::{from_cdr, to_cdr};

/// The types, in the order of their numbers.
pub const TYPES: [fn(&[u8]); 16] = [
    one::<JointState>,
    one::<PoseStamped>,
    one::<WrenchStamped>,
    one::<Clock>,
    one::<TwinStatus>,
    one::<ForceComparison>,
    one::<TissueModel>,
    one::<TissueState>,
    one::<PointCloud2>,
    one::<Marker>,
    one::<DiagnosticArray>,
    one::<PoseArray>,
    one::<ForceBand>,
    one::<TissueEvent>,
    one::<Outlook>,
    one::<Safety>,
];

/// The first byte says which type the others are taken for.
pub fn exercise(data: &[u8]) {
    if let Some((kind, bytes)) = data.split_first() {
        TYPES[usize::from(*kind) % TYPES.len()](bytes);
    }
}

/// What can be read can be written, and read again the same.
fn one<M: RosMessage>(bytes: &[u8]) {
    let Ok(message) = from_cdr::<M>(bytes) else { return };
    let written = to_cdr(&message).expect("a message that was read can be written");
    let again = from_cdr::<M>(&written).expect("what was written can be read");
    assert_eq!(to_cdr(&again).expect("and written again"), written);
}
