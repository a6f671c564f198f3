//! Members that follow a stream of poses one by one.

use super::path::distinct;
use super::{Band, EnsembleError, Member, Spread};
use crate::scene::Recorded;
use crate::twin::{Pose, StampedPose, Twin};

/// Twins of members, each on one thread, all in the thread that asks.
pub struct Live {
    /// A twin for each run that members share, and how much less deep its instrument is, m; none where the scene can't be discretised.
    twins: Vec<(Option<Twin>, f64)>,
    /// Which of them a member has, the member's force over its, and what the load cell reads without load, N.
    members: Vec<(usize, f64, f64)>,
    /// Force of each twin at the last pose, N; not a number where there is none.
    force_n: Vec<f64>,
    /// Positions of targets, m.
    positions: Vec<Vec<[f64; 3]>>,
}

/// Whether members can follow poses as they come.
///
/// # Errors
/// [`EnsembleError::NotLive`] where the clock of the force is uncertain: what it will read is not known yet.
pub fn check_live(members: &[Member]) -> Result<(), EnsembleError> {
    let late = members.iter().any(|member| member.shift.time_offset_s != 0.0);
    let key = Recorded::KEYS.iter().find(|(_, recorded, _)| *recorded == Recorded::TimeOffset).map(|(key, ..)| *key);
    if late { Err(EnsembleError::NotLive(key.unwrap_or_default())) } else { Ok(()) }
}

impl Live {
    /// Builds a twin for each member; those with the same mechanics share one. `trouble` hears why one can't be built.
    ///
    /// # Errors
    /// [`EnsembleError::Threads`].
    pub fn build(members: &[Member], mut trouble: impl FnMut(usize, String)) -> Result<Self, EnsembleError> {
        let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
        let (first, run_of) = distinct(members);
        let mut built = Vec::new();
        for k in first {
            let twin = alone.install(|| Twin::new(&members[k].scene));
            let twin = twin.map_err(|error| trouble(k, error.to_string())).ok();
            built.push((twin, members[k].shift.contact_depth_m));
        }
        Ok(Self {
            force_n: vec![f64::NAN; built.len()],
            positions: vec![Vec::new(); built.len()],
            twins: built,
            members: run_of
                .iter()
                .zip(members)
                .map(|(k, member)| (*k, member.factor, member.shift.force_zero_n))
                .collect(),
        })
    }

    /// Advances every member to a pose. A twin that has no answer has none until it comes back by itself ([`Twin::step`]).
    pub fn step(&mut self, pose: &StampedPose) {
        for (k, (twin, shallower_m)) in self.twins.iter_mut().enumerate() {
            let Some(twin) = twin else { continue };
            let Pose { tip, axis } = pose.pose;
            let own = Pose { tip: std::array::from_fn(|i| tip[i] - *shallower_m * axis[i]), axis };
            let answer = twin.follow(StampedPose { pose: own, ..*pose });
            self.force_n[k] = answer.map_or(f64::NAN, |p| 0.0 - (0..3).map(|i| p.force_n[i] * axis[i]).sum::<f64>());
            self.positions[k].clear();
            if self.force_n[k].is_finite() {
                twin.target_positions(&mut self.positions[k]);
            }
        }
    }

    /// Band of the force at the last pose, with the number of members that have an answer; `None` of none.
    #[must_use]
    pub fn band(&self) -> Option<(Band, usize)> {
        let forces =
            || self.members.iter().map(|(k, factor, zero)| factor * self.force_n[*k] + zero).filter(|f| f.is_finite());
        Band::of(forces()).map(|band| (band, forces().count()))
    }

    /// Each target at the last pose, in the scene's order; empty without an answer.
    #[must_use]
    pub fn targets(&self) -> Vec<Spread> {
        let count = self.positions.iter().map(Vec::len).max().unwrap_or(0);
        let of = |t: usize| self.members.iter().filter_map(move |(k, ..)| self.positions[*k].get(t).copied());
        (0..count).filter_map(|t| Spread::of(of(t))).collect()
    }

    /// All members undeformed again.
    pub fn reset(&mut self) {
        self.twins.iter_mut().filter_map(|(twin, _)| twin.as_mut()).for_each(Twin::reset);
        self.force_n.fill(f64::NAN);
    }
}
