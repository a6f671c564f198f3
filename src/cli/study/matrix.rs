//! `needle_twin study matrix`.

use std::path::PathBuf;

use clap::Args;

use crate::cli::options::ThreadOptions;
use crate::cli::output::OutputFolder;
use crate::cli::progress::{Progress, bar};
use crate::cli::recorded::positive;
use crate::cli::{CliError, Outcome, print};
use needle_estimate::compare::Watch as _;
use needle_studies::matrix;

/// Run every instrument with every dimension of the model, law and sample, and say what each costs: real-time factor, longest pose, steps,
/// balance; or why it does not run
#[derive(Debug, Args)]
pub(super) struct Matrix {
    /// Two laws, two dimensions, two samples: half a minute
    #[arg(long)]
    quick: bool,

    /// Longest time of a cell, s; a slower one is stopped, and its figures are those up to there
    #[arg(long, value_name = "S", value_parser = positive)]
    budget_s: Option<f64>,

    /// Write matrix.csv into this folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,

    #[command(flatten)]
    threads: ThreadOptions,
}

/// Longest time of a cell, s, where none is given.
const BUDGET_S: f64 = 20.0;
const QUICK_BUDGET_S: f64 = 2.0;

impl Matrix {
    pub(super) fn run(&self) -> Result<Outcome, CliError> {
        let folder = self.out.as_deref().map(OutputFolder::prepare).transpose()?;
        let budget_s = self.budget_s.unwrap_or(if self.quick { QUICK_BUDGET_S } else { BUDGET_S });
        let progress = Progress::silent();
        let cells = matrix::cells(self.quick);
        let bar = bar(cells.len() as u64, "{pos}/{len} cells");
        bar.suspend(|| print(&matrix::heading()))?;
        let mut rows = Vec::new();
        for cell in cells {
            let row = self.threads.install(|| cell.run(budget_s, progress.cancel()))?;
            if progress.cancel().is_cancelled() {
                break;
            }
            bar.suspend(|| print(&row.line()))?;
            bar.inc(1);
            rows.push(row);
            if let Some(folder) = &folder {
                needle_report::write_file(&folder.path.join("matrix.csv"), matrix::csv(&rows).as_bytes())?;
            }
        }
        bar.finish_and_clear();
        // a cell that is refused, lost or slow is what the table is made to show
        Ok(if progress.cancel().is_cancelled() { Outcome::Lossy } else { Outcome::Complete })
    }
}
