//! Records that name their values, as a table: JSON, a value a line or one for all, the documents of `ros2 topic echo`, and lines of
//! names and numbers.
//!
//! A value within another has the names of both, `header.stamp.sec`, and one of a list its number from 0, `position.0`.

use std::borrow::Cow;
use std::collections::HashMap;
use std::fmt::{self, Write as _};

use super::layout::Kind;
use super::sheets::plain;
use serde::de::{Deserialize, Deserializer, MapAccess, SeqAccess, Visitor};

/// More bytes are not taken.
const MOST_BYTES: usize = 1 << 30;
/// More bytes of one value that holds everything are not taken: all of it is in memory at once.
const MOST_OF_ONE: usize = 1 << 28;
/// More columns are not taken: names that differ from record to record are no columns.
const MOST_COLUMNS: usize = 4096;

/// A table made of records.
pub(super) struct Records {
    /// Cells between tabs, with the names in the first line if there are any.
    pub text: String,
    pub has_names: bool,
    /// Number of records that can't be read, and the first of them with its line.
    pub bad: u64,
    pub first_bad: Option<String>,
}

/// Names and cells of one record, in its order.
struct Record(Vec<(String, String)>);

impl<'de> Deserialize<'de> for Record {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        Part::deserialize(from).map(|part| {
            let mut leaves = Vec::new();
            part.leaves(&mut String::new(), &mut leaves);
            Self(leaves)
        })
    }
}

/// A value as it is read.
enum Part {
    Cell(String),
    List(Vec<Self>),
    Map(Vec<(String, Self)>),
}

impl Part {
    fn leaves(self, path: &mut String, out: &mut Vec<(String, String)>) {
        let length = path.len();
        let parts: Vec<(String, Self)> = match self {
            Self::Cell(cell) => return out.push((path.clone(), cell)),
            Self::List(parts) => parts.into_iter().enumerate().map(|(i, part)| (i.to_string(), part)).collect(),
            Self::Map(parts) => parts,
        };
        for (name, part) in parts {
            if !path.is_empty() {
                path.push('.');
            }
            path.push_str(&name);
            part.leaves(path, out);
            path.truncate(length);
        }
    }
}

impl<'de> Deserialize<'de> for Part {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        struct Any;
        impl<'de> Visitor<'de> for Any {
            type Value = Part;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a value")
            }

            fn visit_bool<E>(self, truth: bool) -> Result<Part, E> {
                Ok(Part::Cell(truth.to_string()))
            }

            fn visit_i64<E>(self, number: i64) -> Result<Part, E> {
                Ok(Part::Cell(number.to_string()))
            }

            fn visit_u64<E>(self, number: u64) -> Result<Part, E> {
                Ok(Part::Cell(number.to_string()))
            }

            fn visit_f64<E>(self, number: f64) -> Result<Part, E> {
                Ok(Part::Cell(number.to_string()))
            }

            fn visit_str<E>(self, text: &str) -> Result<Part, E> {
                Ok(Part::Cell(plain(text)))
            }

            fn visit_unit<E>(self) -> Result<Part, E> {
                Ok(Part::Cell(String::new()))
            }

            fn visit_none<E>(self) -> Result<Part, E> {
                Ok(Part::Cell(String::new()))
            }

            fn visit_some<D: Deserializer<'de>>(self, from: D) -> Result<Part, D::Error> {
                Part::deserialize(from)
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut parts: A) -> Result<Part, A::Error> {
                let mut all = Vec::new();
                while let Some(part) = parts.next_element()? {
                    all.push(part);
                }
                Ok(Part::List(all))
            }

            fn visit_map<A: MapAccess<'de>>(self, mut parts: A) -> Result<Part, A::Error> {
                let mut all = Vec::new();
                while let Some(entry) = parts.next_entry::<String, Part>()? {
                    all.push(entry);
                }
                Ok(Part::Map(all))
            }
        }
        from.deserialize_any(Any)
    }
}

/// Whether bytes begin with JSON that may hold records. Lines of other logs begin with brackets too: `[10:15:00] 0.25`.
pub(super) fn is_json(start: &[u8]) -> bool {
    let mut marks = start.trim_prefix_mark().iter().filter(|b| !b.is_ascii_whitespace());
    matches!((marks.next(), marks.next()), (Some(b'{'), Some(b'"' | b'}')) | (Some(b'['), Some(b'{' | b'[' | b'"')))
}

/// Whether bytes begin with the documents of `ros2 topic echo`.
pub(super) fn is_echo(start: &[u8]) -> bool {
    let text = String::from_utf8_lossy(start.trim_prefix_mark());
    let mut lines = text.lines().map(str::trim_end).filter(|line| !line.is_empty() && *line != "---");
    let is_key = |line: &str| {
        let name = line.trim_start_matches(|c: char| c.is_alphanumeric() || c == '_');
        name.len() < line.len() && (name == ":" || name.starts_with(": "))
    };
    let parts = text.lines().any(|line| line.trim_end() == "---") || text.starts_with("header:");
    parts && lines.next().is_some_and(is_key) && lines.next().is_some_and(|line| is_key(line.trim_start()))
}

trait Marked {
    fn trim_prefix_mark(&self) -> &[u8];
}

impl Marked for [u8] {
    /// Without the mark of UTF-8.
    fn trim_prefix_mark(&self) -> &[u8] {
        self.strip_prefix(b"\xef\xbb\xbf").unwrap_or(self)
    }
}

/// The documents between lines of `---`.
///
/// # Errors
/// Why there is no table, and what to do.
pub(super) fn of_echo(bytes: &[u8]) -> Result<Records, String> {
    let text = fits(bytes, MOST_BYTES)?;
    let mut documents: Vec<(usize, usize)> = Vec::new();
    let (mut from, mut at) = (0, 0);
    for line in text.split_inclusive('\n') {
        if line.trim_end() == "---" {
            documents.push((from, at));
            from = at + line.len();
        }
        at += line.len();
    }
    documents.push((from, at));
    documents.retain(|(from, to)| !text[*from..*to].trim().is_empty());
    let read = |(from, to): &(usize, usize)| {
        // numbers that are none, as words
        let words = [(" .nan", " NaN"), (" .inf", " Infinity"), (" -.inf", " -Infinity")];
        let document = &text[*from..*to];
        let plain = words.iter().fold(Cow::from(document), |document, (mark, word)| match document.contains(mark) {
            true => document.replace(mark, &format!(" \"{}\"", word.trim())).into(),
            false => document,
        });
        let record = serde_saphyr::from_str::<Record>(&plain);
        record.map_err(|_| (*from, &text[*from..*to]))
    };
    table(text, &mut || documents.iter().map(read))
}

/// Values one after the other, or one that holds all.
///
/// # Errors
/// Why there is no table, and what to do.
pub(super) fn of_json(bytes: &[u8]) -> Result<Records, String> {
    let text = &with_quoted_nan(fits(bytes, MOST_BYTES)?);
    let mut values = Values { text, at: 0, in_list: false };
    let mut marks = text.bytes().filter(|b| !b.is_ascii_whitespace());
    if (marks.next(), marks.next()) == (Some(b'['), Some(b'{')) || text.trim_start().starts_with("[[") {
        (values.at, values.in_list) = (text.find('[').map_or(0, |at| at + 1), true);
    }
    let (mut first, second) = {
        let mut values = values.clone();
        (values.next(), values.next())
    };
    if let (Some(Ok(one)), None) = (&mut first, second) {
        fits(bytes, MOST_OF_ONE)?;
        return columns(std::mem::take(&mut one.0));
    }
    table(text, &mut || values.clone())
}

/// Whether all of the first lines are values with their names: `t:0.1,force_N:0.25` of a serial plotter, `t=0.1 F=0.25`.
pub(super) fn is_labelled(start: &[u8]) -> bool {
    let text = String::from_utf8_lossy(start.trim_prefix_mark());
    let lines: Vec<&str> = text.lines().filter(|line| !line.trim().is_empty()).take(3).collect();
    lines.len() == 3 && lines.iter().all(|line| labelled(line).is_some_and(|record| record.0.len() > 1))
}

/// Lines of values with their names.
///
/// # Errors
/// As [`of_json`].
pub(super) fn of_labelled(bytes: &[u8]) -> Result<Records, String> {
    let text = fits(bytes, MOST_BYTES)?;
    let lines = || text.lines().filter(|line| !line.trim().is_empty());
    let place = |line: &str| line.as_ptr() as usize - text.as_ptr() as usize;
    table(text, &mut || lines().map(|line| labelled(line).ok_or_else(|| (place(line), line))))
}

/// The values of a line; `None` if one has no name or is no number.
fn labelled(line: &str) -> Option<Record> {
    let values = line.split([',', ';', '\t', ' ']).filter(|value| !value.is_empty());
    let one = |value: &str| {
        let (name, number) = value.split_once([':', '='])?;
        let named = name.starts_with(|c: char| c.is_alphabetic() || c == '_');
        (named && number.parse::<f64>().is_ok()).then(|| (name.to_owned(), number.to_owned()))
    };
    values.map(one).collect::<Option<Vec<_>>>().map(Record)
}

fn fits(bytes: &[u8], most: usize) -> Result<&str, String> {
    let bytes = bytes.trim_prefix_mark();
    if bytes.len() > most {
        let size = most >> 20;
        return Err(format!("it has more than {size} MiB: make a CSV of it, which is read piece by piece"));
    }
    std::str::from_utf8(bytes).map_err(|_| "it is not UTF-8: save it as UTF-8, or as CSV".to_owned())
}

/// NaN and Infinity, as Python writes them, in quotation marks: JSON has no such numbers.
fn with_quoted_nan(text: &str) -> String {
    if !text.contains("NaN") && !text.contains("Infinity") {
        return text.to_owned();
    }
    let (mut out, mut rest, mut quoted) = (String::with_capacity(text.len()), text, false);
    while let Some(at) = rest.find(['"', 'N', 'I', '-']) {
        let found = ["NaN", "Infinity", "-Infinity"].into_iter().find(|word| rest[at..].starts_with(word));
        match found.filter(|_| !quoted) {
            Some(word) => {
                let _ = write!(out, "{}\"{word}\"", &rest[..at]);
                rest = &rest[at + word.len()..];
            }
            None => {
                let escaped = rest[..at].bytes().rev().take_while(|b| *b == b'\\').count() % 2 == 1;
                quoted ^= rest[at..].starts_with('"') && !escaped;
                out.push_str(&rest[..=at]);
                rest = &rest[at + 1..];
            }
        }
    }
    out + rest
}

/// The values of a text one after the other, or where one is broken its place and its line.
#[derive(Clone)]
struct Values<'a> {
    text: &'a str,
    at: usize,
    in_list: bool,
}

impl<'a> Iterator for Values<'a> {
    type Item = Result<Record, (usize, &'a str)>;

    fn next(&mut self) -> Option<Self::Item> {
        let rest = &self.text[self.at..];
        let rest = rest.trim_start_matches(|c: char| c.is_whitespace() || c == ',' || c == '\u{1e}');
        if rest.is_empty() || self.in_list && rest.starts_with(']') {
            return None;
        }
        self.at = self.text.len() - rest.len();
        let mut values = serde_json::Deserializer::from_str(rest).into_iter::<Record>();
        match values.next() {
            Some(Ok(record)) => {
                self.at += values.byte_offset();
                Some(Ok(record))
            }
            _ => {
                let line = rest.split_inclusive('\n').next().unwrap_or(rest);
                let broken = (self.at, line.trim_end());
                self.at += line.len();
                Some(Err(broken))
            }
        }
    }
}

/// A row of each record, with all names that any of them has. Columns that only hold words are the last ones.
fn table<'a, I: Iterator<Item = Result<Record, (usize, &'a str)>>>(
    text: &str,
    records: &mut dyn FnMut() -> I,
) -> Result<Records, String> {
    let (mut columns, mut is_data) = (Names::default(), Vec::new());
    for record in records().flatten() {
        for (name, cell) in record.named() {
            let column = columns.index(&name)?;
            is_data.resize(columns.names.len(), false);
            is_data[column] |= Kind::of(&cell, false).is_data();
        }
    }
    let mut order: Vec<usize> = (0..columns.names.len()).collect();
    order.sort_by_key(|column| !is_data[*column]);
    let has_names = columns.names.iter().any(|name| name.parse::<usize>().is_err());
    let mut made = Records { text: String::new(), has_names, bad: 0, first_bad: None };
    if has_names {
        made.put(&order, &columns.names.iter().map(|name| plain(name)).collect::<Vec<_>>());
    }
    for record in records() {
        let mut row = vec![String::new(); columns.names.len()];
        match record {
            Ok(record) => {
                for (name, cell) in record.named() {
                    row[columns.index(&name)?] = cell;
                }
                made.put(&order, &row);
            }
            Err((at, broken)) => {
                made.bad += 1;
                made.first_bad.get_or_insert_with(|| {
                    let line = text[..at].matches('\n').count() + 1;
                    let shown: String = broken.trim().chars().take(80).collect();
                    format!("line {line}: {shown}")
                });
            }
        }
    }
    Ok(made)
}

impl Record {
    /// Its cells with the names of their columns: values of a message are of its topic, and its stamp is the time whatever its topic.
    fn named(self) -> impl Iterator<Item = (String, String)> {
        let topic =
            self.0.iter().find(|(path, cell)| path == "topic" && !cell.is_empty()).map(|(_, topic)| topic.clone());
        self.0.into_iter().filter_map(move |(path, cell)| {
            let Some(topic) = &topic else { return Some((path, cell)) };
            let within = ["data.", "msg.", "message."].iter().find_map(|part| path.strip_prefix(part));
            match within {
                Some(rest) if !rest.contains("stamp.") => Some((format!("{topic}.{rest}"), cell)),
                _ => (path != "topic").then_some((path, cell)),
            }
        })
    }
}

/// One value whose lists are the columns: `{"time_s": [0, 0.1], "load_n": [0, 0.5]}`, with rows by the first number in a path.
fn columns(leaves: Vec<(String, String)>) -> Result<Records, String> {
    let (mut names, mut rows, mut titles) = (Names::default(), Vec::<Vec<String>>::new(), Vec::new());
    for (path, cell) in leaves {
        let parts: Vec<&str> = path.split('.').collect();
        let found = parts.iter().position(|part| part.parse::<usize>().is_ok());
        let Some((at, row)) = found.and_then(|at| Some((at, parts[at].parse::<usize>().ok()?))) else { continue };
        // as pandas splits a frame
        if path.starts_with("columns.") {
            titles.push(cell);
            continue;
        }
        let column = names.index(&[&parts[..at], &parts[at + 1..]].concat().join("."))?;
        if row > MOST_OF_ONE {
            return Err("its lists have no rows of a table: make a CSV of it".to_owned());
        }
        let missing = (row + 1).saturating_sub(rows.len());
        rows.extend(std::iter::repeat_n(Vec::new(), missing));
        let cells = &mut rows[row];
        cells.resize(cells.len().max(column + 1), String::new());
        cells[column] = cell;
    }
    let title = |name: &String| {
        let number = name.strip_prefix("data.").and_then(|n| n.parse::<usize>().ok());
        plain(number.and_then(|n| titles.get(n)).unwrap_or(name))
    };
    let is_data = |c: &usize| rows.iter().any(|row| row.get(*c).is_some_and(|cell| Kind::of(cell, false).is_data()));
    let mut order: Vec<usize> = (0..names.names.len()).collect();
    order.sort_by_cached_key(|c| !is_data(c));
    let has_names = names.names.iter().any(|name| !name.is_empty() && name.parse::<usize>().is_err());
    let mut made = Records { text: String::new(), has_names, bad: 0, first_bad: None };
    if has_names {
        made.put(&order, &names.names.iter().map(title).collect::<Vec<_>>());
    }
    for mut row in rows {
        row.resize(names.names.len(), String::new());
        made.put(&order, &row);
    }
    Ok(made)
}

/// Names of columns in the order in which they came.
#[derive(Default)]
struct Names {
    names: Vec<String>,
    places: HashMap<String, usize>,
}

impl Names {
    fn index(&mut self, name: &str) -> Result<usize, String> {
        if let Some(place) = self.places.get(name) {
            return Ok(*place);
        }
        if self.names.len() == MOST_COLUMNS {
            return Err(format!(
                "its records have more than {MOST_COLUMNS} names: make a CSV of those that are needed"
            ));
        }
        self.places.insert(name.to_owned(), self.names.len());
        self.names.push(name.to_owned());
        Ok(self.names.len() - 1)
    }
}

impl Records {
    fn put(&mut self, order: &[usize], cells: &[String]) {
        for (number, column) in order.iter().enumerate() {
            self.text.push_str(if number > 0 { "\t" } else { "" });
            self.text.push_str(&cells[*column]);
        }
        self.text.push('\n');
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn json(text: &str) -> (String, u64) {
        assert!(is_json(text.as_bytes()), "{text}");
        let made = of_json(text.as_bytes()).unwrap();
        (made.text, made.bad)
    }

    #[test]
    fn json_in_all_its_forms() {
        let table = "t\td\n0\t1.5\n0.1\t2\n";
        for text in [
            "{\"t\": 0, \"d\": 1.5}\n{\"t\": 0.1, \"d\": 2}\n",
            "{ \"t\": 0,\n \"d\": 1.5 }\n{ \"t\": 0.1,\n \"d\": 2 }",
            "[{\"t\": 0, \"d\": 1.5}, {\"t\": 0.1, \"d\": 2}]",
            "[\n {\"t\": 0, \"d\": 1.5},\n {\"t\": 0.1, \"d\": 2}\n]\n",
            "{\"t\": [0, 0.1], \"d\": [1.5, 2], \"rig\": \"A\"}",
            "{\"t\": {\"0\": 0, \"1\": 0.1}, \"d\": {\"0\": 1.5, \"1\": 2}}",
            "{\"columns\": [\"t\", \"d\"], \"index\": [], \"data\": [[0, 1.5], [0.1, 2]]}",
            "\u{feff}{\"t\": 0, \"d\": 1.5}\r\n{\"t\": 0.1, \"d\": 2}\r\n",
        ] {
            assert_eq!(json(text), (table.to_owned(), 0), "{text}");
        }
        assert_eq!(json("[[0, 1.5], [0.1, 2]]").0, "0\t1.5\n0.1\t2\n");
        assert_eq!(json("[[0, 1.5], [0.1, 2]]").0, json("{\"0\": 0, \"1\": 1.5}\n[0.1, 2]").0);
        assert_eq!(
            json("{\"t\": 0, \"d\": NaN}\n{\"t\": 1, \"note\": \"NaN, \\\"NaN\"}").0,
            "t\td\tnote\n0\tNaN\t\n1\t\t\"NaN, \"\"NaN\"\n"
        );
        for text in ["[10:15:00] 0.25, 3", "[0.1] 0.25", "{t} 0.1", "Time (s),Load (N)", ""] {
            assert!(!is_json(text.as_bytes()), "{text}");
        }
    }

    #[test]
    fn broken_records_are_counted() {
        let made = of_json(b"{\"t\": 0, \"d\": 1}\n{\"t\": 1, \"d\"\n{\"t\": 2, \"d\": 1}\n{\"t\": 3,").unwrap();
        assert_eq!((made.text.as_str(), made.bad), ("t\td\n0\t1\n2\t1\n", 2));
        assert_eq!(made.first_bad.as_deref(), Some("line 2: {\"t\": 1, \"d\""));
    }

    #[test]
    fn messages_of_several_topics_have_columns_of_their_own() {
        let lines = "{\"topic\": \"/a\", \"data\": {\"stamp\": {\"sec\": 1}, \"position\": [2]}}\n\
                     {\"topic\": \"/b\", \"data\": {\"stamp\": {\"sec\": 2}, \"position\": [3, 4]}}\n";
        let table = "data.stamp.sec\t/a.position.0\t/b.position.0\t/b.position.1\n1\t2\t\t\n2\t\t3\t4\n";
        assert_eq!(json(lines).0, table);
    }

    #[test]
    fn values_with_their_names() {
        let text = "t:0.1,force_N:0.25\nt:0.2,force_N:nan\n\nt:0.3,force_N:-1e-3\nt:0.4,for";
        assert!(is_labelled(text.as_bytes()) && is_labelled(b"t=1 F=2\nt=2 F=3\nt=3 F=4\n"));
        for text in ["Rate:1,Gain:2\nTime,Load\n0,1\n", "10:15,0.1\n10:16,0.2\n10:17,0.3\n", "t=1\nt=2\nt=3\n"] {
            assert!(!is_labelled(text.as_bytes()), "{text}");
        }
        let made = of_labelled(text.as_bytes()).unwrap();
        assert_eq!(made.text, "t\tforce_N\n0.1\t0.25\n0.2\tnan\n0.3\t-1e-3\n");
        assert_eq!((made.bad, made.first_bad.as_deref()), (1, Some("line 5: t:0.4,for")));
    }

    #[test]
    fn documents_of_an_echo() {
        let echo = "header:\n  stamp:\n    sec: 1\n    nanosec: 5\n  y: 1\nname:\n- insertion\nposition:\n- .nan\n---\n\
                    header:\n  stamp:\n    sec: 2\n    nanosec: 6\n  y: 1\nname:\n- insertion\nposition:\n- 0.25\n---\n";
        assert!(is_echo(echo.as_bytes()) && is_echo(b"data: 0.5\n---\ndata: 0.6\n---\n"));
        assert!(!is_echo(b"Time: 10\nOperator: me\n\nt,d\n") && !is_echo(b"Time (s),Load (N)\n---\n0,1\n"));
        let made = of_echo(echo.as_bytes()).unwrap();
        let names = "header.stamp.sec\theader.stamp.nanosec\theader.y\tposition.0\tname.0\n";
        assert_eq!(made.text, names.to_owned() + "1\t5\t1\tNaN\tinsertion\n2\t6\t1\t0.25\tinsertion\n");
    }
}
