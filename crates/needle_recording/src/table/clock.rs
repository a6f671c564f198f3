//! Times in a table as text: dates, times of day, whole seconds with nanoseconds in another column.

use chrono::{DateTime, NaiveDate, NaiveTime, Timelike as _};

/// Date formats. If two fit, the one with the smaller span of times is used.
const DATES: [&str; 14] = [
    "%Y-%m-%d",
    "%Y/%m/%d",
    "%Y.%m.%d",
    "%d.%m.%Y",
    "%m/%d/%Y",
    "%d/%m/%Y",
    "%d-%m-%Y",
    "%d-%b-%Y",
    "%d %b %Y",
    "%Y年%m月%d日",
    "%d.%m.%y",
    "%m/%d/%y",
    "%d/%m/%y",
    "%Y%m%d",
];
const DAY_NS: i64 = 86_400_000_000_000;

/// How the cells of a time column are read.
#[derive(Clone, Debug, PartialEq)]
pub enum Clock {
    /// Numbers, with a unit.
    Number,
    /// Whole seconds, with nanoseconds in another column (from 0).
    Nanoseconds(usize),
    /// A date of this format and the time of day in one cell.
    DateTime(&'static str),
    /// The time of day.
    TimeOfDay,
    /// A date of this format in one column and the time of day in another (both from 0).
    Date(&'static str, [usize; 2]),
}

impl Clock {
    /// Description for messages.
    #[must_use]
    pub(crate) const fn describe(&self) -> &'static str {
        match self {
            Self::Number => "",
            Self::Nanoseconds(_) => "s, with ns in the next column",
            Self::DateTime(_) => "date and time",
            Self::TimeOfDay => "time of day",
            Self::Date(..) => "date, with the time of day in the next column",
        }
    }
}

/// Time of day, ns: `10:15:00.5`, `10:15:00,5`, `10:15`, `01:15:00 PM`. `00:01.5` is minutes and seconds.
pub(super) fn of_day(text: &str) -> Option<i64> {
    let text = text.trim();
    if !text.starts_with(|c: char| c.is_ascii_digit()) || !text.contains(':') {
        return None;
    }
    let text = text.replacen(',', ".", 1);
    let formats: &[&str] = match (text.ends_with(['M', 'm']), text.matches(':').count(), text.contains('.')) {
        (true, ..) => &["%I:%M:%S%.f %p", "%I:%M:%S %p", "%I:%M %p"],
        (false, 1, false) => &["%H:%M"],
        (false, 1, true) => return NaiveTime::parse_from_str(&format!("00:{text}"), "%H:%M:%S%.f").ok().map(ns),
        _ => &["%H:%M:%S%.f"],
    };
    formats.iter().find_map(|format| NaiveTime::parse_from_str(&text, format).ok()).map(ns)
}

fn ns(time: NaiveTime) -> i64 {
    i64::from(time.num_seconds_from_midnight()) * 1_000_000_000 + i64::from(time.nanosecond())
}

/// Start of a day, ns since 1970.
pub(super) fn date(text: &str, format: &str) -> Option<i64> {
    use chrono::Datelike as _;
    let text = text.trim();
    if !text.starts_with(|c: char| c.is_ascii_digit()) {
        return None;
    }
    let day = NaiveDate::parse_from_str(text, format).ok().filter(|day| (1950..2200).contains(&day.year()))?;
    Some((day - NaiveDate::default()).num_days() * DAY_NS)
}

/// Date and time of day in one cell, ns since 1970.
pub(super) fn date_time(text: &str, format: &str) -> Option<i64> {
    let text = text.trim();
    if text.ends_with('Z') || text.get(19..).is_some_and(|end| end.contains(['+', '-'])) {
        let with_zone = DateTime::parse_from_rfc3339(&text.replacen(' ', "T", 1)).ok();
        return with_zone.and_then(|time| time.timestamp_nanos_opt());
    }
    // a date may contain blanks, as `4 Mar 2026`: the time of day begins at the last one before the first colon
    let colon = text.find(':')?;
    let between = text[..colon].rfind(['T', ' '])?;
    Some(date(text[..between].trim_end_matches(','), format)? + of_day(&text[between + 1..])?)
}

/// Whether a cell contains a time or a date.
pub(super) fn is_time(cell: &str) -> bool {
    let cell = cell.trim();
    // a plain number does not count: 20260304 is a date only if a date is expected
    cell.starts_with(|c: char| c.is_ascii_digit())
        && cell.len() > 4
        && (of_day(cell).is_some()
            || DATES[..13].iter().any(|format| date(cell, format).or_else(|| date_time(cell, format)).is_some()))
}

/// The format in which all cells can be read; of several, the one with the shortest span.
pub(super) fn format_of(cells: &[&str], read: impl Fn(&str, &str) -> Option<i64>) -> Option<&'static str> {
    let span = |format: &'static str| {
        let times = cells.iter().map(|cell| read(cell, format)).collect::<Option<Vec<i64>>>()?;
        Some((times.iter().max()?.saturating_sub(*times.iter().min()?), format))
    };
    DATES.iter().filter_map(|format| span(format)).min_by_key(|(span, _)| *span).map(|(_, format)| format)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::panic)]
mod tests {
    use super::*;

    #[test]
    fn times_in_words() {
        let at = |text: &str| {
            let format = format_of(&[text], date_time).unwrap_or_else(|| panic!("{text}"));
            date_time(text, format).unwrap()
        };
        let wanted = 1_772_619_300_250_000_000;
        for text in [
            "2026-03-04 10:15:00.250",
            "2026-03-04T10:15:00.250Z",
            "2026-03-04T11:15:00.250+01:00",
            "2026/03/04 10:15:00,250",
            "04.03.2026 10:15:00.250",
            "3/4/2026 10:15:00.250 AM",
            "04.03.26 10:15:00.25",
            "4 Mar 2026 10:15:00.25",
        ] {
            assert_eq!(at(text), wanted, "{text}");
            assert!(is_time(text), "{text}");
        }
        assert_eq!(of_day("00:01.5"), Some(1_500_000_000));
        assert_eq!(of_day("01:00:00 PM"), Some(13 * 3_600_000_000_000));
        for text in ["OVER", "0.5", "12", "1:2:3:4", "99:00:00", "20260304", "INSERT", "-", ""] {
            assert!(!is_time(text), "{text}");
        }
    }

    #[test]
    fn of_two_ways_to_read_a_date_the_closer_one() {
        let cells = ["04/03/2026 23:59:59", "05/03/2026 00:00:01"];
        assert_eq!(format_of(&cells, date_time), Some("%d/%m/%Y"));
    }
}
