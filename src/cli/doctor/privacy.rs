//! Takes out of a text what names a person or a machine: user, folders, host, hardware and network addresses.

use std::fs;
use std::net::{Ipv4Addr, Ipv6Addr};
use std::path::Path;

/// Addresses that every machine has, and that say nothing of one: the loopback, all addresses, and the group of DDS.
const COMMON: [Ipv4Addr; 3] = [Ipv4Addr::LOCALHOST, Ipv4Addr::UNSPECIFIED, Ipv4Addr::new(239, 255, 0, 1)];

/// What is to be taken out.
#[derive(Debug, Default)]
pub(super) struct Mask {
    /// Words of this machine, with what stands for each.
    words: Vec<(String, &'static str)>,
    /// Folders, longest first.
    folders: Vec<(String, &'static str)>,
}

impl Mask {
    /// The names of this user and this machine.
    pub(super) fn of_this_machine() -> Self {
        let variable = |name: &str| std::env::var(name).ok();
        let id = rustix::process::getuid().as_raw().to_string();
        let accounts = fs::read_to_string("/etc/passwd").unwrap_or_default();
        let account =
            accounts.lines().map(|line| line.split(':').collect::<Vec<_>>()).find(|f| f.get(2) == Some(&&*id));
        let field = |at: usize| account.as_ref().and_then(|fields| fields.get(at)).map(|text| (*text).to_owned());
        // the fourth is the person's full name, with commas before room and telephone
        let person = field(4).map(|text| text.split(',').next().unwrap_or_default().to_owned());
        let users = [variable("USER"), variable("LOGNAME"), variable("SUDO_USER"), field(0), person];
        let host = rustix::system::uname().nodename().to_string_lossy().into_owned();
        let short = host.split('.').next().map(ToOwned::to_owned);
        let hosts = [variable("HOSTNAME"), short, Some(host)];
        // a folder of work may be named after a patient
        let here = std::env::current_dir().ok().map(|path| path.to_string_lossy().into_owned());
        let used = [here, variable("PWD"), variable("ROS_LOG_DIR"), variable("ROS_HOME")];
        Self::new(
            users.into_iter().flatten(),
            hosts.into_iter().flatten(),
            [variable("HOME"), field(5)].into_iter().flatten(),
            used.into_iter().flatten(),
        )
    }

    fn new(
        users: impl Iterator<Item = String>,
        hosts: impl Iterator<Item = String>,
        homes: impl Iterator<Item = String>,
        used: impl Iterator<Item = String>,
    ) -> Self {
        let mut words: Vec<_> = hosts.filter(|host| host != "localhost").map(|host| (host, "<host>")).collect();
        words.extend(users.map(|user| (user, "<user>")));
        words.retain(|(word, _)| !word.is_empty());
        words.sort_by_key(|(word, _)| std::cmp::Reverse(word.len()));
        let mut folders: Vec<_> = homes.filter(|home| home.len() > 1).map(|home| (home, "~")).collect();
        // below the home folder the rest of the way tells where it is
        let elsewhere =
            |folder: &String| folder.len() > 1 && !folders.iter().any(|(home, _)| Path::new(folder).starts_with(home));
        let used: Vec<_> = used.filter(elsewhere).map(|folder| (folder, "<folder>")).collect();
        folders.extend(used);
        folders.sort_by_key(|(folder, _)| std::cmp::Reverse(folder.len()));
        Self { words, folders }
    }

    /// The text without them.
    pub(super) fn apply(&self, text: &str) -> String {
        let mut text = text.to_owned();
        for (folder, stand_in) in &self.folders {
            text = replace(&text, folder, stand_in, |c| c != '/' && is_of_word(c));
        }
        for (word, stand_in) in &self.words {
            text = replace(&text, word, stand_in, is_of_word);
        }
        addresses(&text)
    }
}

fn is_of_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// Every `word` that is not a part of a longer one.
fn replace(text: &str, word: &str, stand_in: &str, goes_on: impl Fn(char) -> bool) -> String {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(at) = rest.find(word) {
        let (before, after) = (&rest[..at], &rest[at + word.len()..]);
        out.push_str(before);
        let part = out.chars().next_back().is_some_and(&goes_on) || after.chars().next().is_some_and(&goes_on);
        out.push_str(if part { word } else { stand_in });
        rest = after;
    }
    out + rest
}

/// Without network and hardware addresses: words of digits, dots and colons that are one.
fn addresses(text: &str) -> String {
    let is_of_address = |c: char| c.is_ascii_alphanumeric() || c == '.' || c == ':' || c == '_' || c == '-';
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(start) = rest.find(is_of_address) {
        let end = rest[start..].find(|c| !is_of_address(c)).map_or(rest.len(), |length| start + length);
        out.push_str(&rest[..start]);
        out.push_str(&address(&rest[start..end]));
        rest = &rest[end..];
    }
    out + rest
}

/// A word, or what stands for it: a full stop behind it is none of it, a port is.
fn address(word: &str) -> String {
    let bare = word.trim_end_matches(['.', ':']);
    let tail = &word[bare.len()..];
    let host = bare.rsplit_once(':').filter(|(_, port)| port.parse::<u16>().is_ok()).map(|(host, _)| host);
    let four = |text: &str| text.parse::<Ipv4Addr>().is_ok_and(|address| !COMMON.contains(&address));
    let six = bare.parse::<Ipv6Addr>().is_ok_and(|address| !address.is_loopback() && !address.is_unspecified());
    let pairs: Vec<&str> = bare.split([':', '-']).collect();
    let hardware = pairs.len() >= 6 && pairs.iter().all(|p| p.len() == 2 && p.chars().all(|c| c.is_ascii_hexdigit()));
    if four(bare) || host.is_some_and(four) || six || hardware { format!("<address>{tail}") } else { word.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn masked(text: &str) -> String {
        let own = |words: &[&str]| words.iter().map(|word| (*word).to_owned()).collect::<Vec<_>>().into_iter();
        let used = own(&["/data/patient_7", "/home/ada/runs", "/"]);
        let hosts = own(&["lab-7", "lab-7.example.org", "localhost"]);
        Mask::new(own(&["ada", "Ada Byron"]), hosts, own(&["/home/ada"]), used).apply(text)
    }

    #[test]
    fn names_of_the_user_and_the_machine_go() {
        assert_eq!(masked("/home/ada/runs, by Ada Byron on lab-7.example.org"), "~/runs, by <user> on <host>");
        assert_eq!(
            masked("/var/ada/x lab-7:4711 adaptive /home/adam"),
            "/var/<user>/x <host>:4711 adaptive /home/adam"
        );
        assert_eq!(masked("localhost"), "localhost");
    }

    #[test]
    fn folders_in_use_go() {
        assert_eq!(masked("in /data/patient_7/log, / and ~"), "in <folder>/log, / and ~");
        assert_eq!(masked("/data/patient_77"), "/data/patient_77");
        assert_eq!(masked("/home/ada/runs/1"), "~/runs/1");
    }

    #[test]
    fn addresses_go() {
        assert_eq!(
            masked("at 192.168.1.7, 10.0.0.1:7400. or fe80::1a2b:3c4d"),
            "at <address>, <address>. or <address>"
        );
        assert_eq!(masked("52:54:00:12:34:56 2001:db8::8"), "<address> <address>");
    }

    #[test]
    fn what_only_looks_like_one_stays() {
        for text in [
            "127.0.0.1:8080 and 239.255.0.1",
            "6.1.0-18-amd64, glibc 2.36, rustc 1.95.0",
            "rmw_dds_common::msg::dds_::X_",
            "11:45:07, -r measured_js:=/a",
        ] {
            assert_eq!(masked(text), text);
        }
    }
}
