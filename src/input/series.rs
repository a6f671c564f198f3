//! Values of one topic over time: decoded, stamped and put in order, with what is lost on the way.

use std::collections::BTreeMap;
use std::fmt::Display;

use ros2_messages::builtin_interfaces::Time;
use ros2_messages::{RosMessage, std_msgs::Header};
use rosbag2_mcap::{BagReader, Loss};

/// Largest step back in time that is taken for disorder and sorted, s. A larger one is a second recording.
const DISORDER_S: f64 = 1.0;
/// Reasons that are told apart; further ones are counted together.
const REASONS: usize = 8;

/// Reads series and gathers what is lost on the way.
pub(super) struct Reading<'a> {
    pub bag: &'a BagReader,
    pub losses: Vec<Loss>,
    pub warnings: Vec<String>,
}

/// Stamped values (ns since 1970) and their frame.
pub(super) type Series<V> = (Vec<(i64, V)>, String);

impl Reading<'_> {
    /// Values of one topic in the order of their stamps; why a message has none is counted by its reason.
    pub fn series<T: RosMessage, V: Copy, E: Display>(
        &mut self,
        topic: Option<usize>,
        value: impl Fn(&T) -> (&Header, Result<V, E>),
    ) -> Series<V> {
        let Some(number) = topic else { return (Vec::new(), String::new()) };
        let topic = &self.bag.topics()[number];
        let mut messages = self.bag.select(|t| t.name == topic.name && t.type_name == topic.type_name);
        let (mut samples, mut frame) = (Vec::new(), String::new());
        let mut left_out: BTreeMap<String, u64> = BTreeMap::new();
        let mut leave_out = |reason: String| {
            let told_apart = left_out.len() < REASONS || left_out.contains_key(&reason);
            *left_out.entry(if told_apart { reason } else { "other reasons".to_owned() }).or_default() += 1;
        };
        for message in &mut messages {
            match self.bag.decode::<T>(&message) {
                Err(reason) => leave_out(reason),
                Ok(decoded) => match value(&decoded) {
                    (_, Err(refusal)) => leave_out(refusal.to_string()),
                    (header, Ok(value)) => {
                        samples.push((header.stamp, message.publish_ns, value));
                        header.frame_id.clone_into(&mut frame);
                    }
                },
            }
        }
        for loss in messages.losses() {
            if !self.losses.contains(loss) {
                self.losses.push(loss.clone());
            }
        }
        let lost = left_out.into_iter();
        self.losses.extend(lost.map(|(reason, count)| Loss::Samples { topic: topic.name.clone(), count, reason }));
        let stamped = self.stamp(&topic.name, samples);
        (self.in_order(&topic.name, stamped), frame)
    }

    /// Times in ns: the header's stamps, or where some are zero the times of publishing for all.
    fn stamp<V>(&mut self, topic: &str, samples: Vec<(Time, u64, V)>) -> Vec<(i64, V)> {
        let unstamped = samples.iter().filter(|(stamp, ..)| stamp.is_zero()).count();
        if unstamped > 0 {
            let all = samples.len();
            self.warnings.push(format!(
                "{topic}: {unstamped} of {all} messages have no stamp; the times at which they were sent are used for all"
            ));
        }
        let time =
            |stamp: Time, sent: u64| if unstamped > 0 { sent.min(i64::MAX as u64) as i64 } else { stamp.nanos() };
        samples.into_iter().map(|(stamp, sent, v)| (time(stamp, sent), v)).collect()
    }

    /// Sorts small disorder, drops repeated stamps, and cuts at a large step back.
    fn in_order<V>(&mut self, topic: &str, mut samples: Vec<(i64, V)>) -> Vec<(i64, V)> {
        let mut latest = i64::MIN;
        let back = samples.iter().position(|(time, _)| {
            latest = latest.max(*time);
            (latest - time) as f64 * 1e-9 > DISORDER_S
        });
        if let Some(at) = back {
            let count = (samples.len() - at) as u64;
            let reason = "their stamps step back by more than a second: only what lies before is used".to_owned();
            self.losses.push(Loss::Samples { topic: topic.to_owned(), count, reason });
            samples.truncate(at);
        }
        if !samples.is_sorted_by_key(|(time, _)| *time) {
            samples.sort_by_key(|(time, _)| *time);
            self.warnings.push(format!("{topic}: messages are not in the order of their stamps; they were sorted"));
        }
        let before = samples.len();
        samples.dedup_by_key(|(time, _)| *time);
        if samples.len() < before {
            let count = before - samples.len();
            self.warnings.push(format!("{topic}: {count} messages repeat a stamp; the first of each was taken"));
        }
        samples
    }
}
