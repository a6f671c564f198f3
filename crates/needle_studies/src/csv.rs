//! Tables of a study as CSV (RFC 4180). A row is a struct; its columns are the struct's fields.

use serde::Serialize;
use serde::de::DeserializeOwned;

/// The records with a heading of their fields' names.
#[must_use]
pub(crate) fn write<R: Serialize>(records: impl IntoIterator<Item = R>) -> String {
    text(true, records)
}

/// One record as a line with its end, to be appended to a table.
#[must_use]
pub(crate) fn line<R: Serialize>(record: R) -> String {
    text(false, [record])
}

fn text<R: Serialize>(heading: bool, records: impl IntoIterator<Item = R>) -> String {
    let mut writer = csv::WriterBuilder::new().has_headers(heading).from_writer(Vec::new());
    for record in records {
        // Writing flat structs of numbers and text to memory can't fail.
        let _ = writer.serialize(record);
    }
    String::from_utf8(writer.into_inner().unwrap_or_default()).unwrap_or_default()
}

/// The records of a table with its heading; columns are found by name.
pub(crate) fn read<R: DeserializeOwned>(table: &str) -> impl Iterator<Item = Result<R, csv::Error>> + use<'_, R> {
    csv::Reader::from_reader(table.as_bytes()).into_deserialize()
}
