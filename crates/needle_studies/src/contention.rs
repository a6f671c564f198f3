//! Speed of a needle insertion while other programs use the processors. Fixed numbers of threads and the default run
//! in turn.
//!
//! The other programs are infinite loops, one per thread. The gain or loss of one number of threads against another
//! is a ratio of two consecutive runs, so that the machine's other load affects both.

use std::hint::spin_loop;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use super::speed::SpeedError;
use needle_core::scene::{Override, Scene};
use needle_core::twin::{StampedPose, Twin};
use needle_estimate::compare::Watch;

/// An oblique needle in half of a coarse sample.
const KEYS: [(&str, &str); 4] = [
    ("instrument.tilt_rad", "0.26"),
    ("discretisation.spacing_m", "0.003"),
    ("motion.depth_m", "0.002"),
    ("motion.speed_m_per_s", "0.005"),
];
/// Poses per second of the motion.
const POSE_HZ: f64 = 1000.0;
/// Runs for each number of threads.
pub(crate) const ROUNDS: usize = 3;

/// A number of threads, and its results.
#[derive(Clone, Debug, PartialEq)]
pub struct Team {
    /// Number of threads.
    pub threads: usize,
    /// Simulated over wall time of each run.
    pub factors: Vec<f64>,
    /// Force at the end, N: equal for all runs.
    pub force_n: [f64; 3],
}

impl Team {
    /// Median of its factors.
    #[must_use]
    pub(crate) fn median(&self) -> f64 {
        let mut sorted = self.factors.clone();
        sorted.sort_by(f64::total_cmp);
        sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN)
    }
}

/// Results of the teams during a number of loops.
#[derive(Clone, Debug, PartialEq)]
pub struct Beside {
    /// Number of loops.
    pub loops: usize,
    /// Fixed numbers of threads, and last the default: one thread per processor.
    pub teams: Vec<Team>,
}

impl Beside {
    /// Median of the default divided by the best median of a fixed number.
    #[must_use]
    pub(crate) fn ratio(&self) -> f64 {
        let best = self.teams.iter().map(Team::median).fold(0.0, f64::max);
        self.teams.last().map_or(f64::NAN, |default| default.median() / best)
    }

    /// One line of the table.
    #[must_use]
    pub fn line(&self) -> String {
        let what = match self.loops {
            0 => "quiet".to_owned(),
            1 => "one busy loop".to_owned(),
            n => format!("{n} busy loops"),
        };
        let of = |t: &Team| {
            let factors: Vec<String> = t.factors.iter().map(|f| format!("{f:.2}")).collect();
            format!("{} on {}", factors.join(", "), t.threads)
        };
        let teams: Vec<String> = self.teams.iter().map(of).collect();
        format!("{what:<17}{}; default over best {:.2}\n", teams.join("; "), self.ratio())
    }
}

/// Heading of the table.
#[must_use]
pub fn heading() -> String {
    "\noblique needle, half of a coarse sample, 5 mm/s, 1000 poses/s: times real time, in turn, on so many threads\n"
        .to_owned()
}

/// Useful numbers of loops on a machine with this many processors: none, one, as many as processors.
#[must_use]
pub fn loads(processors: usize) -> Vec<usize> {
    let mut loads = vec![0, 1, processors];
    loads.dedup();
    loads
}

/// Runs teams of one, two and all threads in turn during some loops, `ROUNDS` times; `None` if `watch` cancelled
/// it.
///
/// # Errors
/// [`SpeedError`] if the scene can't be built or the twin halts.
pub fn beside(loops: usize, processors: usize, watch: &dyn Watch) -> Result<Option<Beside>, SpeedError> {
    let keys = KEYS.map(|(key, value)| Override::text(key, value, "study speed"));
    let scene = Scene::preset("needle_insertion")?.with(&keys)?;
    let mut sizes = vec![1, 2.min(processors), processors];
    sizes.dedup();
    let mut twins = Vec::new();
    for threads in sizes {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        // without a thread pool of its own the twin uses the caller's
        let twin = pool.map_or_else(|_| Twin::new(&scene), |pool| pool.install(|| Twin::new(&scene)))?;
        twins.push((twin, Team { threads, factors: Vec::new(), force_n: [0.0; 3] }));
    }
    among(loops, || {
        for _ in 0..ROUNDS {
            for (twin, team) in &mut twins {
                if watch.cancel().is_cancelled() {
                    return Ok(None);
                }
                let (factor, force_n) = insert(twin, &scene)?;
                team.factors.push(factor);
                team.force_n = force_n;
            }
        }
        Ok(Some(()))
    })
    .map(|done| done.map(|()| Beside { loops, teams: twins.into_iter().map(|(_, team)| team).collect() }))
}

/// Real-time factor of an insertion, and the force at its end.
fn insert(twin: &mut Twin, scene: &Scene) -> Result<(f64, [f64; 3]), SpeedError> {
    let (depth, speed) = scene.motion.map_or((0.0, 1.0), |m| (m.depth.get(), m.speed.get()));
    let count = (depth / speed * POSE_HZ).round() as u32;
    twin.reset();
    let (begun, mut force_n) = (Instant::now(), [0.0; 3]);
    for i in 1..=count {
        let at = depth * f64::from(i) / f64::from(count);
        force_n = twin.step(StampedPose { time_s: f64::from(i) / POSE_HZ, pose: twin.pose_at_depth(at) })?.force_n;
    }
    Ok((depth / speed / begun.elapsed().as_secs_f64(), force_n))
}

/// Does some work during infinite loops, and ends these afterwards.
fn among<R>(loops: usize, work: impl FnOnce() -> R) -> R {
    let done = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let _end = EndOnDrop(&done);
        for _ in 0..loops {
            scope.spawn(|| {
                while !done.load(Ordering::Relaxed) {
                    spin_loop();
                }
            });
        }
        work()
    })
}

/// Ends the loops when it is dropped, even if the work panics.
struct EndOnDrop<'a>(&'a AtomicBool);

impl Drop for EndOnDrop<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use needle_estimate::compare::Cancel;

    /// Next to a loop, two threads are not much slower than one, whatever the machine's other load: at least one of
    /// several pairs of consecutive runs shows it. Threads that wait for one that is not scheduled are a half or a
    /// quarter as fast in all pairs.
    #[test]
    fn a_busy_machine_does_not_slow_a_team_down() {
        let mut seen = Vec::new();
        for _ in 0..4 {
            let Beside { teams, .. } = beside(1, 2, &Cancel::default()).unwrap().unwrap();
            assert_eq!(teams.iter().map(|t| t.threads).collect::<Vec<_>>(), [1, 2]);
            assert!(teams.iter().all(|t| t.factors.len() == ROUNDS && t.force_n == teams[0].force_n), "{teams:?}");
            let pairs = teams[0].factors.iter().zip(&teams[1].factors);
            seen.extend(pairs.map(|(one, two)| two / one));
            if seen.iter().any(|ratio| *ratio > 0.8) {
                return;
            }
        }
        assert!(seen.is_empty(), "two threads over one: {seen:?}");
    }

    #[test]
    fn loads_and_ratios() {
        assert_eq!((loads(1), loads(2), loads(8)), (vec![0, 1], vec![0, 1, 2], vec![0, 1, 8]));
        let team = |threads, factors: [f64; 3]| Team { threads, factors: factors.to_vec(), force_n: [0.0; 3] };
        let row = Beside { loops: 1, teams: vec![team(1, [2.0, 0.1, 2.2]), team(2, [1.8, 1.5, 9.0])] };
        assert!((row.ratio() - 0.9).abs() < 1e-12);
        assert!(
            row.line().contains("one busy loop") && row.line().contains("default over best 0.90"),
            "{}",
            row.line()
        );
    }
}
