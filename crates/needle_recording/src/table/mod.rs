//! Text tables of numbers, as written by load cells, testing machines and spreadsheets.

mod arrays;
mod clock;
mod columns;
mod contents;
mod encoding;
mod error;
mod layout;
mod names;
mod number;
mod records;
mod row;
mod rows;
mod sheets;
mod source;
mod survey;
mod text;
#[cfg(feature = "xlsx")]
mod workbook;

use std::collections::VecDeque;
use std::path::{Path, PathBuf};

use super::selection::{Selection, TableLayout};
use super::thin::Thin;
pub use clock::Clock;
use columns::Finder;
pub use columns::{Column, Columns};
pub use contents::Table;
pub use error::TableError;
use layout::{LOOKED_AT, Layout, MOST_LOOKED_AT};
use rows::{Taken, Taking};
use source::Source;
pub(super) use source::size_of_text;
pub(super) use survey::Survey;

impl Table {
    /// Reads one file of a recording; `file_number` is its index, from 0.
    ///
    /// # Errors
    /// [`TableError`].
    pub fn read(path: &Path, said: &Selection, file_number: usize) -> Result<Self, TableError> {
        Self::of_source(path, Source::of_file(path, &said.layout)?, said, file_number, false)
    }

    /// Same as [`Table::read`], without the samples: [`Table::survey`] says what they are like.
    ///
    /// # Errors
    /// [`TableError`].
    pub(super) fn surveyed(path: &Path, said: &Selection, file_number: usize) -> Result<Self, TableError> {
        Self::of_source(path, Source::of_file(path, &said.layout)?, said, file_number, true)
    }

    /// Same as [`Table::read`], with the file's content given.
    ///
    /// # Errors
    /// [`TableError`].
    pub fn from_bytes(path: &Path, bytes: Vec<u8>, said: &Selection, file_number: usize) -> Result<Self, TableError> {
        Self::of_source(path, Source::of_bytes(path, bytes, &said.layout)?, said, file_number, false)
    }

    fn of_source(
        path: &Path,
        source: Source,
        said: &Selection,
        file_number: usize,
        surveyed: bool,
    ) -> Result<Self, TableError> {
        let blocks = Blocks { surveyed, streamed: surveyed, ..Blocks::new(path, source, said, file_number) };
        Self::wanted(path, blocks, said)
    }

    /// The recording that is asked for.
    fn wanted(path: &Path, mut blocks: Blocks, said: &Selection) -> Result<Self, TableError> {
        let no_table = || TableError::NoTable { path: path.to_owned() };
        let mut wanted = blocks.next().ok_or_else(no_table)??;
        let (mut all, mut clocks) = (vec![wanted.extent()], vec![wanted.has_clock()]);
        for (number, block) in (2..).zip(blocks) {
            match block {
                Ok(block) => {
                    all.push(block.extent());
                    clocks.push(block.has_clock());
                    wanted = if said.layout.block == Some(number) { block } else { wanted };
                }
                // errors in the columns of a block that is not requested are ignored
                Err(error) if said.layout.block == Some(number) => return Err(error),
                Err(error @ TableError::Open { .. }) => return Err(error),
                Err(_) => {
                    all.push("of other columns".to_owned());
                    clocks.push(true);
                }
            }
        }
        let timed = clocks.iter().filter(|timed| **timed).count();
        if said.layout.block.is_none() && timed == 1 && clocks[0] && all.len() > 1 {
            // results below the readings
            let rest = all[1..].join(", ");
            wanted.warnings.push(format!("{}: {rest} have no times and were left out", wanted.file));
            return Ok(wanted);
        }
        let reason = match (said.layout.block, all.len()) {
            (None, 2..) => "it holds several recordings: name the one to take with --block N",
            (Some(block), count) if !(1..=count).contains(&block) => "there is no such block (--block)",
            _ => return Ok(wanted),
        };
        let blocks = (1..).zip(all).map(|(n, extent): (usize, _)| format!("{n} is {extent}")).collect::<Vec<_>>();
        let file = path.display().to_string();
        Err(TableError::Blocks { file, reason: reason.to_owned(), blocks: blocks.join(", ") })
    }

    /// Whether its rows have times.
    fn has_clock(&self) -> bool {
        self.columns.time.is_some() || self.rate_hz.is_some()
    }

    /// Columns that the user named and that are not in this file.
    pub(super) fn absent(&self) -> &[(&'static str, String)] {
        &self.absent
    }

    fn extent(&self) -> String {
        let [first, last] = self.lines;
        format!("lines {first} to {last} ({} rows)", self.rows)
    }
}

/// Refuses options that have no meaning for any of the files.
pub(super) fn refuse_options(paths: &[PathBuf], said: &Selection) -> Result<(), TableError> {
    source::refuse_options(paths.iter().map(PathBuf::as_path), &said.layout)
}

/// Number of consecutive recordings in a file; 1 if it can't be determined.
#[must_use]
pub fn blocks(path: &Path, said: &Selection) -> usize {
    let Ok(source) = Source::of_file(path, &said.layout) else { return 1 };
    let timed = |block: &Result<Table, TableError>| block.as_ref().map_or(true, Table::has_clock);
    let all: Vec<bool> = Blocks::new(path, source, said, 0).map(|block| timed(&block)).collect();
    // results below the last recording are none
    all.iter().rposition(|timed| *timed).map_or(all.len(), |last| last + 1).max(1)
}

/// The recordings that stand one after the other in a file.
struct Blocks<'a> {
    path: &'a Path,
    file: String,
    source: Source,
    said: &'a Selection,
    file_number: usize,
    /// Whether the samples are left out, and whether they are taken in the order of time.
    surveyed: bool,
    streamed: bool,
    /// Line at which the next one begins, from 0.
    line: Option<usize>,
    /// Headers and number of columns of the last one.
    before: (Option<Vec<String>>, usize),
}

impl<'a> Blocks<'a> {
    fn new(path: &'a Path, source: Source, said: &'a Selection, file_number: usize) -> Self {
        let (file, before) = (path.display().to_string(), (None, 0));
        Self { path, file, source, said, file_number, surveyed: false, streamed: false, line: Some(0), before }
    }

    /// A table of which no row was taken yet.
    fn table(&mut self, layout: &Layout, line: usize) -> Result<Table, TableError> {
        let finder = Finder { file: &self.file, layout };
        if layout.has_commas_twice() {
            let reason = "its cells are between commas, and its numbers have decimal commas as well, so neither can be recognized: \
                          export it with semicolons or tabs between cells, or with decimal points";
            return Err(finder.error(reason.to_owned()));
        }
        let columns = finder.find(self.said, self.file_number)?;
        let gone = columns::named(self.said).into_iter().filter_map(|(option, name)| match finder.named(name) {
            Ok(Some(_)) => None,
            Ok(None) => Some(Ok((option, name.to_owned()))),
            Err(error) => Some(Err(error)),
        });
        let rate_hz = self.said.rate_hz.or_else(|| layout.step_s.map(|step| step.recip()));
        let left = finder.forces_left(&columns);
        let marks = columns.indices().into_iter().filter(|&c| layout.has_marks(c)).map(|c| {
            let mark = layout.cells(c).find(|cell| layout::is_no_reading(cell)).unwrap_or_default();
            format!("`{mark}` in column {} is taken for no reading", c + 1)
        });
        let notes = self.source.notes.drain(..).chain(layout.note.clone()).chain(left).chain(marks);
        Ok(Table {
            layout: self.source.what.clone() + &describe(layout, line),
            all_columns: finder.describe(),
            absent: gone.collect::<Result<_, _>>()?,
            warnings: notes.map(|note| format!("{}: {note}", self.file)).collect(),
            rate_hz: rate_hz.filter(|_| columns.time.is_none()),
            file: self.file.clone(),
            columns,
            bad: std::mem::take(&mut self.source.bad),
            first_bad: self.source.first_bad.take(),
            survey: self.surveyed.then(Survey::default),
            waiting: self.streamed.then(VecDeque::new),
            thin: [Thin::to(self.said.most_readings); 4],
            ..Table::default()
        })
    }

    /// A table of which no row was taken yet; `None` if there is none.
    fn begin(&mut self, mut line: usize) -> Option<Result<Begun, TableError>> {
        // the line of the headers was said of the first
        let header_line = self.source.layout.header_line.filter(|n| line == 0 || *n == 0);
        let said = TableLayout { header_line, ..self.source.layout.clone() };
        let mut layout = match self.layout(&said) {
            Ok(layout) => layout?,
            Err(error) => return Some(Err(self.open(error))),
        };
        layout.inherit(&self.before);
        let mut table = self.table(&layout, line);
        // a table of results above that of the readings has no times
        if said.header_line.is_none()
            && table.as_ref().is_ok_and(|table| !table.has_clock())
            && let Some((lines, bytes)) = layout.end(self.source.text.read())
            && let Some(next) = Layout::of(&self.source.text.read()[bytes..], &said, LOOKED_AT)
            && let Ok(mut timed) = self.table(&next, line + lines)
            && timed.has_clock()
        {
            timed.warnings.push(format!(
                "{}: the table from line {} on has no times; that from line {} on is taken",
                self.file,
                line + layout.first_row + 1,
                line + lines + next.first_row + 1
            ));
            self.source.text.skip(bytes);
            (line, layout, table) = (line + lines, next, Ok(timed));
        }
        self.before = (layout.headers.clone(), layout.columns);
        let begun = table.map(|mut table| {
            let taking = Taking::new(&mut table, &mut self.source.text, &layout, line);
            Begun { table, layout, taking }
        });
        Some(begun)
    }

    /// The layout of what comes next; `None` if it has no table. The head of a file may be long.
    fn layout(&mut self, said: &TableLayout) -> std::io::Result<Option<Layout>> {
        let least = LOOKED_AT + said.header_line.unwrap_or(0);
        for most in [least, least.max(MOST_LOOKED_AT)] {
            let found = Layout::of(self.source.text.head(most + 1)?, said, most);
            if found.is_some() {
                return Ok(found);
            }
        }
        Ok(None)
    }

    /// Goes on by a piece of the text; false at the end of the recording.
    fn piece(&mut self, begun: &mut Begun) -> Result<bool, TableError> {
        let Begun { table, layout, taking } = begun;
        match taking.piece(table, &mut self.source.text, layout) {
            Ok(Taken::Piece) => Ok(true),
            Ok(Taken::End(next)) => {
                table.keep_all();
                self.line = next;
                Ok(false)
            }
            Err(error) => Err(self.open(error)),
        }
    }

    fn open(&self, source: std::io::Error) -> TableError {
        TableError::Open { path: self.path.to_owned(), source }
    }

    fn whole(&mut self, mut begun: Begun) -> Result<Table, TableError> {
        while self.piece(&mut begun)? {}
        let Table { thin, file, warnings, .. } = &mut begun.table;
        warnings.extend(thin.iter().filter_map(|thin| thin.warning(file)));
        warnings.dedup();
        begun.table.believable().map(|()| begun.table)
    }
}

/// A table that is being read.
struct Begun {
    table: Table,
    layout: Layout,
    taking: Taking,
}

impl Iterator for Blocks<'_> {
    type Item = Result<Table, TableError>;

    fn next(&mut self) -> Option<Self::Item> {
        let line = self.line.take()?;
        Some(self.begin(line)?.and_then(|begun| self.whole(begun)))
    }
}

/// The samples of one recording of a file, a piece at a time.
pub(super) struct Pieces<'a> {
    blocks: Blocks<'a>,
    begun: Begun,
    ended: bool,
}

impl<'a> Pieces<'a> {
    /// Samples of the recording that [`Table::read`] gives.
    ///
    /// # Errors
    /// [`TableError`].
    pub(super) fn open(path: &'a Path, said: &'a Selection, file_number: usize) -> Result<Self, TableError> {
        let no_table = || TableError::NoTable { path: path.to_owned() };
        let source = Source::of_file(path, &said.layout)?;
        let mut blocks = Blocks { surveyed: true, streamed: true, ..Blocks::new(path, source, said, file_number) };
        for _ in 1..said.layout.block.unwrap_or(1) {
            // what is wrong with one that is not asked for was ignored before
            if let Some(Err(error @ TableError::Open { .. })) = blocks.next() {
                return Err(error);
            }
        }
        blocks.surveyed = false;
        let line = blocks.line.take().ok_or_else(no_table)?;
        let begun = blocks.begin(line).ok_or_else(no_table)??;
        Ok(Self { blocks, begun, ended: false })
    }

    /// The table with the samples of the next piece, to be taken out of it; `None` at the end.
    ///
    /// # Errors
    /// [`TableError::Open`].
    pub(super) fn next(&mut self) -> Result<Option<&mut Table>, TableError> {
        if self.ended {
            return Ok(None);
        }
        // the piece in which it ends has samples too
        self.ended = !self.blocks.piece(&mut self.begun)?;
        Ok(Some(&mut self.begun.table))
    }
}

fn describe(layout: &Layout, line: usize) -> String {
    let separator = match layout.separator {
        '\t' => "tabs".to_owned(),
        ' ' => "blanks".to_owned(),
        c => format!("`{c}`"),
    };
    let decimal = if layout.decimal_comma { "decimal comma" } else { "decimal point" };
    let headers = if layout.headers.is_some() { "with headers" } else { "without headers" };
    let step = layout.step_s.map_or_else(String::new, |step| format!(", a row each {step} s"));
    format!(
        "{} columns between {separator}, {decimal}, {headers}, data from line {}{step}",
        layout.columns,
        line + layout.first_row + 1
    )
}
