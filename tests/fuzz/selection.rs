// What a user says of a recording, in front of the recording: shared by the fuzz targets of bags and tables.

use needle_estimate::batch::Entry;
use needle_recording::Selection;

/// Options as TOML stand before a line `---`, the recording behind it; without the line all is recording. Options that are none
/// count as none said.
pub fn split(data: &[u8]) -> (Selection, &[u8]) {
    const LINE: &[u8] = b"\n---\n";
    let Some(at) = data.windows(LINE.len()).take(4096).position(|w| w == LINE) else {
        return (Selection::default(), data);
    };
    (said(&String::from_utf8_lossy(&data[..at])).unwrap_or_default(), &data[at + LINE.len()..])
}

/// A manifest's entry, and what only the command line has: `pose`, `markers`, `comment`.
fn said(text: &str) -> Option<Selection> {
    let mut table: toml::Table = text.parse().ok()?;
    let mut words = |key: &str| -> Vec<String> {
        let list = table.remove(key).and_then(|value| value.try_into().ok());
        list.unwrap_or_default()
    };
    let (pose, markers, comment) = (words("pose"), words("markers"), words("comment"));
    let mut said = table.try_into::<Entry>().ok()?.selection();
    said.pose = pose.try_into().ok();
    said.markers = markers;
    said.layout.comment = comment.first().cloned();
    Some(said)
}
