//! Processor time of the present thread. Other programs do not add to it.

/// Measures the processor time of the thread that started it; wall time if the system has no such clock.
pub(super) struct ThreadClock(Time);

impl ThreadClock {
    /// Starts counting.
    pub(crate) fn start() -> Self {
        Self(now())
    }

    /// Time since the start, s; the calling thread must be the one that started it.
    pub(crate) fn seconds(&self) -> f64 {
        since(&self.0)
    }
}

#[cfg(target_os = "linux")]
type Time = rustix::time::Timespec;
#[cfg(not(target_os = "linux"))]
type Time = std::time::Instant;

#[cfg(target_os = "linux")]
fn now() -> Time {
    rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime)
}

#[cfg(target_os = "linux")]
fn since(start: &Time) -> f64 {
    let now = now();
    (now.tv_sec - start.tv_sec) as f64 + 1e-9 * (now.tv_nsec - start.tv_nsec) as f64
}

#[cfg(not(target_os = "linux"))]
fn now() -> Time {
    std::time::Instant::now()
}

#[cfg(not(target_os = "linux"))]
fn since(start: &Time) -> f64 {
    start.elapsed().as_secs_f64()
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn sleep_costs_nothing_and_work_does() {
        let clock = ThreadClock::start();
        std::thread::sleep(std::time::Duration::from_millis(50));
        let asleep = clock.seconds();
        let mut x = 1.0_f64;
        while clock.seconds() < asleep + 0.01 {
            x = std::hint::black_box(x.sqrt() + 1.0);
        }
        assert!(asleep < 0.02, "{asleep} s of processor time in a sleep of 0.05 s");
    }
}
