//! Whether the wall clock follows a reference: stamps of several machines are compared with each other.

use super::outside::answer;
use super::row::Row;

/// Bit of the kernel's clock status (`man adjtimex`, STA_UNSYNC): nothing keeps the clock in time.
const UNSYNCHRONISED: u32 = 0x40;

/// `several`: whether messages of other machines are read.
pub(super) fn rows(several: bool) -> Vec<Row> {
    const NAME: &str = "wall clock";
    const ADVICE: &str = "Start chrony or systemd-timesyncd on every machine: stamps of several machines are compared.";
    let row = match (synchronised(), several) {
        (Some(true), _) => Row::ok(NAME, "synchronised"),
        (Some(false), true) => Row::problem(NAME, "not synchronised", ADVICE),
        (None, true) => Row::note(NAME, "the system does not tell whether it is synchronised", ADVICE),
        (Some(false), false) => Row::ok(NAME, "not synchronised; messages of this machine alone are read"),
        (None, false) => Row::ok(
            NAME,
            "the system does not tell whether it is synchronised; messages of this machine alone are read",
        ),
    };
    vec![row]
}

/// The kernel's own status, as systemd or adjtimex tell it. The call itself would need unsafe code.
fn synchronised() -> Option<bool> {
    match answer("timedatectl", &["show", "--property=NTPSynchronized", "--value"]).as_deref() {
        Some("yes") => return Some(true),
        Some("no") => return Some(false),
        _ => {}
    }
    status(&answer("adjtimex", &["--print"])?).map(|bits| bits & UNSYNCHRONISED == 0)
}

fn status(text: &str) -> Option<u32> {
    text.lines().find_map(|line| line.trim().strip_prefix("status:")?.trim().parse().ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_status_is_a_line_of_its_own() {
        assert_eq!(status("         mode: 0\n       status: 8257\n"), Some(8257));
        assert_eq!(status("nothing"), None);
    }
}
