//! Sheets of workbooks as text between tabs, and workbooks in XML as Excel 2003 and many instruments write them (SpreadsheetML), whether
//! they end in `.xml` or in `.xls`.

use super::super::TableLayout;
use super::encoding;
use super::layout::{LOOKED_AT, Layout};

/// Cells further to the right, and rows further down, are of no table.
const MOST_COLUMNS: usize = 16_384;
const MOST_ROWS: usize = 1 << 24;

/// A sheet as text.
pub(super) struct Sheet {
    pub name: String,
    pub text: String,
    /// What of the workbook is left out.
    pub notes: Vec<String>,
}

/// The sheet that was named, or the first with rows of numbers. `text` gives the first rows of a sheet.
///
/// # Errors
/// Why there is none, and what to do.
pub(super) fn choose(
    names: &[String],
    said: &TableLayout,
    mut text: impl FnMut(&str, usize) -> Result<String, String>,
) -> Result<Sheet, String> {
    let quoted = |names: &[String]| names.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
    let layout = TableLayout { separator: Some('\t'), block: None, ..said.clone() };
    let mut is_table = |name: &String| {
        let head = text(name, LOOKED_AT + 1);
        head.is_ok_and(|head| Layout::of(&head, &layout, LOOKED_AT).is_some_and(|layout| layout.has_rows()))
    };
    let (name, others) = match &said.sheet {
        Some(wanted) => {
            let found = names.iter().find(|name| *name == wanted);
            let found = found.or_else(|| names.iter().find(|name| name.eq_ignore_ascii_case(wanted.trim())));
            (found.ok_or_else(|| format!("--sheet {wanted}: it has no such sheet, but {}", quoted(names)))?, Vec::new())
        }
        None => {
            let mut tables = names.iter().filter(|name| is_table(name));
            let first = tables.next();
            let missing = || {
                format!(
                    "no sheet has rows of numbers in its first {LOOKED_AT} rows (sheets: {}): name one with --sheet, and the row of its \
                     headers with --header-line",
                    quoted(names)
                )
            };
            (first.ok_or_else(missing)?, tables.cloned().collect::<Vec<String>>())
        }
    };
    let text = text(name, usize::MAX)?;
    let note = format!("sheet `{name}` is taken; {} hold numbers as well: --sheet takes another", quoted(&others));
    Ok(Sheet { name: name.clone(), text, notes: Some(note).filter(|_| !others.is_empty()).into_iter().collect() })
}

/// A text as one cell.
pub(super) fn plain(text: &str) -> String {
    let text = text.replace(['\t', '\n', '\r'], " ");
    if text.contains('"') { format!("\"{}\"", text.replace('"', "\"\"")) } else { text }
}

/// Whether bytes begin a workbook in XML.
pub(super) fn is_workbook(start: &[u8]) -> bool {
    let wide = start.starts_with(&[0xff, 0xfe]) || start.starts_with(&[0xfe, 0xff]);
    let text: String = start.iter().filter(|b| !wide || **b != 0).map(|b| *b as char).collect();
    text.contains("urn:schemas-microsoft-com:office:spreadsheet") && text.contains("Workbook")
}

/// A sheet of a workbook in XML, chosen as [`choose`] does.
///
/// # Errors
/// As [`choose`].
pub(super) fn read(bytes: &[u8], said: &TableLayout) -> Result<Sheet, String> {
    let (encoding, mark) = encoding::of(&mut &*bytes).map_err(|e| e.to_string())?;
    let text = encoding.decode_without_bom_handling(&bytes[mark..]).0;
    let sheets = sheets(&text)?;
    let names: Vec<String> = sheets.iter().map(|sheet| sheet.name.clone()).collect();
    choose(&names, said, |name, _| {
        let found = sheets.iter().find(|sheet| sheet.name == name);
        Ok(found.map_or_else(String::new, |sheet| sheet.text.clone()))
    })
}

/// All sheets. Rows and cells keep their places.
fn sheets(text: &str) -> Result<Vec<Sheet>, String> {
    let mut sheets: Vec<Sheet> = Vec::new();
    // numbers of the row and of the cell that come next, from 0, and what the open cell holds
    let (mut row, mut column, mut open) = (0, 0, None::<Cell>);
    let (mut rows, mut columns) = (0, 0);
    for (tag, behind) in Tags(text) {
        if let Some(cell) = open.as_mut().filter(|cell| cell.is_data && !tag.ends("Data")) {
            // marks of type within a text
            cell.text.push_str(behind);
            continue;
        }
        let sheet = sheets.last_mut();
        match (tag.name, sheet) {
            ("Worksheet", _) if !tag.closes => {
                let name = tag.attribute("Name").map(|name| unescaped(&name)).unwrap_or_default();
                sheets.push(Sheet { name, text: String::new(), notes: Vec::new() });
                (row, rows) = (0, 0);
            }
            ("Row", Some(sheet)) if !tag.closes => {
                row = tag.number("Index").map_or(row, |index| index.saturating_sub(1)).max(rows);
                if row > MOST_ROWS {
                    return Err(format!("sheet `{}` goes beyond row {MOST_ROWS}: save it as CSV", sheet.name));
                }
                sheet.text.extend(std::iter::repeat_n('\n', row - rows));
                (rows, row, column, columns) = (row, row + tag.number("Span").map_or(1, |more| more + 1), 0, 0);
            }
            ("Cell", Some(_)) if !tag.closes => {
                column = tag.number("Index").map_or(column, |index| index.saturating_sub(1)).max(columns);
                let across = tag.number("MergeAcross").unwrap_or(0).min(MOST_COLUMNS);
                open = (!tag.is_empty).then(Cell::default);
                if column < MOST_COLUMNS && open.is_some() {
                    open.iter_mut().for_each(|cell| cell.column = column);
                }
                column += 1 + across;
            }
            ("Data", Some(_)) if !tag.closes => {
                // of a comment within the cell
                if let Some(cell) = open.as_mut().filter(|cell| !cell.has_data) {
                    cell.has_data = true;
                    (cell.is_data, cell.kind) = (!tag.is_empty, tag.attribute("Type").unwrap_or_default());
                    cell.text.push_str(if tag.is_empty { "" } else { behind });
                }
            }
            ("Data", _) => open.iter_mut().for_each(|cell| cell.is_data = false),
            ("Cell", Some(sheet)) => {
                if let Some(cell) = open.take().filter(|cell| cell.column >= columns) {
                    sheet.text.extend(std::iter::repeat_n('\t', cell.column - columns));
                    columns = cell.column;
                    sheet.text.push_str(&cell.written());
                }
            }
            _ => {}
        }
    }
    sheets.iter_mut().for_each(|sheet| sheet.text.push('\n'));
    Ok(sheets)
}

/// A cell that is being read.
#[derive(Default)]
struct Cell {
    column: usize,
    kind: String,
    text: String,
    /// Whether its data have begun, and whether they have not ended.
    has_data: bool,
    is_data: bool,
}

impl Cell {
    fn written(&self) -> String {
        let text = unescaped(&self.text);
        let text = text.trim();
        match self.kind.as_str() {
            // its mark `#` would make a comment of the row
            "Error" => format!("error {text}"),
            // a time of day has the day from which Excel counts
            "DateTime" => {
                let of_day =
                    ["1899-12-31T", "1899-12-30T", "1904-01-01T"].iter().find_map(|day| text.strip_prefix(day));
                of_day.unwrap_or(text).to_owned()
            }
            _ => plain(text),
        }
    }
}

/// A tag.
struct Tag<'a> {
    /// Its name without its namespace.
    name: &'a str,
    attributes: &'a str,
    closes: bool,
    is_empty: bool,
}

impl Tag<'_> {
    fn ends(&self, name: &str) -> bool {
        self.closes && self.name == name
    }

    /// An attribute, whatever its namespace.
    fn attribute(&self, name: &str) -> Option<String> {
        let mut rest = self.attributes;
        loop {
            let (key, value) = rest.split_once('=')?;
            let value = value.trim_start();
            let mark = value.chars().next().filter(|c| ['"', '\''].contains(c))?;
            let (value, behind) = value[1..].split_once(mark)?;
            if key.trim().rsplit(':').next() == Some(name) {
                return Some(value.to_owned());
            }
            rest = behind;
        }
    }

    fn number(&self, name: &str) -> Option<usize> {
        self.attribute(name)?.trim().parse().ok()
    }
}

/// The tags of a text, each with the text from it to the next one.
struct Tags<'a>(&'a str);

impl<'a> Iterator for Tags<'a> {
    type Item = (Tag<'a>, &'a str);

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let rest = &self.0[self.0.find('<')?..];
            let hidden = [("<!--", "-->"), ("<?", "?>"), ("<![CDATA[", "]]>")];
            if let Some((_, end)) = hidden.iter().find(|(begin, _)| rest.starts_with(begin)) {
                self.0 = &rest[rest.find(end)? + end.len()..];
                continue;
            }
            let end = rest.find('>')?;
            let inner = &rest[1..end];
            let behind = &rest[end + 1..];
            self.0 = behind;
            let (closes, is_empty) = (inner.starts_with('/'), inner.ends_with('/'));
            let inner = inner.trim_matches('/');
            let (name, attributes) = inner.split_once(char::is_whitespace).unwrap_or((inner, ""));
            let name = name.rsplit(':').next().unwrap_or(name);
            return Some((
                Tag { name, attributes, closes, is_empty },
                &behind[..behind.find('<').unwrap_or(behind.len())],
            ));
        }
    }
}

/// A text without the marks of XML.
fn unescaped(text: &str) -> String {
    let (mut out, mut rest) = (String::new(), text);
    while let Some((before, behind)) = rest.split_once('&') {
        out.push_str(before);
        let found = behind.split_once(';').and_then(|(name, behind)| {
            let c = match name {
                "lt" => '<',
                "gt" => '>',
                "amp" => '&',
                "quot" => '"',
                "apos" => '\'',
                _ => {
                    let digits = name.strip_prefix('#')?;
                    let hex = digits.strip_prefix('x').map(|digits| u32::from_str_radix(digits, 16));
                    char::from_u32(hex.unwrap_or_else(|| digits.parse()).ok()?)?
                }
            };
            Some((c, behind))
        });
        out.push(found.map_or('&', |(c, _)| c));
        rest = found.map_or(behind, |(_, behind)| behind);
    }
    out + rest
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn rows_and_cells_keep_their_places() {
        let book = r#"<?xml version="1.0"?><?mso-application progid="Excel.Sheet"?>
            <Workbook xmlns="urn:schemas-microsoft-com:office:spreadsheet" xmlns:ss="urn:schemas-microsoft-com:office:spreadsheet">
            <Worksheet ss:Name="Gel &amp; 7"><Table ss:ExpandedColumnCount="4"><Column ss:Width="80"/>
            <Row><Cell ss:MergeAcross="1"><Data ss:Type="String">Time &lt;s&gt;</Data></Cell><Cell><Data ss:Type="String">N</Data></Cell></Row>
            <Row ss:Index="4" ss:Height="12"><Cell ss:Index="2"><Data ss:Type="Number">1.0000000000000001E-4</Data><Comment><Data>no</Data></Comment></Cell>
            <Cell/><ss:Cell><ss:Data ss:Type="DateTime">1899-12-31T10:15:00.250</ss:Data></ss:Cell></Row>
            <Row><Cell><ss:Data ss:Type="String" xmlns="http://www.w3.org/TR/REC-html40">a<B>b</B>&#181;</ss:Data></Cell>
            <Cell><Data ss:Type="Error">#DIV/0!</Data></Cell></Row></Table></Worksheet>
            <ss:Worksheet ss:Name='B'><Table/></ss:Worksheet></Workbook>"#;
        assert!(is_workbook(book.as_bytes()));
        let made = sheets(book).unwrap();
        assert_eq!((made[0].name.as_str(), made[1].name.as_str(), made.len()), ("Gel & 7", "B", 2));
        let rows = "Time <s>\t\tN\n\n\n\t1.0000000000000001E-4\t\t10:15:00.250\nabµ\terror #DIV/0!\n";
        assert_eq!(made[0].text, rows);
        assert!(
            sheets("<Worksheet ss:Name=\"A\"><Row ss:Index=\"99999999999\"/>").is_err_and(|e| e.contains("as CSV"))
        );
    }
}
