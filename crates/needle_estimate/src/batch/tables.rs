//! Force curves that the recordings of a batch share. They are computed once before the first recording, and stored
//! in a folder next to the rows.
//!
//! A stored table ([`Cache`]) is identified by program, scene, keys with bounds, and depth.

use std::collections::BTreeMap;
use std::path::Path;

use super::{Candidate, Entry};
use crate::cache::Cache;
use crate::calibrate::{CurveTable, Wanted};
use crate::compare::Cancel;
use needle_core::scene::Scene;

/// Folder of the stored tables.
const FOLDER: &str = "curves";

/// The tables, by content. For a recording without a table the twin is run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tables {
    tables: BTreeMap<String, Result<CurveTable, String>>,
    runs: usize,
}

/// Tables that some jobs need.
#[derive(Clone, Debug, Default)]
pub struct Needed(BTreeMap<String, Result<CurveTable, String>>);

/// What identifies a table.
pub(super) struct Content {
    scene: Scene,
    wanted: Vec<Wanted>,
    to_depth_m: f64,
}

impl Content {
    /// `None` if the twin is to be run instead.
    pub(super) fn of(
        entry: &Entry,
        candidate: &Candidate,
        scene: impl FnOnce() -> Result<Scene, String>,
    ) -> Result<Option<Self>, String> {
        match entry.curves.as_deref() {
            None | Some("runs") => return Ok(None),
            Some("table") => {}
            Some(other) => return Err(format!("curves = \"{other}\": runs or table")),
        }
        let to_depth_m = entry.to_depth_m.ok_or("curves = \"table\" needs to_depth_m: how deep the curves go")?;
        let (scene, wanted) = (scene()?, entry.wanted(candidate)?);
        if wanted.is_empty() {
            return Err("curves = \"table\" needs keys to fit; without any, leave it out".to_owned());
        }
        Ok(Some(Self { scene, wanted, to_depth_m }))
    }

    fn name(&self) -> String {
        let (scene, mesh) = (self.scene.to_toml(), self.scene.sample.mesh_digest());
        format!("{} {:?} {} {scene} {mesh}", needle_core::WRITER, self.wanted, self.to_depth_m)
    }
}

impl Needed {
    pub(super) fn add(&mut self, content: &Content) {
        let Content { scene, wanted, to_depth_m } = content;
        let plan = || CurveTable::planned(scene, wanted, *to_depth_m).map_err(|e| e.to_string());
        self.0.entry(content.name()).or_insert_with(plan);
    }

    /// Reads the tables that are stored below a folder.
    pub fn read(&mut self, folder: &Path) {
        let kept = Cache::below(folder, FOLDER);
        for (name, table) in &mut self.0 {
            if let (Ok(table), Some(curves)) = (table, kept.get(name)) {
                table.take(curves);
            }
        }
    }

    /// Number of runs of the twin that remain to be done.
    #[must_use]
    pub fn runs(&self) -> usize {
        self.0.values().flatten().filter(|table| table.curves().is_empty()).map(CurveTable::runs).sum()
    }

    /// Computes the missing tables by runs of the twin on the current rayon pool, and stores them below a folder.
    /// `done` is called after each run.
    #[must_use]
    pub fn make(self, folder: &Path, cancel: &Cancel, done: &(dyn Fn() + Sync)) -> Tables {
        let mut made = Tables::default();
        let kept = Cache::below(folder, FOLDER);
        for (name, table) in self.0 {
            let table = table.and_then(|mut table| {
                if table.curves().is_empty() {
                    table.run_all(cancel, done).map_err(|e| e.to_string())?;
                    made.runs += table.runs();
                    // a failed write only costs the next batch these runs, so it is no error of this batch
                    let _ = kept.put(&name, table.curves());
                }
                Ok(table)
            });
            made.tables.insert(name, table);
        }
        made
    }
}

impl Tables {
    /// Number of runs that were made for the tables.
    #[must_use]
    pub const fn runs(&self) -> usize {
        self.runs
    }

    /// The table with a content.
    pub(super) fn of(&self, content: &Content) -> Result<&CurveTable, String> {
        match self.tables.get(&content.name()) {
            Some(Ok(table)) => Ok(table),
            Some(Err(reason)) => Err(reason.clone()),
            None => Err("its table of curves was not made".to_owned()),
        }
    }
}
