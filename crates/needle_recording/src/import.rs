//! Tables on their way to a bag. Long ones are read twice and never lie in memory: once to see what they are, and once as the bag is
//! written.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};

use super::recording::{Changes, DepthSample, ForceSample, MarkerSample, PoseSample, Recording, RecordingError};
use super::recording::{is_bag, seconds, tables};
use super::selection::Selection;
use super::table::{Pieces, Table, TableError, size_of_text};
use super::write::{Sample, Topics, first};
use needle_core::twin::Pose;
use rosbag2_mcap::Written;

/// Tables with this many bytes of text, 64 MiB, are read twice: their samples would take more than 100 MB.
const LONG: u64 = 1 << 26;

/// Number, duration and range of one series.
#[derive(Clone, Debug, PartialEq)]
pub struct Extent {
    /// The series.
    pub what: &'static str,
    /// Number of its samples.
    pub samples: usize,
    /// Times of the first and the last, s.
    pub from_to_s: [f64; 2],
    /// Least and largest value.
    pub range: [f64; 2],
    /// Unit of the values.
    pub unit: &'static str,
}

/// Extents of depth, tip's z and force while samples go by.
#[derive(Default)]
struct Extents([Option<Extent>; 3]);

impl Extents {
    fn note(&mut self, sample: &Sample) {
        let (k, what, unit, time_s, value) = match sample {
            Sample::Depth(s) => (0, "depth", "m", s.time_s, s.depth_m),
            Sample::Pose(s) => (1, "tip's z", "m", s.time_s, s.tip[2]),
            Sample::Force(s) => (2, "force", "N", s.time_s, s.force_n[2]),
            Sample::Markers(_) => return,
        };
        let begun =
            || Extent { what, samples: 0, from_to_s: [time_s; 2], range: [f64::INFINITY, -f64::INFINITY], unit };
        let extent = self.0[k].get_or_insert_with(begun);
        extent.samples += 1;
        extent.from_to_s[1] = time_s;
        extent.range = [extent.range[0].min(value), extent.range[1].max(value)];
    }

    fn found(self) -> Vec<Extent> {
        self.0.into_iter().flatten().collect()
    }
}

impl Recording {
    /// Extents of depth, tip's z and force, as far as they exist.
    #[must_use]
    pub fn extents(&self) -> Vec<Extent> {
        let mut extents = Extents::default();
        self.depths.iter().for_each(|s| extents.note(&Sample::Depth(*s)));
        self.poses.iter().for_each(|s| extents.note(&Sample::Pose(*s)));
        self.forces.iter().for_each(|s| extents.note(&Sample::Force(*s)));
        extents.found()
    }
}

/// A recording in tables or a bag, understood and not written yet.
pub struct Import<'a> {
    paths: &'a [PathBuf],
    said: &'a Selection,
    /// The tables, without their samples.
    pub tables: Vec<Table>,
    /// The recording; its series are empty if it is read again as it is written.
    recording: Recording,
    changes: Option<Changes>,
}

impl<'a> Import<'a> {
    /// Tables, or one bag.
    ///
    /// # Errors
    /// As [`Recording::open`].
    pub fn open(paths: &'a [PathBuf], said: &'a Selection) -> Result<Self, RecordingError> {
        match paths {
            [bag] if is_bag(bag) => {
                let recording = Recording::open(paths, said)?;
                Ok(Self { paths, said, tables: Vec::new(), recording, changes: None })
            }
            _ => Self::longer_than(LONG, paths, said),
        }
    }

    fn longer_than(least: u64, paths: &'a [PathBuf], said: &'a Selection) -> Result<Self, RecordingError> {
        let bytes = paths.iter().map(|path| size_of_text(path)).sum::<Option<u64>>();
        if bytes.is_some_and(|bytes| bytes >= least) {
            super::table::refuse_options(paths, said)?;
            let surveyed = |(number, path): (usize, &PathBuf)| Table::surveyed(path, said, number);
            let tables = paths.iter().enumerate().map(surveyed).collect::<Result<Vec<_>, _>>()?;
            if let Some((recording, changes)) = Recording::of_surveys(&tables, said)? {
                return Ok(Self { paths, said, tables, recording, changes: Some(changes) });
            }
        }
        let mut tables = tables(paths, said)?;
        let recording = Recording::of_tables(&mut tables, said)?;
        Ok(Self { paths, said, tables, recording, changes: None })
    }

    /// The recording; without its series if it is long.
    #[must_use]
    pub fn told(&self) -> &Recording {
        &self.recording
    }

    /// Writes the bag, or only looks at the samples if there is no folder; `scene` as in [`Recording::write`].
    ///
    /// # Errors
    /// As [`Recording::write`]; [`TableError`] if a long table can't be read a second time.
    pub fn write(
        &self,
        folder: Option<&Path>,
        scene: Option<&str>,
    ) -> Result<(Vec<Extent>, Option<Written>), RecordingError> {
        let Some(changes) = &self.changes else {
            let written = folder.map(|folder| self.recording.write(folder, scene)).transpose()?;
            return Ok((self.recording.extents(), written));
        };
        let has = changes.counts.map(|count| count > 0);
        let mut topics = folder.map(|folder| Topics::create(&self.recording, has, folder, scene)).transpose()?;
        let mut extents = Extents::default();
        let mut counts = [0; 4];
        self.each(changes, |which, sample| {
            counts[which] += 1;
            extents.note(sample);
            topics.as_mut().map_or(Ok(()), |topics| topics.write(sample).map_err(RecordingError::from))
        })?;
        if counts != changes.counts {
            return Err(self.changed().into());
        }
        Ok((extents.found(), topics.map(Topics::finish).transpose()?))
    }

    fn changed(&self) -> TableError {
        let path = self.paths.first().cloned().unwrap_or_default();
        TableError::Contents { path, reason: "it changed while it was read: import it when it is complete".to_owned() }
    }

    /// All samples in order of time, with the number of their series.
    fn each(
        &self,
        changes: &Changes,
        mut take: impl FnMut(usize, &Sample) -> Result<(), RecordingError>,
    ) -> Result<(), RecordingError> {
        let Changes { plan, .. } = changes;
        let open = |k: usize| Pieces::open(&self.paths[k], self.said, k);
        let apart = plan.feeling.filter(|feeling| *feeling != plan.moving || plan.late_ns != 0);
        let feels = plan.feeling.is_some() && apart.is_none();
        let mut motion = Queue { moves: true, feels, ..Queue::new(open(plan.moving)?) };
        let cell = apart.map(open).transpose()?;
        let mut cell = cell.map(|pieces| Queue { feels: true, ..Queue::new(pieces) });
        let origin_ns = self.recording.origin_ns;
        let at = |ns: i64| seconds(ns, origin_ns);
        loop {
            motion.fill()?;
            cell.as_mut().map_or(Ok(()), Queue::fill)?;
            let forces = cell.as_mut().map_or(&mut motion.forces, |cell| &mut cell.forces);
            let times = [
                motion.depths.front().map(|s| at(s.0)),
                motion.poses.front().map(|s| at(s.0)),
                forces.front().map(|s| at(s.0.saturating_sub(plan.late_ns))),
                motion.markers.front().map(|s| at(s.0)),
            ];
            let Some(which) = first(times) else { return Ok(()) };
            let time_s = times[which].unwrap_or_default();
            match which {
                0 => {
                    let Some((_, depth_m)) = motion.depths.pop_front() else { return Ok(()) };
                    take(0, &Sample::Depth(DepthSample { time_s, depth_m }))?;
                }
                1 => {
                    let Some((_, pose)) = motion.poses.pop_front() else { return Ok(()) };
                    let Pose { tip, axis, roll_rad } = plan.frames.pose(pose);
                    take(1, &Sample::Pose(PoseSample { time_s, tip, axis, roll_rad }))?;
                }
                2 => {
                    let Some((_, force_n)) = forces.pop_front() else { return Ok(()) };
                    let force_n = changes.force(force_n).ok_or_else(|| self.changed())?;
                    take(2, &Sample::Force(ForceSample { time_s, force_n }))?;
                }
                _ => {
                    let Some((_, positions)) = motion.markers.pop_front() else { return Ok(()) };
                    let positions = positions.iter().map(|p| plan.frames.point(*p)).collect();
                    take(3, &Sample::Markers(&MarkerSample { time_s, positions }))?;
                }
            }
        }
    }
}

/// Samples of a table that were read and not taken. Its rows are in order of time, so while one of the queues holds a sample, the next
/// sample of the table is in a queue.
struct Queue<'a> {
    pieces: Option<Pieces<'a>>,
    /// Whether depths, poses and markers are taken, and forces.
    moves: bool,
    feels: bool,
    depths: VecDeque<(i64, f64)>,
    poses: VecDeque<(i64, Pose)>,
    forces: VecDeque<(i64, [f64; 3])>,
    markers: VecDeque<(i64, Vec<[f64; 3]>)>,
}

impl<'a> Queue<'a> {
    fn new(pieces: Pieces<'a>) -> Self {
        let (depths, poses) = (VecDeque::new(), VecDeque::new());
        let (forces, markers) = (VecDeque::new(), VecDeque::new());
        Self { pieces: Some(pieces), moves: false, feels: false, depths, poses, forces, markers }
    }

    fn is_empty(&self) -> bool {
        self.depths.is_empty() && self.poses.is_empty() && self.forces.is_empty() && self.markers.is_empty()
    }

    /// Reads on if nothing is left.
    fn fill(&mut self) -> Result<(), TableError> {
        while self.is_empty()
            && let Some(pieces) = &mut self.pieces
        {
            let Some(table) = pieces.next()? else {
                self.pieces = None;
                return Ok(());
            };
            if self.moves {
                self.depths.extend(table.depths.drain(..));
                self.poses.extend(table.poses.drain(..));
                self.markers.extend(table.markers.drain(..));
            }
            if self.feels {
                self.forces.extend(table.forces.drain(..));
            }
            // what is another table's here
            table.depths.clear();
            table.poses.clear();
            table.forces.clear();
            table.markers.clear();
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::panic)]
    use super::*;
    use crate::{Quantity, TableLayout};
    use std::fmt::Write as _;
    use std::fs;

    /// What a command says of a table, the bag's bytes, and whether it was read twice.
    fn imported(least: u64, paths: &[PathBuf], said: &Selection, out: &Path) -> (String, Vec<Vec<u8>>, bool) {
        let import = match Import::longer_than(least, paths, said) {
            Ok(import) => import,
            Err(error) => return (error.to_string(), Vec::new(), false),
        };
        let _ = fs::remove_dir_all(out);
        let (extents, _) = import.write(Some(out), Some("compression")).unwrap();
        let told = import.told();
        let rows: Vec<_> = import.tables.iter().map(|t| (&t.layout, t.rows, t.bad, &t.columns)).collect();
        let text = format!("{extents:?} {:?} {:?} {:?} {rows:?}", told.losses, told.warnings, told.force_frame);
        assert_eq!(import.write(None, None).unwrap(), (extents, None), "a dry run says the same");
        let mut files: Vec<PathBuf> = fs::read_dir(out).unwrap().map(|file| file.unwrap().path()).collect();
        files.sort();
        (text, files.iter().map(|file| fs::read(file).unwrap()).collect(), import.changes.is_some())
    }

    /// Whether the tables are read twice; the same bag and the same words come of them as in memory.
    fn streamed(paths: &[PathBuf], said: &Selection) -> bool {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("bag");
        let (twice, once) = (imported(0, paths, said, &out), imported(u64::MAX, paths, said, &out));
        assert_eq!(twice.0, once.0, "{paths:?}");
        assert!(twice.1 == once.1 && !once.2, "{paths:?}: another bag");
        twice.2
    }

    #[test]
    fn the_bag_is_that_of_the_readings_in_memory() {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str, text: &str| {
            let path = folder.path().join(name);
            fs::write(&path, text).unwrap();
            path
        };
        // so many rows that there are several pieces
        let rows = |row: &dyn Fn(u32) -> String| (0..30_000).map(row).collect::<String>();
        let time = |i: u32| f64::from(i) * 1e-3;
        let depth = |i: u32| f64::from(i) * 1e-4;
        let head = "Time (s),Position (mm),Force (N)\n";
        let plain = rows(&|i| format!("{:.4},{:.5},{:.5}\n", time(i), depth(i), depth(i) * 0.1));
        let said = Selection::default();
        let of = |name: &str, text: String| streamed(&[file(name, &(head.to_owned() + &text))], &said);
        assert!(of("plain.csv", plain.clone()));
        assert!(of("lost.csv", plain.replace("12.3450,", "12.3450,over")), "a lost row is counted, and is no disorder");
        assert!(of("foot.csv", plain.clone() + "end of the test\n"));
        let gaps = |i: u32| {
            if i.is_multiple_of(3) {
                format!("{:.4},,0.25\n", time(i))
            } else {
                format!("{:.4},{:.5},\n", time(i), depth(i))
            }
        };
        assert!(of("gaps.csv", rows(&gaps)), "an empty cell is no reading");
        assert!(of("no_force.csv", rows(&|i| format!("{:.4},{:.5},\n", time(i), depth(i)))));
        // what must be in memory
        assert!(!of("hole.csv", rows(&|i| format!("{:.4},{:.5},0.1\n", time(i + i / 20_000 * 900), depth(i)))));
        assert!(!of("twice.csv", rows(&|i| format!("{:.4},{:.5},0.1\n", time(i / 2), depth(i)))));
        assert!(!of("turned.csv", rows(&|i| format!("{:.4},{:.5},0.1\n", time(i ^ 1), depth(i)))));
        let again = plain.clone() + "\n" + head + &plain;
        let two = file("two.csv", &(head.to_owned() + &again));
        streamed(std::slice::from_ref(&two), &said);
        for block in 1..=3 {
            let layout = TableLayout { block: Some(block), ..TableLayout::default() };
            let said = Selection { layout, ..Selection::default() };
            assert_eq!(streamed(std::slice::from_ref(&two), &said), block < 3, "block {block}");
        }
        // another clock, and another file
        let plain = file("plain.csv", &(head.to_owned() + &plain));
        for time_offset_s in [0.25, -40.0, 0.1 + 0.2] {
            let said = Selection { time_offset_s, ..Selection::default() };
            assert!(streamed(std::slice::from_ref(&plain), &said));
        }
        let motion = file("motion.csv", &rows(&|i| format!("{:.4} {:.5}\n", time(i), depth(i))));
        let cell = rows(&|i| format!("{:.5};{:.5}\n", time(i) * 0.77 + 3.0, depth(i) * -3.0));
        let cell = file("cell.csv", &format!("Zeit (s);Kraft (mN)\n{cell}"));
        let mut said =
            Selection { time: vec!["1".to_owned()], time_unit: vec!["s".to_owned()], ..Selection::default() };
        said.position = Quantity { place: Some("2".to_owned()), unit: Some("mm".to_owned()), ..Quantity::default() };
        said.force = Quantity { place: Some("Kraft".to_owned()), ..Quantity::default() };
        assert!(streamed(&[motion.clone(), cell.clone()], &said));
        assert!(streamed(&[motion, cell], &Selection { time_offset_s: -1e-9, ..said }));
    }

    #[test]
    fn poses_frames_and_axes_without_numbers_are_as_in_memory() {
        let folder = tempfile::tempdir().unwrap();
        let mut text = "t (s),x (m),y (m),z (m),fx (N),fy (N),fz (N),ax (m),ay (m),az (m)\n".to_owned();
        for i in 0..9_000 {
            let t = f64::from(i) * 1e-3;
            let marker = if i % 7 == 0 { ",," } else { "0.01,0.02,0.03" };
            let _ = writeln!(text, "{t:.4},{:.5},{:.5},{:.5},{:.5},nan,nan,{marker}", t * 0.1, t * t, -t, t.sin());
        }
        let path = folder.path().join("poses.csv");
        fs::write(&path, &text).unwrap();
        let names = |of: [&str; 3]| of.map(str::to_owned);
        let mut said = Selection {
            pose: Some(names(["x", "y", "z"])),
            forces: Some(names(["fx", "fy", "fz"])),
            markers: names(["ax", "ay", "az"]).to_vec(),
            ..Selection::default()
        };
        assert!(streamed(std::slice::from_ref(&path), &said), "one axis is measured, and taken for z");
        said.sample_pose = Some([0.4, -0.1, 0.3, 0.0, 0.0, 0.6, 0.8]);
        said.sensor_rotation = Some([0.0, 0.6, 0.0, 0.8]);
        assert!(streamed(std::slice::from_ref(&path), &said));
        fs::write(&path, text.replacen(",nan,nan,", ",0.5,nan,", 1)).unwrap();
        assert!(!streamed(&[path], &said), "a force of which one measured axis has no number");
    }

    /// What strangers brought.
    #[test]
    fn tables_of_other_programs_give_the_same_bag() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/strangers/tables");
        let mut twice = 0;
        for file in fs::read_dir(folder).unwrap() {
            let path = [file.unwrap().path()];
            let said = Selection { rate_hz: None, ..Selection::default() };
            twice += usize::from(streamed(&path, &said));
            let said = Selection { rate_hz: Some(10.0), ..Selection::default() };
            twice += usize::from(streamed(&path, &said));
        }
        assert!(twice > 10, "{twice} of them");
    }
}
