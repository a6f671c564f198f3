//! Whether it is safe to go on, for whoever drives the needle: `safe_to_go_on`, at a steady rate.
//!
//! True only while the prediction is valid in every respect: the node is active and its health no worse than WARN, a pose
//! that came within `guard_timeout_s` has been answered and published, and, with a `residual_band_n`, the load cell
//! speaks and agrees. A node that is frozen or dead says nothing, so silence means "not safe" too: whoever listens needs
//! a timeout of their own, a few periods long.

use std::time::{Duration, Instant};

use super::declared::Settings;
use super::judgement::{Around, judge};
use super::shared::Shared;
use crate::ros::messages::needle_twin::ForceComparison;
use crate::ros::messages::std_msgs::Bool;
use crate::ros::participant::{Output, Participant, ParticipantError};
use crate::ros::qos;

/// See the module.
pub(super) struct Assurance {
    output: Output<Bool>,
}

/// What the force thread has last said, and when.
#[derive(Debug, Default)]
pub(super) struct Said {
    /// When the last pose came whose answer was published.
    pub pose: Option<Instant>,
    /// The last comparison with the load cell that was valid: when it was made, and its residual, N.
    pub residual: Option<(Instant, f64)>,
}

impl Said {
    /// Takes a comparison.
    pub fn compared(&mut self, message: &ForceComparison) {
        if message.valid {
            self.residual = Some((Instant::now(), message.residual_n));
        }
    }

    /// Whether what was said is fresh, and the load cell agrees if it is asked.
    pub fn vouches(&self, settings: &Settings, now: Instant) -> bool {
        let timeout = Duration::try_from_secs_f64(settings.guard_timeout_s).unwrap_or_default();
        let fresh = |then: Instant| now.saturating_duration_since(then) <= timeout;
        let agrees = match self.residual {
            _ if settings.residual_band_n <= 0.0 => true,
            Some((then, residual_n)) => fresh(then) && residual_n.abs() < settings.residual_band_n,
            None => false,
        };
        agrees && self.pose.is_some_and(fresh)
    }
}

impl Assurance {
    pub fn new(participant: &mut Participant) -> Result<Self, ParticipantError> {
        Ok(Self { output: participant.publisher("safe_to_go_on", qos::reliable(10))? })
    }

    /// Says that it is not safe.
    pub fn deny(&self) {
        self.output.send(Bool { data: false });
    }

    /// Whether anyone listens.
    pub fn is_wanted(&self) -> bool {
        self.output.is_wanted()
    }

    pub fn publish(&self, said: &Said, shared: &Shared) {
        if !self.is_wanted() {
            return;
        }
        let settings = shared.settings();
        let data = said.vouches(&settings, Instant::now())
            && judge(&shared.lock(), shared, &settings, &Around::default()).vouches();
        self.output.send(Bool { data });
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::ros::parameters::Parameters;
    use crate::ros::twin_node::declared::declarations;

    #[test]
    fn silence_and_disagreement_are_not_safe() {
        let (parameters, _) = Parameters::declare(declarations(), &[], "/twin").unwrap();
        let elastic = Settings::of(&parameters);
        let cell = Settings { residual_band_n: 0.01, ..elastic.clone() };
        let now = Instant::now();
        let late = now + Duration::from_millis(26);
        let mut said = Said::default();
        assert!(!said.vouches(&elastic, now), "nothing was said");
        said.pose = Some(now);
        assert!(said.vouches(&elastic, now) && !said.vouches(&elastic, late));
        assert!(!said.vouches(&cell, now), "no load cell");
        said.residual = Some((now, -0.009));
        assert!(said.vouches(&cell, now));
        said.residual = Some((now, -0.011));
        assert!(!said.vouches(&cell, now) && said.vouches(&elastic, now));
        said = Said { pose: Some(late), residual: Some((now, 0.0)) };
        assert!(!said.vouches(&cell, late), "the load cell's cable is cut");
    }
}
