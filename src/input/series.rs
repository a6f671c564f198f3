//! Values of one topic over time: decoded, stamped and put in order, with what is lost on the way.

use std::collections::BTreeMap;
use std::fmt::Display;

use super::order::Ordered;
use ros2_messages::builtin_interfaces::Time;
use ros2_messages::std_msgs::Header;
use rosbag2_mcap::{BagReader, Loss, Message};

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
    pub fn series<V, E: Display>(
        &mut self,
        topic: Option<usize>,
        value: impl Fn(&Message) -> Result<(Result<V, E>, Header), String>,
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
            match value(&message) {
                Err(reason) => leave_out(reason),
                Ok((Err(refusal), _)) => leave_out(refusal.to_string()),
                Ok((Ok(value), header)) => {
                    samples.push((header.stamp, message.publish_ns, value));
                    frame = header.frame_id;
                }
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
        (in_order(&topic.name, stamped, &mut self.losses, &mut self.warnings), frame)
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
}

/// Samples in the order of their stamps, without those that are of another time.
pub(super) fn in_order<V>(
    topic: &str,
    samples: Vec<(i64, V)>,
    losses: &mut Vec<Loss>,
    warnings: &mut Vec<String>,
) -> Vec<(i64, V)> {
    let ordered = Ordered::new(samples);
    let mut lose = |count: usize, reason: &str| {
        if count > 0 {
            let (topic, count) = (topic.to_owned(), count as u64);
            losses.push(Loss::Samples { topic, count, reason: reason.to_owned() });
        }
    };
    lose(ordered.strays, "their stamps are of another time than those of the messages round them");
    lose(ordered.second, "their stamps step back by more than a second: only what lies before is used");
    if ordered.sorted {
        warnings.push(format!("{topic}: messages are not in the order of their stamps; they were sorted"));
    }
    if ordered.repeated > 0 {
        let count = ordered.repeated;
        warnings.push(format!("{topic}: {count} messages repeat a stamp; the first of each was taken"));
    }
    ordered.samples
}
