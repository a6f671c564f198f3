//! Values of one topic over time: decoded, stamped and sorted, with the losses.

use std::collections::BTreeMap;
use std::fmt::Display;

use super::clocks::{Arrival, Gathered};
use super::order::Ordered;
use super::thin::Thin;
use ros2_messages::std_msgs::Header;
use rosbag2_mcap::{BagReader, Loss, Message};

/// Number of distinct reasons; further ones are counted together.
const REASONS: usize = 8;

/// Reads series and collects losses.
pub(super) struct Reading<'a> {
    pub bag: &'a BagReader,
    pub losses: Vec<Loss>,
    pub warnings: Vec<String>,
    /// Readings of a series that are kept.
    pub most: Option<usize>,
}

/// Stamped values (ns since 1970) and their frame.
pub(super) type Series<V> = (Vec<(i64, V)>, String);

/// Content of a message.
pub(super) enum Held<V, E> {
    Value(V),
    /// Valid, but not relevant: it belongs to another part of the rig.
    Nothing(E),
    Refused(E),
}

impl<V, E> From<Result<V, E>> for Held<V, E> {
    fn from(result: Result<V, E>) -> Self {
        result.map_or_else(Self::Refused, Self::Value)
    }
}

impl Reading<'_> {
    /// Values of one topic in the order of the bag. Messages without a value are counted by the reason.
    pub(crate) fn gather<V, E: Display>(
        &mut self,
        topic: Option<usize>,
        value: impl Fn(&Message) -> Result<(Held<V, E>, Header), String>,
    ) -> Gathered<V> {
        let (topic_name, nothing) = (String::new(), BTreeMap::new());
        let mut gathered = Gathered { topic: topic_name, samples: Vec::new(), frame: String::new(), nothing };
        let Some(number) = topic else { return gathered };
        let topic = &self.bag.topics()[number];
        gathered.topic.clone_from(&topic.name);
        let mut messages = self.bag.select(|t| t.name == topic.name && t.type_name == topic.type_name);
        let mut thin = Thin::to(self.most);
        let mut left_out: BTreeMap<String, u64> = BTreeMap::new();
        let count = |of: &mut BTreeMap<String, u64>, reason: String| {
            let told_apart = of.len() < REASONS || of.contains_key(&reason);
            *of.entry(if told_apart { reason } else { "other reasons".to_owned() }).or_default() += 1;
        };
        for message in &mut messages {
            match value(&message) {
                Err(reason) => count(&mut left_out, reason),
                Ok((Held::Refused(refusal), _)) => count(&mut left_out, refusal.to_string()),
                Ok((Held::Nothing(why), _)) => count(&mut gathered.nothing, why.to_string()),
                Ok((Held::Value(value), header)) => {
                    let Message { publish_ns, log_ns, .. } = message;
                    thin.take(&mut gathered.samples, (Arrival { stamp: header.stamp, publish_ns, log_ns }, value));
                    gathered.frame = header.frame_id;
                }
            }
        }
        self.warnings.extend(thin.warning(&topic.name));
        for loss in messages.losses() {
            if !self.losses.contains(loss) {
                self.losses.push(loss.clone());
            }
        }
        self.lose(&topic.name, left_out);
        gathered
    }

    /// Counts messages as lost, by the reason.
    pub(crate) fn lose(&mut self, topic: &str, reasons: BTreeMap<String, u64>) {
        let lost = reasons.into_iter();
        self.losses.extend(lost.map(|(reason, count)| Loss::Samples { topic: topic.to_owned(), count, reason }));
    }
}

/// Samples in the order of their stamps, without outlying stamps.
pub(super) fn in_order<V: PartialEq>(
    topic: &str,
    samples: Vec<(i64, V)>,
    losses: &mut Vec<Loss>,
    warnings: &mut Vec<String>,
) -> Vec<(i64, V)> {
    let ordered = Ordered::new(samples);
    told(topic, &ordered, losses, warnings);
    ordered.samples
}

/// Says what was changed and what was left out.
pub(super) fn told<V>(topic: &str, ordered: &Ordered<V>, losses: &mut Vec<Loss>, warnings: &mut Vec<String>) {
    let mut lose = |count: usize, reason: &str| {
        if count > 0 {
            let (topic, count) = (topic.to_owned(), count as u64);
            losses.push(Loss::Samples { topic, count, reason: reason.to_owned() });
        }
    };
    lose(ordered.strays, "their stamps are of another time than those of the messages round them");
    lose(
        ordered.second,
        "their stamps step back by more than a second: only what lies before is used. Where a clock was set back, --rate-hz takes the rows \
         of a table at a constant rate",
    );
    lose(ordered.one_time, "all have one stamp: give the column of the time, or --rate-hz");
    if ordered.sorted {
        warnings.push(format!("{topic}: messages are not in the order of their stamps; they were sorted"));
    }
    if ordered.spread > 0 {
        let count = ordered.spread;
        warnings.push(format!(
            "{topic}: {count} readings have the stamp of another: they were spread evenly over the time to the next stamp"
        ));
    }
    if ordered.repeated > 0 {
        let count = ordered.repeated;
        warnings.push(format!("{topic}: {count} messages repeat another, stamp and value; each was taken once"));
    }
}
