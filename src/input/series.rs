//! Values of one topic over time: decoded, stamped and put in order, with what is lost on the way.

use super::recording::topic_error;
use ros2_messages::builtin_interfaces::Time;
use ros2_messages::sensor_msgs::JointState;
use ros2_messages::{RosMessage, std_msgs::Header};
use rosbag2_mcap::BagReader;
use rosbag2_mcap::{BagError, Loss};

/// Largest step back in time that is taken for disorder and sorted, s. A larger one is a second recording.
const DISORDER_S: f64 = 1.0;

/// Reads series and gathers what is lost on the way.
pub(super) struct Reading<'a> {
    pub bag: &'a BagReader,
    pub losses: Vec<Loss>,
    pub warnings: Vec<String>,
}

/// Stamped values (ns since 1970) and their frame.
pub(super) type Series<const N: usize> = (Vec<(i64, [f64; N])>, String);

impl Reading<'_> {
    /// Depths of one joint.
    pub fn depths(&mut self, topic: Option<usize>, joint: &str) -> Result<Series<1>, BagError> {
        let Some(number) = topic else { return Ok((Vec::new(), String::new())) };
        let topic = &self.bag.topics()[number];
        let mut others: Vec<String> = Vec::new();
        let series = self.series(Some(number), |m: &JointState| {
            let at = m.name.iter().position(|name| name == joint);
            // A sensor with one joint may call it as it likes.
            let at = at.or_else(|| (m.position.len() == 1).then_some(0));
            if m.name.len() == 1 && m.name[0] != joint || at.is_none() {
                for name in &m.name {
                    if !others.contains(name) && others.len() < 20 {
                        others.push(name.clone());
                    }
                }
            }
            Some((m.header.clone(), [*m.position.get(at?)?]))
        })?;
        if series.0.is_empty() && !others.is_empty() {
            let reason = format!(
                "it has no joint {joint:?}; it has {}. Name the joint whose position is the depth",
                others.join(", ")
            );
            return Err(topic_error(self.bag, topic, reason));
        }
        if !others.is_empty() {
            self.warnings.push(format!(
                "{}: its only joint is called {}, not {joint:?}; it was taken",
                topic.name,
                others.join(", ")
            ));
        }
        Ok(series)
    }

    /// Finite values of one topic in the order of their stamps.
    pub fn series<T: RosMessage, const N: usize>(
        &mut self,
        topic: Option<usize>,
        mut values: impl FnMut(&T) -> Option<(Header, [f64; N])>,
    ) -> Result<Series<N>, BagError> {
        let Some(number) = topic else { return Ok((Vec::new(), String::new())) };
        let topic = &self.bag.topics()[number];
        let mut messages = self.bag.select(|t| t.name == topic.name && t.type_name == topic.type_name);
        let (mut samples, mut frame) = (Vec::new(), String::new());
        let (mut undecodable, mut reason, mut without, mut infinite) = (0, String::new(), 0, 0);
        for message in &mut messages {
            match self.bag.decode::<T>(&message) {
                Err(e) => {
                    undecodable += 1;
                    reason = e;
                }
                Ok(decoded) => match values(&decoded) {
                    None => without += 1,
                    Some((_, v)) if !v.iter().all(|v| v.is_finite()) => infinite += 1,
                    Some((header, v)) => {
                        samples.push((header.stamp, message.publish_ns, v));
                        frame = header.frame_id;
                    }
                },
            }
        }
        for loss in messages.losses() {
            if !self.losses.contains(loss) {
                self.losses.push(loss.clone());
            }
        }
        let mut lose = |count: u64, reason: &str| {
            if count > 0 {
                self.losses.push(Loss::Samples { topic: topic.name.clone(), count, reason: reason.to_owned() });
            }
        };
        lose(undecodable, &reason);
        lose(without, "they hold no such value");
        lose(infinite, "their values are not finite");
        let stamped = self.stamp(&topic.name, samples);
        Ok((self.in_order(&topic.name, stamped), frame))
    }

    /// Times in ns: the header's stamps, or where some are zero the times of publishing for all.
    fn stamp<const N: usize>(&mut self, topic: &str, samples: Vec<(Time, u64, [f64; N])>) -> Vec<(i64, [f64; N])> {
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
    fn in_order<const N: usize>(&mut self, topic: &str, mut samples: Vec<(i64, [f64; N])>) -> Vec<(i64, [f64; N])> {
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
