//! Arrays of NumPy (`.npy`, `.npz`) as columns. The format is that of `numpy.lib.format`, versions 1 to 3.
//!
//! The numbers stay as they lie in the file, and become text row by row as they are read.

use std::fmt::Write as _;
use std::io::{self, Cursor, Read};
use std::rc::Rc;

use zip::ZipArchive;

/// More bytes of an archive are not unpacked: a small file can hold any number.
const MOST_BYTES: u64 = 1 << 31;
/// Rows of which text is made at once.
const ROWS: usize = 1024;
/// The number that stands for no time.
const NOT_A_TIME: i64 = i64::MIN;

/// Columns of one length.
pub(super) struct Arrays {
    columns: Vec<Column>,
    named: bool,
    rows: usize,
    /// What was left out.
    pub notes: Vec<String>,
    /// Next row, and what was made of the rows before.
    row: usize,
    made: Cursor<Vec<u8>>,
}

/// Cells of one column within the bytes of an array.
#[derive(Clone)]
struct Column {
    name: String,
    bytes: Rc<Vec<u8>>,
    kind: Kind,
    /// Byte of the first cell, and bytes from a cell to the next.
    first: usize,
    stride: usize,
    rows: usize,
}

/// A type of NumPy that is a number, a time or a text.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Kind {
    /// `f`, `i`, `u`, `b`, `M` (a time), `m` (a duration), `U`, `S`.
    letter: char,
    /// Bytes of one.
    size: usize,
    big_endian: bool,
    /// Of a time.
    unit: Option<&'static str>,
}

/// What stands in the head of an array.
struct Head {
    fields: Vec<Field>,
    fortran_order: bool,
    shape: Vec<usize>,
    /// Bytes of one element, and of the head.
    size: usize,
    length: usize,
}

/// A part of an element: the whole of it, without a name, where it is one number.
struct Field {
    name: Option<String>,
    /// The type, or as it is written where it is none of numbers.
    kind: Result<Kind, String>,
    first: usize,
    count: usize,
}

/// What a literal of Python holds.
#[derive(Debug, PartialEq)]
enum Literal {
    Text(String),
    Number(usize),
    Truth(bool),
    List(Vec<Literal>),
}

/// Reads the literals that stand in heads: texts, whole numbers, truth values, tuples, lists, and dictionaries as lists of keys and values.
struct Parser<'a>(&'a str);

impl Parser<'_> {
    fn blanks(&mut self) {
        self.0 = self.0.trim_start();
    }

    fn next(&mut self, mark: char) -> bool {
        self.blanks();
        let rest = self.0.strip_prefix(mark);
        self.0 = rest.unwrap_or(self.0);
        rest.is_some()
    }

    /// `deep`: how many lists it may stand in.
    fn literal(&mut self, deep: usize) -> Option<Literal> {
        self.blanks();
        let first = self.0.chars().next()?;
        match first {
            '\'' | '"' => {
                let (text, rest) = self.0[1..].split_once(first)?;
                self.0 = rest;
                Some(Literal::Text(text.to_owned()))
            }
            '0'..='9' => {
                let end = self.0.find(|c: char| !c.is_ascii_digit()).unwrap_or(self.0.len());
                let number = self.0[..end].parse().ok()?;
                // whole numbers of Python 2 end so
                self.0 = self.0[end..].trim_start_matches('L');
                Some(Literal::Number(number))
            }
            'T' | 'F' => {
                let word = if first == 'T' { "True" } else { "False" };
                self.0 = self.0.strip_prefix(word)?;
                Some(Literal::Truth(first == 'T'))
            }
            '(' | '[' | '{' => {
                let deep = deep.checked_sub(1)?;
                self.next(first);
                let end = match first {
                    '(' => ')',
                    '[' => ']',
                    _ => '}',
                };
                let mut all = Vec::new();
                while !self.next(end) {
                    all.push(self.literal(deep)?);
                    if !self.next(',') && !self.next(':') && !self.0.starts_with(end) {
                        return None;
                    }
                }
                Some(Literal::List(all))
            }
            _ => None,
        }
    }
}

impl Kind {
    /// Of a type as `<f8`.
    fn of(text: &str) -> Option<Self> {
        let order = text.chars().next()?;
        let text = text.trim_start_matches(['<', '>', '|', '=']);
        let letter = text.chars().next()?;
        let end = text.find('[').unwrap_or(text.len());
        let size: usize = text.get(1..end)?.parse().ok()?;
        let fits = match letter {
            'f' => matches!(size, 2 | 4 | 8),
            'i' | 'u' => matches!(size, 1 | 2 | 4 | 8),
            'b' => size == 1,
            'M' | 'm' => size == 8,
            'U' | 'S' => (1..=4096).contains(&size),
            _ => false,
        };
        let unit = match text.get(end..)? {
            "" => None,
            unit => Some(["s", "ms", "us", "ns"].into_iter().find(|of| unit == format!("[{of}]"))?),
        };
        let fits = fits && unit.is_some() == matches!(letter, 'M' | 'm');
        let size = if letter == 'U' { 4 * size } else { size };
        fits.then_some(Self { letter, size, big_endian: order == '>', unit })
    }

    fn bytes<const N: usize>(self, cell: &[u8]) -> [u8; N] {
        let mut bytes = [0; N];
        bytes[..cell.len().min(N)].copy_from_slice(&cell[..cell.len().min(N)]);
        if self.big_endian {
            bytes.reverse();
        }
        bytes
    }

    fn whole(self, cell: &[u8]) -> i64 {
        match self.size {
            1 => i64::from(i8::from_le_bytes(self.bytes(cell))),
            2 => i64::from(i16::from_le_bytes(self.bytes(cell))),
            4 => i64::from(i32::from_le_bytes(self.bytes(cell))),
            _ => i64::from_le_bytes(self.bytes(cell)),
        }
    }

    fn write(self, cell: &[u8], out: &mut String) {
        // a String takes anything
        let _ = match (self.letter, self.size) {
            ('f', 8) => write!(out, "{}", f64::from_le_bytes(self.bytes(cell))),
            ('f', 4) => write!(out, "{}", f64::from(f32::from_le_bytes(self.bytes(cell)))),
            ('f', _) => write!(out, "{}", half(u16::from_le_bytes(self.bytes(cell)))),
            ('u', 1) => write!(out, "{}", cell.first().copied().unwrap_or(0)),
            ('u', 2) => write!(out, "{}", u16::from_le_bytes(self.bytes(cell))),
            ('u', 4) => write!(out, "{}", u32::from_le_bytes(self.bytes(cell))),
            ('u', _) => write!(out, "{}", u64::from_le_bytes(self.bytes(cell))),
            ('b', _) => write!(out, "{}", u8::from(cell.first().is_some_and(|byte| *byte != 0))),
            ('M' | 'm', _) if self.whole(cell) == NOT_A_TIME => Ok(()),
            ('U', _) => {
                let letters = cell.chunks_exact(4).map(|one| u32::from_le_bytes(self.bytes(one)));
                let text: String = letters.filter(|c| *c != 0).filter_map(char::from_u32).collect();
                write!(out, "{}", plain(&text))
            }
            ('S', _) => write!(out, "{}", plain(String::from_utf8_lossy(cell).trim_end_matches('\0'))),
            _ => write!(out, "{}", self.whole(cell)),
        };
    }
}

/// A text that is one cell.
fn plain(text: &str) -> String {
    text.replace(['\t', '\n', '\r'], " ")
}

/// A number of 16 bits: sign, 5 bits of exponent, 10 of fraction.
fn half(bits: u16) -> f64 {
    let (sign, exponent, fraction) = (bits >> 15, i32::from(bits >> 10 & 31), f64::from(bits & 1023));
    let size = match exponent {
        0 => fraction * 2_f64.powi(-24),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        _ => (1.0 + fraction / 1024.0) * 2_f64.powi(exponent - 15),
    };
    if sign == 0 { size } else { -size }
}

impl Head {
    fn of(bytes: &[u8]) -> Result<Self, String> {
        let no_array = || "it is no array of NumPy, or is cut off in its head".to_owned();
        let rest = bytes.strip_prefix(b"\x93NUMPY").ok_or_else(no_array)?;
        let (length, from): (usize, usize) = match rest {
            [1, _, a, b, ..] => (usize::from(u16::from_le_bytes([*a, *b])), 10),
            [2 | 3, _, a, b, c, d, ..] => (u32::from_le_bytes([*a, *b, *c, *d]) as usize, 12),
            _ => return Err(no_array()),
        };
        let text = from.checked_add(length).and_then(|end| bytes.get(from..end)).ok_or_else(no_array)?;
        let Some(Literal::List(entries)) = Parser(&String::from_utf8_lossy(text)).literal(16) else {
            return Err("its head is not one of NumPy".to_owned());
        };
        let entry = |key: &str| {
            let mut pairs = entries.chunks_exact(2);
            pairs.find(|pair| pair[0] == Literal::Text(key.to_owned())).map(|pair| &pair[1])
        };
        let (Some(Literal::Truth(fortran_order)), Some(Literal::List(shape))) =
            (entry("fortran_order"), entry("shape"))
        else {
            return Err("its head has no shape".to_owned());
        };
        let shape = shape.iter().map(|n| if let Literal::Number(n) = n { Some(*n) } else { None });
        let shape: Vec<usize> = shape.collect::<Option<_>>().ok_or("its shape is not of numbers")?;
        let (fields, size) = fields(entry("descr")).ok_or("its type is none that is known")?;
        Ok(Self { fields, fortran_order: *fortran_order, shape, size, length: from + length })
    }

    /// Bytes of head and elements, where that is a number.
    fn all_bytes(&self) -> Option<usize> {
        let count = self.shape.iter().try_fold(1_usize, |n, of| n.checked_mul(*of))?;
        count.checked_mul(self.size)?.checked_add(self.length)
    }
}

/// Parts of an element, and its bytes.
fn fields(of: Option<&Literal>) -> Option<(Vec<Field>, usize)> {
    match of? {
        Literal::Text(text) => {
            let kind = Kind::of(text).ok_or_else(|| text.clone());
            let size = kind.as_ref().map_or(0, |kind| kind.size);
            Some((vec![Field { name: None, kind, first: 0, count: 1 }], size))
        }
        Literal::List(parts) => {
            let (mut all, mut at) = (Vec::new(), 0_usize);
            for part in parts {
                let Literal::List(part) = part else { return None };
                let (name, kind, shape) = match &part[..] {
                    [name, Literal::Text(kind)] => (name, kind, &[][..]),
                    [name, Literal::Text(kind), Literal::List(shape)] => (name, kind, &shape[..]),
                    _ => return None,
                };
                let name = match name {
                    Literal::Text(name) => name,
                    // a title and a name
                    Literal::List(names) => {
                        names.iter().find_map(|n| if let Literal::Text(n) = n { Some(n) } else { None })?
                    }
                    _ => return None,
                };
                let count = shape.iter().try_fold(1_usize, |n, of| match of {
                    Literal::Number(of) => n.checked_mul(*of),
                    _ => None,
                })?;
                let known = Kind::of(kind);
                // where the next one begins must be known
                let size = known.map_or_else(|| bytes_of_unknown(kind), |kind| Some(kind.size))?;
                let size = count.checked_mul(size)?;
                if !name.is_empty() {
                    all.push(Field {
                        name: Some(name.clone()),
                        kind: known.ok_or_else(|| kind.clone()),
                        first: at,
                        count,
                    });
                }
                at = at.checked_add(size)?;
            }
            Some((all, at))
        }
        _ => None,
    }
}

/// Bytes of a type whose values are not read.
fn bytes_of_unknown(kind: &str) -> Option<usize> {
    let kind = kind.trim_start_matches(['<', '>', '|', '=']);
    let digits: String = kind.get(1..)?.chars().take_while(char::is_ascii_digit).collect();
    let size: usize = digits.parse().ok()?;
    match kind.chars().next()? {
        'V' | 'c' | 'f' | 'S' | 'M' | 'm' => Some(size),
        'U' => size.checked_mul(4),
        'O' => Some(8),
        _ => None,
    }
}

/// Columns of one array. `name`: of the array in an archive.
fn columns(bytes: Vec<u8>, name: Option<&str>, notes: &mut Vec<String>) -> Result<Vec<Column>, String> {
    let head = Head::of(&bytes)?;
    let shape = &head.shape;
    let (rows, width) = match shape[..] {
        [rows] => (rows, 1),
        [rows, width] => (rows, width),
        _ => return Err(format!("its shape {shape:?} is not that of a table, (rows, columns)")),
    };
    if rows < width {
        return Err(format!(
            "its shape ({rows}, {width}) has more columns than rows: a row is a reading, a column a quantity. \
             Save the transpose: numpy.save(FILE, numpy.load(FILE).T)"
        ));
    }
    if let Some(Err(kind)) = head.fields.first().filter(|f| f.name.is_none()).map(|f| &f.kind) {
        return Err(format!("its type {kind} is none of numbers: save it as float64"));
    }
    let needed = head.all_bytes().ok_or("its shape is larger than any file")?;
    if bytes.len() < needed {
        return Err(format!("it is cut off: {} bytes are there of {needed}", bytes.len()));
    }
    let bytes = Rc::new(bytes);
    let mut all = Vec::new();
    for k in 0..width {
        for field in &head.fields {
            let kind = match &field.kind {
                Ok(kind) => *kind,
                Err(kind) => {
                    if k == 0 {
                        notes.push(format!(
                            "`{}` is of type {kind}, no number: left out",
                            field.name.as_deref().unwrap_or_default()
                        ));
                    }
                    continue;
                }
            };
            let (start, stride) =
                if head.fortran_order { (k * rows * head.size, head.size) } else { (k * head.size, width * head.size) };
            for i in 0..field.count {
                let mut name = field.name.as_deref().or(name).unwrap_or_default().to_owned();
                let number = |n: usize, of: usize| if of > 1 { format!("_{}", n + 1) } else { String::new() };
                name += &(number(k, width) + &number(i, field.count));
                if let Some(unit) = kind.unit {
                    name += &format!(" ({unit})");
                }
                let first = head.length + start + field.first + i * kind.size;
                all.push(Column { name: plain(&name), bytes: Rc::clone(&bytes), kind, first, stride, rows });
            }
        }
    }
    Ok(all)
}

/// The columns of an `.npy`: by number of a plain array, by name of one with fields.
///
/// # Errors
/// Why it is no table, and what to do.
pub(super) fn array(bytes: Vec<u8>) -> Result<Arrays, String> {
    let mut notes = Vec::new();
    let columns = columns(bytes, None, &mut notes)?;
    match columns[..] {
        [] => Err("it has no column of numbers".to_owned()),
        [_] => Err("it is one column: a recording needs position and force, or a time and one of them, \
                    as numpy.save(FILE, numpy.column_stack([time, position, force])) writes them"
            .to_owned()),
        _ => Ok(Arrays::new(columns, notes)),
    }
}

/// The columns of an `.npz`: its arrays of one length by their names.
///
/// # Errors
/// Why it is no table, and what to do.
pub(super) fn archive(bytes: Vec<u8>) -> Result<Arrays, String> {
    let broken = |e: zip::result::ZipError| format!("it is no archive of NumPy, or is cut off ({e})");
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(broken)?;
    let (mut all, mut notes, mut unpacked) = (Vec::new(), Vec::new(), 0_u64);
    for number in 0..archive.len() {
        let mut file = archive.by_index(number).map_err(broken)?;
        let name = file.name().to_owned();
        let Some(name) = name.strip_suffix(".npy") else { continue };
        let mut bytes = Vec::new();
        // what it says of its size may be wrong
        let (left, said) = (MOST_BYTES - unpacked, file.size());
        let length = if said > left { Ok(0) } else { file.by_ref().take(left + 1).read_to_end(&mut bytes) };
        unpacked += length.map_err(|e| format!("its array `{name}` can't be unpacked: {e}"))? as u64;
        if said > left || unpacked > MOST_BYTES {
            return Err("it holds more than 2 GiB: save it as CSV, which is read piece by piece".to_owned());
        }
        match columns(bytes, Some(name), &mut notes) {
            Ok(columns) => all.extend(columns),
            Err(why) => notes.push(format!("array `{name}` is left out: {why}")),
        }
    }
    // the length that most columns have; single numbers are none
    let lengths = |columns: &[Column]| columns.iter().map(|c| c.rows).filter(|rows| *rows > 1).collect::<Vec<_>>();
    let all_lengths = lengths(&all);
    let count = |rows: usize| all_lengths.iter().filter(|of| **of == rows).count();
    let most = all_lengths.iter().copied().max_by_key(|rows| (count(*rows), *rows));
    let rows = most.filter(|rows| count(*rows) > 1);
    let rows = rows.ok_or_else(|| {
        let each = all.iter().map(|c| format!("`{}` {}", c.name, c.rows)).collect::<Vec<_>>().join(", ");
        format!("no two of its arrays have one length, so they are no table (lengths: {each}){}", listed(&notes))
    })?;
    if let Some(other) = all_lengths.iter().find(|of| **of != rows && count(**of) >= 2) {
        return Err(format!(
            "its arrays are of two tables, with {rows} and {other} rows ({}): save each as a file of its own and give the force's with \
             --force-file",
            all.iter().map(|c| format!("`{}` {}", c.name, c.rows)).collect::<Vec<_>>().join(", ")
        ));
    }
    let (columns, rest): (Vec<Column>, Vec<Column>) = all.into_iter().partition(|c| c.rows == rows);
    notes.extend(rest.iter().map(|c| format!("array `{}` has {} numbers, not {rows}: left out", c.name, c.rows)));
    Ok(Arrays::new(columns, notes))
}

fn listed(notes: &[String]) -> String {
    notes.iter().map(|note| format!("; {note}")).collect()
}

impl Arrays {
    fn new(columns: Vec<Column>, notes: Vec<String>) -> Self {
        let named = columns.iter().any(|c| !c.name.is_empty() && !c.name.starts_with('_'));
        let rows = columns.first().map_or(0, |c| c.rows);
        let names: Vec<&str> = columns.iter().map(|c| c.name.as_str()).collect();
        let head = if named { names.join("\t") + "\n" } else { String::new() };
        Self { named, rows, notes, row: 0, made: Cursor::new(head.into_bytes()), columns }
    }

    /// Whether its first line has the names of the columns.
    pub(crate) const fn has_names(&self) -> bool {
        self.named
    }
}

impl Read for Arrays {
    fn read(&mut self, to: &mut [u8]) -> io::Result<usize> {
        if self.made.position() == self.made.get_ref().len() as u64 {
            let mut text = String::new();
            let end = (self.row + ROWS).min(self.rows);
            for row in self.row..end {
                for (k, column) in self.columns.iter().enumerate() {
                    if k > 0 {
                        text.push('\t');
                    }
                    let at = column.first + row * column.stride;
                    column.kind.write(column.bytes.get(at..at + column.kind.size).unwrap_or_default(), &mut text);
                }
                text.push('\n');
            }
            self.row = end;
            self.made = Cursor::new(text.into_bytes());
        }
        self.made.read(to)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::panic)]
    use super::*;

    fn npy(head: &str, data: &[u8]) -> Vec<u8> {
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((head.len() as u16).to_le_bytes());
        bytes.extend(head.as_bytes());
        bytes.extend(data);
        bytes
    }

    fn text(mut arrays: Arrays) -> String {
        let mut text = String::new();
        arrays.read_to_string(&mut text).unwrap();
        text
    }

    fn head(kind: &str, fortran: &str, shape: &str) -> String {
        format!("{{'descr': {kind}, 'fortran_order': {fortran}, 'shape': {shape}, }}\n")
    }

    #[test]
    fn arrays_of_any_order_and_type() {
        let numbers = |all: &[f64]| all.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
        let rows = array(npy(&head("'<f8'", "False", "(3, 2)"), &numbers(&[0.0, 1.5, 1.0, 2.5, 2.0, -1e-9]))).unwrap();
        assert!(!rows.has_names());
        assert_eq!(text(rows), "0\t1.5\n1\t2.5\n2\t-0.000000001\n");
        let columns = array(npy(&head("'<f8'", "True", "(3, 2)"), &numbers(&[0.0, 1.0, 2.0, 1.5, 2.5, -1.0]))).unwrap();
        assert_eq!(text(columns), "0\t1.5\n1\t2.5\n2\t-1\n");
        let big: Vec<u8> = [1_i16, -2, 300, 4].iter().flat_map(|x| x.to_be_bytes()).collect();
        assert_eq!(text(array(npy(&head("'>i2'", "False", "(2, 2)"), &big)).unwrap()), "1\t-2\n300\t4\n");
        let halves: Vec<u8> = [0x3c00_u16, 0xc500, 0x0001, 0x7c00].iter().flat_map(|x| x.to_le_bytes()).collect();
        let read = text(array(npy(&head("'<f2'", "False", "(2, 2)"), &halves)).unwrap());
        assert_eq!(read, "1\t-5\n0.00000005960464477539063\tinf\n");
    }

    #[test]
    fn fields_are_columns_by_name() {
        let kind = "[('t', '<M8[ms]'), ('name', '<U2'), ('d', '>f4'), ('F', '<f8', (3,)), ('x', '<c8')]";
        let row = |t: i64| -> Vec<u8> {
            let mut row = t.to_le_bytes().to_vec();
            row.extend(['a', '\0'].iter().flat_map(|c| u32::from(*c).to_le_bytes()));
            row.extend(0.5_f32.to_be_bytes());
            row.extend([1.0_f64, 2.0, 3.0].iter().flat_map(|x| x.to_le_bytes()));
            row.extend([0; 8]);
            row
        };
        let read = array(npy(&head(kind, "False", "(2,)"), &[row(7), row(i64::MIN)].concat())).unwrap();
        assert_eq!(read.notes, ["`x` is of type <c8, no number: left out"]);
        assert_eq!(text(read), "t (ms)\tname\td\tF_1\tF_2\tF_3\n7\ta\t0.5\t1\t2\t3\n\ta\t0.5\t1\t2\t3\n");
    }

    #[test]
    fn what_is_no_table_says_why() {
        for (bytes, words) in [
            (npy(&head("'<f8'", "False", "(2, 9)"), &[0; 144]), ".T)"),
            (npy(&head("'<f8'", "False", "(9, 2)"), &[0; 14]), "cut off: "),
            (npy(&head("'|O'", "False", "(9, 2)"), &[0; 14]), "float64"),
            (npy(&head("'<f8'", "False", "(9,)"), &[0; 72]), "column_stack"),
            (npy(&head("'<f8'", "False", "(99999999999999999999, 2)"), &[]), "head"),
            (npy(&head("'<f8'", "False", "(9999999999999999, 999999999999999)"), &[]), "larger than any file"),
            (npy(&head("'<f8'", "False", "(3, 3, 3)"), &[0; 216]), "not that of a table"),
            (npy(&"[".repeat(60_000), &[]), "head"),
            (b"PK".to_vec(), "no array of NumPy"),
        ] {
            let Err(why) = array(bytes) else { panic!("{words}") };
            assert!(why.contains(words), "{why}");
        }
        assert!(archive(b"PK".to_vec()).is_err_and(|why| why.contains("no archive of NumPy")));
    }
}
