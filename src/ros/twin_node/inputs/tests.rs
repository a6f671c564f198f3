#![allow(clippy::unwrap_used)]
use super::*;
use crate::ros::clock::NodeClock;
use crate::ros::messages::std_msgs::Header;
use crate::ros::parameters::Parameters;
use crate::ros::twin_node::declared::{Settings, declarations};
use crate::ros::twin_node::inbox::Work;

fn shared() -> Shared {
    let (parameters, _) = Parameters::declare(declarations(), &[], "/twin").unwrap();
    let shared = Shared::new(Settings::of(&parameters), NodeClock::new(false));
    shared.set_state(crate::ros::lifecycle::State::Active);
    shared
}

fn joint(sec: i32, nanosec: u32, names: &[&str], positions: &[f64]) -> JointState {
    JointState {
        header: Header { stamp: Time { sec, nanosec }, frame_id: String::new() },
        name: names.iter().map(|n| (*n).to_owned()).collect(),
        position: positions.to_vec(),
        ..JointState::default()
    }
}

#[test]
fn straight_down_is_half_a_turn_about_x() {
    let axis = forward(Quaternion { x: 1.0, y: 0.0, z: 0.0, w: 0.0 }).unwrap();
    assert!((axis[2] + 1.0).abs() < 1e-12);
    assert_eq!(forward(Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 0.0 }), None);
    assert_eq!(forward(Quaternion { x: f64::NAN, y: 0.0, z: 0.0, w: 1.0 }), None);
}

#[test]
fn what_is_no_pose_is_refused_and_counted() {
    let (shared, inbox) = (shared(), Inbox::default());
    let mut intake = Intake::new("sample", &shared, &inbox);
    intake.joint_state(&joint(10, 0, &["insertion"], &[f64::NAN]));
    intake.joint_state(&joint(10, 0, &["elbow"], &[0.1]));
    intake.joint_state(&joint(10, 0, &["insertion"], &[]));
    intake.pose_stamped(&PoseStamped::default());
    intake.joint_state(&joint(i32::MAX, 0, &["insertion"], &[0.001]));
    let live = shared.lock();
    assert_eq!((live.rejected, live.received), (5, 0));
    assert_eq!(live.rejects[&Reject::NoSuchJoint], 2);
    assert_eq!(live.rejects[&Reject::WrongFrame], 1);
    assert_eq!(live.rejects[&Reject::Future], 1);
}

#[test]
fn order_is_kept_and_a_jump_back_resets() {
    let (shared, inbox) = (shared(), Inbox::default());
    let mut intake = Intake::new("sample", &shared, &inbox);
    intake.joint_state(&joint(100, 0, &["insertion"], &[0.001]));
    intake.joint_state(&joint(100, 0, &["insertion"], &[0.001]));
    intake.joint_state(&joint(99, 900_000_000, &["insertion"], &[0.001]));
    assert_eq!(shared.lock().rejects[&Reject::OutOfOrder], 2);
    // a straggler, and the stream goes on
    intake.joint_state(&joint(40, 0, &["insertion"], &[0.0]));
    intake.joint_state(&joint(100, 10, &["insertion"], &[0.001]));
    let counts = |live: &crate::ros::twin_node::shared::Live| (live.received, live.rejects[&Reject::OutOfOrder]);
    assert_eq!(counts(&shared.lock()), (2, 3));
    // time starts again
    intake.joint_state(&joint(49, 0, &["insertion"], &[0.0]));
    intake.joint_state(&joint(50, 0, &["x", "insertion"], &[0.0, 0.002]));
    assert_eq!(counts(&shared.lock()), (4, 3), "the first pose of the new time is not lost");
    assert!(matches!(inbox.next(), Work::Reset(_)));
    assert!(matches!(inbox.next(), Work::Pose(p) if p.place == Where::Depth(0.002)));
}
