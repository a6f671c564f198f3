//! Tables on their way to a bag. Long ones are read twice and never lie in memory: once to see what they are, and once as the bag is
//! written.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};

use super::error::RecordingError;
use super::holes::Holes;
use super::order::Spread;
use super::recording::{Changes, Recording, is_bag, seconds, tables};
use super::sample::{DepthSample, ForceSample, MarkerSample, PoseSample, Sample, first};
use super::selection::Selection;
use super::table::{Pieces, Table, TableError, size_of_text};
use super::write::Topics;
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
    pub(crate) fn extents(&self) -> Vec<Extent> {
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
    tables: Vec<Table>,
    /// The recording; its series are empty if it is read again as it is written.
    recording: Recording,
    changes: Option<Changes>,
}

/// A recording that was written, or only looked at.
#[derive(Debug)]
pub struct Imported {
    /// The tables, without their samples.
    pub tables: Vec<Table>,
    /// The recording; without its series if it is long.
    pub told: Recording,
    /// Its series.
    pub extents: Vec<Extent>,
    /// The bag.
    pub written: Option<Written>,
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

    /// The recording; without its series if it is long. Holes of a long one are known when it is written.
    #[must_use]
    pub fn told(&self) -> &Recording {
        &self.recording
    }

    /// Writes the bag, or only looks at the samples if there is no folder; `scene` as in [`Recording::write`].
    ///
    /// # Errors
    /// As [`Recording::write`]; [`TableError`] if a long table can't be read a second time.
    pub fn write(mut self, folder: Option<&Path>, scene: Option<&str>) -> Result<Imported, RecordingError> {
        let Some(changes) = self.changes.take() else {
            let written = folder.map(|folder| self.recording.write(folder, scene)).transpose()?;
            let extents = self.recording.extents();
            return Ok(Imported { tables: self.tables, told: self.recording, extents, written });
        };
        let has = changes.counts.map(|count| count > 0);
        let mut topics = folder.map(|folder| Topics::create(&self.recording, has, folder, scene)).transpose()?;
        let (mut extents, mut holes) = (Extents::default(), Holes::new(!has[0]));
        let mut counts = [0; 4];
        self.each(&changes, |which, sample| {
            counts[which] += 1;
            extents.note(sample);
            holes.note(sample);
            topics.as_mut().map_or(Ok(()), |topics| topics.write(sample).map_err(RecordingError::from))
        })?;
        if counts != changes.counts {
            return Err(self.changed().into());
        }
        let written = topics.map(Topics::finish).transpose()?;
        let span = |k: usize| extents.0[k].as_ref().map(|extent| (extent.from_to_s[0], extent.from_to_s[1]));
        let motion = match (span(0), span(1)) {
            (Some(a), Some(b)) => Some((a.0.min(b.0), a.1.max(b.1))),
            (one, other) => one.or(other),
        };
        self.recording.lose_times(motion, span(2), counts[2], holes);
        Ok(Imported { tables: self.tables, told: self.recording, extents: extents.found(), written })
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
        let Changes { plan, counts, spreads, .. } = changes;
        let open = |k: usize| Pieces::open(&self.paths[k], self.said, k);
        let apart = plan.feeling.filter(|feeling| *feeling != plan.moving || plan.late_ns != 0);
        let feels = plan.feeling.is_some() && apart.is_none();
        let mut motion = Queue { moves: true, feels, ..Queue::new(open(plan.moving)?, spreads) };
        let cell = apart.map(open).transpose()?;
        let mut cell = cell.map(|pieces| Queue { feels: true, ..Queue::new(pieces, spreads) });
        let origin_ns = self.recording.origin_ns;
        let at = |ns: i64| seconds(ns, origin_ns);
        loop {
            let of_cell = cell.as_ref().unwrap_or(&motion);
            let late = |ns: i64| ns.saturating_sub(plan.late_ns);
            let force = of_cell.forces.next(of_cell.latest).map(late);
            let next = [
                motion.depths.next(motion.latest),
                motion.poses.next(motion.latest),
                force,
                motion.markers.next(motion.latest),
            ];
            let times = [0, 1, 2, 3].map(|k| next[k].filter(|_| counts[k] > 0).map(at));
            let Some(which) = first(times) else { return Ok(()) };
            let time_s = times[which].unwrap_or_default();
            let is_read = match which {
                0 => motion.depths.take(|depth_m| take(0, &Sample::Depth(DepthSample { time_s, depth_m }))),
                1 => motion.poses.take(|pose| {
                    let Pose { tip, axis, roll_rad } = plan.frames.pose(pose);
                    take(1, &Sample::Pose(PoseSample { time_s, tip, axis, roll_rad }))
                }),
                2 => cell.as_mut().unwrap_or(&mut motion).forces.take(|force_n| {
                    let force_n = changes.force(force_n).ok_or_else(|| self.changed())?;
                    take(2, &Sample::Force(ForceSample { time_s, force_n }))
                }),
                _ => motion.markers.take(|positions| {
                    let positions = positions.iter().map(|p| plan.frames.point(*p)).collect();
                    take(3, &Sample::Markers(&MarkerSample { time_s, positions }))
                }),
            };
            match is_read {
                Some(taken) => taken?,
                None if which == 2 => cell.as_mut().unwrap_or(&mut motion).read_on()?,
                None => motion.read_on()?,
            }
        }
    }
}

/// Samples of a series that were read and not taken.
struct Line<V> {
    /// How those of one stamp are spread; `None`: the first of them is taken.
    spread: Option<Spread>,
    ready: VecDeque<(i64, V)>,
    /// The samples of the last stamp, while there may be more.
    group: Vec<(i64, V)>,
    is_first: bool,
    ended: bool,
}

impl<V> Line<V> {
    fn new(spread: Option<Spread>) -> Self {
        Self { spread, ready: VecDeque::new(), group: Vec::new(), is_first: true, ended: false }
    }

    fn put(&mut self, samples: std::vec::Drain<'_, (i64, V)>) {
        for sample in samples {
            match self.group.first().map(|first| first.0) {
                Some(stamp) if stamp == sample.0 && self.spread.is_none() => continue,
                Some(stamp) if stamp != sample.0 => self.close(Some(sample.0)),
                _ => {}
            }
            self.group.push(sample);
        }
    }

    /// The samples of one stamp are complete; `next`: the next stamp.
    fn close(&mut self, next: Option<i64>) {
        let (stamp, count) = (self.group.first().map_or(0, |first| first.0), self.group.len());
        let of = |spread: Spread| spread.times(stamp, count, next, self.is_first);
        let (from, every) = self.spread.map_or((stamp, 0), of);
        self.ready.extend(self.group.drain(..).zip(0..).map(|((_, value), k)| (from + every * k, value)));
        self.is_first = false;
    }

    /// No further sample has a smaller stamp, ns; `latest`: the last one of the table. `None` at the end.
    fn next(&self, latest: i64) -> Option<i64> {
        let known = self.ready.front().or(self.group.first()).map(|sample| sample.0);
        known.or_else(|| (!self.ended).then_some(latest))
    }

    /// Takes a sample, if one is complete.
    fn take<R>(&mut self, take: impl FnOnce(V) -> R) -> Option<R> {
        self.ready.pop_front().map(|(_, value)| take(value))
    }
}

/// Samples of a table that were read and not taken.
struct Queue<'a> {
    pieces: Pieces<'a>,
    /// Whether depths, poses and markers are taken, and forces.
    moves: bool,
    feels: bool,
    /// Last stamp that was read, ns.
    latest: i64,
    depths: Line<f64>,
    poses: Line<Pose>,
    forces: Line<[f64; 3]>,
    markers: Line<Vec<[f64; 3]>>,
}

impl<'a> Queue<'a> {
    fn new(pieces: Pieces<'a>, spreads: &[Option<Spread>; 4]) -> Self {
        let [depths, poses, forces, markers] = *spreads;
        Self {
            pieces,
            moves: false,
            feels: false,
            latest: i64::MIN,
            depths: Line::new(depths),
            poses: Line::new(poses),
            forces: Line::new(forces),
            markers: Line::new(markers),
        }
    }

    /// Reads a piece.
    fn read_on(&mut self) -> Result<(), TableError> {
        let Some(table) = self.pieces.next()? else {
            self.end();
            return Ok(());
        };
        let last = [
            table.depths.last().map(|s| s.0),
            table.poses.last().map(|s| s.0),
            table.forces.last().map(|s| s.0),
            table.markers.last().map(|s| s.0),
        ];
        self.latest = last.into_iter().flatten().fold(self.latest, i64::max);
        let (depths, poses) = (table.depths.drain(..), table.poses.drain(..));
        let (forces, markers) = (table.forces.drain(..), table.markers.drain(..));
        // what is not taken is another table's here
        if self.moves {
            self.depths.put(depths);
            self.poses.put(poses);
            self.markers.put(markers);
        }
        if self.feels {
            self.forces.put(forces);
        }
        Ok(())
    }

    fn end(&mut self) {
        fn end<V>(line: &mut Line<V>) {
            line.close(None);
            line.ended = true;
        }
        end(&mut self.depths);
        end(&mut self.poses);
        end(&mut self.forces);
        end(&mut self.markers);
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
        let import = || Import::longer_than(least, paths, said);
        let first = match import() {
            Ok(import) => import,
            Err(error) => return (error.to_string(), Vec::new(), false),
        };
        let twice = first.changes.is_some();
        let _ = fs::remove_dir_all(out);
        let Imported { tables, told, extents, .. } = first.write(Some(out), Some("compression")).unwrap();
        let rows: Vec<_> = tables.iter().map(|t| (&t.layout, t.rows, t.bad, &t.columns)).collect();
        let text = format!("{extents:?} {:?} {:?} {:?} {rows:?}", told.losses, told.warnings, told.force_frame);
        let dry = import().unwrap().write(None, None).unwrap();
        assert_eq!((dry.extents, dry.told.losses), (extents, told.losses), "a dry run says the same");
        let mut files: Vec<PathBuf> = fs::read_dir(out).unwrap().map(|file| file.unwrap().path()).collect();
        files.sort();
        (text, files.iter().map(|file| fs::read(file).unwrap()).collect(), twice)
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
        assert!(of("cut.csv", plain.trim_end_matches(|c| c != ',').to_owned()), "its last row is lost");
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
        // holes, and stamps of several readings
        let hole = |i: u32| format!("{:.4},{:.5},{:.5}\n", time(i + i / 9_000 * 900), depth(i), depth(i));
        assert!(of("hole.csv", rows(&hole)));
        let silent = |i: u32| {
            let force = if (9_000..12_000).contains(&i) { "" } else { "0.1" };
            format!("{:.4},{:.5},{force}\n", time(i), depth(i))
        };
        assert!(of("silent.csv", rows(&silent)));
        assert!(of("resting.csv", rows(&|i| silent(i).replace(&format!("{:.5}", depth(i)), "0.5"))));
        assert!(of("twice.csv", rows(&|i| format!("{:.4},{:.5},{:.5}\n", time(i / 2), depth(i), depth(i)))));
        assert!(of("again.csv", rows(&|i| format!("{:.4},{:.5},0.1\n", time(i / 2), depth(i / 2)))), "the same again");
        assert!(of("whole.csv", rows(&|i| format!("{},{:.5},{:.5}\n", (i + 700) / 1000, depth(i), depth(i % 9)))));
        assert!(of("uneven.csv", rows(&|i| format!("{:.1},{:.5},0.1\n", f64::from(i * i / 9_000) * 0.1, depth(i)))));
        let columns = |i: u32| match i % 7 {
            0 => format!("{:.3},{:.5},\n", time(i / 20), depth(i)),
            5 => format!("{:.3},,\n", time(i / 20)),
            _ => format!("{:.3},,{:.5}\n", time(i / 20), depth(i)),
        };
        assert!(of("columns.csv", rows(&columns)), "a column each at its own rate");
        assert!(of("one.csv", rows(&|i| format!("5,{:.5},{:.5}\n", depth(i), depth(i)))));
        // stamps in disorder
        assert!(of("turned.csv", rows(&|i| format!("{:.4},{:.5},0.1\n", time(i ^ 1), depth(i)))));
        let late = |i: u32| {
            // the force comes a third of a second late, in rows of its own
            let row = format!("{:.4},{:.5},\n", time(i), depth(i));
            if i < 333 { row } else { format!("{row}{:.4},,{:.5}\n", time(i - 333), depth(i)) }
        };
        assert!(of("late.csv", rows(&late)));
        // what must be in memory
        let far = |i: u32| if i % 9_000 == 7_000 { time(i) - 1.5 } else { time(i) };
        assert!(!of("far.csv", rows(&|i| format!("{:.4},{:.5},0.1\n", far(i), depth(i)))));
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
