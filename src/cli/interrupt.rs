//! Ctrl-C, SIGTERM and, unless it was ignored from the start as by `nohup`, SIGHUP as a flag, so that a run ends between two poses with its files closed. A second one ends at once.

use std::thread;

use needle_estimate::compare::Cancel;
use tokio::signal::unix::{Signal, SignalKind, signal};

/// Exit codes of a program that SIGHUP, SIGINT or SIGTERM ended, as shells have them.
const HUNG_UP: i32 = 129;
const INTERRUPTED: i32 = 130;
const TERMINATED: i32 = 143;

/// Whether the run is to end.
#[derive(Clone, Debug, Default)]
pub(super) struct Interrupt(Cancel);

impl Interrupt {
    /// Listens from now on. Where that isn't possible, a signal ends the process as ever.
    pub(super) fn listen() -> Self {
        let interrupt = Self::default();
        let flag = interrupt.clone();
        let Ok(runtime) = tokio::runtime::Builder::new_current_thread().enable_all().build() else {
            return interrupt;
        };
        // asked before a handler takes its place
        let outlives = terminal::hangup_is_ignored();
        let listen = move || {
            runtime.block_on(async {
                let (Ok(mut interrupt), Ok(mut terminate)) =
                    (signal(SignalKind::interrupt()), signal(SignalKind::terminate()))
                else {
                    return;
                };
                let mut hangup = if outlives { None } else { signal(SignalKind::hangup()).ok() };
                next(&mut interrupt, &mut terminate, hangup.as_mut()).await;
                flag.0.cancel();
                std::process::exit(next(&mut interrupt, &mut terminate, hangup.as_mut()).await);
            });
        };
        // Without the thread, a signal ends the process as ever.
        let _ = thread::Builder::new().name("signals".to_owned()).spawn(listen);
        interrupt
    }

    /// What a signal cancels.
    pub(super) const fn cancel(&self) -> &Cancel {
        &self.0
    }
}

/// Waits for the next of the signals and gives its exit code.
async fn next(interrupt: &mut Signal, terminate: &mut Signal, hangup: Option<&mut Signal>) -> i32 {
    let hung_up = async {
        match hangup {
            Some(hangup) => drop(hangup.recv().await),
            None => std::future::pending().await,
        }
    };
    tokio::select! {
        () = hung_up => HUNG_UP,
        _ = interrupt.recv() => INTERRUPTED,
        _ = terminate.recv() => TERMINATED,
    }
}
