//! Times in a table as text: dates, times of day, whole seconds with nanoseconds in another column.

use chrono::{DateTime, NaiveDate, NaiveTime, Timelike as _, Weekday};

/// Date formats. If two fit, the one with the smaller span of times is used.
const DATES: [&str; 16] = [
    "%Y-%m-%d",
    "%Y/%m/%d",
    "%Y.%m.%d",
    "%d.%m.%Y",
    "%m/%d/%Y",
    "%d/%m/%Y",
    "%d-%m-%Y",
    "%d-%B-%Y",
    "%d %B %Y",
    "%B %d %Y",
    "%B %d, %Y",
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

/// Time of day, ns: `10:15:00.5`, `10:15:00,5`, `10:15:00:500`, `10:15`, `01:15:00 PM`, `01:15:00 p.m.`. `00:01.5` is minutes and seconds.
/// A span of pandas may have days before it: `0 days 00:00:01.5`. With a comma the parts may be between points: `10.15.00,5`.
pub(super) fn of_day(text: &str) -> Option<i64> {
    let text = text.trim().trim_matches(['[', ']']);
    if !text.contains(':') && text.contains(',') {
        return of_day(&with_colons(text)?);
    }
    if let Some((days, rest)) = text.split_once(" days ") {
        return Some(days.parse::<u16>().map(i64::from).ok()? * DAY_NS + of_day(rest)?);
    }
    if !text.starts_with(|c: char| c.is_ascii_digit()) || !text.contains(':') {
        return None;
    }
    let (clock, mark) = text.split_at(text.find(char::is_alphabetic).unwrap_or(text.len()));
    let clock = clock.trim_end().replacen(',', ".", 1);
    if !mark.is_empty() {
        let mark: String = mark.chars().filter(|c| c.is_alphabetic()).collect();
        let text = format!("{clock} {mark}");
        let formats = ["%I:%M:%S%.f %p", "%I:%M %p"];
        return formats.iter().find_map(|format| NaiveTime::parse_from_str(&text, format).ok()).map(ns);
    }
    let parse = |text: &str, format: &str| NaiveTime::parse_from_str(text, format).ok().map(ns);
    match (clock.matches(':').count(), clock.contains('.')) {
        (1, false) => parse(&clock, "%H:%M"),
        (1, true) => parse(&format!("00:{clock}"), "%H:%M:%S%.f"),
        (3, false) => {
            let (whole, rest) = clock.rsplit_once(':').filter(|(_, rest)| [3, 6].contains(&rest.len()))?;
            parse(&format!("{whole}.{rest}"), "%H:%M:%S%.f")
        }
        _ => parse(&clock, "%H:%M:%S%.f"),
    }
}

/// A time of day between points with colons: `10.15.00,5`, as in Finland.
fn with_colons(text: &str) -> Option<String> {
    let (clock, fraction) = text.split_once(',').unwrap_or((text, "0"));
    let parts: Vec<&str> = clock.split('.').collect();
    let is_part = |part: &&str| (1..=2).contains(&part.len()) && part.bytes().all(|b| b.is_ascii_digit());
    let whole = parts.len() == 3 && parts.iter().all(is_part) && fraction.bytes().all(|b| b.is_ascii_digit());
    whole.then(|| format!("{}.{fraction}", parts.join(":")))
}

fn ns(time: NaiveTime) -> i64 {
    i64::from(time.num_seconds_from_midnight()) * 1_000_000_000 + i64::from(time.nanosecond())
}

/// Start of a day, ns since 1970. Workbooks and pandas write a midnight behind it.
pub(super) fn date(text: &str, format: &str) -> Option<i64> {
    use chrono::Datelike as _;
    let text = text.trim();
    let text = text.strip_suffix("00:00:00").map_or(text, |day| day.trim_end_matches(['T', ' ']));
    if !text.starts_with(|c: char| c.is_ascii_alphanumeric()) {
        return None;
    }
    let day = NaiveDate::parse_from_str(text, format).ok().filter(|day| (1950..2200).contains(&day.year()))?;
    Some((day - NaiveDate::default()).num_days() * DAY_NS)
}

/// The basic format of ISO 8601, ns since 1970: `20260304T101500.25`, `20260304_101500`, `20260304 101500Z`.
fn basic(text: &str) -> Option<i64> {
    let (day, rest) = (text.get(..8)?, text.get(8..)?.strip_prefix(['T', '_', ' ', '-'])?);
    let is_number = |text: &str| text.bytes().all(|b| b.is_ascii_digit());
    let (time, zone) = rest.split_at(rest.find(['Z', '+', '-']).unwrap_or(rest.len()));
    if !is_number(day) || !time.get(..6).is_some_and(is_number) {
        return None;
    }
    let time = NaiveTime::parse_from_str(&time.replacen(',', ".", 1), "%H%M%S%.f").ok()?;
    let zone = if zone.is_empty() { "Z" } else { zone };
    let text = format!("{day}T{time}{zone}");
    DateTime::parse_from_str(&text, "%Y%m%dT%H:%M:%S%.f%#z").ok()?.timestamp_nanos_opt()
}

/// Date and time of day in one cell, ns since 1970.
pub(super) fn date_time(text: &str, format: &str) -> Option<i64> {
    let text = text.trim().trim_matches(['[', ']']);
    if let Some(time) = basic(text) {
        return (format == "%Y%m%d").then_some(time);
    }
    let text = without_names(text);
    if let Some((day, clock)) = text.rsplit_once(' ').filter(|_| !text.contains(':')) {
        return Some(date(day, format)? + of_day(&with_colons(clock)?)?);
    }
    if text.ends_with('Z') || text.get(19..).is_some_and(|end| end.contains(['+', '-'])) {
        let text = text.replacen(' ', "T", 1);
        return DateTime::parse_from_str(&text, "%Y-%m-%dT%H:%M:%S%.f%#z").ok()?.timestamp_nanos_opt();
    }
    // a date may contain blanks, as `4 Mar 2026`: the time of day begins at the last one before the first colon
    let colon = text.find(':')?;
    let between = text[..colon].rfind(['T', ' ']).or_else(|| text[..colon].rfind('-'))?;
    let (day, clock) = (text[..between].trim_end_matches([',', ' ', '-']), &text[between + 1..]);
    // the year may come last: `Mar  4 10:15:00 2026`
    let is_year = |text: &str| text.len() == 4 && text.bytes().all(|b| b.is_ascii_digit());
    match clock.rsplit_once(' ').filter(|(_, year)| is_year(year)) {
        Some((clock, year)) => Some(date(&format!("{day} {year}"), format)? + of_day(clock)?),
        None => Some(date(day, format)? + of_day(clock)?),
    }
}

/// A date and time without the name of the day before it and that of the time zone behind it: all rows have one zone.
fn without_names(text: &str) -> &str {
    let is_day = |word: &str| word.trim_end_matches(',').parse::<Weekday>().is_ok();
    let text = text.split_once(' ').filter(|(word, _)| is_day(word)).map_or(text, |(_, rest)| rest.trim_start());
    let is_zone = |word: &str| {
        let half_of_day = ["am", "pm"].iter().any(|half| word.eq_ignore_ascii_case(half));
        !half_of_day && word.len() > 1 && word.bytes().all(|b| b.is_ascii_alphabetic() || b == b'/' || b == b'_')
    };
    text.rsplit_once(' ').filter(|(_, word)| is_zone(word)).map_or(text, |(rest, _)| rest)
}

/// Whether a cell contains a time or a date.
pub(super) fn is_time(cell: &str) -> bool {
    let cell = cell.trim();
    // a plain number does not count: 20260304 is a date only if a date is expected
    cell.contains(|c: char| c.is_ascii_digit())
        && cell.len() > 4
        && (of_day(cell).is_some()
            || basic(cell).is_some()
            || DATES[..15].iter().any(|format| date(cell, format).or_else(|| date_time(cell, format)).is_some()))
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
            "20260304T101500.25",
            "20260304_101500.250",
            "20260304 111500,25+0100",
            "20260304T101500.25Z",
            "2026-03-04T12:15:00.25+0200",
            "2026-03-04 10:15:00.25 UTC",
            "2026-03-04 10:15:00:250",
            "3/4/2026 10:15:00.250 a.m.",
            "2026-03-04-10:15:00.25",
            "04.03.2026 - 10:15:00.25",
            "[2026-03-04 10:15:00.25]",
            "Mar 4 2026 10:15:00.25",
            "March 4, 2026 10:15:00.25",
            "Wed Mar  4 10:15:00.25 2026",
            "Wed, 04 Mar 2026 10:15:00.25 GMT",
            "2026-03-04 10:15:00.25 Europe/Berlin",
            "4.3.2026 10.15.00,25",
        ] {
            assert_eq!(at(text), wanted, "{text}");
            assert!(is_time(text), "{text}");
        }
        for text in ["00:01.5", "0 days 00:00:01.500000", "[00:00:01.5]", "0:00:01.5", "0.00.01,5"] {
            assert_eq!(of_day(text), Some(1_500_000_000), "{text}");
        }
        for text in ["01:00:00 PM", "1:00 p. m.", "01:00:00pm"] {
            assert_eq!(of_day(text), Some(13 * 3_600_000_000_000), "{text}");
        }
        for text in [
            "OVER",
            "0.5",
            "12",
            "1:2:3:4",
            "99:00:00",
            "20260304",
            "INSERT",
            "-",
            "",
            "Gel 3: 10:15",
            "May 4",
            "1.005.000,5",
            "10.15.00",
            "1.2,3",
        ] {
            assert!(!is_time(text), "{text}");
        }
    }

    #[test]
    fn a_day_may_end_with_midnight() {
        let day = date("2026-03-04", "%Y-%m-%d");
        assert!(day.is_some());
        for text in ["2026-03-04 00:00:00", "2026-03-04T00:00:00"] {
            assert_eq!(date(text, "%Y-%m-%d"), day);
            assert_eq!(date_time(text, "%Y-%m-%d"), day);
        }
        assert_eq!(date("00:00:00", "%Y-%m-%d"), None);
    }

    #[test]
    fn of_two_ways_to_read_a_date_the_closer_one() {
        let cells = ["04/03/2026 23:59:59", "05/03/2026 00:00:01"];
        assert_eq!(format_of(&cells, date_time), Some("%d/%m/%Y"));
    }
}
