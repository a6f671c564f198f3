//! Force curves that the recordings of a batch share: made once, before the first of them.

use std::collections::BTreeMap;

use super::{Candidate, Job, Stop};
use crate::study::calibrate::{CurveTable, Wanted};

/// Tables by what they hold; what is not there is run for each recording.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tables(BTreeMap<String, Result<CurveTable, String>>);

/// What a table is of.
struct Content {
    scene: crate::scene::Scene,
    wanted: Vec<Wanted>,
    to_depth_m: f64,
}

impl Content {
    fn of(job: &Job, candidate: &Candidate) -> Result<Option<Self>, String> {
        let entry = job.entry();
        match entry.curves.as_deref() {
            None | Some("runs") => return Ok(None),
            Some("table") => {}
            Some(other) => return Err(format!("curves = \"{other}\": runs or table")),
        }
        let to_depth_m = entry.to_depth_m.ok_or("curves = \"table\" needs to_depth_m: how deep the curves go")?;
        let (scene, wanted) = (job.scene(candidate, None)?, entry.wanted(candidate)?);
        if wanted.is_empty() {
            return Err("curves = \"table\" needs keys to fit; without any, leave it out".to_owned());
        }
        Ok(Some(Self { scene, wanted, to_depth_m }))
    }

    fn name(&self) -> String {
        format!("{:?} {} {}", self.wanted, self.to_depth_m, self.scene.to_toml())
    }
}

impl Tables {
    /// The tables that some jobs need, by runs of the twin on the current rayon pool.
    #[must_use]
    pub fn new(jobs: &[Job], stop: Stop, progress: &mut dyn FnMut(usize)) -> Self {
        let mut tables = BTreeMap::new();
        for job in jobs {
            for candidate in &job.manifest.candidates {
                // what is wrong with an entry is said in its row
                let Ok(Some(content)) = Content::of(job, candidate) else { continue };
                let name = content.name();
                if stop() || tables.contains_key(&name) {
                    continue;
                }
                let table = CurveTable::new(&content.scene, &content.wanted, content.to_depth_m, stop);
                progress(table.as_ref().map_or(0, CurveTable::runs));
                tables.insert(name, table.map_err(|e| e.to_string()));
            }
        }
        Self(tables)
    }

    /// Runs that the tables took.
    #[must_use]
    pub fn runs(&self) -> usize {
        self.0.values().flatten().map(CurveTable::runs).sum()
    }

    /// The table of a job with a candidate; `None` if it is run.
    pub(super) fn of(&self, job: &Job, candidate: &Candidate) -> Result<Option<&CurveTable>, String> {
        let Some(content) = Content::of(job, candidate)? else { return Ok(None) };
        match self.0.get(&content.name()) {
            Some(Ok(table)) => Ok(Some(table)),
            Some(Err(reason)) => Err(reason.clone()),
            None => Err("its table of curves was not made".to_owned()),
        }
    }
}
