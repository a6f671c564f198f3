//! `needle_twin study speed`.

use std::path::PathBuf;

use clap::Args;

use crate::cli::options::ThreadOptions;
use crate::cli::output::OutputFolder;
use crate::cli::progress::Progress;
use crate::cli::{CliError, Outcome, print, processor};
use needle_estimate::compare::Watch as _;
use needle_studies::bounds::Bounds;
use needle_studies::{contention, speed};

/// Time the step: presets, support, size of the model, threads; a needle while other programs use the processors; and how fast one may go in three dimensions
#[derive(Debug, Args)]
pub(super) struct Speed {
    /// Smaller models, no motions: one to two minutes
    #[arg(long)]
    quick: bool,

    /// Write speed.csv and a picture into this folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,

    #[command(flatten)]
    threads: ThreadOptions,
}

impl Speed {
    pub(super) fn run(&self) -> Result<Outcome, CliError> {
        let folder = self.out.as_deref().map(OutputFolder::prepare).transpose()?;
        let most = self.threads.install(rayon::current_num_threads)?;
        let bounds = Bounds::measure();
        print(&format!(
            "{}, {most} threads at most; one thread reads {:.1} GB/s and computes {:.1} Gflop/s in single precision\n",
            processor::name(),
            1e-9 * bounds.bytes_per_s,
            1e-9 * bounds.flops
        ))?;
        let progress = Progress::silent();
        print(&speed::heading())?;
        let mut rows = Vec::new();
        for case in speed::cases(most, self.quick) {
            if progress.cancel().is_cancelled() {
                break;
            }
            let threads = ThreadOptions { threads: u16::try_from(case.threads).ok() };
            let row = threads.install(|| case.run())??;
            print(&row.line())?;
            rows.push(row);
        }
        if !progress.cancel().is_cancelled() {
            print(&contention::heading())?;
            for loops in contention::loads(most) {
                let Some(row) = contention::beside(loops, most, &progress)? else { break };
                print(&row.line())?;
            }
        }
        if !self.quick && !progress.cancel().is_cancelled() {
            print(&speed::motion_heading())?;
            let mut said = Ok(());
            self.threads.install(|| {
                speed::motions(&progress, |motion| {
                    if said.is_ok() {
                        said = print(&motion.line());
                    }
                })
            })??;
            said?;
        }
        if let Some(folder) = folder {
            for path in needle_report::write_speed(&folder.path, &processor::name(), bounds, &rows)? {
                print(&format!("{}\n", path.display()))?;
            }
        }
        Ok(if progress.cancel().is_cancelled() { Outcome::Lossy } else { Outcome::Complete })
    }
}
