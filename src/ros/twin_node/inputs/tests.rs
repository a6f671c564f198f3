#![allow(clippy::unwrap_used, clippy::panic)]
use super::*;
use crate::ros::twin_node::declared::{Settings, declarations};
use crate::ros::twin_node::inbox::Work;
use needle_recording::{Recording, TopicNames};
use ros2_messages::geometry_msgs::{Point, Pose, Quaternion};
use ros2_messages::std_msgs::Header;
use ros2_node::clock::NodeClock;
use ros2_node::parameters::Parameters;
use rosbag2_mcap::{BagWriter, WriterOptions};
use tracing_subscriber::layer::SubscriberExt as _;

fn shared() -> Shared {
    let (parameters, _) = Parameters::declare(declarations(), &[], "/twin").unwrap();
    let shared = Shared::new(Settings::of(&parameters), NodeClock::new(false));
    shared.set_state(ros2_node::lifecycle::State::Active);
    shared
}

fn from(publisher: u8) -> Origin {
    Origin { publisher: Guid([publisher; 16]), received: Instant::now() }
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
fn what_is_no_pose_is_refused_and_counted() {
    let (shared, inbox) = (shared(), Inbox::default());
    let mut intake = Intake::new("sample", &shared, &inbox);
    intake.joint_state(&joint(10, 0, &["insertion"], &[f64::NAN]), from(1));
    intake.joint_state(&joint(10, 0, &["elbow"], &[0.1]), from(1));
    intake.joint_state(&joint(10, 0, &["insertion"], &[]), from(1));
    intake.pose_stamped(&PoseStamped::default().held(), from(1));
    intake.joint_state(&joint(i32::MAX, 0, &["insertion"], &[0.001]), from(1));
    let live = shared.lock();
    assert_eq!((live.rejected, live.received), (5, 0));
    assert_eq!(live.rejects[&Reject::NoSuchJoint], 2);
    assert_eq!(live.rejects[&Reject::WrongFrame], 1);
    assert_eq!(live.rejects[&Reject::Future], 1);
}

#[test]
fn joints_of_another_robot_on_the_topic_are_no_fault() {
    let (shared, inbox) = (shared(), Inbox::default());
    let mut intake = Intake::new("sample", &shared, &inbox);
    for i in 0..5 {
        intake.joint_state(&joint(10 + i, 0, &["insertion"], &[0.001]), from(1));
        intake.joint_state(&joint(10 + i, 0, &["gripper"], &[0.1]), from(2));
    }
    let live = shared.lock();
    assert_eq!((live.rejected, live.received), (0, 5));
}

#[test]
fn order_is_kept_and_a_jump_back_resets() {
    let (shared, inbox) = (shared(), Inbox::default());
    let mut intake = Intake::new("sample", &shared, &inbox);
    intake.joint_state(&joint(100, 0, &["insertion"], &[0.001]), from(1));
    intake.joint_state(&joint(100, 0, &["insertion"], &[0.001]), from(1));
    intake.joint_state(&joint(99, 900_000_000, &["insertion"], &[0.001]), from(1));
    assert_eq!(shared.lock().rejects[&Reject::OutOfOrder], 2);
    // a late pose, and the stream continues
    intake.joint_state(&joint(40, 0, &["insertion"], &[0.0]), from(1));
    intake.joint_state(&joint(100, 10, &["insertion"], &[0.001]), from(1));
    let counts = |live: &crate::ros::twin_node::shared::Live| (live.received, live.rejects[&Reject::OutOfOrder]);
    assert_eq!(counts(&shared.lock()), (2, 3));
    // two late poses are no restarted time, nor are many from different publishers
    intake.joint_state(&joint(49, 0, &["insertion"], &[0.0]), from(1));
    intake.joint_state(&joint(49, 1, &["insertion"], &[0.0]), from(1));
    intake.joint_state(&joint(100, 20, &["insertion"], &[0.001]), from(1));
    assert_eq!(counts(&shared.lock()), (3, 5));
    // another publisher must wait until the followed one is silent
    intake.joint_state(&joint(100, 30, &["insertion"], &[0.009]), from(2));
    assert_eq!(shared.lock().rejects[&Reject::SecondSource], 1);
    // time restarts
    for i in 0..7 {
        intake.joint_state(&joint(50, i, &["x", "insertion"], &[0.0, 0.002]), from(1));
        std::thread::sleep(Duration::from_millis(100));
    }
    assert_eq!(counts(&shared.lock()), (10, 5), "the first poses of the new time are not lost");
    assert!(matches!(inbox.next(1), Work::Reset(_)));
    assert!(matches!(inbox.next(1), Work::Pose(p) if p.place == Where::Depth(0.002)));
}

/// The live node's result for a message: the position, or the text of the rejection.
fn live(message: &Message) -> Result<Where, String> {
    let (shared, inbox) = (shared(), Inbox::default());
    let words = Words::default();
    tracing::subscriber::with_default(tracing_subscriber::registry().with(words.clone()), || {
        let mut intake = Intake::new("sample", &shared, &inbox);
        match message {
            Message::Joint(m) => intake.joint_state(m, from(1)),
            Message::Pose(m) => intake.pose_stamped(&m.clone().held(), from(1)),
        }
    });
    if shared.lock().rejected == 0 {
        let Work::Pose(pose) = inbox.next(1) else { panic!("a pose was taken") };
        return Ok(pose.place);
    }
    let words = words.0.lock().unwrap();
    Err(words.split_once(": measured_").unwrap().1.split_once(": ").unwrap().1.to_owned())
}

/// The result of a replay or a calibration for the same message, recorded.
fn recorded(message: &Message) -> Result<Where, String> {
    let folder = tempfile::tempdir().unwrap();
    let mut bag = BagWriter::create(folder.path().join("bag"), WriterOptions::default()).unwrap();
    let qos = rosbag2_mcap::Qos::reliable(10);
    match message {
        Message::Joint(m) => {
            let topic = bag.add_topic::<JointState>("/measured_js", &qos).unwrap();
            bag.write(topic, 1, 1, m).unwrap();
        }
        Message::Pose(m) => {
            let topic = bag.add_topic::<PoseStamped>("/measured_cp", &qos).unwrap();
            bag.write(topic, 1, 1, m).unwrap();
        }
    }
    bag.finish().unwrap();
    let recording = Recording::load(folder.path().join("bag"), &TopicNames::default()).map_err(|e| e.to_string());
    match recording {
        Ok(r) => Ok(r.depths.first().map_or_else(|| Where::Pose(r.poses[0].pose()), |d| Where::Depth(d.depth_m))),
        Err(text) => Err(text.split_once("left out: ").unwrap().1.to_owned()),
    }
}

enum Message {
    Joint(JointState),
    Pose(PoseStamped),
}

/// Collects log lines.
#[derive(Clone, Default)]
struct Words(std::sync::Arc<std::sync::Mutex<String>>);

impl<S: tracing::Subscriber> tracing_subscriber::Layer<S> for Words {
    fn on_event(&self, event: &tracing::Event<'_>, _: tracing_subscriber::layer::Context<'_, S>) {
        struct Text<'a>(&'a mut String);
        impl tracing::field::Visit for Text<'_> {
            fn record_debug(&mut self, _: &tracing::field::Field, value: &dyn std::fmt::Debug) {
                self.0.push_str(&format!("{value:?}"));
            }
        }
        event.record(&mut Text(&mut self.0.lock().unwrap()));
    }
}

#[test]
fn live_and_recorded_messages_are_taken_and_refused_alike_in_the_same_words() {
    let pose = |frame: &str, x: f64, orientation: [f64; 4]| {
        let [x_, y, z, w] = orientation;
        Message::Pose(PoseStamped {
            header: Header { stamp: Time { sec: 10, nanosec: 0 }, frame_id: frame.to_owned() },
            pose: Pose { position: Point { x, y: 0.0, z: 0.02 }, orientation: Quaternion { x: x_, y, z, w } },
        })
    };
    let joint = |names: &[&str], positions: &[f64]| Message::Joint(joint(10, 0, names, positions));
    let down = [1.0, 0.0, 0.0, 0.0];
    let taken = [
        joint(&["insertion"], &[0.001]),
        joint(&["yaw", "insertion"], &[9.0, 0.002]),
        joint(&[], &[0.003]),
        pose("sample", 0.0, down),
        pose("/sample", 0.001, [0.95, 0.1, 0.0, 0.2]),
    ];
    for message in &taken {
        let (live, recorded) = (live(message).unwrap(), recorded(message).unwrap());
        assert_eq!(live, recorded);
    }
    let refused = [
        (joint(&["slide"], &[0.001]), "no joint `insertion` but slide"),
        (joint(&["yaw", "slide"], &[0.001, 0.2]), "but yaw, slide"),
        (joint(&[], &[0.001, 0.2]), "joints without names"),
        (joint(&["insertion"], &[]), "no position"),
        (joint(&["insertion"], &[f64::NAN]), "NaN"),
        (pose("world", 0.0, down), "in frame `world`, the twin needs `sample`"),
        (pose("", 0.0, down), "in frame ``"),
        (pose("sample", f64::INFINITY, down), "inf"),
        (pose("sample", 0.0, [0.8, 0.0, 0.0, 0.0]), "norm 0.8"),
        (pose("sample", 0.0, [0.0, 0.0, 0.0, 1.2]), "norm 1.2"),
        (pose("sample", 0.0, [0.0; 4]), "norm 0"),
    ];
    for (message, word) in &refused {
        let (live, recorded) = (live(message).unwrap_err(), recorded(message).unwrap_err());
        assert_eq!(live, recorded);
        assert!(live.contains(word), "{live}");
    }
}
